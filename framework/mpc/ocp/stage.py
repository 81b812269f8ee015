"""The symbols of one stage of the problem, cut into named pieces."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np

from ...numerics.symbolic import ca
from ...region import Auxiliary, Constraint
from ...robot import Robot
from ...values.motion import Pose
from .bodies import Body, repeated
from .problem import Slots

State: TypeAlias = Callable[[Pose, Any, Any, Any], Constraint]
"""(pose of a body, parameters, level, auxiliary) -> constraint."""


class ReferenceSymbols:
    """Where the robot should be: position, direction, speed, and what a cost has of the path.

    Parameters
    ----------
    dimension : D.
    curve : C, numbers of the path.
    """

    def __init__(self, dimension: int, curve: int) -> None:
        self.position: Any = ca.SX.sym("reference", dimension)
        self.direction: Any = ca.SX.sym("direction", dimension)
        self.speed: Any = ca.SX.sym("speed")
        self.curve: Any = ca.SX.sym("curve", curve)
        self.vector: Any = ca.vertcat(self.position, self.direction, self.speed, self.curve)


@dataclass(frozen=True, eq=False)
class Frame:
    """Symbols of one stage in which constraints are stated.

    Attributes
    ----------
    robot : whose states x are.
    x : (n,).
    pose : of the robot at x.
    s : the level of all slots where it is shared, else empty.
    """

    robot: Robot
    x: Any
    pose: Pose
    s: Any


def slots_of(
    name: str,
    count: int,
    width: int,
    own: Auxiliary,
    bodies: Sequence[Body],
    state: State,
    frame: Frame,
    *,
    levelled: bool,
) -> Slots:
    """Make slots that keep every body of the robot out of every thing of one kind.

    An inactive slot states 1 >= 0, and its equalities hold the auxiliaries at a value of no
    meaning: rows that vanish would leave the Jacobian without full rank, with which fatrop does
    not converge.

    Parameters
    ----------
    name : of one thing, see `Slots`.
    count : slots.
    width : parameters of each.
    own : extra variables per slot and body.
    bodies : of the robot.
    state : states one constraint.
    frame : symbols of x, the pose there, and s.
    levelled : whether each slot has a level among its numbers.
    """
    x, pose, s = frame.x, frame.pose, frame.s
    rest = _inner(own)
    extra = repeated(own, len(bodies))
    numbers, lifted = ca.SX.sym("numbers", width), ca.SX.sym("auxiliary", len(extra))
    given = ca.SX.sym("level", int(levelled))
    on, guess = ca.SX.sym("active"), ca.SX.sym("guess", len(extra))
    level = s if s.numel() or not levelled else given
    inequalities, equalities = [], []
    for i, body in enumerate(bodies):
        mine = lifted[i * len(own) : (i + 1) * len(own)]
        parts = state(body.at(pose), numbers, level, mine)
        inequalities += [on * value + (1 - on) for value in parts.inequalities]
        for k, value in enumerate(parts.equalities):
            held = mine[k] - rest[k] if k < len(own) else 0.0
            equalities.append(on * value + (1 - on) * held)
    constraint = ca.Function(
        "constraint",
        [x, lifted, s, ca.vertcat(numbers, given, on, guess)],
        [ca.vertcat(*inequalities), ca.vertcat(*equalities)],
    )
    return Slots(name, count, width, levelled, extra, constraint)


def _inner(auxiliary: Auxiliary) -> list[float]:
    """Values away from the bounds, of which an interior point method has to keep clear."""
    lower, upper = np.array(auxiliary.lower), np.array(auxiliary.upper)
    room = np.minimum(1.0, 0.5 * (upper - lower))
    return [float(value) for value in np.clip(auxiliary.start, lower + room, upper - room)]

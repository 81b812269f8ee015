"""The symbols of one stage of the problem, cut into named pieces."""

from collections.abc import Callable, Sequence
from typing import Any, TypeAlias

import numpy as np

from ..motion import Pose
from ..region import Auxiliary, Constraint
from ..symbolic import ca
from .bodies import Body, repeated

State: TypeAlias = Callable[[Pose, Any, Any, Any], Constraint]
"""(pose of a body, parameters, level, auxiliary) -> constraint."""


class ReferenceSymbols:
    """Where the robot should be: position, direction and speed.

    Parameters
    ----------
    dimension : D.
    """

    def __init__(self, dimension: int) -> None:
        self.position = ca.SX.sym("reference", dimension)
        self.direction = ca.SX.sym("direction", dimension)
        self.speed = ca.SX.sym("speed")
        self.vector = ca.vertcat(self.position, self.direction, self.speed)


class Obstructions:
    """Slots for obstacles of one kind, each with parameters, level, mask and auxiliaries.

    Parameters
    ----------
    count : slots.
    width : parameters of each.
    own : extra variables per slot and body.
    bodies : of the robot.
    state : states one constraint.
    levelled : whether each slot has a level among its parameters.
    """

    def __init__(
        self,
        count: int,
        width: int,
        own: Auxiliary,
        bodies: Sequence[Body],
        state: State,
        *,
        levelled: bool,
    ) -> None:
        self._state = state
        self.count, self.width, self.bodies, self._own = count, width, bodies, len(own)
        self._rest = _inner(own)
        self.extra = repeated(own, len(bodies))
        self.numbers = ca.SX.sym("numbers", width, count)
        self.level = ca.SX.sym("level", count if levelled else 0)
        self.active = ca.SX.sym("active", count)
        self.guess = ca.SX.sym("guess", len(self.extra), count)
        self.auxiliary = ca.SX.sym("auxiliary", len(self.extra), count)
        self.lifted = ca.vec(self.auxiliary)
        rows = [self.numbers, *([self.level.T] if levelled else []), self.active.T, self.guess]
        self.vector = ca.vec(ca.vertcat(*rows))

    def outside(self, pose: Pose, s: Any) -> tuple[Any, Any]:
        """Keep every body out of every slot; an inactive one states 1 >= 0.

        Its equalities hold the auxiliaries at a value of no meaning: rows that vanish would
        leave the Jacobian without full rank, with which fatrop does not converge.

        Parameters
        ----------
        pose : of the robot.
        s : the level of all slots where it is shared, else empty.
        """
        inequalities, equalities = [], []
        for slot in range(self.count):
            level = s if s.numel() or not self.level.numel() else self.level[slot]
            on = self.active[slot]
            for i, body in enumerate(self.bodies):
                own = self.auxiliary[i * self._own : (i + 1) * self._own, slot]
                parts = self._state(body.at(pose), self.numbers[:, slot], level, own)
                inequalities += [on * value + (1 - on) for value in parts.inequalities]
                for k, value in enumerate(parts.equalities):
                    held = own[k] - self._rest[k] if k < self._own else 0.0
                    equalities.append(on * value + (1 - on) * held)
        return ca.vertcat(*inequalities), ca.vertcat(*equalities)

    def regularisation(self) -> Any:
        """Pull of the auxiliaries towards their guess."""
        if not self.lifted.numel():
            return ca.SX(0)
        return self.extra.regularisation * ca.sumsqr(self.lifted - ca.vec(self.guess))


def _inner(auxiliary: Auxiliary) -> list[float]:
    """Values away from the bounds, of which an interior point method has to keep clear."""
    lower, upper = np.array(auxiliary.lower), np.array(auxiliary.upper)
    room = np.minimum(1.0, 0.5 * (upper - lower))
    return [float(value) for value in np.clip(auxiliary.start, lower + room, upper - room)]

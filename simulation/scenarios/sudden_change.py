"""A walker stops or turns all of a sudden, in the robot's way."""

from dataclasses import dataclass
from typing import Literal, TypeAlias, final

import numpy as np

from ...framework.values.arrays import Array, checked_choice, positive
from ...framework.values.path import Path
from ...metrics.episode import approach
from ..engine.agents import Bystander, ReplayAgent
from .base import PHASE, Placement, Scenario, draw_value
from .placing import draw_place

Change: TypeAlias = Literal["stop", "turn", "either"]

SPAN = (60.0, 200.0)
"""s before and after the change for which the walker is there."""
NOTICE = (2.5, 5.0)
"""s, range of t - c."""
ANGLE = (0.8, 2.2)
"""rad, range of the turn; to the left or to the right with equal chances."""
REACH = 8.0
"""m from the middle of the way to its ends."""
SHARE = (0.4, 0.7)
"""Range of the share of the way at which P lies."""
WALKER_SPEED = (0.5, 1.2)
"""m/s, range of the walker's speed."""
WALKER_RADIUS = 0.3
"""m, of the walker."""
SPACE = 0.3
"""m, between the surfaces until c."""
SPEED = 0.7
"""m/s, of the robot at time 0, and its reference speed."""


@final
@dataclass(frozen=True)
class SuddenChange(Scenario):
    """The robot drives from (-reach, 0) to (reach, 0); a walker surprises it.

    An undisturbed robot would be at the drawn place P of its way at the time t. a drawn `NOTICE`
    before t, at the time c, the walker changes:

    - stop: it has come straight along a random direction, and stands still in P from c on.
    - turn: it has come straight along a random direction, turns by the drawn angle at c, walks
      straight on, is in P at the time t, and walks away.

    Until c a forecast of constant velocity is exact and says that nothing will happen, or
    something else; from c on it has that time to learn better. Ways that would come within
    `SPACE` m of an undisturbed robot before c are drawn again.

    Parameters
    ----------
    change : "stop", "turn", or "either", with equal chances.
    robot_radius : m, of the robot that there is room for.

    Raises
    ------
    WideberthError : a range that is not ordered or out of bounds; when drawing, no such way.

    Notes
    -----
    The benchmark names sudden stops and turns without numbers; all of these are ours. A robot
    at v that brakes at a needs v / (2 a) s of notice to stand before P.
    """

    change: Change = "either"
    robot_radius: float = 0.3

    def __post_init__(self) -> None:
        checked_choice("sudden_change.change", self.change, Change)
        positive("sudden_change.robot_radius", self.robot_radius)

    def build(self, rng: np.random.Generator) -> tuple[Placement, ...]:
        """Draw the phase; the way is the same for every seed."""
        way = Path(np.array([[-REACH, 0.0], [REACH, 0.0]]))
        return (Placement("robot", way, SPEED, draw_value(rng, PHASE)),)

    def bystanders(
        self, rng: np.random.Generator, placements: tuple[Placement, ...]
    ) -> tuple[Bystander, ...]:
        """Draw the walker."""
        way = placements[0].path
        met = way.length * draw_value(rng, SHARE)
        place, time = way.at(np.array(met)), met / SPEED
        changes = time - draw_value(rng, NOTICE)
        stops = self.change == "stop" or (self.change == "either" and rng.random() < 0.5)
        speed = draw_value(rng, WALKER_SPEED)
        times = np.array([changes - SPAN[0], changes, changes + SPAN[1]])
        clock = np.arange(0.0, changes, 0.1)
        robot = way.at(SPEED * clock)

        def positions() -> Array:
            """Draw a way, (3, 2), m: before, at and after the change."""
            after = 0.0 if stops else speed
            heading = rng.uniform(-np.pi, np.pi)
            left = 1.0 if rng.random() < 0.5 else -1.0
            before = heading - left * draw_value(rng, ANGLE)
            onward, come = _unit(heading), _unit(before)
            corner = place - after * (time - changes) * onward
            away = after * SPAN[1] * onward
            return np.stack([corner - speed * SPAN[0] * come, corner, corner + away])

        def far(drawn: Array) -> bool:
            """Whether the walker leaves the robot alone until the change."""
            walker = ReplayAgent("", times, drawn, WALKER_RADIUS).at(clock)
            least = WALKER_RADIUS + self.robot_radius + SPACE
            return len(clock) < 2 or bool(approach(walker, robot).min() >= least)

        drawn = draw_place(positions, far, "the walker: allow for less notice or less space")
        return (ReplayAgent("walker", times, drawn, WALKER_RADIUS),)


def _unit(angle: float) -> Array:
    return np.array([np.cos(angle), np.sin(angle)])

"""A walker stops or turns all of a sudden, in the robot's way."""

from dataclasses import dataclass
from typing import Literal, TypeAlias, final

import numpy as np

from ...framework.values.arrays import Array, positive
from ...framework.values.path import Path
from ...metrics.episode import approach
from ..engine.agents import Bystander, ReplayAgent
from .base import Placement, Range, Scenario, checked_range, draw
from .placing import checked_choice, draw_place

Change: TypeAlias = Literal["stop", "turn", "either"]

SPAN = (60.0, 200.0)
"""s before and after the change for which the walker is there."""


@final
@dataclass(frozen=True)
class SuddenChange(Scenario):
    """The robot drives from (-reach, 0) to (reach, 0); a walker surprises it.

    An undisturbed robot would be at the drawn place P of its way at the time t. ``notice`` s
    before t, at the time c, the walker changes:

    - stop: it has come straight along a random direction, and stands still in P from c on.
    - turn: it has come straight along a random direction, turns by the drawn angle at c, walks
      straight on, is in P at the time t, and walks away.

    Until c a forecast of constant velocity is exact and says that nothing will happen, or
    something else; from c on it has ``notice`` s to learn better. Ways that would come within
    ``space`` m of an undisturbed robot before c are drawn again.

    Parameters
    ----------
    change : "stop", "turn", or "either", with equal chances.
    notice : s, range of t - c.
    angle : rad, range of the turn; to the left or to the right with equal chances.
    reach : m.
    share : range of the share of the way at which P lies.
    walker_speed : m/s, range.
    walker_radius : m.
    robot_radius : m, of the robot that there is room for.
    space : m, between the surfaces until c.
    phase : range of the phase offset, as a share of the control period, in [0, 1).
    speed : m/s, of the robot at time 0, and its reference speed.

    Raises
    ------
    WideberthError : a range that is not ordered or out of bounds; when drawing, no such way.

    Notes
    -----
    The benchmark names sudden stops and turns without numbers; all of these are ours. A robot
    at v that brakes at a needs v / (2 a) s of notice to stand before P.
    """

    change: Change = "either"
    notice: Range = (2.5, 5.0)
    angle: Range = (0.8, 2.2)
    reach: float = 8.0
    share: Range = (0.4, 0.7)
    walker_speed: Range = (0.5, 1.2)
    walker_radius: float = 0.3
    robot_radius: float = 0.3
    space: float = 0.3
    phase: Range = (0.0, 0.99)
    speed: float = 0.7

    def __post_init__(self) -> None:
        checked_choice("sudden_change.change", self.change, Change)
        for name in ("reach", "walker_radius", "robot_radius", "space", "speed"):
            positive(f"sudden_change.{name}", getattr(self, name))
        checked_range("sudden_change.angle", self.angle, 0.0, np.pi)
        checked_range("sudden_change.share", self.share, 0.0, 1.0)
        checked_range("sudden_change.walker_speed", self.walker_speed, 1e-3)
        checked_range("sudden_change.phase", self.phase, 0.0, 1.0 - 1e-9)
        soonest = self.share[0] * 2.0 * self.reach / self.speed
        checked_range("sudden_change.notice", self.notice, 0.0, soonest)

    def build(self, rng: np.random.Generator) -> tuple[Placement, ...]:
        """Draw the phase; the way is the same for every seed."""
        way = Path(np.array([[-self.reach, 0.0], [self.reach, 0.0]]))
        return (Placement("robot", way, self.speed, draw(rng, self.phase)),)

    def bystanders(
        self, rng: np.random.Generator, placements: tuple[Placement, ...]
    ) -> tuple[Bystander, ...]:
        """Draw the walker."""
        way = placements[0].path
        met = way.length * draw(rng, self.share)
        place, time = way.at(np.array(met)), met / self.speed
        changes = time - draw(rng, self.notice)
        stops = self.change == "stop" or (self.change == "either" and rng.random() < 0.5)
        speed = draw(rng, self.walker_speed)
        times = np.array([changes - SPAN[0], changes, changes + SPAN[1]])
        clock = np.arange(0.0, changes, 0.1)
        robot = way.at(self.speed * clock)

        def positions() -> Array:
            """Draw a way, (3, 2), m: before, at and after the change."""
            after = 0.0 if stops else speed
            heading = rng.uniform(-np.pi, np.pi)
            left = 1.0 if rng.random() < 0.5 else -1.0
            before = heading - left * draw(rng, self.angle)
            onward, come = _unit(heading), _unit(before)
            corner = place - after * (time - changes) * onward
            away = after * SPAN[1] * onward
            return np.stack([corner - speed * SPAN[0] * come, corner, corner + away])

        def far(drawn: Array) -> bool:
            """Whether the walker leaves the robot alone until the change."""
            walker = ReplayAgent("", times, drawn, self.walker_radius).at(clock)
            least = self.walker_radius + self.robot_radius + self.space
            return len(clock) < 2 or bool(approach(walker, robot).min() >= least)

        drawn = draw_place(positions, far, "the walker: allow for less notice or less space")
        return (ReplayAgent("walker", times, drawn, self.walker_radius),)


def _unit(angle: float) -> Array:
    return np.array([np.cos(angle), np.sin(angle)])

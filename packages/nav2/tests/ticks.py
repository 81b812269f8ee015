"""Local controllers and ticks for tests that need no recorded case."""

from dataclasses import dataclass, field

import numpy as np

from wideberth.framework.values.arrays import Array
from wideberth.framework.values.costmap import Costmap
from wideberth.framework.values.motion import Twist
from wideberth_nav2.controllers.local_controller import Answer, LocalController, Tick
from wideberth_nav2.costmap.footprint import RobotFootprint
from wideberth_nav2.goal_checker import GoalChecker

ROBOT = RobotFootprint.round_of(0.22)


def straight(length: float, start: float = 0.0) -> Array:
    """Poses along the x axis, 5 cm apart."""
    x = np.arange(start, start + length + 1e-9, 0.05)
    return np.column_stack([x, np.zeros_like(x), np.zeros_like(x)])


def tick(plan: Array, pose: tuple[float, ...] | Array = (0.0, 0.0, 0.0), **other: object) -> Tick:
    values = {
        "time": 0.0, "pose": np.array(pose), "speed": np.zeros(3), "plan": plan,
        "goal": plan[-1], "costmap": FREE, "footprint": ROBOT, "track_unknown": False,
        "checker": GoalChecker(),
    }  # fmt: skip
    return Tick(**{**values, **other})  # type: ignore[arg-type]


def free(size: int) -> Costmap:
    """A free costmap of so many cells of 5 cm to a side, about the origin."""
    return Costmap(np.zeros((size, size), np.uint8), 0.05, (-0.025 * size, -0.025 * size))


FREE = free(60)


def walls(*boxes: tuple[float, float, float, float]) -> Costmap:
    """A costmap of 3 m x 3 m about the origin with lethal boxes (x0, y0, x1, y1)."""
    cells = np.zeros((60, 60), np.uint8)
    for x0, y0, x1, y1 in boxes:
        low, high = FREE.world_to_map((x0, y0)), FREE.world_to_map((x1, y1))
        cells[max(low[1], 0) : high[1], max(low[0], 0) : high[0]] = 254
    return Costmap(cells, 0.05, (-1.5, -1.5))


@dataclass(eq=False)
class Scripted(LocalController):
    """Answers what it is told, and notes what it is asked."""

    answers: list[Answer] = field(default_factory=lambda: [Answer(Twist((0.2, 0.0), 0.1))])
    calls: list[str] = field(default_factory=list)
    ticks: list[Tick] = field(default_factory=list)

    def reset(self) -> None:
        self.calls.append("reset")

    def new_path(self, path: Array) -> None:
        self.calls.append("new_path")

    def limit_speed(self, value: float, percentage: bool) -> None:
        self.calls.append("limit_speed")

    def velocity(self, tick: Tick) -> Answer:
        self.calls.append("velocity")
        self.ticks.append(tick)
        return self.answers[min(len(self.ticks), len(self.answers)) - 1]

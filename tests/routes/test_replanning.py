"""Re-planning: after the period, at once where blocked, not near the goal."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pytest

from wideberth import Costmap, Path, Route, RoutePlanner, WideberthError
from wideberth.routes.replanning import KeptRoute, Replanning, is_blocked

FREE = Costmap(np.zeros((20, 100), dtype=int), 0.1)
START, GOAL = (1.05, 1.05), (9.05, 1.05)


@dataclass(frozen=True, eq=False)
class Counted(RoutePlanner):
    """Straight on, unless there is no way; counts how often it is asked."""

    asked: list[Any] = field(default_factory=list)
    way: list[bool] = field(default_factory=lambda: [True])

    def plan(self, costmap: Costmap, start: Any, goal: Any) -> Route:
        self.asked.append(start)
        return Route(Path([start, goal])) if self.way[0] else Route(None, "no way")


def blocked_at(x: float) -> Costmap:
    cells = np.zeros((20, 100), dtype=int)
    cells[:, int(x / 0.1)] = 254
    return Costmap(cells, 0.1)


def run(*steps: tuple[float, Costmap, tuple[float, float], tuple[float, float]],
        planner: Counted | None = None) -> tuple[list[int], KeptRoute]:  # fmt: skip
    """Return after which steps the planner had been asked how often, and the last route."""
    planner = planner or Counted()
    replanning, kept, counts = Replanning(planner, period=1.0), None, []
    for time, costmap, position, goal in steps:
        kept = replanning.update(kept, time, costmap, position, goal)
        counts.append(len(planner.asked))
    assert kept is not None
    return counts, kept


def test_a_route_is_kept_for_its_period() -> None:
    steps = [(time, FREE, START, GOAL) for time in (0.0, 0.5, 0.99, 1.0, 1.5, 2.1)]
    assert run(*steps)[0] == [1, 1, 1, 2, 2, 3]


def test_near_the_goal_time_is_no_reason() -> None:
    near = (5.2, 1.05)
    assert run((0.0, FREE, near, GOAL), (5.0, FREE, near, GOAL))[0] == [1, 1]


def test_a_blocked_path_and_a_new_goal_do_not_wait() -> None:
    assert run((0.0, FREE, START, GOAL), (0.1, blocked_at(5.0), START, GOAL))[0] == [1, 2]
    assert run((0.0, FREE, START, GOAL), (0.1, FREE, START, (9.0, 1.0)))[0] == [1, 2]


def test_what_lies_behind_the_robot_blocks_nothing() -> None:
    ahead = (6.0, 1.05)
    assert run((0.0, FREE, START, GOAL), (0.1, blocked_at(5.0), ahead, GOAL))[0] == [1, 1]
    path = Path([START, GOAL])
    assert is_blocked(path, blocked_at(5.0), START) and not is_blocked(path, FREE, START)


def test_a_clock_that_jumps_back_starts_anew() -> None:
    assert run((10.0, FREE, START, GOAL), (3.0, FREE, START, GOAL))[0] == [1, 2]


def test_a_free_route_is_kept_where_no_new_one_is_found() -> None:
    planner = Counted()
    replanning = Replanning(planner)
    first = replanning.update(None, 0.0, FREE, START, GOAL)
    planner.way[0] = False
    second = replanning.update(first, 1.2, FREE, START, GOAL)
    assert second.route.path is first.route.path and "no way" in second.route.reason
    third = replanning.update(second, 1.5, FREE, START, GOAL)
    assert third is second
    fourth = replanning.update(third, 1.6, blocked_at(5.0), START, GOAL)
    assert fourth.route.path is None and fourth.route.reason == "no way"
    fifth = replanning.update(fourth, 2.0, FREE, START, GOAL)
    assert fifth is fourth  # the next attempt waits for the period
    planner.way[0] = True
    assert replanning.update(fifth, 2.6, FREE, START, GOAL).route.path is not None


def test_bad_settings_are_refused() -> None:
    with pytest.raises(WideberthError, match=r"replanning\.period is -1"):
        Replanning(Counted(), period=-1.0)

"""Tracking a timed reference against contouring: who waits, who hurries, at what price."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import ClassVar, Self, final

import numpy as np

from ...framework import Controller
from ...framework.mpc.costs.base import Cost
from ...simulation.log.episode_log import Episode
from ...simulation.measures.summary import robot_rows, summarise
from ..drawing.strips import strips
from ..engine.closed_loop import column, condense, group, pick
from .episodes import PlacesStudy
from .grid import Axes, Pictures, Result, Row, Task, TaskOutcome, reduced
from .stopwatch import Stopwatch
from .variants import planner_of

COLUMNS = (
    "episodes", "collisions", "deadlocks", "goals_in_time", "clearance_min_m",
    "clearance_median_m", "time_ratio", "length_ratio", "below_reference", "least_content",
    "fallback_plans",
)  # fmt: skip
PANELS = {
    "clearance": "least clearance (m)",
    "time_ratio_worst": "slower robot's time\n/ free time",
    "peak_speed": "highest speed (m/s)",
    "deviation": "largest distance\nfrom path (m)",
}
"""Column of the table -> label of its panel."""


@final
@dataclass(frozen=True)
class CostComparison(PlacesStudy):
    """The same planner with each cost, on the same seeds.

    ``peak_speed`` is the highest speed of any robot in the episode, ``deviation`` the largest
    distance of any robot from its path; medians over the seeds. One task plays all costs at
    one seed, one after another, so that a machine that is slower for a while slows all; solve
    times are processor time of all solves of a call, without forecast and re-check.

    Parameters
    ----------
    planner : settings of the MPC; its cost is exchanged.
    costs : by name; solve times are over those of the first.
    """

    claim: ClassVar[str] = (
        "A robot that tracks a timed reference hurries after it when it has had to wait; does one "
        "whose progress is its own choice drive more calmly, and what does that cost?"
    )
    reference: ClassVar[str] = "schoeneberg2025trajectory,liniger2015optimization"
    printed: ClassVar[tuple[str, ...]] = (
        *("collisions", "goals_in_time", "clearance_min_m", "clearance_median_m"),
        *("time_ratio", "length_ratio", "fallback_plans", "peak_speed"),
    )

    planner: Controller
    costs: dict[str, Cost]

    def validate(self) -> None:
        """Refuse settings that make no study."""
        planner_of(self.planner)

    def axes(self) -> Axes:
        """Each scenario, for all costs."""
        return {"scenario": self.scenarios, "seed": self.seed_range}

    def controllers(self) -> Mapping[str, Controller]:
        """Return the planner with each cost."""
        planner = planner_of(self.planner)
        return {name: replace(planner, cost=cost) for name, cost in self.costs.items()}

    def measure(self, task: Task) -> TaskOutcome:
        """Play one episode with each cost."""
        rows, times = [], []
        for name, planner in self.controllers().items():
            label = {**task.settings, "planner": name, "seed": task.seed}
            watch = Stopwatch(planner_of(planner), [])
            episode = self.played(task, watch)
            rows.append({**label, **summarise(episode, self.tail), **_manner(episode)})
            median, slow = map(float, np.quantile(watch.seconds, (0.5, 0.95)))
            times.append({**label, "median_s": median, "p95_s": slow})
        return TaskOutcome(rows, times)

    def summary(self, rows: list[Row]) -> list[Row]:
        """One line per scenario and cost."""
        return [
            {
                "scenario": scenario,
                "cost": cost,
                **pick(condense(some), COLUMNS),
                "peak_speed": float(np.median(column(some, "peak_speed"))),
                "deviation": float(np.median(column(some, "deviation"))),
            }
            for (scenario, cost), some in group(rows, "scenario", "planner").items()
        ]

    def pictures(self, result: Result) -> Pictures:
        """Draw every episode, one column per scenario, and write the solve times as a table."""
        groups = group(result.rows, "scenario").items()
        columns = {scenario.replace("_", " "): rows for (scenario,), rows in groups}
        yield "cost_comparison", strips(columns, PANELS, (2.6 * len(columns), 7.2), touch=False)
        yield "solve_times.csv", solve_times(result.times)

    def quick(self) -> Self:
        """One seed of the first scenario."""
        return reduced(self, scenarios=1, seeds=1)


def solve_times(times: list[Row]) -> list[Row]:
    """One line per scenario and cost: medians over the seeds, and of the ratios to the first."""
    lines = []
    for (scenario,), some in group(times, "scenario").items():
        costs = group(some, "planner")
        base = column(next(iter(costs.values())), "median_s")
        for (cost,), own in costs.items():
            median = column(own, "median_s")
            line: Row = {"scenario": scenario, "cost": cost}
            line["median_ms"] = 1e3 * float(np.median(median))
            line["p95_ms"] = 1e3 * float(np.median(column(own, "p95_s")))
            lines.append(line | {"ratio": float(np.median(median / base))})
    return lines


def _manner(episode: Episode) -> Row:
    """How the robots drove."""
    return {
        "peak_speed": float(max(np.nanmax(np.abs(log.speeds)) for log in episode.robots)),
        "deviation": max(row["deviation"] for row in robot_rows(episode)),
    }

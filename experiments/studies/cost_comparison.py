"""Tracking a timed reference against contouring: who waits, who hurries, at what price."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import ClassVar, Self, final

import numpy as np

from ...framework.controller import Controller
from ...framework.mpc.costs.base import Cost
from ...framework.plugins.io import write_table
from ...framework.robot import Robot
from ...simulation.engine.settings import Settings
from ...simulation.log.episode_log import Episode
from ...simulation.measures.summary import robot_rows, summarise
from ...simulation.scenarios.base import Scenario
from ..engine.base import Experiment, Result, Row, Task, TaskOutcome
from ..engine.closed_loop import (
    check_settings,
    check_starts,
    column,
    condense,
    first_of,
    grid,
    group,
    inputs_of,
    pick,
    play,
    seeds_of,
)
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
class CostComparison(Experiment):
    """The same planner with each cost, on the same seeds.

    ``peak_speed`` is the highest speed of any robot in the episode, ``deviation`` the largest
    distance of any robot from its path; medians over the seeds. One task plays all costs at
    one seed, one after another, so that a machine that is slower for a while slows all; solve
    times are processor time of all solves of a call, without forecast and re-check.

    Parameters
    ----------
    scenarios : by name; each seed draws the same situation for every cost.
    robot : model of all plants.
    planner : settings of the MPC; its cost is exchanged.
    costs : by name; solve times are over those of the first.
    settings : clock, noise and end of the episodes.
    seeds : number of episodes per scenario and cost.
    first_seed : the seeds are first_seed to first_seed + seeds - 1.
    tail : 1 - content that the plans' levels are compared with.
    """

    claim: ClassVar[str] = (
        "A robot that tracks a timed reference hurries after it when it has had to wait; does one "
        "whose progress is its own choice drive more calmly, and what does that cost?"
    )
    reference: ClassVar[str] = "schoeneberg2025trajectory,liniger2015optimization"
    growing: ClassVar[tuple[str, ...]] = ("seeds",)
    captions: ClassVar[Mapping[str, str]] = {
        "cost_comparison": (
            "Every episode with each cost: a calm drive has a low peak speed and a small "
            "deviation from the path."
        ),
    }
    headline: ClassVar[tuple[str, ...]] = ("peak_speed", "deviation", "time_ratio")

    scenarios: dict[str, Scenario]
    robot: Robot
    planner: Controller
    costs: dict[str, Cost]
    settings: Settings = field(default_factory=Settings)
    seeds: int = 20
    first_seed: int = 0
    tail: float = 0.05

    def __post_init__(self) -> None:
        check_settings(self, costs=self.costs, scenarios=self.scenarios)
        planner_of(self.planner)

    def tasks(self) -> list[Task]:
        """One per scenario and seed, for all costs."""
        return grid({"scenario": self.scenarios}, seeds_of(self))

    def inputs(self) -> list[Path]:
        """Return the files that the scenarios read."""
        return inputs_of(self.scenarios.values())

    def check(self) -> None:
        """Begin an episode with every cost in every scenario."""
        planner = planner_of(self.planner)
        planners = {name: replace(planner, cost=cost) for name, cost in self.costs.items()}
        check_starts(self.scenarios, self.robot, planners, self.first_seed)

    def measure(self, task: Task) -> TaskOutcome:
        """Play one episode with each cost."""
        rows, times = [], []
        for name, cost in self.costs.items():
            label = {**task.settings, "planner": name, "seed": task.seed}
            watch = Stopwatch(replace(planner_of(self.planner), cost=cost), [])
            scenario = self.scenarios[task.settings["scenario"]]
            episode = play(scenario, self.robot, watch, self.settings, task.seed)
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

    def figures(self, result: Result, folder: Path) -> list[Path]:
        """Draw every episode, one column per scenario, and write the solve times as a table."""
        from ..drawing.plotting import paper_style, save, subplots
        from ..drawing.strips import strip, strip_legend

        groups = group(result.rows, "scenario")
        with paper_style():
            figure, panels = subplots(
                len(PANELS), len(groups), figsize=(2.6 * len(groups), 7.2), squeeze=False,
                sharex=True, sharey="row", layout="constrained",
            )  # fmt: skip
            for i, ((scenario,), rows) in enumerate(groups.items()):
                panels[0, i].set_title(scenario.replace("_", " "))
                for panel, name in zip(panels[:, i], PANELS, strict=True):
                    strip(panel, rows, name)
            for panel, text in zip(panels[:, 0], PANELS.values(), strict=True):
                panel.set_ylabel(text)
            strip_legend(figure)
            files = save(figure, folder, "cost_comparison")
        return [*files, write_table(folder / "solve_times.csv", solve_times(result.times))]

    def quick(self) -> Self:
        """One seed of the first scenario."""
        return replace(self, scenarios=first_of(self.scenarios), seeds=1)


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

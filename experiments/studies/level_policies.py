"""How much of its level should a plan hold, where and when? The level policies in closed loop."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, ClassVar, Self, final

import numpy as np

from ...framework.controller import Controller
from ...framework.mpc.levels.base import LevelPolicy, level_of
from ...framework.mpc.planner.planner import Planner
from ...framework.predictor import Predictor
from ...framework.robot import Robot
from ...framework.values.plan import Plan, Rung
from ...metrics.gaps import gaps
from ...simulation.drawing.artists import pairs
from ...simulation.drawing.logged import DrawnAgent
from ...simulation.engine.settings import Settings
from ...simulation.log.episode_log import Episode
from ...simulation.scenarios.base import Scenario
from ..drawing.trade_off_markers import front_legend, front_looks, mark, widen
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
    outcome,
    pick,
    play,
    seeds_of,
)
from .replay import STILL
from .variants import planner_of

COLUMNS = (
    "collisions", "deadlocks", "goals_in_time", "clearance_min_m", "clearance_median_m",
    "extra_time_s", "length_ratio", "fallback_plans", "coverage",
)  # fmt: skip


@final
@dataclass(frozen=True)
class LevelPolicies(Experiment):
    """The same planner with each level policy, on the same seeds.

    Beside the columns of every closed loop, ``success`` is the share of episodes in which
    all arrived without contact; ``entered`` the share of plans that enter a region,
    on the rungs `least violation` and `brake`; ``driven_below`` the share of plans, of those with
    an obstacle, whose first step, the one that is driven, holds less than the level of the
    policy's promise for the experiment's tail, or that enter a region. ``drove_into`` counts the
    episodes in which a robot touched another body while it moved: a walker may also run into one
    that stands, which no policy of the robot can prevent.

    Parameters
    ----------
    scenarios : by name; each seed draws the same situation for every policy.
    robot : model of all plants.
    planner : settings of the MPC; its level and predictor are exchanged.
    predictors, levels : by name.
    settings : clock, noise and end of the episodes.
    seeds : number of episodes per scenario, predictor and policy.
    first_seed : the seeds are first_seed to first_seed + seeds - 1.
    tail : that the driven step is held against.
    """

    claim: ClassVar[str] = (
        "The paper lets one level give way for the whole horizon; what does it cost to hold it, "
        "to let it fall over the horizon, or to hold one risk for the whole plan?"
    )
    reference: ClassVar[str] = "schoeneberg2025trajectory"
    growing: ClassVar[tuple[str, ...]] = ("seeds",)
    captions: ClassVar[Mapping[str, str]] = {
        "level_policies": (
            "Least clearance against extra time for each level policy: upper left is better, "
            "and hollow markers had failures."
        ),
    }
    headline: ClassVar[tuple[str, ...]] = ("success", "clearance_median_m", "extra_time_s")

    scenarios: dict[str, Scenario]
    robot: Robot
    planner: Controller
    predictors: dict[str, Predictor]
    levels: dict[str, LevelPolicy]
    settings: Settings = field(default_factory=Settings)
    seeds: int = 20
    first_seed: int = 0
    tail: float = 0.05

    def __post_init__(self) -> None:
        check_settings(
            self,
            scenarios=self.scenarios,
            predictors=self.predictors,
            levels=self.levels,
        )
        planner_of(self.planner)
        for predictor in self.predictors.values():
            for level in self.levels.values():
                replace(planner_of(self.planner), predictor=predictor, level=level)

    def tasks(self) -> list[Task]:
        """One per scenario, predictor, policy and seed."""
        return grid(
            {"scenario": self.scenarios, "forecast": self.predictors, "planner": self.levels},
            seeds_of(self),
        )

    def inputs(self) -> list[Path]:
        """Return the files that the scenarios read."""
        return inputs_of(self.scenarios.values())

    def check(self) -> None:
        """Begin an episode in every scenario."""
        check_starts(self.scenarios, self.robot, {"planner": self.planner}, self.first_seed)

    def measure(self, task: Task) -> TaskOutcome:
        """Play one episode."""
        scenario, forecast, level = (
            task.settings[key] for key in ("scenario", "forecast", "planner")
        )
        planner = replace(
            planner_of(self.planner),
            predictor=self.predictors[forecast],
            level=self.levels[level],
        )
        place = self.scenarios[scenario]
        episode = play(place, self.robot, planner, self.settings, task.seed)
        made = outcome(episode, task, self.tail, keep=False)
        made.rows[0].update(_held(episode, planner, self.tail))
        return made

    def summary(self, rows: list[Row]) -> list[Row]:
        """One line per scenario, forecast and policy."""
        lines = []
        for (scenario, forecast, level), some in group(
            rows, "scenario", "forecast", "planner"
        ).items():
            held = column(some, "plans_with_obstacles").sum()
            lines.append(
                {
                    **{"scenario": scenario, "forecast": forecast, "level": level},
                    "episodes": len(some),
                    "success": float(np.mean([bool(row["success"]) for row in some])),
                    "drove_into": int(column(some, "drove_into").sum()),
                    **pick(condense(some), COLUMNS),
                    "entered": float(column(some, "entered").sum() / column(some, "plans").sum()),
                    "driven_below": float(column(some, "driven_below").sum() / max(held, 1.0)),
                }
            )
        return lines

    def figures(self, result: Result, folder: Path) -> list[Path]:
        """Draw least clearance against extra time, a panel per scenario and forecast."""
        from ..drawing.plotting import paper_style, save

        with paper_style():
            return save(draw_prices(result.rows), folder, "level_policies")

    def quick(self) -> Self:
        """Play one seed to its end, in the last scenario with the first forecast."""
        name, scenario = list(self.scenarios.items())[-1]
        return replace(
            self,
            scenarios={name: scenario},
            predictors=first_of(self.predictors),
            seeds=1,
        )


def _held(episode: Episode, planner: Planner, tail: float) -> Row:
    """Count plans that enter a region, and those that hold less at the step that is driven."""
    plans = [plan for log in episode.robots for plan in log.plans]
    size = planner.robot.dimension
    full = level_of(planner.region, planner.level.promise, tail, size) - 1e-4
    met = [plan for plan in plans if plan.level.size]
    return {
        "drove_into": any(_drove_into(a, b) for a, b in pairs(episode)),
        "entered": sum(plan.rung in (Rung.LEAST, Rung.BRAKE) for plan in plans),
        "plans_with_obstacles": len(met),
        "driven_below": sum(_below(plan, full) for plan in met),
    }


def _below(plan: Plan, full: float) -> bool:
    return bool(plan.level[0].min() < full or plan.violation > 1e-4)


def _drove_into(first: DrawnAgent, second: DrawnAgent) -> bool:
    """Whether a robot of the two moved when they first touched."""
    touched = np.flatnonzero(gaps(first, second) < 0.0)
    robots = [log for log in (first, second) if log.kind == "robot"]
    return bool(touched.size) and any(log.speeds[touched[0]] >= STILL for log in robots)


def draw_prices(rows: list[Row]) -> Any:
    """Draw a marker per policy: median clearance against median extra time.

    Bars reach down to the least clearance and over the quartiles of the time. A hollow marker
    stands for a policy with contacts or without all arrivals, with their number beside it.
    """
    from ..drawing.plotting import PAGE, subplots

    panels = group(rows, "scenario", "forecast")
    scenarios = list(dict.fromkeys(scenario for scenario, _ in panels))
    forecasts = list(dict.fromkeys(forecast for _, forecast in panels))
    names = list(dict.fromkeys(str(row["planner"]) for row in rows))
    looks, drawn = front_looks(names), set()
    figure, axes = subplots(
        len(forecasts), len(scenarios), figsize=(PAGE, 0.6 + 2.1 * len(forecasts)), squeeze=False
    )  # fmt: skip
    for (scenario, forecast), some in panels.items():
        panel = axes[forecasts.index(forecast), scenarios.index(scenario)]
        panel.set_title(f"{scenario}, {forecast}".replace("_", " "))
        for (name,), own in group(some, "planner").items():
            if mark(panel, own, "extra_time_worst", looks[str(name)]) is not None:
                drawn.add(str(name))
        panel.axhline(0.0, color="black", linewidth=0.8)
        widen(panel)
        panel.set_xlabel("extra time (s)")
    for panel in axes[:, 0]:
        panel.set_ylabel("least clearance (m)")
    known = {name: look for name, look in looks.items() if name in drawn}
    counts = group(rows, "scenario", "forecast", "planner").values()
    front_legend(figure, known, map(len, counts))
    return figure

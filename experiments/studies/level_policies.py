"""How much of its level should a plan hold, where and when? The level policies in closed loop."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, ClassVar, Self, final

import numpy as np

from ...framework import Controller, Plan, Predictor
from ...framework.mpc.levels.base import LevelPolicy, level_of
from ...framework.mpc.planner.planner import Planner
from ...framework.values.plan import Rung
from ...metrics.gaps import gaps
from ...simulation.drawing.artists import pairs
from ...simulation.drawing.logged import DrawnAgent
from ...simulation.log.episode_log import Episode
from ..drawing.plotting import PAGE, subplots
from ..drawing.trade_off_markers import front_legend, front_looks, mark, nest, widen
from ..engine.closed_loop import column, condense, group, outcome, pick
from .episodes import PlacesStudy
from .grid import Axes, Pictures, Result, Row, Task, TaskOutcome, reduced
from .replay import STILL
from .variants import planner_of

COLUMNS = (
    "collisions", "deadlocks", "goals_in_time", "clearance_min_m", "clearance_median_m",
    "extra_time_s", "length_ratio", "fallback_plans", "coverage",
)  # fmt: skip


@final
@dataclass(frozen=True)
class LevelPolicies(PlacesStudy):
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
    planner : settings of the MPC; its level and predictor are exchanged.
    predictors, levels : by name.
    """

    claim: ClassVar[str] = (
        "The paper lets one level give way for the whole horizon; what does it cost to hold it, "
        "to let it fall over the horizon, or to hold one risk for the whole plan?"
    )
    reference: ClassVar[str] = "schoeneberg2025trajectory"
    printed: ClassVar[tuple[str, ...]] = (
        *("success", "collisions", "goals_in_time", "clearance_median_m"),
        *("extra_time_s", "length_ratio", "coverage", "driven_below"),
    )

    planner: Controller
    predictors: dict[str, Predictor]
    levels: dict[str, LevelPolicy]

    def validate(self) -> None:
        """Refuse settings that make no study."""
        for predictor in self.predictors:
            for level in self.levels:
                self._variant(predictor, level)

    def axes(self) -> Axes:
        """Each scenario with each predictor and policy."""
        return {
            "scenario": self.scenarios,
            "forecast": self.predictors,
            "planner": self.levels,
            "seed": self.seed_range,
        }

    def controllers(self) -> Mapping[str, Controller]:
        """Return the planner as it is given."""
        return {"planner": self.planner}

    def _variant(self, forecast: str, level: str) -> Planner:
        """Return the planner with a predictor and a policy."""
        parts = self.predictors[forecast], self.levels[level]
        return replace(planner_of(self.planner), predictor=parts[0], level=parts[1])

    def measure(self, task: Task) -> TaskOutcome:
        """Play one episode."""
        planner = self._variant(task.settings["forecast"], task.settings["planner"])
        episode = self.played(task, planner)
        return outcome(episode, task, self.tail, _held(episode, planner, self.tail))

    def summary(self, rows: list[Row]) -> list[Row]:
        """One line per scenario, forecast and policy."""
        lines = []
        for keys, some in group(rows, "scenario", "forecast", "planner").items():
            held = column(some, "plans_with_obstacles").sum()
            lines.append({
                **dict(zip(("scenario", "forecast", "level"), keys, strict=True)),
                "episodes": len(some),
                "success": float(np.mean([bool(row["success"]) for row in some])),
                "drove_into": int(column(some, "drove_into").sum()),
                **pick(condense(some), COLUMNS),
                "entered": float(column(some, "entered").sum() / column(some, "plans").sum()),
                "driven_below": float(column(some, "driven_below").sum() / max(held, 1.0)),
            })  # fmt: skip
        return lines

    def pictures(self, result: Result) -> Pictures:
        """Draw least clearance against extra time, a panel per scenario and forecast."""
        yield "level_policies", draw_prices(result.rows)

    def quick(self) -> Self:
        """Play one seed to its end, in the last scenario with the first forecast."""
        return reduced(self, scenarios=-1, predictors=1, seeds=1)


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
        nest(panel)
        panel.axhline(0.0, color="black", linewidth=0.8)
        widen(panel)
        panel.set_xlabel("extra time (s)")
    for panel in axes[:, 0]:
        panel.set_ylabel("least clearance (m)")
    known = {name: look for name, look in looks.items() if name in drawn}
    counts = group(rows, "scenario", "forecast", "planner").values()
    front_legend(figure, known, map(len, counts))
    return figure

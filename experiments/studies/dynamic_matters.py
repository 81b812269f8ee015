"""The paper's headline: treating obstacles as moving beats treating them as static."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import ClassVar, Self, final

from ...framework.controller import Controller
from ...framework.predictor import Predictor
from ...framework.robot import Robot
from ...simulation.engine.settings import Settings
from ...simulation.scenarios.base import Scenario
from ..engine.base import Experiment, Result, Row, Task, TaskOutcome
from ..engine.closed_loop import (
    check_settings,
    check_starts,
    condense,
    grid,
    group,
    inputs_of,
    outcome,
    pick,
    play,
    seeds_of,
)
from .variants import by_predictor, planner_of

COLUMNS = (
    "episodes",
    "collisions",
    "deadlocks",
    "goals_in_time",
    "clearance_min_m",
    "clearance_median_m",
    "time_ratio",
    "extra_time_s",
    "length_ratio",
    "named_forecasts",
    "coverage",
)


@final
@dataclass(frozen=True)
class DynamicMatters(Experiment):
    """The same planner with predictors from "it stays there" to the other's own plan.

    Parameters
    ----------
    scenarios : by name; each seed draws the same situation for every predictor.
    robot : model of all plants.
    planner : settings of the MPC; its predictor is exchanged.
    predictors : by name.
    settings : clock, noise and end of the episodes.
    seeds : number of episodes per scenario and predictor.
    first_seed : the seeds are first_seed to first_seed + seeds - 1.
    tail : 1 - content that levels and coverage are measured against.
    """

    claim: ClassVar[str] = (
        "Trajectory planning is significantly enhanced when obstacles are considered dynamic "
        "(section I): static against moving predictions on the same seeds."
    )
    reference: ClassVar[str] = "schoeneberg2025trajectory"
    growing: ClassVar[tuple[str, ...]] = ("seeds",)
    captions: ClassVar[Mapping[str, str]] = {
        "dynamic_matters": (
            "Clearance and time of every episode by predictor: below the line at 0 bodies touch."
        ),
    }
    headline: ClassVar[tuple[str, ...]] = ("collisions", "clearance_min_m", "time_ratio")

    scenarios: dict[str, Scenario]
    robot: Robot
    planner: Controller
    predictors: dict[str, Predictor]
    settings: Settings = field(default_factory=Settings)
    seeds: int = 20
    first_seed: int = 0
    tail: float = 0.05

    def __post_init__(self) -> None:
        check_settings(self, predictors=self.predictors, scenarios=self.scenarios)
        planner_of(self.planner)

    def tasks(self) -> list[Task]:
        """One per scenario, predictor and seed."""
        return grid({"scenario": self.scenarios, "planner": self.predictors}, seeds_of(self))

    def inputs(self) -> list[Path]:
        """Return the files that the scenarios read."""
        return inputs_of(self.scenarios.values())

    def check(self) -> None:
        """Begin an episode with every predictor in every scenario."""
        planners = by_predictor(self.planner, self.predictors)
        check_starts(self.scenarios, self.robot, planners, self.first_seed)

    def measure(self, task: Task) -> TaskOutcome:
        """Play one episode."""
        name = task.settings["planner"]
        variant = by_predictor(self.planner, {name: self.predictors[name]})[name]
        scenario = self.scenarios[task.settings["scenario"]]
        episode = play(scenario, self.robot, variant, self.settings, task.seed)
        return outcome(episode, task, self.tail, keep=False)

    def summary(self, rows: list[Row]) -> list[Row]:
        """One line per scenario and predictor."""
        return [
            {"scenario": scenario, "predictor": predictor, **pick(condense(some), COLUMNS)}
            for (scenario, predictor), some in group(rows, "scenario", "planner").items()
        ]

    def figures(self, result: Result, folder: Path) -> list[Path]:
        """Draw clearance and time of every episode by predictor, one column per scenario."""
        from ..drawing.plotting import paper_style, save, subplots
        from ..drawing.strips import strip, strip_legend

        groups = group(result.rows, "scenario")
        with paper_style():
            figure, panels = subplots(
                2, len(groups), figsize=(3.4 * len(groups), 4.4), squeeze=False, sharex=True,
                sharey="row", layout="constrained",
            )  # fmt: skip
            for i, ((scenario,), rows) in enumerate(groups.items()):
                panels[0, i].set_title(scenario.replace("_", " "))
                strip(panels[0, i], rows, "clearance")
                strip(panels[1, i], rows, "time_ratio_worst")
                panels[0, i].axhline(0.0, color="0.5", linewidth=0.6)
            strip_legend(figure, "bodies touch")
            panels[0, 0].set_ylabel("least clearance (m)")
            panels[1, 0].set_ylabel("slower robot's time\n/ free time")
            return save(figure, folder, "dynamic_matters")

    def quick(self) -> Self:
        """One seed."""
        return replace(self, seeds=1)

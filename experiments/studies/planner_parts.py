"""Predictors and regions, each with each in one planner: what the pairs do in closed loop."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, is_dataclass, replace
from pathlib import Path
from typing import Any, ClassVar, Self, final

import numpy as np

from ...framework.controller import Controller, driving
from ...framework.predictor import Predictor
from ...framework.region import Region
from ...framework.robot import Robot
from ...framework.values.errors import WideberthError
from ...simulation.engine.settings import Settings
from ...simulation.scenarios.base import Scenario
from ..drawing.plotting import PAGE, subplots
from ..drawing.shaded_tables import shaded
from ..engine.base import Experiment, Result, Row, Task, TaskOutcome
from ..engine.closed_loop import (
    check_settings,
    check_starts,
    first_of,
    grid,
    group,
    inputs_of,
    seeds_of,
)
from .comparison import ANSWERS, SOURCES, against, check_robots, condensed, measured


@final
@dataclass(frozen=True)
class PlannerParts(Experiment):
    """One planner with each predictor and each region in place of its own, on the same seeds.

    Each pair is held against the first one, seed by seed. Columns as of a `comparison`.

    Parameters
    ----------
    scenario : drawn from each seed.
    robot : model of the plant.
    planner : all that stays the same; a controller with a predictor and a region.
    predictors, regions : by name.
    settings : clock, noise and end of the episodes.
    seeds : number of episodes per pair.
    first_seed : the seeds are first_seed to first_seed + seeds - 1.
    tail : 1 - content that forecasts and regions are measured against.
    """

    claim: ClassVar[str] = (
        "Which predictor and which region does a planner need, and does one make up for the other?"
    )
    reference: ClassVar[str] = SOURCES
    growing: ClassVar[tuple[str, ...]] = ("seeds",)
    captions: ClassVar[Mapping[str, str]] = {
        "planner_parts": (
            "Success, time and nearness for every predictor (down) with every region (across): "
            "darker is better."
        ),
    }
    headline: ClassVar[tuple[str, ...]] = ("success", "time_mean_s", "collision")
    printed: ClassVar[tuple[str, ...]] = ANSWERS

    scenario: Scenario
    robot: Robot
    planner: Controller
    predictors: dict[str, Predictor]
    regions: dict[str, Region]
    settings: Settings = field(default_factory=Settings)
    seeds: int = 20
    first_seed: int = 0
    tail: float = 0.05

    def __post_init__(self) -> None:
        check_settings(self, predictors=self.predictors, regions=self.regions)
        own: Any = fields(self.planner) if is_dataclass(self.planner) else ()
        missing = sorted({"predictor", "region"} - {entry.name for entry in own if entry.init})
        if missing:
            raise WideberthError(
                f"planner is {type(self.planner).__name__}, without {' and '.join(missing)}; "
                "wanted one that takes both, such as mpc"
            )
        check_robots({"scenario": self.scenario}, {"robot": self.robot}, {"planner": self.planner})

    def pair(self, predictor: str, region: str) -> Controller:
        """Return the planner with a predictor and a region."""
        made: Any = driving(self.planner, self.robot)
        changed: Controller = replace(
            made, predictor=self.predictors[predictor], region=self.regions[region]
        )
        return changed

    def tasks(self) -> list[Task]:
        """One per predictor, region and seed."""
        seeds = seeds_of(self)
        return grid({"predictor": self.predictors, "region": self.regions}, seeds)

    def inputs(self) -> list[Path]:
        """Return the files that the scenario reads."""
        return inputs_of([self.scenario])

    def check(self) -> None:
        """Make every pair, and begin an episode with those that have a part of the first one.

        So each predictor begins with the first region, and each region with the first
        predictor: to begin with all pairs takes as long as some episodes.
        """
        pairs = {(p, r): self.pair(p, r) for p in self.predictors for r in self.regions}
        predictor, region = next(iter(pairs))
        begun = {
            f"{p} and {r}": planner
            for (p, r), planner in pairs.items()
            if p == predictor or r == region
        }
        check_starts({"": self.scenario}, self.robot, begun, self.first_seed)

    def measure(self, task: Task) -> TaskOutcome:
        """Play one episode."""
        planner = self.pair(task.settings["predictor"], task.settings["region"])
        return measured(self.scenario, self.robot, planner, self.settings, task, self.tail)

    def summary(self, rows: list[Row]) -> list[Row]:
        """One line per pair, compared with the first."""
        played = group(rows, "predictor", "region")
        first = next(iter(played.values()))
        return [
            {"predictor": predictor, "region": region, **condensed(own), **against(own, first)}
            for (predictor, region), own in played.items()
        ]

    def figures(self, result: Result, folder: Path) -> list[Path]:
        """Draw tables of success, time and nearness, predictors down and regions across."""
        from ..drawing.plotting import paper_style, save

        with paper_style():
            return save(draw_tables(self.summary(result.rows)), folder, "planner_parts")

    def quick(self) -> Self:
        """Play one seed with the first two predictors and regions."""
        predictors, regions = first_of(self.predictors, 2), first_of(self.regions, 2)
        return replace(self, predictors=predictors, regions=regions, seeds=1)


SHOWN = (
    ("success", "success", ".2f"),
    ("time_mean_s", "time to the goals (s)", ".1f"),
    ("intrusion_share", "share of time near a person", ".2f"),
)
"""Column of the summary, title and format of each table."""


def draw_tables(lines: Sequence[Row]) -> Any:
    """Draw a table for each measure; dark is better, and the number stands in its cell."""
    predictors = list(dict.fromkeys(str(line["predictor"]) for line in lines))
    regions = list(dict.fromkeys(str(line["region"]) for line in lines))
    size = PAGE, 0.5 + len(SHOWN) * (0.35 + 0.17 * len(predictors)) + 0.9
    figure, axes = subplots(len(SHOWN), 1, figsize=size, sharex=True, squeeze=False)
    for panel, (name, title, form) in zip(axes[:, 0], SHOWN, strict=True):
        found = {(line["predictor"], line["region"]): line[name] for line in lines}
        table = np.array([[_number(found[one, other]) for other in regions] for one in predictors])
        shaded(panel, table, form, better_high=name == "success")
        panel.set_title(title)
        panel.set_yticks(range(len(predictors)), [one.replace("_", " ") for one in predictors])
    names = [other.replace("_", " ") for other in regions]
    axes[-1, 0].set_xticks(range(len(regions)), names, rotation=40, ha="right")
    return figure


def _number(value: Any) -> float:
    return float("nan") if value is None else float(value)

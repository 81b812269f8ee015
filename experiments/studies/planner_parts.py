"""Predictors and regions, each with each in one planner: what the pairs do in closed loop."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any, ClassVar, Self, final

import numpy as np

from ...framework import Controller, Predictor, Region
from ...framework.controller import driving
from ..drawing.plotting import PAGE, subplots
from ..drawing.shaded_tables import shaded
from .episode_statistics import ANSWERS, SOURCES, against, condensed
from .episodes import OnePlaceStudy, check_robots, measured
from .grid import Axes, Pictures, Result, Row, Task, TaskOutcome, labelled, reduced
from .variants import exchanged


@final
@dataclass(frozen=True)
class PlannerParts(OnePlaceStudy):
    """One planner with each predictor and each region in place of its own, on the same seeds.

    Each pair is held against the first one, seed by seed. Columns as of a `comparison`.

    Parameters
    ----------
    planner : all that stays the same; a controller with a predictor and a region.
    predictors, regions : by name.
    """

    claim: ClassVar[str] = (
        "Which predictor and which region does a planner need, and does one make up for the other?"
    )
    reference: ClassVar[str] = SOURCES
    printed: ClassVar[tuple[str, ...]] = ANSWERS

    planner: Controller
    predictors: dict[str, Predictor]
    regions: dict[str, Region]

    def validate(self) -> None:
        """Refuse settings that make no study."""
        check_robots({"scenario": self.scenario}, {"robot": self.robot}, {"planner": self.planner})
        for predictor, region in product(self.predictors, self.regions):
            self.pair(predictor, region)

    def pair(self, predictor: str, region: str) -> Controller:
        """Return the planner with a predictor and a region."""
        return exchanged(
            driving(self.planner, self.robot),
            predictor=self.predictors[predictor],
            region=self.regions[region],
        )

    def axes(self) -> Axes:
        """Each predictor with each region."""
        return {"predictor": self.predictors, "region": self.regions, "seed": self.seed_range}

    def controllers(self) -> Mapping[str, Controller]:
        """Make every pair, and return those that have a part of the first one.

        So each predictor begins with the first region, and each region with the first
        predictor: to begin with all pairs takes as long as some episodes.
        """
        pairs = {(p, r): self.pair(p, r) for p in self.predictors for r in self.regions}
        predictor, region = next(iter(pairs))
        return {
            f"{p} and {r}": planner
            for (p, r), planner in pairs.items()
            if p == predictor or r == region
        }

    def measure(self, task: Task) -> TaskOutcome:
        """Play one episode."""
        planner = self.pair(task.settings["predictor"], task.settings["region"])
        return measured(self.scenario, self.robot, planner, self.settings, task, self.tail)

    def summary(self, rows: list[Row]) -> list[Row]:
        """One line per pair, compared with the first."""
        played = labelled(rows, "predictor", "region")
        return [
            {**labels, **condensed(own), **against(own, played[0][1])} for labels, own in played
        ]

    def pictures(self, result: Result) -> Pictures:
        """Draw tables of success, time and nearness, predictors down and regions across."""
        yield "planner_parts", draw_tables(self.summary(result.rows))

    def quick(self) -> Self:
        """Play one seed with the first two predictors and regions."""
        return reduced(self, predictors=2, regions=2, seeds=1)


SHOWN = (
    ("success", "success", ".2f"),
    ("time_mean_s", "time to the goals (s)", ".1f"),
    ("intrusion_share", "share of time near a person", ".2f"),
)
"""Column of the summary, title and format of each table."""


def draw_tables(lines: Sequence[Row]) -> Any:
    """Draw a table for each measure; dark is better, and the number stands in its cell."""
    counts = sorted({int(line["episodes"]) for line in lines})
    words = " to ".join(str(count) for count in dict.fromkeys((counts[0], counts[-1])))
    predictors = list(dict.fromkeys(str(line["predictor"]) for line in lines))
    regions = list(dict.fromkeys(str(line["region"]) for line in lines))
    size = PAGE, 0.5 + len(SHOWN) * (0.35 + 0.17 * len(predictors)) + 0.9
    figure, axes = subplots(len(SHOWN), 1, figsize=size, sharex=True, squeeze=False)
    for panel, (name, title, form) in zip(axes[:, 0], SHOWN, strict=True):
        found = {(line["predictor"], line["region"]): line[name] for line in lines}
        table = np.array([[_number(found[one, other]) for other in regions] for one in predictors])
        shaded(panel, table, form, better_high=name == "success")
        panel.set_title(f"{title}, n = {words} per cell")
        panel.set_ylabel("predictor")
        panel.set_yticks(range(len(predictors)), [one.replace("_", " ") for one in predictors])
    names = [other.replace("_", " ") for other in regions]
    axes[-1, 0].set_xticks(range(len(regions)), names, rotation=40, ha="right")
    axes[-1, 0].set_xlabel("region")
    return figure


def _number(value: Any) -> float:
    return float("nan") if value is None else float(value)

"""Time and path that each region and covariance costs in closed loop, and the share it keeps."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import ClassVar, Self, final

import numpy as np

from ...framework.controller import Controller
from ...framework.predictor import Predictor
from ...framework.region import Region
from ...framework.robot import Robot
from ...framework.values.arrays import Array
from ...framework.values.errors import WideberthError
from ...metrics.statistics import known_mean
from ...simulation.engine.settings import Settings
from ...simulation.log.episode_log import AgentLog, Episode
from ...simulation.scenarios.base import Scenario
from ..engine.base import Experiment, Result, Row, Task, TaskOutcome
from ..engine.closed_loop import (
    check_settings,
    check_starts,
    column,
    condense,
    first_of,
    group,
    inputs_of,
    outcome,
    pick,
    play,
    seeds_of,
)
from .variants import by_region_and_predictor, planner_of

ORACLE = "oracle"
"""Name of the predictor that the others are compared with."""

COLUMNS = (
    "episodes",
    "collisions",
    "deadlocks",
    "clearance_min_m",
    "clearance_median_m",
    "below_reference",
    "least_content",
    "coverage",
)


@final
@dataclass(frozen=True)
class Conservativeness(Experiment):
    """Every pair of region and covariance rule, on the same seeds.

    ``extra_time`` and ``extra_path`` of an episode are the slower robot's time and the
    longer path, relative to the same seed under the oracle (the same region, the other's
    own plan as forecast). ``promised`` is the mean content that the plans' levels stand
    for; ``kept`` is the share of planned positions (all plans, steps 1..N up to the end of
    the episode) from which the other robot, where it then truly was, is at least r + r_d
    away. A region is conservative where kept exceeds promised.

    Parameters
    ----------
    scenarios, robot, planner, settings, seeds, first_seed, tail : as in `dynamic_matters`.
    regions : by name.
    predictors : covariance rules by name; one of them is named ``oracle``.
    """

    claim: ClassVar[str] = (
        "The ellipse is the more accurate representation of the underlying distribution and "
        "less conservative (section III): what each region and covariance costs and keeps."
    )
    reference: ClassVar[str] = "schoeneberg2025trajectory"
    growing: ClassVar[tuple[str, ...]] = ("seeds",)
    captions: ClassVar[Mapping[str, str]] = {
        "conservativeness": (
            "What a region and a covariance keep against what they cost: upper left keeps more "
            "for less."
        ),
    }
    headline: ClassVar[tuple[str, ...]] = ("kept", "extra_time", "collisions")

    scenarios: dict[str, Scenario]
    robot: Robot
    planner: Controller
    regions: dict[str, Region]
    predictors: dict[str, Predictor]
    settings: Settings = field(default_factory=Settings)
    seeds: int = 10
    first_seed: int = 0
    tail: float = 0.05

    def __post_init__(self) -> None:
        check_settings(self, regions=self.regions, scenarios=self.scenarios)
        planner_of(self.planner)
        if ORACLE not in self.predictors:
            raise WideberthError(
                f"predictors are {sorted(self.predictors)}; one must be named {ORACLE!r}: the "
                "extra time and path of the others are relative to it"
            )

    def tasks(self) -> list[Task]:
        """One per scenario, region, covariance rule and seed."""
        return [
            Task(
                f"{scenario} {region} {rule} {seed}",
                seed,
                {
                    "scenario": scenario,
                    "planner": f"{region} {rule}",
                    "region": region,
                    "covariance": rule,
                },
            )
            for scenario in self.scenarios
            for region in self.regions
            for rule in self.predictors
            for seed in seeds_of(self)
        ]

    def inputs(self) -> list[Path]:
        """Return the files that the scenarios read."""
        return inputs_of(self.scenarios.values())

    def check(self) -> None:
        """Begin an episode with every region and covariance rule in every scenario."""
        variants = by_region_and_predictor(self.planner, self.regions, self.predictors)
        planners = {" ".join(key): planner for key, planner in variants.items()}
        check_starts(self.scenarios, self.robot, planners, self.first_seed)

    def measure(self, task: Task) -> TaskOutcome:
        """Play one episode and count what its plans kept."""
        region, rule = task.settings["region"], task.settings["covariance"]
        variants = by_region_and_predictor(
            self.planner, {region: self.regions[region]}, {rule: self.predictors[rule]}
        )
        scenario = self.scenarios[task.settings["scenario"]]
        episode = play(scenario, self.robot, variants[region, rule], self.settings, task.seed)
        result = outcome(episode, task, self.tail, keep=False)
        row = {**result.rows[0], "promised": promised(episode), "kept": kept(episode)}
        return replace(result, rows=[row])

    def summary(self, rows: list[Row]) -> list[Row]:
        """One line per scenario, region and covariance rule, paired with the oracle."""
        base = {
            (row["scenario"], row["region"], row["seed"]): row
            for row in rows
            if row["covariance"] == ORACLE
        }
        lines = []
        for keys, some in group(rows, "scenario", "region", "covariance").items():
            pairs = [base[row["scenario"], row["region"], row["seed"]] for row in some]
            line = dict(zip(("scenario", "region", "covariance"), keys, strict=True))
            lines.append(
                {
                    **line,
                    "extra_time": _extra(some, pairs, "time_ratio_worst"),
                    "extra_path": _extra(some, pairs, "length_ratio_worst"),
                    "promised": known_mean(column(some, "promised")),
                    "kept": known_mean(column(some, "kept")),
                    **pick(condense(some), COLUMNS),
                }
            )
        return lines

    def figures(self, result: Result, folder: Path) -> list[Path]:
        """Draw what is kept against what it costs, one panel per scenario."""
        from ..drawing.plotting import paper_style, save, subplots

        groups = group(self.summary(result.rows), "scenario")
        marks = dict(zip(self.regions, "osD^vP*X<>", strict=False))
        shades = dict(
            zip(self.predictors, np.linspace(1.0, 0.0, len(self.predictors)), strict=True)
        )
        with paper_style():
            figure, panels = subplots(
                1, len(groups), figsize=(3.5 * len(groups), 3.6), squeeze=False,
                layout="constrained", sharey=True,
            )  # fmt: skip
            for panel, ((scenario,), lines) in zip(panels[0], groups.items(), strict=True):
                for line in lines:
                    panel.plot(
                        100 * line["extra_time"], line["clearance_median_m"],
                        marks[line["region"]], color=str(0.85 * shades[line["covariance"]]),
                        markeredgecolor="black", markeredgewidth=0.6, markersize=6,
                    )  # fmt: skip
                panel.set_title(scenario.replace("_", " "))
                panel.set_xlabel("median extra time over the oracle (%)")
                panel.grid(linewidth=0.4, alpha=0.6)
            panels[0, 0].set_ylabel("median least clearance (m)")
            keys = [("region", marks), ("covariance", shades)]
            entries = [
                _entry(kind, name, look) for kind, table in keys for name, look in table.items()
            ]
            figure.legend(handles=entries, loc="outside lower center", ncols=2 * len(groups))
            return save(figure, folder, "conservativeness")

    def quick(self) -> Self:
        """One seed of the first scenario, two regions, the oracle and one other rule."""
        rules = [*[name for name in self.predictors if name != ORACLE][-1:], ORACLE]
        return replace(
            self,
            scenarios=first_of(self.scenarios),
            regions=first_of(self.regions, 2),
            predictors={name: self.predictors[name] for name in rules},
            seeds=1,
        )


def promised(episode: Episode) -> float:
    """Mean content over all plans, steps and obstacles; nan without any."""
    contents = [plan.content.ravel() for log in episode.robots for plan in log.plans]
    joined = np.concatenate(contents) if contents else np.zeros(0)
    return float(joined.mean()) if joined.size else float("nan")


def kept(episode: Episode) -> float:
    """Share of planned positions that stay clear of where the others then truly were."""
    shares = [
        clear
        for log in episode.robots
        for other in episode.agents
        if other is not log
        for clear in _clear(episode, log, other)
    ]
    joined = np.concatenate(shares) if shares else np.zeros(0)
    return float(joined.mean()) if joined.size else float("nan")


def _clear(episode: Episode, log: AgentLog, other: AgentLog) -> list[Array]:
    margin = log.radius + other.radius
    shares = []
    for plan in log.plans:
        times = plan.stamp + plan.dt * np.arange(1.0, len(plan.positions), dtype=np.float64)
        distance = np.linalg.norm(plan.positions[1:] - episode.at(other, times), axis=1)
        known = np.isfinite(distance)
        shares.append((distance[known] >= margin - 1e-3).astype(np.float64))
    return shares


def _extra(some: list[Row], pairs: list[Row], name: str) -> float:
    """Median over seeds of the relative excess over the paired row."""
    ratio = column(some, name) / column(pairs, name) - 1.0
    return float(np.median(ratio))


def _entry(kind: str, name: str, look: str | float) -> object:
    from matplotlib.lines import Line2D

    marker = look if isinstance(look, str) else "s"
    colour = "white" if isinstance(look, str) else str(0.85 * look)
    label = f"{kind}: {name.replace('_', ' ')}"
    return Line2D(
        [], [], linestyle="", marker=marker, color=colour, markeredgecolor="black", label=label
    )

"""Time and path that each region and covariance costs in closed loop, and the share it keeps."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, ClassVar, Self, final

import numpy as np

from ...framework import Controller, Predictor, Region, WideberthError
from ...framework.values.arrays import Array
from ...metrics.statistics import known_mean
from ...simulation.log.episode_log import AgentLog, Episode
from ..drawing.plotting import entry, subplots, title
from ..engine.closed_loop import column, condense, group, outcome, pick
from .episodes import PlacesStudy
from .grid import Axes, Pictures, Result, Row, Task, TaskOutcome, labelled, reduced
from .variants import exchanged

ORACLE = "oracle"
"""Name of the predictor that the others are compared with."""

COLUMNS = (
    *("episodes", "collisions", "deadlocks", "clearance_min_m", "clearance_median_m"),
    *("below_reference", "least_content", "coverage"),
)


@final
@dataclass(frozen=True)
class Conservativeness(PlacesStudy):
    """Every pair of region and covariance rule, on the same seeds.

    ``extra_time`` and ``extra_path`` of an episode are the slower robot's time and the
    longer path, relative to the same seed under the oracle (the same region, the other's
    own plan as forecast). ``promised`` is the mean content that the plans' levels stand
    for; ``kept`` is the share of planned positions (all plans, steps 1..N up to the end of
    the episode) from which the other robot, where it then truly was, is at least r + r_d
    away. A region is conservative where kept exceeds promised.

    Parameters
    ----------
    planner : settings of the MPC; its region and predictor are exchanged.
    regions : by name.
    predictors : covariance rules by name; one of them is named ``oracle``.
    """

    claim: ClassVar[str] = (
        "The ellipse is the more accurate representation of the underlying distribution and "
        "less conservative (section III): what each region and covariance costs and keeps."
    )
    reference: ClassVar[str] = "schoeneberg2025trajectory"

    planner: Controller
    regions: dict[str, Region]
    predictors: dict[str, Predictor]

    def validate(self) -> None:
        """Refuse settings that make no study."""
        self.controllers()
        if ORACLE not in self.predictors:
            raise WideberthError(
                f"predictors are {sorted(self.predictors)}; one must be named {ORACLE!r}: the "
                "extra time and path of the others are relative to it"
            )

    def axes(self) -> Axes:
        """Each region with each covariance rule, in each scenario."""
        names = [(f"{one} {rule}", one, rule) for one in self.regions for rule in self.predictors]
        return {
            "scenario": self.scenarios,
            ("planner", "region", "covariance"): {own[0]: own for own in names},
            "seed": self.seed_range,
        }

    def controllers(self) -> Mapping[str, Controller]:
        """Return the planner with each region and covariance rule."""
        return {
            f"{region} {rule}": exchanged(self.planner, region=shape, predictor=predictor)
            for region, shape in self.regions.items()
            for rule, predictor in self.predictors.items()
        }

    def measure(self, task: Task) -> TaskOutcome:
        """Play one episode and count what its plans kept."""
        episode = self.played(task, self.controllers()[task.settings["planner"]])
        more = {"promised": promised(episode), "kept": kept(episode)}
        return outcome(episode, task, self.tail, more)

    def summary(self, rows: list[Row]) -> list[Row]:
        """One line per scenario, region and covariance rule, paired with the oracle."""
        place = ("scenario", "region", "seed")
        base = {tuple(row[key] for key in place): row for row in rows if _by_oracle(row)}
        lines = []
        for labels, some in labelled(rows, "scenario", "region", "covariance"):
            pairs = [base[tuple(row[key] for key in place)] for row in some]
            lines.append({
                **labels,
                "extra_time": _extra(some, pairs, "time_ratio_worst"),
                "extra_path": _extra(some, pairs, "length_ratio_worst"),
                "promised": known_mean(column(some, "promised")),
                "kept": known_mean(column(some, "kept")),
                **pick(condense(some), COLUMNS),
            })  # fmt: skip
        return lines

    def pictures(self, result: Result) -> Pictures:
        """Draw what is kept against what it costs, one panel per scenario."""
        lines = self.summary(result.rows)
        yield "conservativeness", _draw(lines, list(self.regions), list(self.predictors))

    def quick(self) -> Self:
        """One seed of the first scenario, two regions, the oracle and one other rule."""
        rules = [*[name for name in self.predictors if name != ORACLE][-1:], ORACLE]
        two = replace(self, predictors={name: self.predictors[name] for name in rules})
        return reduced(two, scenarios=1, regions=2, seeds=1)


def _by_oracle(row: Row) -> bool:
    return bool(row["covariance"] == ORACLE)


def _draw(lines: list[Row], regions: list[str], rules: list[str]) -> Any:
    """Draw a marker per region and a shade per covariance rule, a panel per scenario."""
    groups = group(lines, "scenario")
    marks = dict(zip(regions, "osD^vP*X<>", strict=False))
    shades = dict(zip(rules, np.linspace(1.0, 0.0, len(rules)), strict=True))
    figure, panels = subplots(
        1, len(groups), figsize=(3.5 * len(groups), 3.6), squeeze=False, sharey=True
    )
    for panel, ((scenario,), some) in zip(panels[0], groups.items(), strict=True):
        for line in some:
            panel.plot(
                100 * line["extra_time"], line["clearance_median_m"],
                marks[line["region"]], color=str(0.85 * shades[line["covariance"]]),
                markeredgecolor="black", markeredgewidth=0.6, markersize=6,
            )  # fmt: skip
        panel.set(title=title(scenario), xlabel="median extra time over the oracle (%)")
        panel.grid(linewidth=0.4, alpha=0.6)
    panels[0, 0].set_ylabel("median least clearance (m)")
    edge = {"markeredgecolor": "black"}
    entries = [
        *(entry(f"region: {title(name)}", marker=marker, color="white", **edge)
          for name, marker in marks.items()),
        *(entry(f"covariance: {title(name)}", marker="s", color=str(0.85 * shade), **edge)
          for name, shade in shades.items()),
    ]  # fmt: skip
    figure.legend(handles=entries, loc="outside lower center", ncols=2 * len(groups))
    return figure


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

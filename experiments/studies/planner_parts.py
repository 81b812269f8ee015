"""One planner with other predictors, regions, levels or costs, in closed loop."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import product
from typing import Any, ClassVar, Self, final

import numpy as np

from ...framework import (
    Controller,
    GaussianObstacle,
    Plan,
    Predictor,
    Region,
    WideberthError,
)
from ...framework.controller import driving
from ...framework.mpc.costs.base import Cost
from ...framework.mpc.levels.base import LevelPolicy, level_of
from ...framework.mpc.planner.planner import planner_behind
from ...framework.plugins.registry import unknown
from ...framework.values.arrays import Array
from ...framework.values.plan import Rung
from ...metrics.gaps import gaps
from ...metrics.statistics import known_mean
from ...regions.minkowski_sum import MinkowskiSum
from ...simulation.drawing.artists import pairs
from ...simulation.drawing.logged import DrawnAgent
from ...simulation.log.episode_log import AgentLog, Episode
from ...simulation.measures.summary import robot_rows
from ..drawing.plotting import PAGE, subplots, title
from ..drawing.shaded_tables import shaded
from ..engine.closed_loop import column, condense, group, log_name
from .episode_statistics import SOURCES, against, condensed, paired
from .episodes import PlacesStudy, check_robots, measured
from .grid import Axes, Pictures, Result, Row, Task, TaskOutcome, reduced, rounded
from .replay import STILL
from .variants import exchanged

PARTS = {"predictor": "predictors", "region": "regions", "level": "levels", "cost": "costs"}
"""Part of a planner -> field of the study with its variants."""


@final
@dataclass(frozen=True)
class PlannerParts(PlacesStudy):
    """One planner with every combination of some parts in place of its own, on the same seeds.

    Each combination is held against a reference, seed by seed: the first one in the same scenario,
    or the one that differs in the parts that ``relative_to`` names alone. Columns are those of a
    `comparison` and of every closed loop, and

    - ``extra_time``, ``extra_path``: the slowest robot's time and the longest path over those of
      the reference, less 1; medians over the seeds.
    - ``promised``: the mean content that the plans' levels stand for.
    - ``kept``: share of planned positions (all plans, steps 1..N up to the end of the episode)
      from which the others, where they then truly were, are at least r + r_d away.
    - ``entered``: share of plans that enter a region, on the rungs `least violation` and `brake`.
    - ``driven_below``: share of plans, of those with an obstacle, whose first step, the one that
      is driven, holds less than the level of the policy's promise for ``tail``, or that enter a
      region.
    - ``drove_into``: number of episodes in which a robot touched another body while it moved.
    - ``peak_speed``, ``deviation``: highest speed of any robot, and largest distance of any robot
      from its path; medians over the seeds.
    - ``area_ratio``: median area (in space volume) of the planner's region over that of the exact
      sum of the same tail, for forecasts that the plans met; mean over the seeds.
    - ``iterations``: mean number of solver iterations per plan.

    Where covariances are round (a Kalman filter with the same noise in all directions) the paper's
    ellipse, its repairs, the outer forms and the exact sum are one and the same disc.

    Parameters
    ----------
    planner : all that stays the same; a controller with the stated parts.
    predictors, regions, levels, costs : by name; the planner's own where there are none.
    relative_to : part (predictor, region, level, cost) -> name of its variant in the reference.
    show : seeds whose episodes are kept, and drawn for each variant of the first part with the
        first ones of all others.
    """

    claim: ClassVar[str] = (
        "What does each variant of a planner's parts (predictor, region, level policy, cost) keep "
        "and cost in the same situations?"
    )
    reference: ClassVar[str] = SOURCES
    printed: ClassVar[tuple[str, ...]] = (
        *("episodes", "success", "p_success", "collision", "time_mean_s", "extra_time"),
        *("clearance_median_m", "kept", "driven_below", "peak_speed", "errors"),
    )

    planner: Controller
    predictors: dict[str, Predictor] = field(default_factory=dict)
    regions: dict[str, Region] = field(default_factory=dict)
    levels: dict[str, LevelPolicy] = field(default_factory=dict)
    costs: dict[str, Cost] = field(default_factory=dict)
    relative_to: dict[str, str] = field(default_factory=dict)
    show: tuple[int, ...] = ()

    def validate(self) -> None:
        """Refuse settings that make no study."""
        if not self.parts:
            raise WideberthError(
                "predictors, regions, levels and costs are empty; name at least one of them"
            )
        for part, name in self.relative_to.items():
            if part not in self.parts:
                raise WideberthError(f"relative_to: {unknown('part', part, self.parts)}")
            if name not in self.parts[part]:
                what = unknown(part, name, self.parts[part])
                raise WideberthError(f"relative_to.{part}: {what}")
        self.check_shown(self.show)
        places = {f"scenarios.{name}": one for name, one in self.scenarios.items()}
        check_robots(places, {"robot": self.robot}, {"planner": self.planner})
        for names in product(*self.parts.values()):
            self.variant(dict(zip(self.parts, names, strict=True)))

    @property
    def parts(self) -> dict[str, Mapping[str, Any]]:
        """Part -> its variants by name, of those that are exchanged."""
        found = {part: getattr(self, name) for part, name in PARTS.items()}
        return {part: variants for part, variants in found.items() if variants}

    def variant(self, names: Mapping[str, Any]) -> Controller:
        """Return the planner with the named variant of every part."""
        chosen = {part: variants[names[part]] for part, variants in self.parts.items()}
        return exchanged(driving(self.planner, self.robot), **chosen)

    def axes(self) -> Axes:
        """Each combination of parts in each scenario."""
        return {"scenario": self.scenarios, **self.parts, "seed": self.seed_range}

    def controllers(self) -> Mapping[str, Controller]:
        """Return the combinations that differ from the first one in at most one part.

        So each variant of a part begins once: to begin with all combinations takes as long as some
        episodes.
        """
        every = list(product(*self.parts.values()))
        few = [key for key in every if sum(map(str.__ne__, key, every[0])) <= 1]
        return {
            " and ".join(key): self.variant(dict(zip(self.parts, key, strict=True))) for key in few
        }

    def measure(self, task: Task) -> TaskOutcome:
        """Play one episode."""
        scenario = self.scenarios[task.settings["scenario"]]
        planner = self.variant(task.settings)

        def more(episode: Episode) -> Row:
            return manner(episode) | held(episode, planner, self.tail)

        shared = self.settings, task, self.tail, self.show
        return measured(scenario, self.robot, planner, *shared, more=more)

    def summary(self, rows: list[Row]) -> list[Row]:
        """One line per scenario and combination, compared with its reference."""
        labels = ("scenario", *self.parts)
        played = group(rows, *labels)
        first = dict(zip(labels, next(iter(played)), strict=True))
        lines = []
        for key, own in played.items():
            known = dict(zip(labels, key, strict=True))
            if self.relative_to:
                base = known | self.relative_to
            else:
                base = first | {"scenario": known["scenario"]}
            lines.append(known | _line(own, played[tuple(base.values())]))
        return lines

    def pictures(self, result: Result) -> Pictures:
        """Draw tables of the measures, the last part across, and the episodes that are shown."""
        yield "planner_parts", draw_tables(self.summary(result.rows), [*self.parts])
        first, *others = self.parts
        firsts = {part: next(iter(self.parts[part])) for part in others}
        for task in self.tasks():
            if task.seed in self.show and firsts.items() <= task.settings.items():
                place = [task.settings["scenario"]] * (len(self.scenarios) > 1)
                name = "_".join([*place, task.settings[first]])
                episode = Episode.from_bytes(result.read(log_name(task)))
                called = self.figure_name(name, task.seed, self.show)
                yield from self.episode_pictures(called, episode, self.variant(task.settings))

    def quick(self) -> Self:
        """Play one seed: of one part all variants, else two of each part in the first scenario."""
        if len(self.parts) == 1:
            return reduced(self, seeds=1)
        few: dict[str, dict[str, Any]] = {}
        for part, variants in self.parts.items():
            names = [*filter(None, [self.relative_to.get(part)]), *variants]
            few[PARTS[part]] = {name: variants[name] for name in list(dict.fromkeys(names))[:2]}
        changed: Any = replace(self, **few)  # type: ignore[arg-type]  # each of its own kind
        return reduced(changed, scenarios=1, seeds=1)  # type: ignore[no-any-return]


def _line(own: list[Row], base: list[Row]) -> Row:
    """Condense the episodes of one combination, and hold them against its reference."""
    met = column(own, "plans_with_obstacles").sum()
    return {
        **condense(own),
        **condensed(own),
        **against(own, base),
        "extra_time": _extra(own, base, "time_ratio_worst"),
        "extra_path": _extra(own, base, "length_ratio_worst"),
        **{name: known_mean(column(own, name)) for name in MEANS},
        "drove_into": int(column(own, "drove_into").sum()),
        "entered": float(column(own, "entered").sum() / max(column(own, "plans").sum(), 1.0)),
        "driven_below": float(column(own, "driven_below").sum() / max(met, 1.0)),
        **{name: float(np.median(column(own, name))) for name in ("peak_speed", "deviation")},
    }


MEANS = ("promised", "kept", "area_ratio", "iterations")
"""Columns of the table whose mean over the episodes is in the summary."""


def _extra(own: list[Row], base: list[Row], name: str) -> float:
    """Median of the relative excess over the seeds at which the reference has a finite value."""
    values, others = paired(own, base, name), paired(base, own, name)
    known = np.isfinite(others)
    return float(np.median(values[known] / others[known] - 1.0)) if known.any() else np.nan


def manner(episode: Episode) -> Row:
    """Return how the robots of an episode drove, and what their plans promised and kept."""
    spent = [plan.iterations for log in episode.robots for plan in log.plans]
    return {
        "iterations": known_mean(spent),
        "promised": promised(episode),
        "kept": kept(episode),
        "drove_into": any(_drove_into(a, b) for a, b in pairs(episode)),
        "peak_speed": float(max(np.nanmax(np.abs(log.speeds)) for log in episode.robots)),
        "deviation": max(row["deviation"] for row in robot_rows(episode)),
    }


def held(episode: Episode, controller: Controller, tail: float) -> Row:
    """Count plans that enter a region or hold less at the step that is driven; measure regions.

    Of a controller that contains no planner none holds less.
    """
    plans = [plan for log in episode.robots for plan in log.plans]
    met = [plan for plan in plans if plan.level.size]
    planner, full, ratio = planner_behind(controller), -np.inf, None
    if planner is not None:
        level = level_of(planner.region, planner.level.promise, tail, planner.robot.dimension)
        full, ratio = level - 1e-4, area_ratio(episode, planner.region, tail)
    return {
        "area_ratio": ratio,
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


SAMPLE = 200
"""Forecasts of an episode, of one obstacle at one step, over which areas are taken."""


def area_ratio(episode: Episode, region: Region, tail: float) -> float | None:
    """Median area of a region over the exact sum's, for forecasts of the plans.

    Both have the content 1 - tail before they are enlarged, as far as the plan's was.

    Returns
    -------
    None without a forecast, and where the region is not defined for one of them.
    """
    means, covariances, radii = [], [], []
    for plan in (plan for log in episode.robots for plan in log.plans):
        if plan.forecast is not None and plan.situation is not None and len(plan.tracked):
            size = plan.forecast.mean.shape[-1]
            means.append(plan.forecast.mean.reshape(-1, size))
            covariances.append(plan.forecast.covariance.reshape(-1, size, size))
            margins = plan.situation.radii + plan.situation.room
            radii.append(np.repeat(margins, len(means[-1]) // len(margins)))
    if not means:
        return None
    chosen = np.random.default_rng(0).permutation(sum(map(len, means)))[:SAMPLE]
    mean, covariance, radius = (
        np.concatenate(parts)[chosen] for parts in (means, covariances, radii)
    )
    obstacle, exact, size = GaussianObstacle(mean, covariance), MinkowskiSum(), mean.shape[-1]
    try:
        areas = [
            one.area(one.parameters(obstacle, radius), np.array(one.level(tail, size)))
            for one in (region, exact)
        ]
    except WideberthError:
        return None
    return rounded(float(np.median(areas[0] / areas[1])))


def promised(episode: Episode) -> float:
    """Mean content over all plans, steps and obstacles; nan without any."""
    contents = [plan.content.ravel() for log in episode.robots for plan in log.plans]
    return known_mean(np.concatenate([np.zeros(0), *contents]))


def kept(episode: Episode) -> float:
    """Share of planned positions that stay clear of where the others then truly were."""
    shares = [
        clear
        for log in episode.robots
        for other in episode.agents
        if other is not log
        for clear in _clear(episode, log, other)
    ]
    return known_mean(np.concatenate([np.zeros(0), *shares]))


def _clear(episode: Episode, log: AgentLog, other: AgentLog) -> list[Array]:
    margin = log.radius + other.radius
    shares = []
    for plan in log.plans:
        times = plan.stamp + plan.dt * np.arange(1.0, len(plan.positions), dtype=np.float64)
        distance = np.linalg.norm(plan.positions[1:] - episode.at(other, times), axis=1)
        known = np.isfinite(distance)
        shares.append((distance[known] >= margin - 1e-3).astype(np.float64))
    return shares


SHOWN = (
    ("success", "success", ".2f"),
    ("time_mean_s", "time to the goals (s)", ".1f"),
    ("clearance_median_m", "median least clearance (m)", ".2f"),
    ("intrusion_share", "share of time near a person", ".2f"),
)
"""Column of the summary, title and format of each table."""
LESS_IS_BETTER = ("time_mean_s", "intrusion_share")


def draw_tables(lines: Sequence[Row], parts: Sequence[str]) -> Any:
    """Draw a table for each measure; dark is better, and the number stands in its cell.

    The last part stands across, scenarios and the other parts down.
    """
    counts = sorted({int(line["episodes"]) for line in lines})
    words = " to ".join(str(count) for count in dict.fromkeys((counts[0], counts[-1])))
    several = len({line["scenario"] for line in lines}) > 1
    beside = [name for name in ("scenario", *parts[:-1]) if several or name != "scenario"]
    down, across = group(list(lines), *beside), group(list(lines), parts[-1])
    size = PAGE, 0.5 + len(SHOWN) * (0.35 + 0.17 * len(down)) + 0.9
    figure, axes = subplots(len(SHOWN), 1, figsize=size, sharex=True, squeeze=False)
    for panel, (name, text, form) in zip(axes[:, 0], SHOWN, strict=True):
        table = np.full((len(down), len(across)), np.nan)
        for i, some in enumerate(down.values()):
            at = [list(across).index((line[parts[-1]],)) for line in some]
            table[i, at] = column(some, name)
        shaded(panel, table, form, better_high=name not in LESS_IS_BETTER)
        panel.set_title(f"{text}, n = {words} per cell")
        panel.set_ylabel(", ".join(beside))
        panel.set_yticks(range(len(down)), [title(", ".join(key)) for key in down])
    axes[-1, 0].set_xticks(range(len(across)), [title(key[0]) for key in across], rotation=40,
                           ha="right")  # fmt: skip
    axes[-1, 0].set_xlabel(parts[-1])
    return figure

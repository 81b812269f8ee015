"""Risk that a closed loop takes against the risk it states, under a true forecast model."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar, Self, final

import numpy as np

from ...framework import Controller, GaussianObstacle, Plan, Predictor, WideberthError
from ...framework.mpc.levels.base import LevelPolicy
from ...framework.mpc.levels.fixed import Fixed
from ...framework.mpc.planner.planner import Planner
from ...framework.region import RiskLevel
from ...framework.risk.collision_probability import collision_probability
from ...framework.values.arrays import Array, whole
from ...metrics.statistics import clopper_pearson, ratio, ratio_interval
from ...simulation.engine.agents import ReplayAgent
from ...simulation.engine.episode import run_episode
from ...simulation.engine.settings import Settings
from ...simulation.scenarios.model_crowd import ModelCrowd
from ..drawing.plotting import COLOURS, ENOUGH, LINES, PAGE, few, legend_below, subplots
from ..engine.closed_loop import column, group, pick
from .grid import Axes, GridStudy, Pictures, Result, Row, Task, TaskOutcome, labelled, reduced
from .variants import planner_of

BLOCK = 50
"""Episodes per task: they share a planner, whose problem is then assembled once."""
COUNTED = ("outside", "touched", "expected", "near", "near_touched", "near_expected")
LABELS = ("crowd", "predictor", "level")
NEAR = 0.2
"""Share of the risk that a level allows from which on a pair counts as near."""
RATIOS = {
    "outside": ("outside", "pairs"),
    "touched": ("touched", "pairs"),
    "near_touched": ("near_touched", "near"),
    "ratio": ("touched", "expected"),
}
"""Ratio of the summary -> its numerator and denominator."""


@final
@dataclass(frozen=True)
class RiskCrowd:
    """Walkers of one model, who forecasts them, and how they are seen.

    Attributes
    ----------
    scenario : who walks there.
    predictors : by name.
    settings : how the episodes are run.
    """

    scenario: ModelCrowd
    predictors: dict[str, Predictor]
    settings: Settings = field(default_factory=Settings)


@final
@dataclass(frozen=True)
class ClosedLoopRisk(GridStudy):
    """Many short episodes in which walkers do exactly what a predictor assumes of them.

    The robot plans anew every period at a fixed level. Of every plan that keeps its level, each
    step i and walker make a pair, and with the walker where it truly was at that step it is
    counted

    - ``outside``: whether the walker was outside the un-enlarged region of its forecast.
      Nominal is 1 - content of the level, which is met exactly where the covariance is.
    - ``touched``: whether the bodies overlapped, the robot at the planned place. Nominal, as an
      upper bound, is the risk that the region guarantees at its level: for the exact sum and what
      encloses it Phi(-s), at most the level's tail; for other regions that tail.
    - ``expected``: the collision probability computed from plan and forecast. Where forecasts
      are calibrated its sum is that of ``touched``: ``ratio`` is the one over the other.
    - ``near``: whether that is a fifth of what is nominal or more. Elsewhere nothing is at
      stake, and a share over all pairs is small because most walkers are far away.

    Pairs of one episode depend on each other; episodes do not. So intervals of shares over
    pairs are from a bootstrap over whole episodes, and beside them stand exact ones
    (Clopper-Pearson, ``single``) from one pair at step 1 per episode, drawn at random. All
    are two-sided with 95 %.

    Parameters
    ----------
    crowds : by name.
    planner : `mpc`, whose predictor and level are exchanged.
    levels : fixed levels by name.
    seeds : number of episodes of each crowd, predictor and level.
    first_seed : the seeds are first_seed to first_seed + seeds - 1.
    """

    claim: ClassVar[str] = (
        "The chance constraints hold (section III): what regions promise at one step is kept in "
        "closed loop where the covariance is exact, and is not with the paper's recursion."
    )
    reference: ClassVar[str] = "schoeneberg2025trajectory"
    printed: ClassVar[tuple[str, ...]] = (
        *("episodes", "outside", "outside_nominal", "touched"),
        *("touched_nominal", "near_touched", "near_expected", "ratio"),
    )

    crowds: dict[str, RiskCrowd]
    planner: Controller
    levels: dict[str, LevelPolicy]
    seeds: int = 2000
    first_seed: int = 0

    def __post_init__(self) -> None:
        planner_of(self.planner)
        whole("seeds", self.seeds)
        whole("first_seed", self.first_seed, least=0)
        if not self.crowds or not self.levels:
            raise WideberthError("crowds and levels must each name at least one")
        loose = [name for name, level in self.levels.items() if not isinstance(level, Fixed)]
        if loose:
            raise WideberthError(f"levels {loose} may give way; what is nominal needs type: fixed")

    def axes(self) -> Axes:
        """Each predictor of each crowd with each level, and the seeds in blocks."""
        seeds = range(self.first_seed, self.first_seed + self.seeds)
        return {
            ("crowd", "predictor"): [
                (name, predictor) for name, crowd in self.crowds.items()
                for predictor in crowd.predictors
            ],
            "level": self.levels,
            ("seed", "seeds"): [(one, min(BLOCK, seeds.stop - one)) for one in seeds[::BLOCK]],
        }  # fmt: skip

    def measure(self, task: Task) -> TaskOutcome:
        """Play a block of episodes, one row each."""
        names = pick(task.settings, LABELS)
        crowd, level = self.crowds[names["crowd"]], self.levels[names["level"]]
        predictor = crowd.predictors[names["predictor"]]
        planner = replace(planner_of(self.planner), predictor=predictor, level=level)
        block = range(task.seed, task.seed + task.settings["seeds"])
        rows = [_play(crowd, planner, seed) for seed in block]
        return TaskOutcome([{**names, **row} for row in rows])

    def summary(self, rows: list[Row]) -> list[Row]:
        """One line per crowd, predictor and level, of step 1 and of all steps.

        The columns ``single`` are of step 1 in both.
        """
        return [
            {**labels, "steps": name, **self._line(labels["level"], some, steps)}
            for labels, some in labelled(rows, *LABELS)
            for name, steps in (("1", (1,)), ("all", range(1, self._horizon + 1)))
        ]

    def _line(self, level: str, rows: list[Row], steps: Sequence[int]) -> Row:
        """Shares over some steps with their intervals."""
        planner = replace(planner_of(self.planner), level=self.levels[level])
        size = planner.robot.dimension
        held = float(planner.level.levels(planner.region, 1, 1, size)[0, 0])
        sums = {
            name: np.sum([column(rows, f"{name}_{i}") for i in steps], axis=0) for name in COUNTED
        }
        sums["pairs"] = column(rows, "pairs") * len(steps)
        line: Row = {"episodes": len(rows), "pairs": int(sums["pairs"].sum())}
        line["left_out"] = float(1.0 - column(rows, "kept").sum() / column(rows, "plans").sum())
        for name, (part, whole_of) in RATIOS.items():
            line[name] = ratio(sums[part].sum(), sums[whole_of].sum())
            line[f"{name}_low"], line[f"{name}_high"] = ratio_interval(sums[part], sums[whole_of])
            if name == "outside":
                line["outside_nominal"] = planner.region.tail(held, size)
                line |= _single(rows, "outside")
            elif name == "touched":
                line["touched_nominal"] = allowed(planner)
                line |= _single(rows, "touched")
        line["near_expected"] = ratio(sums["near_expected"].sum(), sums["near"].sum())
        return line

    @property
    def _horizon(self) -> int:
        return planner_of(self.planner).horizon

    def pictures(self, result: Result) -> Pictures:
        """Draw the shares at every step beside their nominal values, one column per crowd."""
        lines = [
            {**labels, "step": i, **self._line(labels["level"], some, (i,))}
            for labels, some in labelled(result.rows, *LABELS)
            for i in range(1, self._horizon + 1)
        ]
        yield "closed_loop_risk", draw(lines)

    def quick(self) -> Self:
        """Keep a few episodes at one level."""
        return reduced(self, levels=1, seeds=4)


def allowed(planner: Planner) -> float:
    """Collision risk that the planner's region guarantees at its level, at each step."""
    region, size = planner.region, planner.robot.dimension
    held = float(planner.level.levels(region, 1, 1, size)[0, 0])
    return region.risk(held) if isinstance(region, RiskLevel) else planner.level.tail


def _single(rows: list[Row], name: str) -> Row:
    """Exact interval from one pair at step 1 of each episode that has any."""
    found = column(rows, f"single_{name}")
    found = found[np.isfinite(found)]
    low, high = clopper_pearson(int(found.sum()), len(found))
    return {f"{name}_single_low": low, f"{name}_single_high": high}


def _play(crowd: RiskCrowd, planner: Planner, seed: int) -> Row:
    """Play one episode and count its pairs."""
    cast = crowd.scenario.cast(seed)
    (one,) = cast.placements
    agent = one.agent(planner.robot, planner, truth=False)
    episode = run_episode([agent], crowd.settings, seed=seed, others=cast.bystanders)
    plans = episode.robots[0].plans
    walkers = {one.name: one for one in cast.bystanders if isinstance(one, ReplayAgent)}
    kept = [plan for plan in plans if plan.below_reference is False]
    found = [_pairs(plan, planner, walkers) for plan in kept]
    counts = {name: _together([each[name] for each in found]) for name in COUNTED}
    pairs = len(counts["outside"])
    row: Row = {"seed": seed, "plans": len(plans), "kept": len(kept), "pairs": pairs}
    for name, values in counts.items():
        totals = values.sum(axis=0) if pairs else np.zeros(planner.horizon)
        row |= {f"{name}_{i}": float(total) for i, total in enumerate(totals, start=1)}
    chosen = int(np.random.default_rng([seed, 1]).integers(pairs)) if pairs else None
    for name in ("outside", "touched"):
        row[f"single_{name}"] = None if chosen is None else float(counts[name][chosen, 0])
    return row


def _together(values: list[Array]) -> Array:
    return np.concatenate(values) if values else np.zeros((0, 0))


def _pairs(plan: Plan, planner: Planner, walkers: Mapping[str, ReplayAgent]) -> dict[str, Array]:
    """Return what is counted of each walker and step of one plan, (O, N) each."""
    forecast = plan.forecast
    assert forecast is not None and forecast.weight.shape[1] == 1
    order = [plan.tracked.index(name) for name in plan.ids]
    times = plan.stamp + plan.dt * np.arange(1.0, planner.horizon + 1.0)
    truth = np.array([walkers[name].at(times) for name in plan.ids])
    mean, covariance = forecast.mean[order, 0], forecast.covariance[order, 0]
    radii = np.array([[planner.robot.radius + walkers[name].radius] for name in plan.ids])
    ahead = plan.positions[1:]
    apart = np.linalg.norm(truth - ahead, axis=-1)
    bare = planner.region.parameters(GaussianObstacle(mean, covariance), np.zeros(mean.shape[:2]))
    inside = planner.region.contains(truth, bare, plan.level.T)
    touched = 1.0 * (apart < radii)
    expected = collision_probability(mean - ahead, covariance, radii)
    near = 1.0 * (expected >= NEAR * allowed(planner))
    found = (1.0 - inside, touched, expected, near, near * touched, near * expected)
    return {
        name: np.asarray(value, dtype=np.float64)
        for name, value in zip(COUNTED, found, strict=True)
    }


MARKS = "osD^vP"
LEAST = 1e-3
"""Lower end of the logarithmic axis; shares of zero show as the upper half of their bar."""


def draw(lines: list[Row]) -> Any:
    """Draw one column per crowd and level: who left the region, and who was touched."""
    columns = group(lines, "crowd", "level")
    looks = {name: k for k, (name,) in enumerate(group(lines, "predictor"))}
    figure, panels = subplots(
        2, len(columns), figsize=(PAGE, 4.2), squeeze=False, sharex=True, sharey="row"
    )
    for i, ((crowd, level), own) in enumerate(columns.items()):
        upper, lower = panels[0, i], panels[1, i]
        for (name,), some in group(own, "predictor").items():
            _outside(upper, some, looks[name], name)
            _touched(lower, some, looks[name])
        _nominal(upper, own, "outside_nominal")
        _nominal(lower, own, "touched_nominal")
        upper.set_title(f"{crowd}\n{str(level).replace('_', ', tail ')} %")
        lower.set_xlabel("step")
    words = few(int(line["episodes"]) for line in lines) or "bars: intervals of 95 %"
    legend_below(figure, panels[0], ncols=6, title=f"{words}; dotted: nominal", title_fontsize=7)
    panels[0, 0].set_ylabel("walker outside its region")
    panels[0, 0].set_ylim(0.0, 1.0)
    panels[1, 0].set_ylabel("touched, of near pairs\n(line: computed)")
    panels[1, 0].set_yscale("log")
    panels[1, 0].set_ylim(LEAST, 1.0)
    return figure


def _outside(panel: Any, some: list[Row], k: int, name: str) -> None:
    steps, share = column(some, "step"), column(some, "outside")
    panel.errorbar(
        steps, share, _bars(some, "outside"), fmt=MARKS[k], color=COLOURS[k],
        linestyle="none", markersize=3, linewidth=0.8, label=name,
    )  # fmt: skip


def _touched(panel: Any, some: list[Row], k: int) -> None:
    steps, share = column(some, "step"), column(some, "near_touched")
    shift = 0.12 * (k - 2)
    panel.errorbar(
        steps + shift, share, _bars(some, "near_touched"), fmt=MARKS[k], color=COLOURS[k],
        linestyle="none", markersize=3, linewidth=0.8,
    )  # fmt: skip
    expected = column(some, "near_expected")
    panel.plot(steps + shift, expected, linestyle=LINES[k], color=COLOURS[k], linewidth=0.8)


def _nominal(panel: Any, own: list[Row], name: str) -> None:
    panel.axhline(own[0][name], color="black", linestyle=":", linewidth=0.9)


def _bars(some: list[Row], name: str) -> Any:
    """Lengths of bars below and above a share, (2, K); None of fewer than `ENOUGH` episodes."""
    if min(column(some, "episodes")) < ENOUGH:
        return None
    share = column(some, name)
    bars = [share - column(some, f"{name}_low"), column(some, f"{name}_high") - share]
    return np.maximum(bars, 0.0)

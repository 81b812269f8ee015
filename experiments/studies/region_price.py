"""Price of each region in closed loop: clearance, time, path and solve time."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar, Self, cast, final

import numpy as np

from ...framework import Controller, GaussianObstacle, Predictor, Region, WideberthError
from ...framework.mpc.levels.base import LevelPolicy
from ...framework.mpc.planner.planner import Planner
from ...framework.values.arrays import Array
from ...metrics.statistics import known_mean, quartiles
from ...regions.minkowski_sum import MinkowskiSum
from ...simulation.log.episode_log import Episode
from ...simulation.measures.summary import robot_rows, summarise
from ..drawing.plotting import PAGE, entry, few, style, subplots, title
from ..engine.closed_loop import column, condense, group, pick
from .episodes import OnePlaceStudy
from .grid import Axes, Pictures, Result, Row, Task, TaskOutcome, labelled, reduced
from .region_family import family, member, rounded
from .stopwatch import Stopwatch
from .variants import planner_of

AT_RISK = "_at_risk"
"""Ends the name of a region whose level is that for a risk, not for a content."""

COLUMNS = (
    "episodes", "collisions", "deadlocks", "goals_in_time", "clearance_min_m",
    "clearance_median_m",
)  # fmt: skip


@final
@dataclass(frozen=True)
class RegionPrice(OnePlaceStudy):
    """The same planner with every region, on the same seeds, against the paper's ellipse.

    ``extra_time`` and ``extra_path`` are the slower robot's time and the longer path over
    those under the ellipse at the same seed and forecast, less 1; medians over the ``paired``
    seeds at which both arrived. ``area_ratio`` is the mean area over that of the exact sum
    for the forecasts that were met under the ellipse. The level policy is the planner's: its
    ``minimum`` and ``weight`` are in each region's own level, and its tail is the content
    kept out or the risk asked for, whichever the region's level stands for.

    Solve times are the solver's own, without forecast and re-check, in processor time, each
    region in its own closed loop: what a user pays, on problems that differ a little. One task
    plays all regions at one seed, one after another, from another one first at every seed; a
    ratio is of two quantiles within one task, and what is reported is the median of the ratios
    over the seeds, so that a machine that is slower for a while slows both.

    Parameters
    ----------
    planner : settings of the MPC; its region and predictor are exchanged.
    predictors : forecasts by name. Round ones set the regions apart less: there the paper's
        ellipse, the exact sum and all outer ellipses are the same disc.
    regions : by name; one of them is named ``mahalanobis_ellipse``.
    registered : add every other registered region.
    at_risk : names of regions to be played once more at the level at which the collision
        risk is at most the policy's tail (promise: risk).
    """

    claim: ClassVar[str] = (
        "A tighter or a safer region has its price in clearance, time and computation: what "
        "does each cost in the same encounters?"
    )
    reference: ClassVar[str] = "schoeneberg2025trajectory"
    printed: ClassVar[tuple[str, ...]] = (
        *("collisions", "goals_in_time", "clearance_min_m", "clearance_median_m"),
        *("extra_time", "extra_path", "fallback_plans", "remark"),
    )

    planner: Controller
    predictors: dict[str, Predictor]
    regions: dict[str, Region]
    registered: bool = True
    at_risk: tuple[str, ...] = ()

    def validate(self) -> None:
        """Refuse settings that make no study."""
        planner_of(self.planner)
        if ELLIPSE not in self.regions:
            raise WideberthError(
                f"regions are {sorted(self.regions)}; one must be named {ELLIPSE!r}: the price "
                "of the others is relative to it"
            )
        unknown = sorted(set(self.at_risk) - set(self.regions))
        if unknown:
            raise WideberthError(
                f"at_risk names {unknown}; wanted some of regions, {sorted(self.regions)}"
            )

    def axes(self) -> Axes:
        """Each forecast, for all regions."""
        return {"forecast": self.predictors, "seed": self.seed_range}

    def controllers(self) -> Mapping[str, Controller]:
        """Return the planner as it is given."""
        return {"planner": self.planner}

    def measure(self, task: Task) -> TaskOutcome:
        """Play one episode with each region."""
        forecast = str(task.settings["forecast"])
        names = self._names()
        turn = task.seed % len(names)
        rows: dict[str, Row] = {}
        seconds: dict[str, list[float]] = {}
        planners: dict[str, Planner] = {}
        covariances = None
        for name in names[turn:] + names[:turn]:
            try:
                planners[name] = self.variant(name, self.predictors[forecast])
            except WideberthError as error:
                rows[name] = {"remark": str(error)}
                continue
            watch = Stopwatch(planners[name], [])
            episode = self.played(task, watch)
            rows[name], seconds[name] = _row(episode, self.tail), watch.seconds
            if name == ELLIPSE:
                covariances = met(episode)
        for name, planner in planners.items():
            rows[name] |= {"area_ratio": area_ratio(planner, planners.get(ELLIPSE), covariances)}
        labels: list[Row] = [
            {"forecast": forecast, "region": name, "seed": task.seed} for name in names
        ]
        times = time_rows([(label, seconds.get(label["region"], [])) for label in labels])
        return TaskOutcome([label | rows[label["region"]] for label in labels], times)

    def summary(self, rows: list[Row]) -> list[Row]:
        """One line per forecast and region, paired with the paper's ellipse."""
        base = {(row["forecast"], row["seed"]): row for row in rows if row["region"] == ELLIPSE}
        lines = []
        for labels, some in labelled(rows, "forecast", "region"):
            if some[0]["remark"]:
                lines.append(labels | {"remark": some[0]["remark"]})
                continue
            pairs = [base[row["forecast"], row["seed"]] for row in some]
            time = excess(some, pairs, "time_ratio_worst")
            rest = condense(some)
            lines.append({
                **labels,
                "area_ratio": known_mean(column(some, "area_ratio")),
                **pick(rest, COLUMNS),
                "extra_time": quartiles(time)[1],
                "extra_path": quartiles(excess(some, pairs, "length_ratio_worst"))[1],
                "paired": len(time),
                **pick(rest, ("below_reference", "least_content", "fallback_plans")),
                "iterations": known_mean(column(some, "iterations")),
                "remark": rest["errors"],
            })  # fmt: skip
        return lines

    def pictures(self, result: Result) -> Pictures:
        """Draw the prices, and write the solve times and their ratios as a table."""
        times = solve_times(result.times)
        yield "region_price", draw_prices(result.rows, self.summary(result.rows), times)
        yield "solve_times.csv", times

    def quick(self) -> Self:
        """One seed, the first forecast, the ellipse and two other regions."""
        names = [ELLIPSE, *(name for name in self.regions if name != ELLIPSE)][:3]
        few = {name: self.regions[name] for name in names}
        return reduced(
            replace(self, regions=few, registered=False, at_risk=()), predictors=1, seeds=1
        )

    def _names(self) -> list[str]:
        """Names of the rows: every region, then those that are played at a risk too."""
        names = family(self.regions, self.registered, self.robot.dimension)
        return [*names, *(name + AT_RISK for name in self.at_risk)]

    def variant(self, name: str, predictor: Predictor) -> Planner:
        """Return the planner with the region and the level policy behind a row's name.

        Raises
        ------
        WideberthError : no such region, one that the planner refuses, or one without a level
            for a risk.
        """
        planner = planner_of(self.planner)
        policy = planner.level
        short = name.removesuffix(AT_RISK)
        at_risk = name != short and short in self.at_risk
        region = member(self.regions, short if at_risk else name)
        if at_risk:
            policy = cast(LevelPolicy, replace(cast(Any, policy), promise="risk"))
        return replace(planner, region=region, level=policy, predictor=predictor)


def _row(episode: Episode, tail: float) -> Row:
    """Return what is kept of an episode."""
    iterations = column(robot_rows(episode), "iterations")
    return {"remark": "", **summarise(episode, tail), "iterations": known_mean(iterations)}


ELLIPSE = "mahalanobis_ellipse"
"""Name of the region that the others are compared with: the paper's."""

SAMPLE = 60
"""Forecast covariances per episode over which the areas are averaged."""


def met(episode: Episode) -> Array:
    """Covariances that the plans of an episode met, evenly thinned out, (K, D, D)."""
    found = [
        plan.forecast.covariance.reshape(-1, *plan.forecast.covariance.shape[-2:])
        for log in episode.robots
        for plan in log.plans
        if plan.forecast is not None
    ]
    joined = np.concatenate(found)
    return np.asarray(joined[:: max(len(joined) // SAMPLE, 1)])


def area_ratio(
    planner: Planner, reference: Planner | None, covariances: Array | None
) -> float | None:
    """Mean area of the planner's region over that of the exact sum of the reference's tail.

    Parameters
    ----------
    planner, reference : region, level policy, radius and extra margin are read from them; two
        robots of the planner's radius meet.
    covariances : (K, D, D), m^2.

    Returns
    -------
    None where nothing was met, or where the region is not defined for one of them.
    """
    if reference is None or covariances is None or not len(covariances):
        return None
    size = covariances.shape[-1]
    margin = np.full(len(covariances), 2.0 * planner.robot.radius + planner.margin)
    obstacle = GaussianObstacle(np.zeros((len(covariances), size)), covariances)
    exact, own = MinkowskiSum(), planner.region
    whole = exact.area(
        exact.parameters(obstacle, margin), np.asarray(exact.level(reference.level.tail, size))
    )
    try:
        parameters = own.parameters(obstacle, margin)
    except WideberthError:
        return None
    area = own.area(parameters, planner.level.levels(own, 1, 1, size)[0])
    return rounded(float(np.mean(area / whole)))


def time_rows(found: list[tuple[Row, list[float]]]) -> list[Row]:
    """Median and 95th percentile of the solves, s, and both over those under the ellipse.

    Parameters
    ----------
    found : labels of a row, ``region`` among them, and its solves, s; the solves of one task.
    """
    levels = {str(label["region"]): np.quantile(own, (0.5, 0.95)) for label, own in found if own}
    reference = levels.get(ELLIPSE, np.full(2, np.nan))
    rows = []
    for label, own in found:
        if own:
            middle, high = levels[str(label["region"])]
            rows.append({
                **label,
                "solves": len(own),
                "solve_median_s": float(middle),
                "solve_p95_s": float(high),
                "ratio": float(middle / reference[0]),
                "ratio_p95": float(high / reference[1]),
            })  # fmt: skip
    return rows


def solve_times(times: list[Row]) -> list[Row]:
    """One line per forecast and region: solve times in ms, ratios with quartiles over seeds.

    ``ratio`` is of the medians of one seed, ``ratio_p95`` of the 95th percentiles: most plans
    of an episode are far from any region, the latter is about those that are not.
    """
    lines = []
    for labels, some in labelled(times, "forecast", "region"):
        low, middle, high = quartiles(column(some, "ratio"))
        lines.append({
            **labels,
            "solves": int(column(some, "solves").sum()),
            "median_ms": 1e3 * float(np.median(column(some, "solve_median_s"))),
            "p95_ms": 1e3 * float(np.median(column(some, "solve_p95_s"))),
            "ratio": middle,
            "ratio_q25": low,
            "ratio_q75": high,
            "ratio_p95": quartiles(column(some, "ratio_p95"))[1],
        })  # fmt: skip
    return lines


def excess(some: list[Row], pairs: list[Row], name: str) -> Array:
    """Relative excess over the paired rows, where both arrived."""
    own, other = column(some, name), column(pairs, name)
    both = np.isfinite(column(some, "time_ratio_worst") + column(pairs, "time_ratio_worst"))
    return np.asarray(own[both] / other[both] - 1.0)


MARKERS = "osD^v"
"""One per forecast; the first is filled, the others are hollow."""


def draw_prices(rows: list[Row], summary: list[Row], times: list[Row]) -> Any:
    """Clearance, extra time, extra way and solve-time ratio of each region, by its area.

    Dots are medians over the seeds. Bars reach from the least to the median clearance, and
    between the quartiles of all else, where there are at least `ENOUGH` seeds; left of zero
    clearance the discs overlap.
    """
    names = _by_area(summary)
    words = few(len(some) for some in group(rows, "region", "forecast").values())
    forecasts = list(dict.fromkeys(str(line["forecast"]) for line in summary))
    figure, panels = subplots(
        1, 5, figsize=(PAGE, 1.2 + 0.2 * len(names)), sharey=True,
        width_ratios=(0.75, 1.0, 1.0, 1.0, 1.0),
    )  # fmt: skip
    for i, forecast in enumerate(forecasts):
        offset = (i - 0.5 * (len(forecasts) - 1)) * 0.6 / max(len(forecasts), 2)
        for place, name in enumerate(names):
            values = _values(rows, summary, times, forecast, name)
            for panel, three in zip(panels, values, strict=True):
                _mark(panel, three, place + offset, i, bars=not words)
    _dress(panels, names)
    _legend(figure, forecasts, words)
    return figure


def _values(
    rows: list[Row], summary: list[Row], times: list[Row], forecast: str, name: str
) -> list[Sequence[float]]:
    """Lower end, dot and upper end in each panel; empty where there is nothing to show."""

    def chosen(table: list[Row], region: str) -> list[Row]:
        found = [row for row in table if row["region"] == region]
        return [row for row in found if row["forecast"] == forecast]

    (line,), own, base = chosen(summary, name), chosen(rows, name), chosen(rows, ELLIPSE)
    if not line.get("episodes"):
        return [()] * 5
    timed = [(line["ratio_q25"], line["ratio"], line["ratio_q75"]) for line in chosen(times, name)]
    clearance = column(own, "clearance")
    return [
        (line["area_ratio"],) * 3,
        (clearance.min(), float(np.median(clearance)), float(np.median(clearance))),
        quartiles(100.0 * excess(own, base, "time_ratio_worst")),
        quartiles(100.0 * excess(own, base, "length_ratio_worst")),
        timed[0] if timed else (),
    ]


def _by_area(summary: list[Row]) -> list[str]:
    """Regions from the smallest to the largest, by their mean area over the forecasts."""
    sizes = {}
    for (name,), some in group(summary, "region").items():
        known = [float(line["area_ratio"]) for line in some if line.get("episodes")]
        sizes[name] = float(np.nan_to_num(np.mean(known or [np.inf]), nan=np.inf))
    return sorted(sizes, key=lambda name: sizes[name])


def _mark(panel: Any, three: Sequence[float], place: float, i: int, *, bars: bool) -> None:
    if not np.isfinite(three).all() or not len(three):
        return
    low, middle, high = three
    look = _look(i)
    if bars:
        panel.plot([low, high], [place, place], "-", color=look["color"], linewidth=1.0)
    panel.plot(middle, place, linestyle="", markeredgewidth=0.8, **look)


def _look(i: int) -> dict[str, Any]:
    """Return colour and marker of a forecast."""
    look = style(1 + i, MARKERS[-1] + MARKERS[:-1])
    hollow = {"markerfacecolor": "white"} if i else {}
    return {"color": look["color"], "marker": look["marker"], "markersize": 3.4, **hollow}


def _dress(panels: Any, names: list[str]) -> None:
    """Axes, units and the line at the paper's ellipse, or at touching discs."""
    labels = (
        "area over\nexact sum", "least clearance\n(m)", "extra time\nover ellipse (%)",
        "extra path\nover ellipse (%)", "solve time\nover ellipse",
    )  # fmt: skip
    for panel, text, line in zip(panels, labels, (1.0, 0.0, 0.0, 0.0, 1.0), strict=True):
        panel.axvline(line, color="black", linestyle=":", linewidth=0.9)
        panel.set_xlabel(text)
        panel.margins(x=0.12)
    left, right = panels[1].get_xlim()
    if left < 0.0:
        panels[1].axvspan(left, 0.0, color="0.88", linewidth=0.0, zorder=0)
        panels[1].set_xlim(left, right)
    _octaves(panels[-1])
    panels[0].set_yticks(range(len(names)), [title(name) for name in names])
    panels[0].set_ylim(len(names) - 0.4, -0.6)


def _octaves(panel: Any) -> None:
    """Logarithmic axis with ticks at powers of two: the ratios span little more than ten."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullLocator

    panel.set_xscale("log", base=2)
    panel.xaxis.set_major_locator(LogLocator(base=2, numticks=12))
    panel.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    panel.xaxis.set_minor_locator(NullLocator())


def _legend(figure: Any, forecasts: list[str], words: str) -> None:
    entries = [
        entry(f"{forecast} forecasts", **_look(i), linestyle="-", linewidth=1.0)
        for i, forecast in enumerate(forecasts)
    ]
    bars = words or "bars: quartiles\n(clearance: from the least; grey: collision)"
    entries.append(entry(f"dots: medians over the seeds; {bars}"))
    figure.legend(handles=entries, loc="outside lower center", ncols=len(entries))

"""Sums and ratios for the price of a region: areas, paired excesses, solve times."""

import numpy as np

from ...framework.mpc.planner.planner import Planner
from ...framework.values.arrays import Array
from ...framework.values.errors import WideberthError
from ...framework.values.forecast import GaussianObstacle
from ...regions.minkowski_sum import MinkowskiSum
from ...simulation.log.episode_log import Episode
from ..engine.base import Row
from ..engine.closed_loop import column, group
from .region_family import rounded

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
            times = levels[str(label["region"])]
            ratios = times / reference
            rows.append(
                {
                    **label,
                    "solves": len(own),
                    "solve_median_s": float(times[0]),
                    "solve_p95_s": float(times[1]),
                    "ratio": float(ratios[0]),
                    "ratio_p95": float(ratios[1]),
                }
            )
    return rows


def solve_times(times: list[Row]) -> list[Row]:
    """One line per forecast and region: solve times in ms, ratios with quartiles over seeds.

    ``ratio`` is of the medians of one seed, ``ratio_p95`` of the 95th percentiles: most plans
    of an episode are far from any region, the latter is about those that are not.
    """
    lines = []
    for (forecast, region), some in group(times, "forecast", "region").items():
        low, middle, high = quartiles(column(some, "ratio"))
        lines.append(
            {
                "forecast": forecast,
                "region": region,
                "solves": int(column(some, "solves").sum()),
                "median_ms": 1e3 * float(np.median(column(some, "solve_median_s"))),
                "p95_ms": 1e3 * float(np.median(column(some, "solve_p95_s"))),
                "ratio": middle,
                "ratio_q25": low,
                "ratio_q75": high,
                "ratio_p95": quartiles(column(some, "ratio_p95"))[1],
            }
        )
    return lines


def quartiles(values: Array) -> tuple[float, float, float]:
    """Quartiles and median of what is known, the median in the middle; nan where nothing is."""
    known = values[np.isfinite(values)]
    if not known.size:
        return float("nan"), float("nan"), float("nan")
    low, middle, high = map(float, np.quantile(known, (0.25, 0.5, 0.75)))
    return low, middle, high


def excess(some: list[Row], pairs: list[Row], name: str) -> Array:
    """Relative excess over the paired rows, where both arrived."""
    own, other = column(some, name), column(pairs, name)
    both = np.isfinite(column(some, "time_ratio_worst") + column(pairs, "time_ratio_worst"))
    return np.asarray(own[both] / other[both] - 1.0)

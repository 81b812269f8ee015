"""Metrics of an episode, each defined once. Functions of plain arrays.

Distances are between surfaces where they are called clearance, and between centres or to
a path otherwise. Positions are (T, D), m, NaN where something was absent; between two
instants everything moves in a straight line.
"""

from collections import Counter
from collections.abc import Iterable, Sequence

import numpy as np

from ..framework.numerics.chi_square import content_bound as content_bound
from ..framework.values.arrays import Array, BoolArray, checked_covariance
from ..framework.values.path import Path


def closest_approach(first: Array, second: Array) -> tuple[float, int]:
    """Smallest distance between two moving centres, m, and the interval in which it occurs.

    In each interval the relative position d(u) = d0 + u (d1 - d0), u in [0, 1], is nearest
    to the origin at u = -d0.(d1 - d0) / |d1 - d0|^2, cut off at 0 and 1. Returns (inf, -1)
    when the two are never present together over a whole interval.

    Examples
    --------
    >>> import numpy as np
    >>> past = np.array([[-1.0, 0.5], [1.0, 0.5]])
    >>> closest_approach(past, np.zeros((2, 2)))
    (0.5, 0)
    """
    distance = approach(first, second)
    if not np.isfinite(distance).any():
        return float("inf"), -1
    index = int(np.nanargmin(distance))
    return float(distance[index]), index


def approach(first: Array, second: Array) -> Array:
    """Smallest distance of two centres in each interval, (..., T - 1), m; NaN where absent.

    ``first`` and ``second`` are (..., T, D), m, and broadcast.
    """
    relative = np.asarray(first) - np.asarray(second)
    begin, move = relative[..., :-1, :], np.diff(relative, axis=-2)
    square = np.einsum("...d,...d->...", move, move)
    share = -np.einsum("...d,...d->...", begin, move) / np.where(square > 0, square, 1.0)
    nearest = begin + np.clip(share, 0.0, 1.0)[..., None] * move
    return np.asarray(np.linalg.norm(nearest, axis=-1))


def clearance(first: Array, second: Array, radii: float) -> float:
    """Smallest distance between the surfaces of two discs, m; negative in a collision.

    ``radii`` is the sum of the two radii, m; inf when they never were there together.
    """
    return closest_approach(first, second)[0] - radii


def collided(first: Array, second: Array, radii: float) -> bool:
    """Whether two discs overlapped at any moment, also between the instants."""
    return clearance(first, second, radii) < 0.0


def free_time(path: Path, speed: float) -> float:
    """Seconds that the path takes at the reference speed without obstacles."""
    return path.length / speed


def path_length(positions: Array) -> float:
    """Length of the way driven, m, the sum of |p_{t+1} - p_t|."""
    steps = np.linalg.norm(np.diff(positions, axis=0), axis=1)
    return float(np.nansum(steps))


def along_and_aside(positions: Array, path: Path) -> tuple[Array, Array]:
    """Arc length of the nearest point of the path, and distance to it, (T,) each, m.

    Meant for paths that do not cross themselves.
    """
    begin, step = path.points[:-1], np.diff(path.points, axis=0)
    length = np.diff(path.arc)
    offset = np.asarray(positions)[:, None] - begin
    share = np.clip(np.einsum("tsd,sd->ts", offset, step) / length**2, 0.0, 1.0)
    distance = np.linalg.norm(offset - share[..., None] * step, axis=-1)
    best = np.argmin(distance, axis=1)
    row = np.arange(len(best))
    return path.arc[best] + share[row, best] * length[best], distance[row, best]


def lateral_deviation(positions: Array, path: Path) -> float:
    """Largest distance from the own path, m. Head-on, who deviates more is who yields."""
    return float(np.nanmax(along_and_aside(positions, path)[1]))


def crossing_point(first: Path, second: Path) -> tuple[float, float] | None:
    """Arc lengths, m, at which two plane paths cross first; None if they do not."""
    for i, (p, r) in enumerate(zip(first.points[:-1], np.diff(first.points, axis=0), strict=True)):
        for j, (q, s) in enumerate(
            zip(second.points[:-1], np.diff(second.points, axis=0), strict=True)
        ):
            cross = r[0] * s[1] - r[1] * s[0]
            if cross == 0.0:
                continue
            gap = q - p
            u = (gap[0] * s[1] - gap[1] * s[0]) / cross
            v = (gap[0] * r[1] - gap[1] * r[0]) / cross
            if 0.0 <= u <= 1.0 and 0.0 <= v <= 1.0:
                return (
                    float(first.arc[i] + u * np.linalg.norm(r)),
                    float(second.arc[j] + v * np.linalg.norm(s)),
                )
    return None


def passing_time(times: Array, positions: Array, path: Path, arc: float) -> float:
    """When the robot's progress along its path first exceeds ``arc`` m; NaN if never.

    Of two robots whose paths cross, the one that passes the crossing point first passes in
    front of the other; the second one passes behind it, that is, it yields.
    """
    progress = along_and_aside(positions, path)[0]
    past = np.flatnonzero(progress >= arc)
    if not past.size:
        return float("nan")
    i = int(past[0])
    if i == 0:
        return float(times[0])
    share = (arc - progress[i - 1]) / (progress[i] - progress[i - 1])
    return float(times[i - 1] + share * (times[i] - times[i - 1]))


def time_statistics(seconds: Sequence[float] | Array) -> dict[str, float]:
    """Median, 95th and 99th percentile (linear interpolation) and maximum, s."""
    array = np.asarray(seconds, dtype=np.float64)
    if not array.size:
        return dict.fromkeys(("median", "p95", "p99", "max"), float("nan"))
    levels = np.quantile(array, (0.5, 0.95, 0.99, 1.0))
    return dict(zip(("median", "p95", "p99", "max"), map(float, levels), strict=True))


def deadline_misses(stamps: Array, effects: Array, period: float) -> int:
    """Count commands that took effect more than one period after their stamp."""
    late = np.asarray(effects) - np.asarray(stamps)
    return int(np.sum(late > period + 1e-9))


def tally(labels: Iterable[str]) -> dict[str, int]:
    """How often each label occurs (the rungs of the fallback ladder, say), sorted."""
    return dict(sorted(Counter(str(label) for label in labels).items()))


def share_named(fallbacks: Iterable[Sequence[str | None]]) -> float:
    """Share of forecasts that are truly the named predictor's; NaN without any.

    One forecast is one obstacle in one plan; None marks those without a fallback.
    """
    flat = [reason is None for plan in fallbacks for reason in plan]
    return float(np.mean(flat)) if flat else float("nan")


SMALLEST = 1e-12
"""m^2, below which a variance counts as this much: a certain forecast contains its own mean."""


def squared_mahalanobis(mean: Array, covariance: Array, points: Array) -> Array:
    """Squared Mahalanobis distance (x - mu)^T Sigma^-1 (x - mu), (..., D) -> (...).

    Eigenvalues of the covariance below `SMALLEST` count as that much.

    Raises
    ------
    WideberthError : what is no covariance, see `arrays.checked_covariance`.
    """
    values, vectors = np.linalg.eigh(
        checked_covariance("covariance", covariance, np.shape(mean)[-1])
    )
    turned = np.einsum("...ji,...j->...i", vectors, points - mean)
    return np.asarray(np.sum(turned**2 / np.maximum(values, SMALLEST), axis=-1))


def inside_content(mean: Array, covariance: Array, truth: Array, tail: float) -> BoolArray:
    """Whether the truth lies in the forecast's content region, (..., D) -> (...).

    `squared_mahalanobis` at most `content_bound`.

    Raises
    ------
    WideberthError : tail outside (0, 1), or what is no covariance.
    """
    square = squared_mahalanobis(mean, covariance, truth)
    return np.asarray(square <= content_bound(mean.shape[-1], tail), dtype=np.bool_)


def coverage(mean: Array, covariance: Array, truth: Array, tail: float) -> tuple[Array, Array]:
    """Share of later true positions inside the forecast's region, per step, and their number.

    Parameters
    ----------
    mean, covariance : (K, N, D) and (K, N, D, D), of K forecasts.
    truth : (K, N, D), m, what then happened; NaN where unknown (it does not count).
    tail : 1 - content of the region.

    Returns
    -------
    share : (N,), NaN where nothing is known; number : (N,).
    """
    known: BoolArray = np.asarray(np.isfinite(truth).all(axis=-1), dtype=np.bool_)
    inside = inside_content(mean, covariance, np.where(known[..., None], truth, mean), tail)
    number = known.sum(axis=0).astype(np.float64)
    hits = (inside & known).sum(axis=0)
    share = np.where(number > 0, hits / np.maximum(number, 1.0), np.nan)
    return np.asarray(share), np.asarray(number)

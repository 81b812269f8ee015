"""Errors of past forecasts, for calibrated predictors."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import TypeAlias

import numpy as np

from ...framework.calibration import Calibration, CalibrationScores
from ...framework.numerics.chi_square import content_bound
from ...framework.predictor import Fittable, Predictor
from ...framework.values.arrays import Array, altered, assembled, checked, positive
from ...framework.values.beliefs import Beliefs
from ...framework.values.errors import WideberthError
from ...framework.values.forecast import Forecast, heeded
from ...framework.values.measurements import measurements_on_grid
from ...framework.values.tracks import Tracks
from ...metrics.episode import SMALLEST, squared_mahalanobis
from ..data.windows import IntArray, Windows
from .assembly import more_modes

GRID = 80
"""Rows of the past that are on the grid of a forecast that knows all of it, as in a planner."""

Judge: TypeAlias = Callable[[Forecast, IntArray, Array], Array]
"""(forecast, indices of those forecast, where all are (O, N, D)) -> squared errors (P, N) of
those forecast, or (1, N) of all together."""


def squared_distances(mean: Array, covariance: Array, weight: Array, truth: Array) -> Array:
    """Squared Mahalanobis distance of the truth from the nearest mode, (O, N).

    d^2 = min over modes of (x - mu_m)' Sigma_m^-1 (x - mu_m)

    d^2 <= q says that the truth lies in the union of the modes' ellipses of size q, which is
    what a planner keeps clear of. Modes of weight below `LIGHT` do not count, as in plans. NaN
    where the truth is unknown.

    Parameters
    ----------
    mean, covariance, weight : of a `Forecast`, (O, M, N, D), (O, M, N, D, D), (O, M).
    truth : (O, N, D), m, NaN where unobserved.
    """
    square = squared_mahalanobis(mean, covariance, truth[:, None])
    some = heeded(weight)[..., None]
    return np.asarray(np.where(some, square, np.inf).min(axis=1, initial=np.inf))


def scaled(forecast: Forecast, known: Array, known_dt: float, tracks: Tracks) -> Forecast:
    """Multiply the covariances of each obstacle by one factor per step.

    Sigma_h -> s_h Sigma_h,   Cov(x_h, x_j) -> sqrt(s_h s_j) Cov(x_h, x_j)

    Scales are carried to the time since each obstacle was last seen: linear between the steps
    that are known, as at the first before it and as at the last after it.

    Parameters
    ----------
    known : (K,) or, of each obstacle its own, (O, K); above 0, for the times dt, 2 dt, ... of
        ``known_dt``, s.
    tracks : what was forecast.
    """
    last = known.shape[-1] - 1
    rows = known if known.ndim == 2 else np.broadcast_to(known, (len(tracks), last + 1))
    if known_dt == tracks.dt and not tracks.lag.any():  # the usual case: the same grid
        scale = rows[:, np.minimum(np.arange(forecast.steps), last)]
    else:
        times = tracks.lag[:, None] + tracks.dt * np.arange(1.0, forecast.steps + 1)
        place = np.clip(times / known_dt - 1.0, 0.0, last)
        below = np.minimum(place.astype(np.int64), max(last - 1, 0))
        share, above = place - below, np.minimum(below + 1, last)
        each = np.arange(len(tracks))[:, None]
        scale = (1.0 - share) * rows[each, below] + share * rows[each, above]
    joint = forecast.joint_source is not None
    return assembled(  # scales are above 0
        Forecast,
        mean=forecast.mean,
        covariance=forecast.covariance * scale[:, None, :, None, None],
        weight=forecast.weight,
        dt=forecast.dt,
        fallback=forecast.fallback,
        joint_source=partial(_scaled_joint, forecast, scale) if joint else None,
    )


def _scaled_joint(forecast: Forecast, scale: Array) -> Array:
    assert forecast.joint is not None
    root = np.repeat(np.sqrt(scale), forecast.mean.shape[-1], axis=1)
    return np.asarray(forecast.joint * (root[:, :, None] * root[:, None, :])[:, None])


def replayed(predictor: Predictor, scene: Tracks, windows: Windows) -> tuple[Array, Array, Array]:
    """Forecast every window from its own samples.

    Row by row and with all obstacles present there, so that a predictor which looks at
    neighbours sees the true ones.

    Parameters
    ----------
    predictor : to be asked.
    scene : the whole recording that the windows were cut from, or one with more tracks
        whose ``obstacle`` numbers mean the same.
    windows : at least one.

    Returns
    -------
    mean (W, M, N, D), covariance (W, M, N, D, D) and weight (W, M), in the windows' order.
    M is the most modes of any row; missing ones repeat the first with weight 0.
    """
    length, steps = windows.tracks.positions.shape[1], windows.future.shape[1]

    def forecast(row: int) -> tuple[Forecast, IntArray]:
        now, present = seen_at(scene, row, length)
        return predictor.predict(now, steps), present

    return _of_each_row(forecast, windows)


def followed(predictor: Predictor, scene: Tracks, windows: Windows) -> tuple[Array, Array, Array]:
    """Forecast every window from all that was seen before, as a planner does; see `replayed`."""
    steps, dt = windows.future.shape[1], scene.dt
    every = measurements_on_grid(scene.positions, dt, scene.noise)
    last = scene.positions.shape[1] - 1
    beliefs: Beliefs | None = None

    def forecast(row: int) -> tuple[Forecast, IntArray]:
        nonlocal beliefs
        now, present = seen_at(scene, row, GRID)
        stamp = dt * (row - last)
        seen = every.select(present.tolist())
        used = [int(times.searchsorted(stamp + 0.5 * dt)) for times in seen.times]
        seen = altered(seen.part([slice(number) for number in used]), log=tuple(present.tolist()))
        now = replace(now, stamp=stamp, sightings=seen)
        beliefs = predictor.filtered(now, beliefs)
        return predictor.ahead(beliefs, now, steps), present

    return _of_each_row(forecast, windows)


def _of_each_row(
    forecast: Callable[[int], tuple[Forecast, IntArray]], windows: Windows
) -> tuple[Array, Array, Array]:
    """Ask for the forecast of each row, in order, and sort what it says by window."""
    parts: list[tuple[Array, Array, Array]] = []
    order = np.argsort(windows.row, kind="stable")
    starts = np.flatnonzero(np.diff(windows.row[order], prepend=-1))
    for chosen in np.split(order, starts[1:]):
        said, present = forecast(int(windows.row[chosen[0]]))
        place = np.searchsorted(present, windows.obstacle[chosen])
        parts.append((said.mean[place], said.covariance[place], said.weight[place]))
    modes = max(part[2].shape[1] for part in parts)
    back = np.argsort(order, kind="stable")
    mean, covariance, weight = (
        np.concatenate([more_modes(part[k], modes, empty=k == 2) for part in parts])[back]
        for k in range(3)
    )
    return mean, covariance, weight


def of_each(forecast: Forecast, present: IntArray, future: Array) -> Array:
    """Squared distance of each person from its forecast, (P, N): a `Judge`."""
    return squared_distances(forecast.mean, forecast.covariance, forecast.weight, future[present])


def scored(
    base: Predictor,
    dataset: Sequence[Tracks],
    spans: Sequence[range],
    observed: int,
    steps: int,
    judge: Judge = of_each,
) -> CalibrationScores:
    """Score the forecasts of every row at which anyone is seen, of all who are seen there.

    Parameters
    ----------
    base : to be calibrated.
    dataset : recordings.
    spans : rows of each recording to forecast from; those within ``steps`` of its end are left
        out, as no one is seen beyond it.
    observed, steps : rows up to a forecast that are shown to the base, and rows after it.
    """
    squares, keys, rows = [np.zeros((0, steps))], [np.zeros((0, 4), dtype=np.int64)], []
    for number, (scene, span) in enumerate(zip(dataset, spans, strict=True)):
        used = span[: max(scene.positions.shape[1] - steps - span.start, 0)]
        rows.append(len(used))
        for place, row in enumerate(used):
            now, present = seen_at(scene, row, observed)
            if not len(present):
                continue
            future = scene.positions[:, row + 1 : row + 1 + steps]
            found = judge(base.predict(now, steps), present, future)
            lasting = np.isfinite(future[present]).all(axis=(1, 2))
            lasting &= np.isfinite(now.positions).all(axis=(1, 2)) & (row + 1 >= observed)
            same = np.full(len(present), number), np.full(len(present), place)
            known = np.isfinite(found).any(axis=1)
            squares.append(found[known])
            rest = np.stack([*same, present, lasting.astype(np.int64)], axis=1)
            keys.append(rest[: len(found)][known])
    recording, place, track, lasting = np.concatenate(keys).T
    whole = np.asarray(lasting > 0, dtype=np.bool_)
    count = tuple(rows)
    return CalibrationScores(
        np.concatenate(squares), recording, place, track, whole, count, dataset[0].dt
    )


def scored_in_time(
    base: Predictor, dataset: Sequence[Tracks], observed: int, steps: int, judge: Judge = of_each
) -> tuple[Predictor, CalibrationScores, CalibrationScores]:
    """Cut recordings in time: fit the base to the first halves, and score both halves.

    No future that is scored reaches from the first half into the second one.

    Returns
    -------
    The base, fitted where it can be; the scores of the first halves; those of the second ones.
    """
    middles = [scene.positions.shape[1] // 2 for scene in dataset]
    if isinstance(base, Fittable):
        firsts = [_until(scene, row) for scene, row in zip(dataset, middles, strict=True)]
        base = base.fit([scene for scene in firsts if len(scene)])
    early = [range(max(row - steps, 0)) for row in middles]
    lengths = [scene.positions.shape[1] for scene in dataset]
    late = [range(row, length) for row, length in zip(middles, lengths, strict=True)]
    learnt, scores = (
        scored(base, dataset, spans, observed, steps, judge) for spans in (early, late)
    )
    return base, learnt, scores


def _until(scene: Tracks, row: int) -> Tracks:
    """Return the rows before one, with those who are seen there."""
    past = scene.positions[:, :row]
    seen = np.asarray(np.isfinite(past).all(axis=2), dtype=np.bool_)
    present = np.flatnonzero(seen.any(axis=1)).tolist()
    stamp = scene.stamp - scene.dt * (scene.positions.shape[1] - row)
    return replace(scene, positions=past, stamp=stamp).select(present)


@dataclass(frozen=True)
class Scales:
    """Scales learnt by split conformal calibration.

    Attributes
    ----------
    dt : s, between the steps.
    scale : (N,), by which the covariance of each step is multiplied.
    groups : how many groups of forecasts it was learnt from, each of which counts as one.

    Raises
    ------
    WideberthError : no step, or a number that is not above 0.
    """

    dt: float
    scale: tuple[float, ...]
    groups: int

    def __post_init__(self) -> None:
        positive("scales.dt", self.dt)
        scale = checked("scales.scale", self.scale, (len(self.scale),))
        if not scale.size or (scale <= 0).any():
            raise WideberthError("scales.scale must hold one number at least, and all above 0")


def known_scales(
    calibration: Calibration,
    scores: CalibrationScores,
    tail: float,
    learnt: CalibrationScores | None,
    size: int,
    who: str,
) -> Scales:
    """Scale each step so that its region of content 1 - tail has the calibration's size.

    s_h = q_h / q_D,   q_D the quantile of chi^2_D, D = ``size``, at 1 - tail

    Raises
    ------
    WideberthError : fewer groups than the calibration needs.
    """
    groups = calibration.groups(scores)
    found = len(np.unique(groups[groups >= 0]))
    fewest = calibration.fewest(tail, scores.steps)
    if found < fewest:
        raise WideberthError(
            f"{who}.fit: {len(scores)} scored forecasts of {scores.steps} steps make {found} "
            f"groups that count as one each for {type(calibration).__name__}; wanted at least "
            f"{fewest} at a tail of {tail:g}: give more or longer recordings, or a larger tail"
        )
    # A base that is exactly right on all windows would leave a region without interior.
    sizes = np.maximum(calibration.sizes(scores, tail, learnt), SMALLEST)
    return Scales(scores.dt, tuple((sizes / content_bound(size, tail)).tolist()), found)


def same_step(dataset: Sequence[Tracks], who: str) -> None:
    """Refuse scenes with different dt: one step ahead would mean different times.

    Raises
    ------
    WideberthError : names the steps found.
    """
    steps = sorted({scene.dt for scene in dataset})
    if len(steps) > 1:
        raise WideberthError(
            f"{who}.fit: scenes have steps of {', '.join(f'{dt:g} s' for dt in steps)}; "
            "resample them to one, or fit a predictor to each"
        )


def seen_at(scene: Tracks, row: int, length: int) -> tuple[Tracks, IntArray]:
    """Return the tracks observed up to one row, and their indices.

    Parameters
    ----------
    row : newest row.
    length : rows of past, the newest included; fewer where the recording began later.
    """
    past = scene.positions[:, max(0, row + 1 - length) : row + 1]
    present = np.flatnonzero(np.isfinite(past[:, -1]).all(axis=1))
    joint = scene.state_covariance
    now = Tracks(
        past[present],
        scene.dt,
        tuple(scene.ids[index] for index in present),
        scene.radius[present],
        scene.noise[present],
        scene.stamp - scene.dt * (scene.positions.shape[1] - 1 - row),
        None if joint is None else joint[present],
    )
    return now, np.asarray(present, dtype=np.int64)

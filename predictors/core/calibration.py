"""Errors of past forecasts, for calibrated predictors."""

from collections.abc import Sequence
from functools import partial

import numpy as np

from ...framework.predictor import Predictor
from ...framework.tracking.windows import IntArray, Windows
from ...framework.values.arrays import Array
from ...framework.values.errors import WideberthError
from ...framework.values.forecast import LIGHT, Forecast
from ...framework.values.tracks import Tracks
from ...metrics.episode import squared_mahalanobis
from .assembly import more_modes
from .history import gather


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
    heeded = (weight >= LIGHT) | (weight == weight.max(axis=1, keepdims=True, initial=0.0))
    return np.asarray(np.where(heeded[..., None], square, np.inf).min(axis=1, initial=np.inf))


def scaled(forecast: Forecast, known: Array, known_dt: float, tracks: Tracks) -> Forecast:
    """Multiply the covariances of each obstacle by one factor per step.

    Sigma_h -> s_h Sigma_h,   Cov(x_h, x_j) -> sqrt(s_h s_j) Cov(x_h, x_j)

    Scales are carried to the time since each obstacle was last seen: linear between the steps
    that are known, as at the first before it and as at the last after it.

    Parameters
    ----------
    known : (K,) or, of each obstacle its own, (O, K); above 0, for the times dt, 2 dt, ... of
        ``known_dt``, s.
    tracks : what was forecast; the past steps of obstacles that are late are dropped.
    """
    late = gather(tracks).late
    times = tracks.dt * (late[:, None] + np.arange(1.0, forecast.steps + 1))
    grid = known_dt * np.arange(1, known.shape[-1] + 1)
    if known.ndim == 1:
        scale = np.interp(times, grid, known)
    else:
        rows = [np.interp(time, grid, own) for time, own in zip(times, known, strict=True)]
        scale = np.reshape(rows, times.shape)
    joint = forecast.joint_source is not None
    return Forecast(
        forecast.mean,
        forecast.covariance * scale[:, None, :, None, None],
        forecast.weight,
        forecast.dt,
        forecast.fallback,
        partial(_scaled_joint, forecast, scale) if joint else None,
    )


def _scaled_joint(forecast: Forecast, scale: Array) -> Array:
    assert forecast.joint is not None
    root = np.repeat(np.sqrt(scale), forecast.mean.shape[-1], axis=1)
    return np.asarray(forecast.joint * (root[:, :, None] * root[:, None, :])[:, None])


def replayed(
    predictor: Predictor, scene: Tracks, windows: Windows, length: int | None = None
) -> tuple[Array, Array, Array]:
    """Forecast every window from the samples observed up to its newest row.

    Row by row and with all obstacles present there, so that a predictor which looks at
    neighbours sees the true ones.

    Parameters
    ----------
    predictor : to be asked.
    scene : the whole recording that the windows were cut from, or one with more tracks
        whose ``obstacle`` numbers mean the same.
    windows : at least one.
    length : rows of past, the newest included; by default those of the windows.

    Returns
    -------
    mean (W, M, N, D), covariance (W, M, N, D, D) and weight (W, M), in the windows' order.
    M is the most modes of any row; missing ones repeat the first with weight 0.
    """
    own, steps = windows.tracks.positions.shape[1], windows.future.shape[1]
    parts: list[tuple[Array, Array, Array]] = []
    order = np.argsort(windows.row, kind="stable")
    starts = np.flatnonzero(np.diff(windows.row[order], prepend=-1))
    for chosen in np.split(order, starts[1:]):
        now, present = seen_at(scene, int(windows.row[chosen[0]]), length or own)
        forecast = predictor.predict(now, steps)
        place = np.searchsorted(present, windows.obstacle[chosen])
        parts.append((forecast.mean[place], forecast.covariance[place], forecast.weight[place]))
    modes = max(part[2].shape[1] for part in parts)
    back = np.argsort(order, kind="stable")
    mean, covariance, weight = (
        np.concatenate([more_modes(part[k], modes, empty=k == 2) for part in parts])[back]
        for k in range(3)
    )
    return mean, covariance, weight


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

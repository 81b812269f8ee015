"""Assembly of one `Forecast` from the Gaussians of each obstacle."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from ...framework.predictor import Adaptive, Predictor
from ...framework.values.arrays import Array, BoolArray
from ...framework.values.errors import WideberthError
from ...framework.values.forecast import Forecast, Scene
from ...framework.values.tracks import Tracks
from .history import Histories, IntArray

NEVER_SEEN_SPREAD = 1000.0
"""m, standard deviation given to an obstacle of which not one sample is known."""


@dataclass(frozen=True, eq=False)
class Gaussians:
    """One Gaussian per obstacle and step.

    Attributes
    ----------
    mean : (O, N, D), m.
    covariance : (O, N, D, D), m^2.
    reasons : per obstacle why the method was not fully used, or None.
    joint : computes (O, N*D, N*D), m^2, over the whole horizon when asked for; None if the
        method does not know it. It must be picklable (a partial of a module's function).
    """

    mean: Array
    covariance: Array
    reasons: tuple[str | None, ...]
    joint: Callable[[], Array] | None = None

    @property
    def steps(self) -> int:
        """N, the number of steps."""
        return int(self.mean.shape[1])


def finish(own: Gaussians, past: Histories, tracks: Tracks, name: str) -> Forecast:
    """Turn Gaussians into a forecast with the same number of steps.

    Obstacles never observed are seen to here. Nothing is known of them, so their mean is the
    world's origin (the one place where a forecast cannot turn and shift with the world) and
    their standard deviation `NEVER_SEEN_SPREAD`, the same unknown place at all steps.
    """
    unseen = np.asarray(past.samples == 0)
    if unseen.any():
        reasons = tuple(
            f"{name}: never observed" if missing else reason
            for missing, reason in zip(unseen, own.reasons, strict=True)
        )
        own = _without(own, unseen, NEVER_SEEN_SPREAD, reasons)
    return _forecast(own, tracks)


def _forecast(own: Gaussians, tracks: Tracks) -> Forecast:
    return Forecast.single(own.mean, own.covariance, tracks.dt, own.reasons, _source(own))


def _source(own: Gaussians | Forecast) -> Callable[[], Array] | None:
    """Return a function for the joint covariance, (O, M, N*D, N*D), m^2; None if not known."""
    if isinstance(own, Gaussians):
        return None if own.joint is None else partial(_single_mode, own.joint)
    return None if own.joint_source is None else partial(_joint, own)


def _joint(forecast: Forecast) -> Array:
    assert forecast.joint is not None
    return forecast.joint


def _single_mode(joint: Callable[[], Array]) -> Array:
    return joint()[:, None]


def _without(
    own: Gaussians, rows: BoolArray, spread: float, reasons: tuple[str | None, ...]
) -> Gaussians:
    """Set some rows to an unknown position with this standard deviation, m."""
    mean, covariance = own.mean.copy(), own.covariance.copy()
    mean[rows], covariance[rows] = 0.0, spread**2 * np.eye(own.mean.shape[2])
    joint = None if own.joint is None else partial(_joint_without, own.joint, rows, covariance)
    return Gaussians(mean, covariance, reasons, joint)


def _joint_without(joint: Callable[[], Array], rows: BoolArray, covariance: Array) -> Array:
    whole = joint().copy()
    steps = covariance.shape[1]
    whole[rows] = np.tile(covariance[rows, 0], (steps, steps)) if steps else whole[rows]
    return whole


def placed(own: Gaussians, rows: IntArray, count: int) -> Gaussians:
    """Scatter the values of some obstacles, (O,) of ``rows``, into ``count``; the rest is zero."""
    if len(rows) == count:
        return own
    mean = np.zeros((count, *own.mean.shape[1:]))
    covariance = np.zeros((count, *own.covariance.shape[1:]))
    mean[rows], covariance[rows] = own.mean, own.covariance
    reasons: list[str | None] = [None] * count
    for row, reason in zip(rows, own.reasons, strict=True):
        reasons[row] = reason
    joint = None if own.joint is None else partial(_joint_placed, own.joint, rows, count)
    return Gaussians(mean, covariance, tuple(reasons), joint)


def _joint_placed(joint: Callable[[], Array], rows: IntArray, count: int) -> Array:
    known = joint()
    whole = np.zeros((count, *known.shape[1:]))
    whole[rows] = known
    return whole


def with_fallback(
    own: Gaussians | Forecast,
    missing: Sequence[str | None],
    fallback: Predictor,
    tracks: Tracks,
    scene: Scene | None,
) -> Forecast:
    """Use the fallback predictor for obstacles that the named predictor cannot forecast.

    Parameters
    ----------
    own : what the named method says; anything where it could not be used.
    missing : per obstacle why it could not be used, or None.
    fallback : asked once, for all obstacles with a reason; it may return several modes
        (obstacles with fewer get the others with weight 0).
    tracks, scene : as given to `Predictor.predict`.

    Returns
    -------
    Forecast; its reasons name both, "var: 12 samples, needs 20; kalman: never observed".
    """
    index = [place for place, reason in enumerate(missing) if reason is not None]
    if not index:
        return _forecast(own, tracks) if isinstance(own, Gaussians) else own
    filled = fallback.predict(tracks.select(index), own.steps, narrowed(scene, index))
    source = _source(own)
    # What cannot be used is replaced before any of it is checked.
    if isinstance(own, Gaussians):
        reasons = list(own.reasons)
        parts = own.mean[:, None], own.covariance[:, None], np.ones((len(own.mean), 1))
    else:
        reasons = list(own.fallback)
        parts = own.mean, own.covariance, own.weight
    for place, deeper in zip(index, filled.fallback, strict=True):
        reasons[place] = both_reasons(str(missing[place]), deeper)
    modes = max(parts[0].shape[1], filled.mean.shape[1])
    mean, covariance, weight = (more_modes(part, modes, k == 2) for k, part in enumerate(parts))
    mean[index] = more_modes(filled.mean, modes)
    covariance[index] = more_modes(filled.covariance, modes)
    weight[index] = more_modes(filled.weight, modes, empty=True)
    joint = None
    if source is not None and filled.joint_source is not None:
        joint = partial(_joined, source, filled, index, modes)
    return Forecast(mean, covariance, weight, tracks.dt, tuple(reasons), joint)


def both_reasons(first: str, deeper: str | None) -> str:
    """Join the reason of the named method and that of its fallback predictor."""
    return first if deeper is None else f"{first}; {deeper}"


def refuse_adaptive(name: str, base: Predictor) -> None:
    """Refuse an adaptive base where nothing would update it.

    Raises
    ------
    WideberthError : the base is `Adaptive`.
    """
    if isinstance(base, Adaptive):
        raise WideberthError(
            f"{name} is {type(base).__name__}, which adapts while it runs, and nothing here would "
            "update it; put the adaptive predictor outermost"
        )


def narrowed(scene: Scene | None, index: list[int]) -> Scene | None:
    """Return the scene restricted to some of the obstacles."""
    if scene is None or scene.goals is None:
        return scene
    return replace(scene, goals=scene.goals[index])


def more_modes(values: Array, modes: int, empty: bool = False) -> Array:
    """Copy (O, M, ...) to more modes: repeats of the first one, or zeros."""
    extra = np.repeat(values[:, :1], modes - values.shape[1], axis=1)
    return np.concatenate([values, 0.0 * extra if empty else extra], axis=1)


def _joined(own: Callable[[], Array], filled: Forecast, index: list[int], modes: int) -> Array:
    joint = more_modes(own(), modes)
    joint[index] = more_modes(_joint(filled), modes)
    return joint

"""From forecasts of single obstacles to one `Forecast` of all."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..framework.arrays import Array
from ..framework.forecast import Forecast, Scene
from ..framework.predictor import Predictor
from ..framework.tracks import Tracks

NEVER_SEEN_SPREAD = 1000.0
"""m, standard deviation given to an obstacle of which not one sample is known."""


@dataclass(frozen=True, eq=False)
class Gaussian:
    """Forecast of one obstacle.

    Attributes
    ----------
    mean : (N, D), m.
    covariance : (N, D, D), m^2.
    joint : (N*D, N*D), m^2, over the whole horizon, or None.
    reason : why the named method was not used, or None.
    """

    mean: Array
    covariance: Array
    joint: Array | None = None
    reason: str | None = None

    @classmethod
    def from_joint(
        cls, mean: Array, joint: Array, reason: str | None = None, *, skip: int = 0
    ) -> "Gaussian":
        """Build it from the joint covariance alone, without the first ``skip`` steps."""
        size = mean.shape[1]
        kept = joint[skip * size :, skip * size :]
        kept = 0.5 * (kept + kept.T)
        steps = len(mean) - skip
        each = np.arange(steps)
        blocks = kept.reshape(steps, size, steps, size)[each, :, each, :]
        return cls(mean[skip:], blocks, kept, reason)


def never_observed(name: str, steps: int, size: int) -> Gaussian:
    """Forecast of an obstacle without a single sample.

    Nothing is known of it, so its mean is the world's origin (the one place where a
    forecast cannot turn and shift with the world) and its standard deviation
    `NEVER_SEEN_SPREAD`, the same unknown place at all steps.
    """
    joint = np.tile(NEVER_SEEN_SPREAD**2 * np.eye(size), (steps, steps))
    reason = f"{name}: never observed"
    return Gaussian.from_joint(np.zeros((steps, size)), joint, reason)


def assemble(parts: Sequence[Gaussian], tracks: Tracks, steps: int) -> Forecast:
    """Stack one Gaussian per obstacle; zero obstacles are allowed."""
    return _stack(list(parts), tracks, steps, None, [])


def with_fallback(
    own: Sequence[Gaussian | str],
    fallback: Predictor,
    tracks: Tracks,
    steps: int,
    scene: Scene | None,
) -> Forecast:
    """Let another predictor fill in where the named one could not be used.

    Parameters
    ----------
    own : per obstacle its forecast, or the reason why there is none.
    fallback : asked once, for all obstacles with a reason; it may return several modes
        (obstacles with one mode get the others with weight 0).
    tracks, steps, scene : as given to `Predictor.predict`.

    Returns
    -------
    Forecast; its reasons name both, "var: 12 samples, needs 20; kalman: never observed".
    """
    missing = [index for index, part in enumerate(own) if isinstance(part, str)]
    filled = None
    if missing:
        filled = fallback.predict(tracks.select(missing), steps, _narrow(scene, missing))
    return _stack(list(own), tracks, steps, filled, missing)


def _narrow(scene: Scene | None, index: list[int]) -> Scene | None:
    """Return the scene for some of the obstacles."""
    if scene is None or scene.goals is None:
        return scene
    return replace(scene, goals=scene.goals[index])


def _stack(
    own: list[Gaussian | str],
    tracks: Tracks,
    steps: int,
    filled: Forecast | None,
    missing: list[int],
) -> Forecast:
    """Allocate (O, M, ...) arrays and put each part into its row."""
    count, size = len(own), tracks.dimension
    modes = 1 if filled is None else filled.mean.shape[1]
    mean = np.zeros((count, modes, steps, size))
    covariance = np.zeros((count, modes, steps, size, size))
    joint = np.zeros((count, modes, steps * size, steps * size))
    weight = np.zeros((count, modes))
    reasons: list[str | None] = [None] * count
    whole = filled is None or filled.joint is not None
    for index, part in enumerate(own):
        if isinstance(part, str):
            continue
        mean[index], covariance[index] = part.mean, part.covariance
        weight[index, 0] = 1.0
        reasons[index] = part.reason
        if part.joint is None:
            whole = False
        else:
            joint[index] = part.joint
    if filled is not None:
        mean[missing], covariance[missing] = filled.mean, filled.covariance
        weight[missing] = filled.weight
        if filled.joint is not None:
            joint[missing] = filled.joint
        for index, deeper in zip(missing, filled.fallback, strict=True):
            first = str(own[index])
            reasons[index] = first if deeper is None else f"{first}; {deeper}"
    return Forecast(mean, covariance, weight, tracks.dt, tuple(reasons), joint if whole else None)

"""Single steps of the compiled filter loop."""

import numpy as np

from wideberth.framework.values.arrays import Array
from wideberth.predictors.core.kalman_filter import ModeStates, ModeStep, _run, moved, whitened


def still(modes: ModeStates, switching: Array | None = None) -> ModeStep:
    """Return a step in which nothing moves, with the chain (M, M, L)."""
    components, _, number, _ = modes.state.shape
    if switching is None:
        switching = np.eye(number)[..., None]
    lengths = switching.shape[-1]
    unit = np.ones((1, 1, number, lengths)) * np.eye(components)[:, :, None, None]
    return ModeStep(unit, np.zeros_like(unit), np.ascontiguousarray(switching))


def mixed(modes: ModeStates, switching: Array) -> ModeStates:
    """Return the modes after a switch alone."""
    return moved(modes, still(modes, switching))


def updated(modes: ModeStates, place: Array, noise: Array) -> ModeStates:
    """Return the modes after a position (D, O), m, with covariance (O, D, D), m^2, alone."""
    components, size, number, count = modes.state.shape
    copy = ModeStates(*(part.copy() for part in modes))
    once, first = np.ones(count, dtype=np.int64), (np.zeros(components - 1), np.ones(number))
    measured = np.ascontiguousarray(place.T), noise, whitened(noise)
    _run(copy, np.zeros((size, count)), once.copy(), np.arange(count + 1), measured, once,
         0 * once, still(modes), first)  # fmt: skip
    return copy

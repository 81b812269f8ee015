"""Growth of uncertainty over the horizon in a linear Gaussian model: pure functions.

Notation: dT is the step, h counts steps ahead, D is the dimension of a position, S that of the
state, N the number of steps, O the number of obstacles.
"""

import numpy as np

from ...framework.values.arrays import Array
from .history import IntArray


def white_steps(times: Array, density: float) -> tuple[Array, Array]:
    """Transition and process covariance of an axis in times (L,), s, (2, 2, L) each.

    f = [[1, t], [0, 1]],   q = density [[t^3/3, t^2/2], [t^2/2, t]]

    for the state (position, velocity) and white acceleration of a spectral density, m^2/s^3.
    """
    one, zero = np.ones(len(times)), np.zeros(len(times))
    square = 0.5 * times**2
    process: Array = density * np.array([[times**3 / 3.0, square], [square, times]])
    return np.array([[one, times], [zero, one]]), process


def white_acceleration(dt: float, density: float, size: int) -> tuple[Array, Array]:
    """Transition and process covariance of a velocity that drifts as a random walk.

    F = f kron I,  Q = q kron I  with f and q of `white_steps`, for the state (position, velocity),
    each of ``size`` components.
    """
    transition, process = white_steps(np.array([dt]), density)
    eye = np.eye(size)
    wide = np.kron(transition[..., 0], eye), np.kron(process[..., 0], eye)
    return wide[0].astype(np.float64), wide[1].astype(np.float64)


def cut_steps(joint: Array, steps: int, size: int, late: IntArray) -> Array:
    """Drop the first ``late`` steps of each obstacle from its joint covariance."""
    column = (late[:, None] * size + np.arange(steps * size)).astype(np.int64)
    row = np.arange(len(joint))[:, None, None]
    return np.asarray(joint[row, column[:, :, None], column[:, None, :]])


def after(values: Array, steps: int, late: IntArray) -> Array:
    """Keep the steps late + 1 to late + N of values (O, late + N or more, ...)."""
    if not late.any():
        return values[:, :steps]
    return np.asarray(values[np.arange(len(values))[:, None], late[:, None] + np.arange(steps)])


def joint_covariance(
    transition: Array, process: Array, start: Array, size: int, steps: int
) -> Array:
    """Covariance of the positions at all steps together, (N*D, N*D), m^2.

    P_h = F P_{h-1} F' + Q,   Cov(s_j, s_h) = F^(j-h) P_h  for j >= h

    Parameters
    ----------
    transition : (S, S), F; the first ``size`` components of the state are the position.
    process : (S, S), Q.
    start : (S, S), P_0.
    size : D.
    steps : N.
    """
    reads = [np.eye(len(transition))[:size]]
    for _ in range(1, steps):
        reads.append(reads[-1] @ transition)
    powers = np.stack(reads) if steps else np.zeros((0, size, len(transition)))
    joint = np.zeros((steps, size, steps, size))
    covariance = start
    for h in range(steps):
        covariance = transition @ covariance @ transition.T + process
        blocks = powers[: steps - h] @ covariance[:, :size]
        joint[h:, :, h, :] = blocks
        joint[h, :, h:, :] = blocks.transpose(2, 0, 1)
    return joint.reshape(steps * size, steps * size)

"""The social force of Moussaïd et al. between people, as a function of plain arrays."""

import numpy as np

from ..framework.values.arrays import Array

TINY = 1e-9
"""m; keeps the range of the force above zero where nothing moves against each other."""


def interaction_force(
    towards: Array,
    approach: Array,
    velocity_weight: float = 2.0,
    range_factor: float = 0.35,
    turning: float = 2.0,
    slowing: float = 3.0,
) -> Array:
    """Force of one walker on another, without its factor, (..., 2).

    ::

        D = lambda (v - v_j) + e,    t = D / |D|,    B = gamma |D|
        f = -exp(-d / B) (exp(-(n' B theta)^2) t + sign(theta) exp(-(n B theta)^2) left(t))

    with e the unit vector to the other walker, d the distance of the centres, theta the angle
    from t to e in [-pi, pi]: the first term slows down, the second one turns to the side on which
    the other is not.

    Parameters
    ----------
    towards : (..., 2), m, position of the other minus the own.
    approach : (..., 2), m/s, own velocity minus the other's.
    velocity_weight : lambda, s/m.
    range_factor : gamma, m.
    turning, slowing : n and n', 1/(m rad).
    """
    distance = np.linalg.norm(towards, axis=-1)
    ahead = towards / np.where(distance > 0.0, distance, 1.0)[..., None]
    interaction = velocity_weight * approach + ahead
    length = np.linalg.norm(interaction, axis=-1)
    t = interaction / np.where(length > 0.0, length, 1.0)[..., None]
    left = np.stack([-t[..., 1], t[..., 0]], axis=-1)
    theta = np.arctan2((left * ahead).sum(axis=-1), (t * ahead).sum(axis=-1))
    reach = np.maximum(range_factor * length, TINY)
    slow = np.exp(-distance / reach - (slowing * reach * theta) ** 2)
    turn = np.exp(-distance / reach - (turning * reach * theta) ** 2)
    return np.asarray(-slow[..., None] * t - (np.sign(theta) * turn)[..., None] * left)

"""Turns of the plane, and the gauge of an ellipse plus a disc in the eigenframe, vectorised.

``axes`` are semi-axes in m, from large to small; a zero axis is allowed everywhere.
"""

from typing import TypeVar

import numpy as np

from ..values.arrays import Array

Angle = TypeVar("Angle", float, Array)


def plane_turn(angle: float) -> Array:
    """Return the matrix that turns the plane by an angle, rad."""
    cosine, sine = np.cos(angle), np.sin(angle)
    return np.array([[cosine, -sine], [sine, cosine]])


def wrapped(angle: Angle) -> Angle:
    """Return angles brought to [-pi, pi), rad."""
    return (angle + np.pi) % (2.0 * np.pi) - np.pi


def concave_maximiser(
    coordinates: Array, squares: Array, disc: Array, lowest: float, highest: float
) -> Array:
    """Where F(t) = sum_i x_i^2 t (1 - t) / ((1 - t) a_i^2 + t R^2) is largest, (...).

    F is concave (a sum of parallel sums), so the sign of its slope is bisected:
    F' = sum_i x_i^2 (a_i^2 (1 - t)^2 - R^2 t^2) / ((1 - t) a_i^2 + t R^2)^2.

    Parameters
    ----------
    coordinates : (..., D), m, in the eigenframe.
    squares : (..., D), m^2, a_i^2.
    disc : (...), m^2, R^2.
    lowest, highest : ends of the interval of t.
    """
    x2 = coordinates**2
    disc = np.asarray(disc)[..., None]
    shape = np.broadcast_shapes(x2.shape, squares.shape, disc.shape)[:-1]
    low, high = np.full(shape, lowest), np.full(shape, highest)
    for _ in range(55):
        t = 0.5 * (low + high)[..., None]
        below = np.maximum((1.0 - t) * squares + t * disc, 1e-150)
        slope = (x2 * (squares * (1.0 - t) ** 2 - disc * t**2) / below**2).sum(axis=-1)
        rising = slope > 0
        low, high = np.where(rising, t[..., 0], low), np.where(rising, high, t[..., 0])
    return np.asarray(0.5 * (low + high))


def sum_gauge(coordinates: Array, axes: Array, margin: Array) -> Array:
    """Gauge of ellipse plus disc: below 1 inside, 1 on the boundary; (..., D) -> (...).

    The square root of max_t F(t), see `concave_maximiser`; infinite off a flat set without
    margin.
    """
    squares, disc = np.asarray(axes) ** 2, np.asarray(margin, dtype=np.float64) ** 2
    x2 = np.asarray(coordinates) ** 2
    t = concave_maximiser(coordinates, squares, disc, 0.0, 1.0)[..., None]
    a2, b2 = np.broadcast_arrays(squares, disc[..., None])
    with np.errstate(divide="ignore", invalid="ignore"):
        blend = t * (1.0 - t) / ((1.0 - t) * a2 + t * b2)
        blend = np.where(a2 == 0.0, (1.0 - t) / b2, blend)
        blend = np.where(b2 == 0.0, t / a2, blend)
        terms = np.where(x2 > 0.0, x2 * blend, 0.0)
    return np.asarray(np.sqrt(terms.sum(axis=-1)))

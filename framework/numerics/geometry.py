"""Distances, perimeters and gauges of ellipses, all in the eigenframe and vectorised.

``axes`` are semi-axes in m, from large to small; a zero axis is allowed everywhere.
"""

from typing import TypeVar

import numpy as np

from ..values.arrays import Array, BoolArray

Angle = TypeVar("Angle", float, Array)

UNIT_BALL = {2: np.pi, 3: 4.0 / 3.0 * np.pi}
"""Area of the unit disc and volume of the unit ball, by dimension."""

_FLAT = 1e-60
"""Below this share of the largest axis an ellipse counts as flat: ratios squared stay finite."""


def plane_turn(angle: float) -> Array:
    """Return the matrix that turns the plane by an angle, rad."""
    cosine, sine = np.cos(angle), np.sin(angle)
    return np.array([[cosine, -sine], [sine, cosine]])


def wrapped(angle: Angle) -> Angle:
    """Return angles brought to [-pi, pi), rad."""
    return (angle + np.pi) % (2.0 * np.pi) - np.pi


def closest_point(points: Array, axes: Array) -> Array:
    """Nearest point on the boundary of an ellipse or ellipsoid, (..., D) m.

    Solves G(u) = sum_i (n_i / (u + d_i))^2 - 1 = 0 with z = x / a, r_i = (a_i / a_D)^2,
    n_i = r_i z_i, d_i = r_i - 1, which decreases in u; then the point is r_i x_i / (u + d_i).
    A flat ellipsoid (a_D = 0) is taken as the flat set itself. Where the nearest point is not
    unique one of them is returned.

    Parameters
    ----------
    points : (..., D), m, in the eigenframe.
    axes : (..., D), m, from large to small.

    References
    ----------
    D. Eberly, Distance from a point to an ellipse, an ellipse, or a hyperellipsoid. There
    s = u - 1 is bisected, which loses all digits near the centre.
    """
    points, axes = np.broadcast_arrays(
        np.asarray(points, dtype=np.float64), np.asarray(axes, dtype=np.float64)
    )
    size = points.shape[-1]
    x, a = np.abs(points.reshape(-1, size)), axes.reshape(-1, size)
    nearest = _closest_positive(x, a)
    return np.asarray(np.copysign(nearest, points.reshape(-1, size)).reshape(points.shape))


def _closest_positive(x: Array, a: Array) -> Array:
    nearest = np.zeros_like(x)
    flat = a[:, -1] <= _FLAT * a[:, 0]
    full = ~flat
    if full.any():
        nearest[full] = _closest_full(x[full], a[full])
    if flat.any() and x.shape[1] > 1:
        lower_x, lower_a = x[flat, :-1], a[flat, :-1]
        edge = _closest_positive(lower_x, lower_a)
        within = _inside(lower_x, lower_a)
        nearest[flat, :-1] = np.where(within[:, None], lower_x, edge)
    return nearest


def _inside(x: Array, a: Array) -> BoolArray:
    solid = np.maximum(a, 1e-300)
    return np.asarray(np.hypot.reduce(x / solid, axis=-1) < 1.0)


def _closest_full(x: Array, a: Array) -> Array:
    """Bisect G until the midpoint equals an end, for all points at once."""
    least = a[:, -1:]
    z = x / a
    ratio = (a / least) ** 2
    n, d = ratio * z, (a - least) * (a + least) / least**2
    low = z[:, -1].copy()
    high = np.where(_inside(x, a), 1.0, np.maximum(np.hypot.reduce(n, axis=-1), low))
    on_plane = _pole(x, a, n, d)
    active = np.flatnonzero(np.isnan(on_plane[:, 0]))
    while active.size:
        middle = 0.5 * (low[active] + high[active])
        open_ = (middle > low[active]) & (middle < high[active])
        active, middle = active[open_], middle[open_]
        with np.errstate(over="ignore"):
            above = ((n[active] / (middle[:, None] + d[active])) ** 2).sum(axis=1) > 1.0
        low[active[above]], high[active[~above]] = middle[above], middle[~above]
    u = high
    share = np.divide(ratio, u[:, None] + d, out=np.zeros_like(x), where=u[:, None] + d > 0)
    share[:, -1] = np.divide(1.0, u, out=np.zeros_like(u), where=u > 0)
    nearest = share * x
    return np.where(np.isfinite(on_plane[:, :1]), on_plane, nearest)


def _pole(x: Array, a: Array, n: Array, d: Array) -> Array:
    """Nearest points for x_D = 0 between the cusps of the evolute (u = 0); NaN elsewhere."""
    size = x.shape[1]
    share = np.full((len(x), size), np.nan)
    share[:, :-1] = np.divide(n[:, :-1], d[:, :-1], out=share[:, :-1], where=d[:, :-1] > 0)
    share[:, :-1][(d[:, :-1] <= 0) & (x[:, :-1] == 0)] = 0.0
    rest = 1.0 - (share[:, :-1] ** 2).sum(axis=1)
    valid = (x[:, -1] == 0) & (rest >= 0)  # NaN compares false
    share[:, -1] = np.sqrt(np.where(valid, rest, 0.0))
    return np.where(valid[:, None], share * a, np.nan)


def distance_to_ellipse(points: Array, axes: Array) -> Array:
    """Distance to the boundary, m, negative inside: (..., D) -> (...).

    For a flat ellipse it is the distance to the flat set, which has no inside.
    """
    points = np.asarray(points, dtype=np.float64)
    offset = points - closest_point(points, axes)
    x, a = np.broadcast_arrays(np.abs(points), np.asarray(axes, dtype=np.float64))
    inside = _inside(x, a) & (a[..., -1] > _FLAT * a[..., 0])
    length = np.hypot.reduce(offset, axis=-1)
    return np.asarray(np.where(inside, -length, length))


def perimeter(axes: Array) -> Array:
    """Perimeter of an ellipse, m, 8 R_G(0, a^2, b^2): (..., 2) -> (...)."""
    from scipy.special import elliprg

    squares = np.asarray(axes, dtype=np.float64) ** 2
    perimeter = 8.0 * elliprg(0.0, squares[..., 0], squares[..., 1])
    return np.asarray(perimeter, dtype=np.float64)


def surface(axes: Array) -> Array:
    """Surface of an ellipsoid, m^2: (..., 3) -> (...).

    4 pi R_G(a^2 b^2, a^2 c^2, b^2 c^2), which is 4 pi a b c R_G(a^-2, b^-2, c^-2) by the
    homogeneity of R_G and stays finite for flat ellipsoids.
    """
    from scipy.special import elliprg

    a, b, c = np.moveaxis(np.asarray(axes, dtype=np.float64) ** 2, -1, 0)
    return np.asarray(4.0 * np.pi * elliprg(a * b, a * c, b * c))


def mean_support(axes: Array) -> Array:
    """Mean of the support function of an ellipsoid, m, R_G(a^2, b^2, c^2); half the width."""
    from scipy.special import elliprg

    a, b, c = np.moveaxis(np.asarray(axes, dtype=np.float64) ** 2, -1, 0)
    return np.asarray(elliprg(a, b, c))


def mean_cubed_support(axes: Array) -> Array:
    """Mean of h^3 over directions, h the support function of an ellipsoid, m^3: (..., 3) -> (...).

    With e_k the elementary symmetric functions of the squared axes,

        (4 e_1 R_G - e_2 R_F - sqrt(e_3)) / 8,

    by the recurrence of Carlson's R_-p in p, which ends here since its next term is elementary.
    """
    from scipy.special import elliprf, elliprg

    a, b, c = np.moveaxis(np.asarray(axes, dtype=np.float64) ** 2, -1, 0)
    pairs = a * b + a * c + b * c
    solid = pairs > 0.0  # with two axes of zero R_F is infinite and its factor zero
    product = pairs * elliprf(*(np.where(solid, value, 1.0) for value in (a, b, c)))
    total = 4.0 * (a + b + c) * elliprg(a, b, c)
    return np.asarray((total - product - np.sqrt(a * b * c)) / 8.0)


def sum_volume(axes: Array, margin: Array) -> Array:
    """Area (m^2) or volume (m^3) of ellipse plus disc by Steiner's formula."""
    axes, margin = np.asarray(axes, dtype=np.float64), np.asarray(margin, dtype=np.float64)
    if axes.shape[-1] == 2:
        return np.asarray(
            np.pi * axes.prod(axis=-1) + perimeter(axes) * margin + np.pi * margin**2
        )
    return np.asarray(
        4.0 / 3.0 * np.pi * (axes.prod(axis=-1) + margin**3)
        + surface(axes) * margin
        + 4.0 * np.pi * mean_support(axes) * margin**2
    )


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

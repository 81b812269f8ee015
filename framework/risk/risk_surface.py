"""Covering the boundary of one 3-D region, with what holds at each point of it."""

import numpy as np

from ..values.arrays import Array
from .risk_walk import Readings, Survey, Walk, joined

_STEPS = 32
"""Nodes of the rules for the boundary; see `_directions`."""

_TAIL_STEPS = 64
"""The same for the tail, whose integrand has kinks where the region has edges."""

_NUDGE = 1e-6
"""Step of the differences, rad: relative errors of about 1e-6 from the bend and from rounding."""

_CLOSE = 4e-6
"""Step, rad, at which the search ends: the square of it is the error of a smooth extreme."""

_ROUNDING = 1e-14
"""Share by which a point must be better to be moved to."""

_ROUNDS = 80
"""Of the search, at most."""

_GOLDEN = np.pi * (3.0 - np.sqrt(5.0))


def surface(walk: Walk) -> Survey:
    """Cover the boundary of a 3-D region and search around the best points for each extreme.

    The directions are those of `_directions` with the region's own half-widths w along the
    eigenvectors. The boundary is the surface m(u) w * u with u on the sphere, and has, per area
    of the sphere, the area

        |w_1 w_2 w_3 (m^2 u - m grad m) / w|,

    with the gradient along the sphere by differences; the mean of the risk is weighted with it.
    """
    widths = _widths(walk)
    u, solid, density = _directions(widths, _STEPS)
    coarse = walk.read(_rays(walk, widths, u))
    area = solid * density * _stretch(walk, widths, u, coarse)
    fine = _refined(walk, widths, u, coarse)
    return Survey(coarse, fine, solid / solid.sum(), area / area.sum(), walk.tail(_tail_rule))


def _tail_rule(deviations: Array) -> tuple[Array, Array]:
    """Spread directions in the frame in which the covariance is round, with their weights."""
    u, solid, density = _directions(deviations, _TAIL_STEPS)
    return u, solid * density


def _directions(widths: Array, steps: int) -> tuple[Array, Array, Array]:
    """Directions u that are dense both in the world and where w * u is.

    A product rule on the sphere, Gauss-Legendre along one axis and equal steps around it, is
    used twice: for the rays w * u in the world, and for u, which follows thin regions. Against
    the solid angle in the world the second has the density

        q(u) = |w * u|^3 / (w_1 w_2 w_3),

    and with all weights over 1 + q both together integrate over the solid angle: each rule
    counts where it is the denser one, and neither has to resolve a peak of the other's.

    Parameters
    ----------
    widths : (3,), w, m, above 0.
    steps : nodes along the axis, and half as many as around it, of each rule.

    Returns
    -------
    u : (4 steps^2, 3), unit vectors along the eigenvectors.
    solid : (4 steps^2,), weights over the solid angle of w * u.
    density : (4 steps^2,), q; ``solid * density`` are weights over the sphere of u.
    """
    nodes, weights = _sphere(steps)
    even = nodes / (widths / widths[0])
    u = np.concatenate([even / np.hypot.reduce(even, axis=-1)[:, None], nodes])
    relative = widths / np.cbrt(widths.prod())
    density = np.hypot.reduce(relative * u, axis=-1) ** 3
    return u, np.tile(weights, 2) / (1.0 + density), density


def _sphere(steps: int) -> tuple[Array, Array]:
    """Return unit vectors (2 steps^2, 3) and weights that add up to 1; the pole is first."""
    points, weights = np.polynomial.legendre.leggauss(steps)
    angle = np.pi * (np.arange(2 * steps) + 0.5) / steps
    height, turn = (grid.ravel() for grid in np.meshgrid(points, angle, indexing="ij"))
    ring = np.sqrt(1.0 - height**2)
    nodes = np.stack([height, ring * np.cos(turn), ring * np.sin(turn)], axis=-1)
    return nodes, np.repeat(weights, 2 * steps) / (4.0 * steps)


def _widths(walk: Walk) -> Array:
    """Half-widths of the region along the eigenvectors, m, (3,)."""
    ray = np.concatenate([walk.vectors.T, -walk.vectors.T])
    return np.asarray(walk.radius(ray, walk.parameters).reshape(2, -1).mean(axis=0))


def _rays(walk: Walk, widths: Array, u: Array) -> Array:
    """Return unit vectors (K, 3) in the world along w * u."""
    stretched = widths * u
    return np.asarray(stretched / np.hypot.reduce(stretched, axis=-1)[:, None] @ walk.vectors.T)


def _tangents(u: Array) -> tuple[Array, Array]:
    """Two unit vectors (K, 3) each, which with u (K, 3) form a right-handed frame."""
    aside = np.eye(3)[np.argmin(np.abs(u), axis=-1)]
    first = np.asarray(np.cross(u, aside), dtype=np.float64)
    first /= np.hypot.reduce(first, axis=-1)[:, None]
    return first, np.asarray(np.cross(u, first), dtype=np.float64)


def _stretch(walk: Walk, widths: Array, u: Array, found: Readings) -> Array:
    """Area of the boundary per area of the sphere of u, m^2, (K,)."""
    tangents = _tangents(u)

    def multiple(u: Array, radius: Array) -> Array:
        return np.asarray(radius / np.hypot.reduce(widths * u, axis=-1))

    offset = found.points - walk.obstacle.mean
    m = multiple(u, np.hypot.reduce(offset, axis=-1))[:, None]
    slope = np.zeros_like(u)
    for tangent in tangents:
        near = u + _NUDGE * tangent
        moved = multiple(near, walk.radius(_rays(walk, widths, near), walk.parameters))[:, None]
        slope += (moved - m) / _NUDGE * tangent
    normal = widths.prod() * (m**2 * u - m * slope) / widths
    return np.asarray(np.hypot.reduce(normal, axis=-1))


def _refined(walk: Walk, widths: Array, u: Array, coarse: Readings) -> Readings:
    """Search around the best point in each third of the sphere and return all points.

    A third is where one coordinate of u is the largest: mirror images of one extreme, which are
    equally good, cannot then crowd out another. The search looks in six directions around each
    point, turned by the golden angle from round to round so that no ridge stays unseen, moves
    to the best and halves its step where none is better.
    """
    values = np.stack(coarse.sought())
    third = np.argmax(np.abs(u), axis=-1)
    kind, at = (
        grid.ravel()
        for grid in np.broadcast_arrays(
            np.arange(len(values))[:, None],
            np.stack([np.where(third == i, values, np.inf).argmin(axis=1) for i in range(3)], -1),
        )
    )
    centre, best, step = u[at], values[kind, at], np.full(len(at), 2.0 / _STEPS)
    every = [coarse]
    for turn in range(_ROUNDS):
        open_ = np.flatnonzero(step > _CLOSE)
        if not open_.size:
            break
        near = _ring(centre[open_], step[open_], _GOLDEN * turn)
        found = walk.read(_rays(walk, widths, near.reshape(-1, 3)))
        every.append(found)
        row = np.arange(len(open_))
        value = np.stack(found.sought()).reshape(len(values), len(open_), -1)[kind[open_], row]
        pick = np.argmin(value, axis=1)
        new, old = value[row, pick], best[open_]
        better = new < old - _ROUNDING * np.abs(old)
        centre[open_[better]] = near[row, pick][better]
        best[open_[better]] = new[better]
        step[open_[~better]] *= 0.5
    return joined(*every)


def _ring(centre: Array, step: Array, turn: float) -> Array:
    """Six unit vectors around each one, (K, 3) and steps (K,) rad -> (K, 6, 3)."""
    angle = turn + np.pi / 3.0 * np.arange(6)
    first, second = (tangent[:, None] for tangent in _tangents(centre))
    aside = np.cos(angle)[:, None] * first + np.sin(angle)[:, None] * second
    near = centre[:, None] + step[:, None, None] * aside
    return np.asarray(near / np.hypot.reduce(near, axis=-1)[..., None])

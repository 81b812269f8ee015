"""Walking along the boundary of one 2-D region, with what holds at each point of it."""

from dataclasses import dataclass
from typing import final

import numpy as np

from ..region import Region
from ..values.arrays import Array, whole
from ..values.errors import WideberthError
from ..values.forecast import GaussianObstacle
from .risk_walk import Readings, Survey, Walk, joined, start

COUNT = 721
"""Points along the boundary from each of two rules; see `along_boundary`."""

_ZOOM = 65
"""Points per bracket and round of the refinement, which narrows each bracket 32 times."""


@final
@dataclass(frozen=True, eq=False)
class Boundary(Readings):
    """The boundary of a 2-D region, counter-clockwise around the mean.

    Attributes
    ----------
    angles : (K,), rad, polar angle of each point around the mean, increasing.
    """

    angles: Array


def along_boundary(
    region: Region, obstacle: GaussianObstacle, margin: float, level: float, count: int = COUNT
) -> Boundary:
    """Walk along a region's boundary in about ``2 * count`` points.

    Half of the directions are those of ``region.boundary``, dense where it bends; the others are
    at equal steps of the boundary's length, since straight sides get no points of their own.
    Along each the boundary is found from ``region.contains``, or the signed distance.

    Parameters
    ----------
    region : of two dimensions; star-shaped around the mean, as convex ones are.
    obstacle : mean (2,) m and covariance (2, 2) m^2.
    margin : m, the radii together.
    level : the region's own.
    count : points from each rule.

    Raises
    ------
    WideberthError : not two dimensions, more than one obstacle, a level of tail 0, or a region
        that is empty or unbounded at this level.
    """
    walk = start(region, obstacle, margin, level)
    if len(walk.axes) != 2:
        raise WideberthError(
            f"the obstacle has {len(walk.axes)} coordinates; a boundary is walked along in two, "
            "use framework.risk_meter.measure"
        )
    return _along(walk, whole("count", count, least=3))


def outline(walk: Walk) -> Survey:
    """Cover the boundary of a 2-D region and zoom in twice on each extreme."""
    coarse = _along(walk, COUNT)
    angle = np.linspace(0.0, 2.0 * np.pi, 4 * COUNT - 4, endpoint=False)
    tail = walk.tail(lambda _: (_circle(angle), None))
    return Survey(coarse, _refined(walk, coarse), *_shares(coarse), tail)


def _circle(angles: Array) -> Array:
    """Return unit vectors (K, 2) at these polar angles."""
    return np.stack([np.cos(angles), np.sin(angles)], axis=-1)


def _along(walk: Walk, count: int) -> Boundary:
    """Cover the boundary; see `along_boundary`."""
    edge = walk.region.boundary(walk.parameters, walk.level, count) - walk.obstacle.mean
    if not np.isfinite(edge).all():
        raise walk.refuse("has a boundary that is not finite")
    closed = np.concatenate([edge, edge[:1]])
    steps = np.hypot.reduce(np.diff(closed, axis=0), axis=1)
    length = np.concatenate([[0.0], np.cumsum(steps)])
    even = np.linspace(0.0, length[-1], count, endpoint=False)
    extra = np.stack([np.interp(even, length, closed[:, i]) for i in range(2)], axis=1)
    places = np.concatenate([edge, extra])
    return _at(walk, np.unique(np.arctan2(places[:, 1], places[:, 0])))


def _refined(walk: Walk, coarse: Boundary) -> Boundary:
    """Zoom in twice on each extreme and return all points."""
    last, first = coarse.angles[-1:] - 2.0 * np.pi, coarse.angles[:1] + 2.0 * np.pi
    around = np.concatenate([last, coarse.angles, first])
    centres = [int(np.argmin(value)) for value in coarse.sought()]
    brackets = [(around[i], around[i + 2]) for i in centres]
    for _ in range(2):
        grid = np.concatenate([np.linspace(*bracket, _ZOOM) for bracket in brackets])
        found = _at(walk, grid)
        brackets = []
        for k, value in enumerate(found.sought()):
            own = slice(k * _ZOOM, (k + 1) * _ZOOM)
            best = int(np.clip(np.argmin(value[own]), 1, _ZOOM - 2))
            brackets.append((grid[own][best - 1], grid[own][best + 1]))
        coarse = joined(coarse, found)
    return coarse


def _at(walk: Walk, angles: Array) -> Boundary:
    """Find the boundary in these directions and what holds there."""
    found = walk.read(_circle(angles))
    return Boundary(**vars(found), angles=angles)


def _shares(boundary: Boundary) -> tuple[Array, Array]:
    """Share of each point in the full turn and in the boundary's length, trapezoidal."""
    steps = np.diff(boundary.angles, append=boundary.angles[0] + 2.0 * np.pi)
    lengths = np.hypot.reduce(boundary.points - np.roll(boundary.points, -1, axis=0), axis=1)
    turn, length = (0.5 * (value + np.roll(value, 1)) for value in (steps, lengths))
    return turn / turn.sum(), length / length.sum()

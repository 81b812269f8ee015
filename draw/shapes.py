"""Outlines and surfaces: content ellipses, ellipsoids, and the sets of regions."""

import numpy as np

from ..framework.region import Region
from ..framework.values.arrays import Array
from ..framework.values.footprint import Discs, Footprint, Outline
from ..framework.values.forecast import GaussianObstacle
from ..framework.values.motion import Pose
from ..framework.values.roots import factor

COUNT = 64
"""Points of an outline; a multiple of 8, so that the corners of a square are among them."""
_DOUBLINGS, _HALVINGS = 12, 13  # within a mm
_AT_ONCE = 500  # outlines whose points are tested in one call


def circle(count: int = COUNT) -> Array:
    """Points of the unit circle, (2, count)."""
    angle = np.linspace(0.0, 2.0 * np.pi, count, endpoint=False)
    return np.stack([np.cos(angle), np.sin(angle)])


def sphere(count: int) -> Array:
    """Give unit vectors on a grid of polar and azimuth angle, (count, count, 3)."""
    polar, around = np.meshgrid(
        np.linspace(0.0, np.pi, count), np.linspace(0.0, 2.0 * np.pi, count), indexing="ij"
    )
    level = np.sin(polar)
    return np.stack([level * np.cos(around), level * np.sin(around), np.cos(polar)], axis=-1)


def ellipses(mean: Array, covariance: Array, square: float, count: int = COUNT) -> Array:
    """Outlines of (x - mu)^T Sigma^-1 (x - mu) <= square, (K, count, 2), m."""
    return np.asarray(
        mean[:, None] + np.swapaxes(factor(square * covariance) @ circle(count), 1, 2)
    )


def ellipsoid(mean: Array, covariance: Array, square: float, count: int = 25) -> Array:
    """Return points of the surface of one such set in space, (count, count, 3), m."""
    return np.asarray(mean + sphere(count) @ factor(square * covariance).T)


def body_outlines(
    place: Array, heading: float, radius: float, footprint: Footprint | None, count: int = 60
) -> list[Array]:
    """Outlines (K, 2), m, of what a body covers from above: its footprint, or its whole disc.

    Parameters
    ----------
    place : (D,), m.
    heading : rad; of no account for a disc.
    radius : m, of the enclosing disc.
    footprint : see `Footprint`; None for the disc.
    count : points of a circle.
    """
    pose, round_one = Pose((place[0], place[1]), heading), circle(count).T
    if isinstance(footprint, Discs):
        centres = [np.array(pose.offset(centre)) for centre in footprint.centres]
        return [centre + footprint.radius * round_one for centre in centres]
    if isinstance(footprint, Outline):
        return [np.array([pose.offset(corner) for corner in footprint.vertices])]
    return [place[:2] + radius * round_one]


def outlines(region: Region, obstacle: GaussianObstacle, margin: Array, level: Array) -> Array:
    """Outlines of many 2-D regions at once: batch (...,) -> (..., COUNT, 2), m.

    Where rays from the mean leave the region, by bisection with `Region.contains`:
    `Region.boundary` takes one region a call, and 0.1 s of some. The rays are stretched like the
    spread, so that thin regions are sampled as evenly as round ones. All points are the mean
    where the region is empty.
    """
    return _rims(region, obstacle, margin, level, circle())


def surfaces(
    region: Region, obstacle: GaussianObstacle, margin: Array, level: Array, count: int = 17
) -> Array:
    """Surfaces of regions in space, batch (...,) -> (..., count, count, 3), m; as `outlines`."""
    grid = sphere(count)
    found = _rims(region, obstacle, margin, level, grid.reshape(-1, 3).T)
    return found.reshape(*level.shape, *grid.shape)


def _rims(
    region: Region, obstacle: GaussianObstacle, margin: Array, level: Array, directions: Array
) -> Array:
    """Points at which rays leave the regions, (..., C, D).

    The rays have these directions (D, C) in the frame of the spread.
    """
    size, count = directions.shape
    values, vectors = np.linalg.eigh(obstacle.covariance)
    reach = 3.0 * np.sqrt(np.clip(values, 0.0, None)) + margin[..., None]
    rays = np.swapaxes((vectors * reach[..., None, :]) @ directions, -1, -2)
    rays = rays.reshape(-1, count, size)
    numbers = region.parameters(obstacle, margin)
    share = shares(region, obstacle.mean.reshape(-1, size), rays, numbers, level)
    found = obstacle.mean.reshape(-1, 1, size) + share[..., None] * rays
    return np.asarray(found.reshape(*level.shape, count, size))


def shares(region: Region, mean: Array, rays: Array, parameters: Array, level: Array) -> Array:
    """Share of each ray (K, C, D) from the means (K, D) at which it leaves the region, (K, C)."""
    numbers = parameters.reshape(-1, 1, parameters.shape[-1])
    centre, held = mean[:, None], np.maximum(level.reshape(-1, 1), 0.0)
    share = np.zeros(rays.shape[:-1])
    for begin in range(0, len(rays), _AT_ONCE):
        some = slice(begin, begin + _AT_ONCE)
        share[some] = _left(region, centre[some], rays[some], numbers[some], held[some])
    return share


def _left(region: Region, mean: Array, rays: Array, numbers: Array, level: Array) -> Array:
    """Share of each ray at which it leaves the region, (K, C)."""
    low, high = np.zeros(rays.shape[:-1]), np.ones(rays.shape[:-1])
    for _ in range(_DOUBLINGS):
        inside = region.contains(mean + high[..., None] * rays, numbers, level)
        if not inside.any():
            break
        high = np.where(inside, 2.0 * high, high)
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        inside = region.contains(mean + middle[..., None] * rays, numbers, level)
        low, high = np.where(inside, middle, low), np.where(inside, high, middle)
    return low

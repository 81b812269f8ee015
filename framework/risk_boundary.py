"""Walking along the boundary of one 2-D region, with what holds at each point of it."""

from collections.abc import Callable
from dataclasses import dataclass, fields

import numpy as np

from .arrays import Array, positive, whole
from .errors import WideberthError
from .forecast import GaussianObstacle
from .geometry import distance_to_ellipse, sum_gauge
from .region import Region, Signed
from .risk import collision_probability

COUNT = 721
"""Points along the boundary from each of two rules; see `along_boundary`."""

_ZOOM = 65
"""Points per bracket and round of the refinement, which narrows each bracket 32 times."""


@dataclass(frozen=True, eq=False)
class Boundary:
    """What holds at points of a region's boundary, counter-clockwise around the mean.

    Attributes
    ----------
    angles : (K,), rad, polar angle of each point around the mean, increasing.
    points : (K, 2), m.
    risk : (K,), collision probability of a robot there.
    clearance : (K,), m, signed distance to the content ellipse.
    gap : (K,), m, distance from the mean less that of the exact sum's boundary on the same ray.
    """

    angles: Array
    points: Array
    risk: Array
    clearance: Array
    gap: Array


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
    return start(region, obstacle, margin, level).along(whole("count", count, least=3))


@dataclass(frozen=True, eq=False)
class Walk:
    """One region at one level, with its parameters and the axes (m) of the content ellipse.

    Made by `start`, which checks.
    """

    region: Region
    obstacle: GaussianObstacle
    margin: float
    level: float
    parameters: Array
    vectors: Array
    deviations: Array
    axes: Array

    def along(self, count: int) -> Boundary:
        """Cover the boundary; see `along_boundary`."""
        edge = self.region.boundary(self.parameters, self.level, count) - self.obstacle.mean
        if not np.isfinite(edge).all():
            raise self.refuse("has a boundary that is not finite")
        closed = np.concatenate([edge, edge[:1]])
        steps = np.hypot.reduce(np.diff(closed, axis=0), axis=1)
        length = np.concatenate([[0.0], np.cumsum(steps)])
        even = np.linspace(0.0, length[-1], count, endpoint=False)
        extra = np.stack([np.interp(even, length, closed[:, i]) for i in range(2)], axis=1)
        places = np.concatenate([edge, extra])
        return self.at(np.unique(np.arctan2(places[:, 1], places[:, 0])))

    def refined(self, coarse: Boundary) -> Boundary:
        """Zoom in twice on each extreme and return all points."""
        last, first = coarse.angles[-1:] - 2.0 * np.pi, coarse.angles[:1] + 2.0 * np.pi
        around = np.concatenate([last, coarse.angles, first])
        centres = [int(np.argmin(value)) for value in _sought(coarse)]
        brackets = [(around[i], around[i + 2]) for i in centres]
        for _ in range(2):
            grid = np.concatenate([np.linspace(*bracket, _ZOOM) for bracket in brackets])
            found = self.at(grid)
            brackets = []
            for k, value in enumerate(_sought(found)):
                own = slice(k * _ZOOM, (k + 1) * _ZOOM)
                best = int(np.clip(np.argmin(value[own]), 1, _ZOOM - 2))
                brackets.append((grid[own][best - 1], grid[own][best + 1]))
            coarse = _joined(coarse, found)
        return coarse

    def at(self, angles: Array) -> Boundary:
        """Find the boundary in these directions and what holds there."""
        ray = np.stack([np.cos(angles), np.sin(angles)], axis=-1)
        radius = self.radius(ray, self.parameters)
        offset = radius[:, None] * ray
        local, turned = offset @ self.vectors, ray @ self.vectors
        margin = np.asarray(self.margin)
        exact = 1.0 / sum_gauge(turned, self.axes, margin)
        return Boundary(
            angles,
            self.obstacle.mean + offset,
            collision_probability(-offset, self.obstacle.covariance, self.margin),
            distance_to_ellipse(local, self.axes),
            radius - exact,
        )

    def radius(self, ray: Array, parameters: Array) -> Array:
        """Distance from the mean to the boundary along unit vectors, m.

        By the secant where the region is signed, which takes about ten steps, else by bisection.
        """
        level, mean = np.asarray(self.level), self.obstacle.mean
        high = np.full(len(ray), float(self.axes[0] + self.margin + self.deviations[0]))
        for _ in range(60):
            inside = self.region.contains(mean + high[:, None] * ray, parameters, level)
            if not inside.any():
                break
            high = np.where(inside, 2.0 * high, high)
        else:
            raise self.refuse("has no boundary in some direction")
        if isinstance(self.region, Signed):
            distance = self.region.signed_distance
            return _secant(lambda r: distance(mean + r[:, None] * ray, parameters, level), high)
        low = np.zeros(len(ray))
        for _ in range(52):
            middle = 0.5 * (low + high)
            inside = self.region.contains(mean + middle[:, None] * ray, parameters, level)
            low, high = np.where(inside, middle, low), np.where(inside, high, middle)
        return high

    def tail(self) -> float:
        """Probability outside the un-enlarged region: the mean of exp(-w^2 / 2).

        w is the Mahalanobis distance of its boundary, averaged over directions in the frame in
        which the covariance is round.
        """
        if not self.deviations[-1] > 1e-12 * self.deviations[0]:
            return float("nan")
        try:
            bare = self.region.parameters(self.obstacle, np.asarray(0.0))
            centre = self.obstacle.mean[None]
            if not self.region.contains(centre, bare, np.asarray(self.level)).all():
                return 1.0
        except WideberthError:  # a region that needs a disc
            return float("nan")
        angle = np.linspace(0.0, 2.0 * np.pi, 4 * COUNT - 4, endpoint=False)
        stretched = np.stack([np.cos(angle), np.sin(angle)], axis=-1) * self.deviations
        scale = np.hypot.reduce(stretched, axis=-1)
        ray = (stretched / scale[:, None]) @ self.vectors.T
        return float(np.exp(-0.5 * (self.radius(ray, bare) / scale) ** 2).mean())

    def refuse(self, why: str) -> WideberthError:
        """Say what cannot be measured."""
        return WideberthError(
            f"{self.region!r} {why} (covariance {self.obstacle.covariance.tolist()}, margin "
            f"{self.margin:g} m, level {self.level:g}): there is nothing to measure"
        )


def start(region: Region, obstacle: GaussianObstacle, margin: float, level: float) -> Walk:
    """Check the input and prepare a walk; raises as `along_boundary`."""
    if obstacle.mean.shape != (2,) or 2 not in region.dimensions:
        raise WideberthError(
            f"the obstacle has mean of shape {obstacle.mean.shape} and the region takes "
            f"{region.dimensions} dimensions; the meter wants one obstacle in two"
        )
    margin = positive("margin", margin, zero=True)
    tail = region.tail(level, 2)
    if not tail > 0.0:
        raise WideberthError(f"level is {level:g}, whose tail is 0 in double precision; lower it")
    values, vectors = np.linalg.eigh(obstacle.covariance)
    deviations = np.sqrt(np.clip(values, 0.0, None))[::-1]
    axes = np.sqrt(-2.0 * np.log(min(tail, 1.0))) * deviations
    parameters = region.parameters(obstacle, np.asarray(margin))
    walk = Walk(
        region, obstacle, margin, float(level), parameters, vectors[:, ::-1], deviations, axes
    )
    if not region.contains(obstacle.mean[None], parameters, np.asarray(level)).all():
        raise walk.refuse("is empty or does not hold the mean")
    return walk


def _secant(value: Callable[[Array], Array], high: Array) -> Array:
    """Root between 0, where the value is negative, and ``high``: the Illinois method."""
    low, near, reach = np.zeros_like(high), high.copy(), high.copy()
    below, above = value(low), value(high)
    side = np.zeros(len(high))
    for _ in range(100):
        gap = above - below
        share = np.divide(-below, gap, out=np.full_like(high, 0.5), where=gap > 0)
        near = low + share * (high - low)
        found = value(near)
        if (np.abs(found) <= 1e-14 * reach).all() or (high - low <= 4e-16 * reach).all():
            break
        inside = found < 0
        # The end that stays twice counts half, so that both ends move.
        above = np.where(inside, np.where(side < 0, 0.5 * above, above), found)
        below = np.where(inside, found, np.where(side > 0, 0.5 * below, below))
        low, high = np.where(inside, near, low), np.where(inside, high, near)
        side = np.where(inside, -1.0, 1.0)
    return near


def _sought(found: Boundary) -> tuple[Array, ...]:
    """Return what is minimised: extremes of risk, clearance and gap."""
    return found.risk, -found.risk, found.clearance, found.gap, -found.gap


def _joined(first: Boundary, second: Boundary) -> Boundary:
    pairs = [(getattr(first, one.name), getattr(second, one.name)) for one in fields(first)]
    return Boundary(*[np.concatenate(pair) for pair in pairs])


def shares(boundary: Boundary) -> tuple[Array, Array]:
    """Share of each point in the full turn and in the boundary's length, trapezoidal."""
    steps = np.diff(boundary.angles, append=boundary.angles[0] + 2.0 * np.pi)
    lengths = np.hypot.reduce(boundary.points - np.roll(boundary.points, -1, axis=0), axis=1)
    turn, length = (0.5 * (value + np.roll(value, 1)) for value in (steps, lengths))
    return turn / turn.sum(), length / length.sum()

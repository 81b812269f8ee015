"""What the risk meter does in two and three dimensions alike: from the mean to the boundary."""

from collections.abc import Callable
from dataclasses import dataclass, fields
from typing import TypeVar, final

import numpy as np
from scipy import special

from ..numerics.geometry import distance_to_ellipse, sum_gauge
from ..region import Region, Signed
from ..values.arrays import Array, positive
from ..values.errors import WideberthError
from ..values.forecast import GaussianObstacle
from .collision_probability import collision_probability


@dataclass(frozen=True, eq=False)
class Readings:
    """What holds at points of a region's boundary.

    Attributes
    ----------
    points : (K, D), m.
    risk : (K,), collision probability of a robot there.
    clearance : (K,), m, signed distance to the content ellipse.
    gap : (K,), m, distance from the mean less that of the exact sum's boundary on the same ray.
    """

    points: Array
    risk: Array
    clearance: Array
    gap: Array

    def sought(self) -> tuple[Array, ...]:
        """Return what is minimised, (K,) each: extremes of risk, clearance and gap."""
        return self.risk, -self.risk, self.clearance, self.gap, -self.gap


_Kind = TypeVar("_Kind", bound=Readings)


def joined(first: _Kind, *others: _Kind) -> _Kind:
    """Return the points of all, one after the other."""
    parts = (first, *others)
    return type(first)(
        **{
            one.name: np.concatenate([getattr(part, one.name) for part in parts])
            for one in fields(first)
        }
    )


@final
@dataclass(frozen=True, eq=False)
class Survey:
    """A boundary covered by points and searched for its extremes, and the tail.

    Attributes
    ----------
    coarse : K points all over the boundary.
    fine : the same and those of the search.
    directions : (K,), share of each coarse point in all directions around the mean.
    extent : (K,), its share in the boundary's length, in 3-D in its area.
    tail : see `Walk.tail`.
    """

    coarse: Readings
    fine: Readings
    directions: Array
    extent: Array
    tail: float


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

    def read(self, ray: Array) -> Readings:
        """Find the boundary along unit vectors (K, D) and what holds there."""
        radius = self.radius(ray, self.parameters)
        offset = radius[:, None] * ray
        local, turned = offset @ self.vectors, ray @ self.vectors
        margin = np.asarray(self.margin)
        exact = 1.0 / sum_gauge(turned, self.axes, margin)
        return Readings(
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

    def tail(self, rule: Callable[[Array], tuple[Array, Array | None]]) -> float:
        """Probability outside the un-enlarged region: the mean of Pr(chi_D > w).

        w is the Mahalanobis distance of its boundary, averaged over directions in the frame in
        which the covariance is round.

        Parameters
        ----------
        rule : deviations (D,) m, all above 0 -> unit vectors (K, D) along the eigenvectors in
            that frame, and their weights (K,), None for equal ones.
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
        directions, weights = rule(self.deviations)
        stretched = directions * self.deviations
        scale = np.hypot.reduce(stretched, axis=-1)
        ray = (stretched / scale[:, None]) @ self.vectors.T
        half = 0.5 * (self.radius(ray, bare) / scale) ** 2
        size = len(self.axes)
        beyond = np.exp(-half) if size == 2 else special.gammaincc(0.5 * size, half)
        return float(np.average(beyond, weights=weights))

    def refuse(self, why: str) -> WideberthError:
        """Say what cannot be measured."""
        return WideberthError(
            f"{self.region!r} {why} (covariance {self.obstacle.covariance.tolist()}, margin "
            f"{self.margin:g} m, level {self.level:g}): there is nothing to measure"
        )


def start(region: Region, obstacle: GaussianObstacle, margin: float, level: float) -> Walk:
    """Check the input and prepare a walk; raises as `along_boundary`."""
    size = obstacle.mean.size
    if obstacle.mean.shape not in ((2,), (3,)) or size not in region.dimensions:
        raise WideberthError(
            f"the obstacle has mean of shape {obstacle.mean.shape} and the region takes "
            f"{region.dimensions} dimensions; the meter wants one obstacle in two or three of them"
        )
    margin = positive("margin", margin, zero=True)
    tail = region.tail(level, size)
    if not tail > 0.0:
        raise WideberthError(f"level is {level:g}, whose tail is 0 in double precision; lower it")
    values, vectors = np.linalg.eigh(obstacle.covariance)
    deviations = np.sqrt(np.clip(values, 0.0, None))[::-1]
    axes = _content_level(min(tail, 1.0), size) * deviations
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


def _content_level(tail: float, dimension: int) -> float:
    """Root of the upper chi-square quantile; in 2-D its closed form."""
    if dimension == 2:
        return float(np.sqrt(-2.0 * np.log(tail)))
    return float(np.sqrt(2.0 * special.gammainccinv(0.5 * dimension, tail)))

"""Obstacles to check regions on, and points at known places relative to a region's boundary."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import TypeAlias

import numpy as np

from ..numerics.eigenframe import eigen_axes
from ..numerics.geometry import sum_gauge
from ..region import Region
from ..values.arrays import Array, BoolArray
from ..values.errors import WideberthError
from ..values.forecast import GaussianObstacle

_HALVINGS = 36
"""Of the bracket of a boundary point, from a factor of 2 down to 2e-11 of the radius."""
_NEAR, _SHARE = 1e-8, 1e-6
"""m, and without unit: within these the symbolic constraint may differ from `contains`. It keeps
its numbers finite with lengths of 1e-9 m, gauges to 5e-7 and probabilities to 2e-7.
"""

Sides: TypeAlias = tuple[BoolArray, BoolArray]
"""Per point: surely inside, and possibly inside."""


@dataclass(frozen=True, eq=False)
class RegionCase:
    """A region for one obstacle, or for a batch of them, all at their own level.

    Attributes
    ----------
    region : the region.
    mean : (..., D), m.
    covariance : (..., D, D), m^2.
    margin : (...), m.
    tail : (...), what `Region.level` is asked for.
    """

    region: Region
    mean: Array
    covariance: Array
    margin: Array
    tail: Array

    @cached_property
    def level(self) -> Array:
        """The region's level for each tail, (...)."""
        return self._levels(self.region.level)

    @cached_property
    def parameters(self) -> Array:
        """Parameters of the region, (..., P)."""
        return self.region.parameters(GaussianObstacle(self.mean, self.covariance), self.margin)

    @cached_property
    def axes(self) -> Array:
        """Semi-axes of the ellipse of content 1 - tail, from large to small, (..., D) m."""
        return np.asarray(self._content_level[..., None] * self._principal[1])

    @property
    def size(self) -> int:
        """D."""
        return int(self.mean.shape[-1])

    @property
    def extents(self) -> Array:
        """Half-widths of the exact set along the eigenvectors, from large to small, (..., D) m."""
        return np.asarray(self.axes + np.asarray(self.margin)[..., None])

    def contains(self, points: Array) -> BoolArray:
        """Ask the region: (..., D) -> (...)."""
        return self.region.contains(points, self.parameters, self.level)

    def gauge(self, points: Array) -> Array:
        """Gauge of content ellipse plus disc: below 1 inside the exact set, (...)."""
        local = np.einsum("...ij,...i->...j", self._principal[0], points - self.mean)
        return sum_gauge(local, self.axes, self.margin)

    def rays(self, directions: Array) -> Array:
        """Lead unit vectors of the eigenframe to about the exact set's boundary, (..., D) m.

        Coordinate i becomes (s sigma_i + margin) n_i: the rays of a thin set are spread as
        evenly along it as those of a round one.
        """
        local = self.extents * directions
        return np.asarray(np.einsum("...ij,...j->...i", self._principal[0], local))

    def reach(self, rays: Array, halvings: int = _HALVINGS) -> tuple[Array, Array]:
        """Multiples of each ray, the last known inside and the first known outside, (...).

        By bisection of `contains`: for regions that are star-shaped around the mean. (0, tiny)
        where the region is empty. Each halving gives a bit; a few do for a rough size.
        """
        shape = np.broadcast_shapes(rays.shape[:-1], self.level.shape)
        low, high = np.zeros(shape), np.ones(shape)
        for _ in range(60):
            inside = self.contains(self.mean + high[..., None] * rays)
            if not inside.any():
                break
            low, high = np.where(inside, high, low), np.where(inside, 2.0 * high, high)
        for _ in range(halvings):
            middle = 0.5 * (low + high)
            inside = self.contains(self.mean + middle[..., None] * rays)
            low, high = np.where(inside, middle, low), np.where(inside, high, middle)
        return low, high

    def bracket(self, points: Array) -> Sides:
        """Whether points are surely inside, and whether they may be, up to rounding, (...).

        `contains` with the margin 1e-8 m smaller and larger, and with the squared level, which
        for levels sqrt(-2 ln p) is the logarithm of a probability, 1e-6 smaller and larger.
        """
        given = GaussianObstacle(self.mean, self.covariance)

        def contains(sense: float) -> BoolArray:
            square = self.level**2 * (1.0 + 2.0 * sense * _SHARE) + sense * _SHARE
            level = np.sqrt(np.maximum(square, 0.0))
            try:
                margin = np.maximum(self.margin + sense * _NEAR, 0.0)
                parameters = self.region.parameters(given, margin)
            except WideberthError:  # a region may be defined without a margin alone
                parameters = self.parameters
            return self.region.contains(points, parameters, level)

        return contains(-1.0), contains(1.0)

    def fail(self, law: str) -> AssertionError:
        """Name a broken law and the obstacle."""
        return AssertionError(
            f"{law} (mean {self.mean.tolist()}, covariance "
            f"{self.covariance.tolist()}, margin {self.margin.tolist()}, tail "
            f"{self.tail.tolist()})"
        )

    @cached_property
    def _content_level(self) -> Array:
        from scipy.special import chdtri

        return np.asarray(np.sqrt(chdtri(self.size, self.tail)))

    @cached_property
    def _principal(self) -> tuple[Array, Array]:
        deviations, vectors = eigen_axes(self.covariance)
        return vectors, deviations

    def _levels(self, level: Callable[[float, int], float]) -> Array:
        flat = [level(float(tail), self.size) for tail in self.tail.ravel()]
        return np.array(flat).reshape(self.tail.shape)


def random_auxiliaries(
    region: Region, dimension: int, count: int, rng: np.random.Generator
) -> Array:
    """Draw between the bounds, around the declared start where there are none, (count, A)."""
    declared = region.auxiliary(dimension)
    low, high, start = (np.array(v) for v in (declared.lower, declared.upper, declared.start))
    shape = (count, len(declared))
    bound = np.isfinite(low) & np.isfinite(high)
    within = rng.uniform(np.where(bound, low, 0.0), np.where(bound, high, 1.0), shape)
    around = np.clip(start + 3.0 * rng.standard_normal(shape), low, high)
    return np.asarray(np.where(bound, within, around))


def sphere(rng: np.random.Generator, count: int, size: int) -> Array:
    """Draw unit vectors, (count, size), every fourth of them along a coordinate axis."""
    draws = rng.standard_normal((count, size))
    draws[::4] = np.eye(size)[rng.integers(size, size=len(draws[::4]))]
    return np.asarray(draws / np.linalg.norm(draws, axis=1)[:, None])


def turned(rng: np.random.Generator, deviations: Array) -> Array:
    """Covariances (..., D, D), m^2, with these deviations (..., D), m, along random axes."""
    size = deviations.shape[-1]
    turn = np.linalg.qr(rng.standard_normal((*deviations.shape, size)))[0]
    covariance = np.einsum("...ij,...j,...kj->...ik", turn, deviations**2, turn)
    return np.asarray(0.5 * (covariance + np.swapaxes(covariance, -1, -2)))

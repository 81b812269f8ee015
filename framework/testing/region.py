"""The contract of a Region, checked on random obstacles."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import special

from ..arrays import Array, BoolArray
from ..errors import WideberthError
from ..forecast import GaussianObstacle
from ..region import Guarantee, Region, Relation
from ..risk import collision_probability
from .twin import Twin, compile_twin

_TAILS = (0.5, 0.1, 0.05, 1e-3, 1e-12)
_NEAR = 1e-6
"""m. Points closer to the boundary than this may fall on either side."""


def check_region(
    region: Region,
    *,
    dimensions: Sequence[int] | None = None,
    rng: np.random.Generator | None = None,
) -> None:
    """Check the laws of a region, among them the relation and the guarantee it declares.

    Parameters
    ----------
    region : what to check.
    dimensions : numbers of coordinates; those that the region declares by default.
    rng : of the random obstacles and points; a fixed seed by default.

    Raises
    ------
    AssertionError : a law does not hold; the message names it and says where.
    """
    rng = np.random.default_rng(0) if rng is None else rng
    for size in region.dimensions if dimensions is None else dimensions:
        _check_level(region, size)
        twin = compile_twin(region, size)
        for case in _cases(region, size, rng):
            _check_twin(case, twin, rng)
            _check_gradient(case, twin, rng)
            _check_growth(case, rng)
            _check_motion(case, rng)
            _check_relation(case, rng)
            _check_guarantee(case, rng)
            _check_area(case, rng)
        _check_degenerate(region, size, twin, rng)


@dataclass(frozen=True, eq=False)
class _Case:
    """One obstacle at one level."""

    region: Region
    mean: Array
    covariance: Array
    margin: float
    tail: float

    @property
    def level(self) -> float:
        return self.region.level(self.tail, len(self.mean))

    @property
    def parameters(self) -> Array:
        obstacle = GaussianObstacle(self.mean, self.covariance)
        return self.region.parameters(obstacle, np.asarray(self.margin))

    @property
    def extent(self) -> float:
        """Length, m, of the order of the region's size."""
        deviation = float(np.sqrt(np.linalg.eigvalsh(self.covariance)[-1]))
        return _ellipse_level(self.tail, len(self.mean)) * deviation + self.margin

    def contains(self, points: Array) -> BoolArray:
        return self.region.contains(points, self.parameters, np.asarray(self.level))

    def points(self, rng: np.random.Generator, count: int) -> Array:
        """Random points around the region, none of them near its boundary."""
        size = len(self.mean)
        spread = rng.uniform(-1.5, 1.5, (count, size)) * self.extent
        points = self.mean + spread
        inside = self.contains(points)
        clear = np.ones(count, dtype=bool)
        for step in np.concatenate([np.eye(size), -np.eye(size)]) * _NEAR:
            clear &= self.contains(points + step) == inside
        return points[clear]

    def edge(self, rng: np.random.Generator, count: int) -> Array:
        """Points just outside the boundary along random rays from the mean."""
        ray = rng.standard_normal((count, len(self.mean)))
        ray /= np.linalg.norm(ray, axis=1)[:, None]
        low, high = np.zeros(count), np.full(count, 10.0 * self.extent)
        for _ in range(60):
            middle = 0.5 * (low + high)
            inside = self.contains(self.mean + middle[:, None] * ray)
            low, high = np.where(inside, middle, low), np.where(inside, high, middle)
        return np.asarray(self.mean + high[:, None] * ray)

    def fail(self, law: str) -> AssertionError:
        return AssertionError(
            f"{self.region!r} breaks a law: {law} (mean {self.mean.tolist()}, covariance "
            f"{self.covariance.tolist()}, margin {self.margin:g}, tail {self.tail:g})"
        )


def _cases(region: Region, size: int, rng: np.random.Generator) -> list[_Case]:
    cases = []
    for axis_ratio, margin, tail in ((1.0, 1.5, 0.05), (0.5, 0.4, 0.1), (0.1, 1.0, 0.3)):
        turn = np.linalg.qr(rng.standard_normal((size, size)))[0]
        deviations = np.linspace(1.0, axis_ratio, size)
        covariance = turn @ np.diag(deviations**2) @ turn.T
        mean = rng.uniform(-3.0, 3.0, size)
        cases.append(_Case(region, mean, 0.5 * (covariance + covariance.T), margin, tail))
    return cases


def _check_level(region: Region, size: int) -> None:
    levels = [region.level(tail, size) for tail in _TAILS]
    if not (np.isfinite(levels).all() and (np.diff(levels) > 0).all()):
        raise AssertionError(f"{region!r}: level must grow as the tail shrinks; got {levels}")
    for tail, level in zip(_TAILS, levels, strict=True):
        back = region.tail(level, size)
        if not np.isclose(back, tail, rtol=1e-6, atol=0.0):
            raise AssertionError(f"{region!r}: tail(level({tail:g})) is {back:g} in {size}-D")


def _check_twin(case: _Case, twin: Twin, rng: np.random.Generator) -> None:
    points = case.points(rng, 2000)
    values, _, ties = twin(points, case.parameters, case.level)
    if ties.max(initial=0.0) > 1e-6:
        raise case.fail("auxiliary_start must satisfy the equalities")
    differ = (values >= 0.0) == case.contains(points)
    if differ.any():
        where = points[differ][0].tolist()
        raise case.fail(f"symbolic constraint and contains() differ at {where}")


def _check_gradient(case: _Case, twin: Twin, rng: np.random.Generator) -> None:
    if not case.contains(case.mean[None])[0]:
        return  # an empty region has no boundary
    edge = case.edge(rng, 200)
    _, gradients, _ = twin(edge, case.parameters, case.level)
    size = np.linalg.norm(gradients, axis=1) * case.extent
    if not (np.isfinite(size).all() and size.min() > 1e-3):
        raise case.fail("the gradient must be finite and must not vanish at the boundary")


def _check_growth(case: _Case, rng: np.random.Generator) -> None:
    points = case.points(rng, 2000)
    inside = case.contains(points)
    wider = _Case(case.region, case.mean, case.covariance, 1.2 * case.margin, case.tail)
    if (inside & ~wider.contains(points)).any():
        raise case.fail("the region must grow with the margin")
    level = np.asarray(case.level + 0.3)
    if (inside & ~case.region.contains(points, case.parameters, level)).any():
        raise case.fail("the region must grow with the level")


def _check_motion(case: _Case, rng: np.random.Generator) -> None:
    points = case.points(rng, 2000)
    inside = case.contains(points)
    shift = rng.uniform(-5.0, 5.0, len(case.mean))
    moved = _Case(case.region, case.mean + shift, case.covariance, case.margin, case.tail)
    if (moved.contains(points + shift) != inside).any():
        raise case.fail("the region must move with the obstacle")
    if not case.region.rotation_invariant:
        return
    turn = np.linalg.qr(rng.standard_normal((len(shift), len(shift))))[0]
    covariance = turn @ case.covariance @ turn.T
    covariance = 0.5 * (covariance + covariance.T)
    turned = _Case(case.region, turn @ case.mean, covariance, case.margin, case.tail)
    if (turned.contains(points @ turn.T) != inside).any():
        raise case.fail("the region must turn with the obstacle, or declare that it does not")


def _check_relation(case: _Case, rng: np.random.Generator) -> None:
    relation = case.region.relation
    points = case.points(rng, 2000)
    inside = case.contains(points)
    gauge = _exact_gauge(case, points)
    if relation in (Relation.INNER, Relation.EXACT) and (gauge[inside] > 1 + _NEAR).any():
        raise case.fail(f"declared {relation}, but it holds points outside the exact sum")
    if relation in (Relation.OUTER, Relation.EXACT) and (gauge[~inside] < 1 - _NEAR).any():
        raise case.fail(f"declared {relation}, but it leaves out points of the exact sum")


def _exact_gauge(case: _Case, points: Array) -> Array:
    """Gauge of content ellipse plus disc, the square root of the maximum of the concave F(t)."""
    values, vectors = np.linalg.eigh(case.covariance)
    squares = _ellipse_level(case.tail, len(values)) ** 2 * values
    x2 = ((points - case.mean) @ vectors) ** 2
    low, high = np.zeros(len(points)), np.ones(len(points))
    disc = case.margin**2
    for _ in range(60):
        t = 0.5 * (low + high)[:, None]
        below = (1.0 - t) * squares + t * disc
        rising = (x2 * (squares * (1.0 - t) ** 2 - disc * t**2) / below**2).sum(axis=1) > 0.0
        low, high = np.where(rising, t[:, 0], low), np.where(rising, high, t[:, 0])
    t = high[:, None]
    return np.asarray(np.sqrt((x2 * t * (1 - t) / ((1 - t) * squares + t * disc)).sum(axis=1)))


def _ellipse_level(tail: float, size: int) -> float:
    return float(np.sqrt(2.0 * special.gammainccinv(0.5 * size, tail)))


def _check_guarantee(case: _Case, rng: np.random.Generator) -> None:
    if case.region.guarantee is Guarantee.NONE:
        return
    edge = case.edge(rng, 100 if len(case.mean) == 2 else 20)
    nodes = 64 if len(case.mean) == 2 else 32
    risk = collision_probability(case.mean - edge, case.covariance, case.margin, nodes)
    worst = float(risk.max())
    if worst > case.tail * (1 + 1e-6):
        raise case.fail(
            f"declared guarantee {case.region.guarantee}, but the collision risk on the boundary "
            f"reaches {worst:.3g}"
        )


def _check_area(case: _Case, rng: np.random.Generator) -> None:
    area = float(case.region.area(case.parameters, np.asarray(case.level)))
    if len(case.mean) == 2:
        edge = case.region.boundary(case.parameters, case.level, 4000)
        if edge.shape != (4000, 2):
            raise case.fail(f"boundary must return (count, 2); got {edge.shape}")
        ahead = np.roll(edge, -1, axis=0)
        polygon = 0.5 * float((edge[:, 0] * ahead[:, 1] - edge[:, 1] * ahead[:, 0]).sum())
        slack = 1e-4 * area
    else:
        box = 3.0 * case.extent
        sample = case.mean + rng.uniform(-0.5, 0.5, (40000, len(case.mean))) * box
        share = float(case.contains(sample).mean())
        polygon = share * box ** len(case.mean)
        slack = 4.0 * np.sqrt(share * (1 - share) / 40000) * box ** len(case.mean)
    if abs(polygon - area) > slack:
        raise case.fail(
            f"area() says {area:.6g}, its counter-clockwise boundary or contains() {polygon:.6g}"
        )


def _refuses(case: _Case) -> bool:
    try:
        return case.parameters.size == 0
    except WideberthError:
        return True


def _check_degenerate(region: Region, size: int, twin: Twin, rng: np.random.Generator) -> None:
    turn = np.linalg.qr(rng.standard_normal((size, size)))[0]
    for deviations in ([0.0] * size, [1.0] + [0.0] * (size - 1), [1.0] * (size - 1) + [1e-4]):
        covariance = turn @ np.diag(np.square(deviations)) @ turn.T
        for margin in (0.0, 1.0):
            mean = np.ones(size)
            case = _Case(region, mean, 0.5 * (covariance + covariance.T), margin, 0.05)
            points = np.stack([mean, mean + 0.7, mean + np.eye(size)[0], mean + 30.0])
            if min(deviations) == 0.0 and not region.singular_covariances and _refuses(case):
                continue
            if not np.isfinite(case.parameters).all():
                raise case.fail("parameters must be finite for degenerate covariances")
            values, gradients, _ = twin(points, case.parameters, case.level)
            if not (np.isfinite(values).all() and np.isfinite(gradients).all()):
                raise case.fail("constraint and gradient must be finite, at the centre too")
            if values[-1] < 0.0:
                raise case.fail("a point 30 standard deviations away must be outside")

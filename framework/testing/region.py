"""The contract of a Region, checked on random obstacles."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ..region import Guarantee, Region, Relation
from ..risk.collision_probability import collision_probability
from ..values.arrays import Array, BoolArray
from ..values.errors import WideberthError
from .region_cases import RegionCase, Sides, random_auxiliaries, sphere, turned
from .twin import Twin, compile_twin

_TAILS = (1.0 - 1e-9, 0.999, 0.5, 0.1, 0.05, 1e-3, 1e-12, 1e-15)
_NEAR = 1e-6
"""Share of its size by which a declared relation may be missed."""
_RAYS = 200
_FACTORS = np.array([0.3, 0.95, 1.0 - 1e-4, 1.0 + 1e-4, 1.05, 2.0])
"""Multiples of the boundary's distance from the mean at which points are taken."""


def check_region(
    region: Region,
    *,
    dimensions: Sequence[int] | None = None,
    rng: np.random.Generator | None = None,
) -> None:
    """Check the laws of a region, among them the relation and the guarantee it declares.

    Per dimension 7000 points around five obstacles: round to condition 1e8, tails from 1e-12 to
    1 - 1e-9; and degenerate ones. Points are at multiples of the boundary's distance from the
    mean, so the laws are sharp for regions that are star-shaped around it.

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
        for case, usual in _cases(region, size, rng):
            rays = case.rays(sphere(rng, _RAYS, size))
            reach = case.reach(rays)[1][:, None] * rays
            spread = case.mean + (_FACTORS[:, None, None] * reach).reshape(-1, size)
            scattered = case.mean + rng.uniform(-1.5, 1.5, (_RAYS, size)) * case.extents[0]
            points = np.concatenate([spread, scattered])
            sides, inside = case.bracket(points), case.contains(points)
            check_sides(case, twin, points, sides)
            check_guesses(case, twin, points, sides, rng)
            _check_growth(case, points, inside)
            _check_motion(case, points, sides, rng)
            _check_relation(case, points, inside)
            _check_guarantee(case, reach)
            _check_beyond(case, twin, points, rng)
            if usual:
                _check_gradient(case, twin, case.mean + reach)
                _check_area(case, rng)
        _check_degenerate(region, size, twin, rng)


def _cases(region: Region, size: int, rng: np.random.Generator) -> list[tuple[RegionCase, bool]]:
    """Obstacles, each with whether it is a usual one, without extremes."""
    cases = []
    for axis_ratio, margin, tail, usual in (
        (1.0, 1.5, 0.05, True),
        (0.5, 0.4, 0.1, True),
        (0.1, 1.0, 0.3, True),
        (1e-4, 0.5, 1e-12, False),
        (0.3, 0.7, 1.0 - 1e-9, False),
    ):
        covariance = turned(rng, np.linspace(1.0, axis_ratio, size))
        mean = rng.uniform(-3.0, 3.0, size)
        case = RegionCase(region, mean, covariance, np.asarray(margin), np.asarray(tail))
        cases.append((case, usual))
    return cases


def _check_level(region: Region, size: int) -> None:
    levels = [region.level(tail, size) for tail in _TAILS]
    usual = [level for level, tail in zip(levels, _TAILS, strict=True) if tail <= 0.5]
    growing = (np.diff(levels) >= 0).all() and (np.diff(usual) > 0).all()
    if not (np.isfinite(levels).all() and growing):
        raise AssertionError(f"{region!r}: level must grow as the tail shrinks; got {levels}")
    for tail, level in zip(_TAILS, levels, strict=True):
        back = region.tail(level, size)
        # Some regions do not shrink any further for tails that large: they keep more than asked.
        kept = back <= tail * (1 + 1e-6) and (tail > 0.5 or back >= tail * (1 - 1e-6))
        if not kept:
            raise AssertionError(f"{region!r}: tail(level({tail:g})) is {back:g} in {size}-D")


def check_sides(case: RegionCase, twin: Twin, points: Array, sides: Sides) -> None:
    """Check that the symbolic constraint is finite and holds exactly outside, up to rounding.

    ``sides`` is `RegionCase.bracket` of the points.

    Raises
    ------
    AssertionError : as `check_region`.
    """
    values, gradients, ties = twin(points, case.parameters, float(case.level))
    if not (np.isfinite(values).all() and np.isfinite(gradients).all()):
        raise case.fail("constraint and gradient must be finite")
    if ties.max(initial=0.0) > 1e-6:
        raise case.fail("auxiliary_start must satisfy the equalities")
    surely, maybe = sides
    differ = (surely & (values >= 0.0)) | (~maybe & (values < 0.0))
    if differ.any():
        where = points[differ][0].tolist()
        raise case.fail(f"symbolic constraint and contains() differ at {where}")


def check_guesses(
    case: RegionCase, twin: Twin, points: Array, sides: Sides, rng: np.random.Generator
) -> None:
    """Check that no random auxiliary makes a point inside look outside.

    ``sides`` is `RegionCase.bracket` of the points.

    Raises
    ------
    AssertionError : as `check_region`.
    """
    if not len(case.region.auxiliary(case.size)):
        return
    drawn = random_auxiliaries(case.region, case.size, len(points), rng)
    values, _, ties = twin(points, case.parameters, float(case.level), drawn)
    if (sides[0] & (values >= 0.0) & (ties < 1e-6)).any():
        raise case.fail("no auxiliary may make a point inside look outside")


def _check_gradient(case: RegionCase, twin: Twin, edge: Array) -> None:
    if not case.contains(case.mean[None])[0]:
        return  # an empty region has no boundary
    _, gradients, _ = twin(edge, case.parameters, float(case.level))
    size = np.linalg.norm(gradients, axis=1) * case.extents[0]
    if not (np.isfinite(size).all() and size.min() > 1e-3):
        raise case.fail("the gradient must be finite and must not vanish at the boundary")


def _check_growth(case: RegionCase, points: Array, inside: BoolArray) -> None:
    if (inside & ~replace(case, margin=1.2 * case.margin).contains(points)).any():
        raise case.fail("the region must grow with the margin")
    level = case.level + 0.3
    if (inside & ~case.region.contains(points, case.parameters, level)).any():
        raise case.fail("the region must grow with the level")


def _check_motion(case: RegionCase, points: Array, sides: Sides, rng: np.random.Generator) -> None:
    surely, maybe = sides

    def differ(other: RegionCase, places: Array) -> bool:
        inside = other.contains(places)
        return bool(((surely & ~inside) | (~maybe & inside)).any())

    shift = rng.uniform(-5.0, 5.0, case.size)
    if differ(replace(case, mean=case.mean + shift), points + shift):
        raise case.fail("the region must move with the obstacle")
    if not case.region.rotation_invariant:
        return
    turn = np.linalg.qr(rng.standard_normal((case.size, case.size)))[0]
    covariance = turn @ case.covariance @ turn.T
    covariance = 0.5 * (covariance + covariance.T)
    if differ(replace(case, mean=turn @ case.mean, covariance=covariance), points @ turn.T):
        raise case.fail("the region must turn with the obstacle, or declare that it does not")


def _check_relation(case: RegionCase, points: Array, inside: BoolArray) -> None:
    relation, gauge = case.region.relation, case.gauge(points)
    if relation in (Relation.INNER, Relation.EXACT) and (gauge[inside] > 1 + _NEAR).any():
        raise case.fail(f"declared {relation}, but it holds points outside the exact sum")
    if relation in (Relation.OUTER, Relation.EXACT) and (gauge[~inside] < 1 - _NEAR).any():
        raise case.fail(f"declared {relation}, but it leaves out points of the exact sum")


def _check_guarantee(case: RegionCase, reach: Array) -> None:
    if case.region.guarantee is Guarantee.NONE:
        return
    worst = float(collision_probability(reach, case.covariance, case.margin).max())
    if worst > case.tail * (1 + 1e-6):
        raise case.fail(
            f"declared guarantee {case.region.guarantee}, but the collision risk on the boundary "
            f"reaches {worst:.3g}"
        )


def _check_area(case: RegionCase, rng: np.random.Generator) -> None:
    area = float(case.region.area(case.parameters, case.level))
    if case.size == 2:
        edge = case.region.boundary(case.parameters, float(case.level), 1000)
        if edge.shape != (1000, 2):
            raise case.fail(f"boundary must return (count, 2); got {edge.shape}")
        ahead = np.roll(edge, -1, axis=0)
        counted = 0.5 * float((edge[:, 0] * ahead[:, 1] - edge[:, 1] * ahead[:, 0]).sum())
        slack = 1e-4 * area
    else:
        box, draws = 3.0 * case.extents[0], 10_000
        sample = case.mean + rng.uniform(-0.5, 0.5, (draws, case.size)) * box
        share = float(case.contains(sample).mean())
        counted = share * box**case.size
        slack = 5.0 * np.sqrt(share * (1 - share) / draws) * box**case.size
    if abs(counted - area) > slack:
        raise case.fail(
            f"area() says {area:.6g}, its counter-clockwise boundary or contains() {counted:.6g}"
        )


def _refuses(case: RegionCase) -> bool:
    try:
        return case.parameters.size == 0
    except WideberthError:
        return True


def _check_beyond(case: RegionCase, twin: Twin, points: Array, rng: np.random.Generator) -> None:
    """Look beyond the bounds: fatrop keeps them only in the end, and never ends on a NaN."""
    start = np.array(case.region.auxiliary(len(case.mean)).start)
    spread = rng.uniform(-3.0, 3.0, (len(points), len(start)))
    for level in (-3.0, 0.0, float(case.level), 30.0):
        values, gradients, _ = twin(points, case.parameters, level, start + spread)
        if not (np.isfinite(values).all() and np.isfinite(gradients).all()):
            raise case.fail(
                "constraint and gradient must be finite also where auxiliaries and level are "
                f"beyond their bounds (level {level:g})"
            )


def _check_degenerate(region: Region, size: int, twin: Twin, rng: np.random.Generator) -> None:
    mean = np.ones(size)
    points = np.stack([mean, mean + 0.7, mean + np.eye(size)[0], mean + 30.0])
    for deviations in ([0.0] * size, [1.0] + [0.0] * (size - 1), [1.0] * (size - 1) + [1e-4]):
        covariance = turned(rng, np.array(deviations))
        for margin, tail in ((0.0, 0.05), (1.0, 0.05), (0.0, 1e-12), (1.0, 1.0 - 1e-9)):
            case = RegionCase(region, mean, covariance, np.asarray(margin), np.asarray(tail))
            if min(deviations) == 0.0 and not region.singular_covariances and _refuses(case):
                continue
            if not np.isfinite(case.parameters).all():
                raise case.fail("parameters must be finite for degenerate covariances")
            values, gradients, _ = twin(points, case.parameters, float(case.level))
            if not (np.isfinite(values).all() and np.isfinite(gradients).all()):
                raise case.fail("constraint and gradient must be finite, at the centre too")
            if tail == 0.05 and values[-1] < 0.0:
                raise case.fail("a point 30 standard deviations away must be outside")

"""The contract of a Region, checked on random obstacles."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np

from ..numerics.symbolic import ca
from ..region import Bounded, ClosedForm, Guarantee, Region, Relation
from ..risk.collision_probability import collision_probability
from ..values.arrays import Array, BoolArray
from ..values.errors import WideberthError
from .laws import Law, each, require
from .region_cases import RegionCase, Sides, random_auxiliaries, sphere, turned
from .twin import Twin, compile_twin

_TAILS = (1.0 - 1e-9, 0.999, 0.5, 0.1, 0.05, 1e-3, 1e-12, 1e-15)
_NEAR = 1e-6
"""Share of its size by which a declared relation may be missed."""
_POINT = 1e-9
"""m; what is smaller is a point, such as the outline of an empty region."""
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
    AssertionError : names every law that does not hold, and where.
    """
    require(laws(region, dimensions=dimensions, rng=rng))


def laws(
    region: Region,
    *,
    dimensions: Sequence[int] | None = None,
    rng: np.random.Generator | None = None,
) -> tuple[Law, ...]:
    """Return the laws of a region; the arguments are those of `check_region`."""
    sizes = tuple(region.dimensions if dimensions is None else dimensions)
    drawn, *seeds = (np.random.default_rng(0) if rng is None else rng).spawn(6)
    around = _Surroundings(region, sizes, drawn)
    guessing, moving, turning, area, beyond = seeds
    flat = "" if any(len(region.auxiliary(size)) for size in sizes) else "it has no auxiliaries"
    fixed = "" if region.rotation_invariant else "it declares rotation_invariant = False"
    unrelated = "it declares no relation" if region.relation is Relation.NONE else ""
    closed = "" if isinstance(region, ClosedForm) else "its parameters have no closed form"
    unbounded = "" if isinstance(region, Bounded) else "no disc is known to hold it"
    unsafe = "it declares no guarantee" if region.guarantee is Guarantee.NONE else ""

    def law(name: str, check: Callable[[_Probe], None], exception: str = "") -> Law:
        return Law(name, each(check, lambda: around.probes), exception)

    return (
        Law("level and tail are inverse", each(partial(_check_level, region), lambda: sizes)),
        law("symbolic constraint and contains agree", _Probe.check_sides),
        law("the closed form of the parameters is theirs", _check_closed_form, closed),
        law("no auxiliary proves too much", partial(_Probe.check_guesses, rng=guessing), flat),
        law("finite beyond the bounds", partial(_check_beyond, rng=beyond)),
        law("gradient at the boundary", _check_gradient),
        law("grows with margin and level", _check_growth),
        law("lies within its outer radius", _check_radius, unbounded),
        law("moves with the obstacle", partial(_check_shift, rng=moving)),
        law("turns with the obstacle", partial(_check_turn, rng=turning), fixed),
        law("relation to the exact sum", _check_relation, unrelated),
        law("guarantee of the risk", _check_guarantee, unsafe),
        law("area", partial(_check_area, rng=area)),
        Law("degenerate covariances", lambda: _check_degenerate(around)),
    )


@dataclass(frozen=True, eq=False)
class _Probe:
    """An obstacle with points around it, and points on the region's boundary.

    Attributes
    ----------
    case : the region for this obstacle.
    twin : its symbolic constraint.
    usual : whether the obstacle is one without extremes.
    reach : (R, D) m, from the mean to the boundary.
    points : (K, D) m.
    """

    case: RegionCase
    twin: Twin
    usual: bool
    reach: Array
    points: Array

    @cached_property
    def sides(self) -> Sides:
        return self.case.bracket(self.points)

    @cached_property
    def inside(self) -> BoolArray:
        return self.case.contains(self.points)

    def check_sides(self) -> None:
        check_sides(self.case, self.twin, self.points, self.sides)

    def check_guesses(self, rng: np.random.Generator) -> None:
        check_guesses(self.case, self.twin, self.points, self.sides, rng)


@dataclass(frozen=True, eq=False)
class _Surroundings:
    """The obstacles and points that the laws of one region share."""

    region: Region
    sizes: tuple[int, ...]
    rng: np.random.Generator

    @cached_property
    def twins(self) -> dict[int, Twin]:
        return {size: compile_twin(self.region, size) for size in self.sizes}

    @cached_property
    def probes(self) -> list[_Probe]:
        return [probe for size in self.sizes for probe in self._drawn(size)]

    def _drawn(self, size: int) -> Iterator[_Probe]:
        for axis_ratio, margin, tail, usual in (
            (1.0, 1.5, 0.05, True),
            (0.5, 0.4, 0.1, True),
            (0.1, 1.0, 0.3, True),
            (1e-4, 0.5, 1e-12, False),
            (0.3, 0.7, 1.0 - 1e-9, False),
        ):
            covariance = turned(self.rng, np.linspace(1.0, axis_ratio, size))
            mean = self.rng.uniform(-3.0, 3.0, size)
            case = RegionCase(self.region, mean, covariance, np.asarray(margin), np.asarray(tail))
            rays = case.rays(sphere(self.rng, _RAYS, size))
            reach = case.reach(rays)[1][:, None] * rays
            spread = mean + (_FACTORS[:, None, None] * reach).reshape(-1, size)
            scattered = mean + self.rng.uniform(-1.5, 1.5, (_RAYS, size)) * case.extents[0]
            points = np.concatenate([spread, scattered])
            yield _Probe(case, self.twins[size], usual, reach, points)


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


def _check_closed_form(probe: _Probe) -> None:
    case, size = probe.case, len(probe.case.mean)
    region = case.region
    if not (probe.usual and isinstance(region, ClosedForm)):
        return
    given = ca.SX.sym("mean", size), ca.SX.sym("covariance", size, size), ca.SX.sym("margin")
    try:
        found = ca.Function("found", given, [ca.densify(region.closed_form(*given))])
    except WideberthError:  # in this dimension it has none
        return
    numbers = np.array(found(case.mean, case.covariance, float(case.margin))).ravel()
    if numbers.shape != case.parameters.shape or not np.isfinite(numbers).all():
        raise case.fail(f"closed_form gives {numbers}; wanted as many as parameters, finite")
    spread = np.linalg.eigvalsh(case.covariance)
    if spread[-1] - spread[0] < 1e-9 * spread[-1]:
        return  # any axes are those of a round covariance
    values, *_ = probe.twin(probe.points, case.parameters, float(case.level))
    others, *_ = probe.twin(probe.points, numbers, float(case.level))
    if not np.allclose(values, others, rtol=1e-6, atol=1e-8):
        raise case.fail("closed_form and parameters must state the same constraint")


def _check_gradient(probe: _Probe) -> None:
    case = probe.case
    if not probe.usual or not case.contains(case.mean[None])[0]:
        return  # an empty region has no boundary
    _, gradients, _ = probe.twin(case.mean + probe.reach, case.parameters, float(case.level))
    size = np.linalg.norm(gradients, axis=1) * case.extents[0]
    if not (np.isfinite(size).all() and size.min() > 1e-3):
        raise case.fail("the gradient must be finite and must not vanish at the boundary")


def _check_growth(probe: _Probe) -> None:
    case, points, inside = probe.case, probe.points, probe.inside
    if (inside & ~replace(case, margin=1.2 * case.margin).contains(points)).any():
        raise case.fail("the region must grow with the margin")
    level = case.level + 0.3
    if (inside & ~case.region.contains(points, case.parameters, level)).any():
        raise case.fail("the region must grow with the level")


def _check_radius(probe: _Probe) -> None:
    case, region = probe.case, probe.case.region
    assert isinstance(region, Bounded)
    deviations = np.sqrt(np.linalg.eigvalsh(case.covariance)[::-1])
    radius = float(region.outer_radius(deviations, case.margin, case.level))
    held = np.concatenate([probe.points[probe.inside], case.mean + probe.reach])
    away = np.linalg.norm(held - case.mean, axis=1).max()
    if not away <= radius * (1 + _NEAR) + _POINT:
        raise case.fail(f"outer_radius is {radius:.6g}; a place within lies {away:.6g} away")


def _check_shift(probe: _Probe, rng: np.random.Generator) -> None:
    case = probe.case
    shift = rng.uniform(-5.0, 5.0, case.size)
    if _differ(probe, replace(case, mean=case.mean + shift), probe.points + shift):
        raise case.fail("the region must move with the obstacle")


def _check_turn(probe: _Probe, rng: np.random.Generator) -> None:
    case = probe.case
    turn = np.linalg.qr(rng.standard_normal((case.size, case.size)))[0]
    covariance = turn @ case.covariance @ turn.T
    covariance = 0.5 * (covariance + covariance.T)
    other = replace(case, mean=turn @ case.mean, covariance=covariance)
    if _differ(probe, other, probe.points @ turn.T):
        raise case.fail(
            "the region must turn with the obstacle, or declare rotation_invariant = False"
        )


def _differ(probe: _Probe, other: RegionCase, places: Array) -> bool:
    """Return whether points changed sides when the obstacle moved along with them."""
    surely, maybe = probe.sides
    inside = other.contains(places)
    return bool(((surely & ~inside) | (~maybe & inside)).any())


def _check_relation(probe: _Probe) -> None:
    case, inside = probe.case, probe.inside
    relation, gauge = case.region.relation, case.gauge(probe.points)
    if relation in (Relation.INNER, Relation.EXACT) and (gauge[inside] > 1 + _NEAR).any():
        raise case.fail(f"declared {relation}, but it holds points outside the exact sum")
    if relation in (Relation.OUTER, Relation.EXACT) and (gauge[~inside] < 1 - _NEAR).any():
        raise case.fail(f"declared {relation}, but it leaves out points of the exact sum")


def _check_guarantee(probe: _Probe) -> None:
    case = probe.case
    worst = float(collision_probability(probe.reach, case.covariance, case.margin).max())
    if worst > case.tail * (1 + 1e-6):
        raise case.fail(
            f"declared guarantee {case.region.guarantee}, but the collision risk on the boundary "
            f"reaches {worst:.3g}"
        )


def _check_area(probe: _Probe, rng: np.random.Generator) -> None:
    case = probe.case
    if not probe.usual:
        return
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


def _check_beyond(probe: _Probe, rng: np.random.Generator) -> None:
    """Look beyond the bounds: fatrop keeps them only in the end, and never ends on a NaN."""
    case, points = probe.case, probe.points
    start = np.array(case.region.auxiliary(len(case.mean)).start)
    spread = rng.uniform(-3.0, 3.0, (len(points), len(start)))
    for level in (-3.0, 0.0, float(case.level), 30.0):
        values, gradients, _ = probe.twin(points, case.parameters, level, start + spread)
        if not (np.isfinite(values).all() and np.isfinite(gradients).all()):
            raise case.fail(
                "constraint and gradient must be finite also where auxiliaries and level are "
                f"beyond their bounds (level {level:g})"
            )


def _check_degenerate(around: _Surroundings) -> None:
    for size in around.sizes:
        for deviations in ([0.0] * size, [1.0] + [0.0] * (size - 1), [1.0] * (size - 1) + [1e-4]):
            for margin, tail in ((0.0, 0.05), (1.0, 0.05), (0.0, 1e-12), (1.0, 1.0 - 1e-9)):
                _check_flat(around, np.array(deviations), margin, tail)


def _check_flat(around: _Surroundings, deviations: Array, margin: float, tail: float) -> None:
    """Check one obstacle whose covariance is singular, or nearly so."""
    region, size = around.region, len(deviations)
    mean = np.ones(size)
    points = np.stack([mean, mean + 0.7, mean + np.eye(size)[0], mean + 30.0])
    covariance = turned(np.random.default_rng(size), deviations)
    case = RegionCase(region, mean, covariance, np.asarray(margin), np.asarray(tail))
    if deviations.min() == 0.0 and not region.singular_covariances and _refuses(case):
        return
    if not np.isfinite(case.parameters).all():
        raise case.fail("parameters must be finite for degenerate covariances")
    values, gradients, _ = around.twins[size](points, case.parameters, float(case.level))
    if not (np.isfinite(values).all() and np.isfinite(gradients).all()):
        raise case.fail("constraint and gradient must be finite, at the centre too")
    if tail == 0.05 and values[-1] < 0.0:
        raise case.fail("a point 30 standard deviations away must be outside")

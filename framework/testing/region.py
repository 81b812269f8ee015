"""The contract of a Region, checked on random obstacles."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ..numerics.symbolic import ca
from ..region import Bounded, ClosedForm, Guarantee, Region, Relation
from ..risk.collision_probability import collision_probability
from ..values.arrays import Array, BoolArray
from ..values.errors import WideberthError
from .laws import Contract, Law, law, stated
from .numeric_constraint import ConstraintValues, NumericConstraint, compile_constraint
from .region_cases import RegionCase, Sides, random_auxiliaries, sphere, turned

_TAILS = (1.0 - 1e-9, 0.999, 0.5, 0.1, 0.05, 1e-3, 1e-12, 1e-15)
_NEAR = 1e-6
"""Share of its size by which a declared relation may be missed."""
_POINT = 1e-9
"""m; what is smaller is a point, such as the outline of an empty region."""
_RAYS = 200
_FACTORS = np.array([0.3, 0.95, 1.0 - 1e-4, 1.0 + 1e-4, 1.05, 2.0])
"""Multiples of the boundary's distance from the mean at which points are taken."""


@Contract
def check_region(
    region: Region,
    *,
    dimensions: Sequence[int] | None = None,
    rng: np.random.Generator | None = None,
) -> Iterator[Law]:
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
    sizes = tuple(region.dimensions if dimensions is None else dimensions)
    generator = np.random.default_rng(0) if rng is None else rng
    around = _Surroundings(region, sizes, generator.spawn(1)[0])
    yield from stated(_Surroundings, region, lambda: [around], generator)
    yield from stated(Probe, region, lambda: around.probes, generator)


def has_auxiliaries(region: Region) -> bool:
    """Whether a region has auxiliaries in any dimension."""
    return any(len(region.auxiliary(size)) for size in region.dimensions)


@dataclass(frozen=True, eq=False)
class Probe:
    """An obstacle with points around it, and points on the region's boundary.

    Attributes
    ----------
    case : the region for this obstacle.
    constraint : its symbolic constraint.
    usual : whether the obstacle is one without extremes.
    reach : (R, D) m, from the mean to the boundary.
    points : (K, D) m.
    """

    case: RegionCase
    constraint: NumericConstraint
    usual: bool
    reach: Array
    points: Array

    @cached_property
    def sides(self) -> Sides:
        """`RegionCase.bracket` of the points."""
        return self.case.bracket(self.points)

    @cached_property
    def inside(self) -> BoolArray:
        """Which points the region holds."""
        return self.case.contains(self.points)

    def values(
        self, level: float | None = None, auxiliaries: Array | None = None
    ) -> ConstraintValues:
        """Return the symbolic constraint at the points, its gradient, and the equalities."""
        held = float(self.case.level) if level is None else level
        return self.constraint(self.points, self.case.parameters, held, auxiliaries)

    @law("symbolic constraint and contains agree")
    def check_sides(self) -> None:
        """Check that it is finite, and holds exactly outside, up to rounding."""
        values, gradients, ties = self.values()
        if not (np.isfinite(values).all() and np.isfinite(gradients).all()):
            raise self.case.fail("constraint and gradient must be finite")
        if ties.max(initial=0.0) > 1e-6:
            raise self.case.fail("auxiliary_start must satisfy the equalities")
        surely, maybe = self.sides
        differ = (surely & (values >= 0.0)) | (~maybe & (values < 0.0))
        if differ.any():
            where = self.points[differ][0].tolist()
            raise self.case.fail(f"symbolic constraint and contains() differ at {where}")

    @law("the closed form of the parameters is theirs", ClosedForm, "they have no closed form")
    def check_closed_form(self) -> None:
        """Check numbers of the same constraint, for any covariance that is not round."""
        case, region, size = self.case, self.case.region, self.case.size
        if not (self.usual and isinstance(region, ClosedForm)):
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
        others, *_ = self.constraint(self.points, numbers, float(case.level))
        if not np.allclose(self.values()[0], others, rtol=1e-6, atol=1e-8):
            raise case.fail("closed_form and parameters must state the same constraint")

    @law("no auxiliary proves too much", has_auxiliaries, "it has no auxiliaries")
    def check_guesses(self, rng: np.random.Generator) -> None:
        """Check that no random auxiliary makes a point inside look outside."""
        drawn = random_auxiliaries(self.case.region, self.case.size, len(self.points), rng)
        values, _, ties = self.values(None, drawn)
        if (self.sides[0] & (values >= 0.0) & (ties < 1e-6)).any():
            raise self.case.fail("no auxiliary may make a point inside look outside")

    @law("finite beyond the bounds")
    def check_beyond(self, rng: np.random.Generator) -> None:
        """Look beyond the bounds: fatrop keeps them only in the end, and never ends on a NaN."""
        case = self.case
        start = np.array(case.region.auxiliary(case.size).start)
        spread = rng.uniform(-3.0, 3.0, (len(self.points), len(start)))
        for level in (-3.0, 0.0, float(case.level), 30.0):
            values, gradients, _ = self.values(level, start + spread)
            if not (np.isfinite(values).all() and np.isfinite(gradients).all()):
                raise case.fail(
                    "constraint and gradient must be finite also where auxiliaries and level are "
                    f"beyond their bounds (level {level:g})"
                )

    @law("gradient at the boundary")
    def check_gradient(self) -> None:
        """Check that it is finite and does not vanish, but for an empty region."""
        case = self.case
        if not self.usual or not case.contains(case.mean[None])[0]:
            return
        _, gradients, _ = self.constraint(
            case.mean + self.reach, case.parameters, float(case.level)
        )
        size = np.linalg.norm(gradients, axis=1) * case.extents[0]
        if not (np.isfinite(size).all() and size.min() > 1e-3):
            raise case.fail("the gradient must be finite and must not vanish at the boundary")

    @law("grows with margin and level")
    def check_growth(self) -> None:
        """Check that what is inside stays inside."""
        case, points = self.case, self.points
        if (self.inside & ~replace(case, margin=1.2 * case.margin).contains(points)).any():
            raise case.fail("the region must grow with the margin")
        if (self.inside & ~case.region.contains(points, case.parameters, case.level + 0.3)).any():
            raise case.fail("the region must grow with the level")

    @law("lies within its outer radius", Bounded, "no disc is known to hold it")
    def check_radius(self) -> None:
        """Check points inside and on the boundary."""
        case, region = self.case, self.case.region
        assert isinstance(region, Bounded)
        deviations = np.sqrt(np.linalg.eigvalsh(case.covariance)[::-1])
        radius = float(region.outer_radius(deviations, case.margin, case.level))
        held = np.concatenate([self.points[self.inside], case.mean + self.reach])
        away = np.linalg.norm(held - case.mean, axis=1).max()
        if not away <= radius * (1 + _NEAR) + _POINT:
            raise case.fail(f"outer_radius is {radius:.6g}; a place within lies {away:.6g} away")

    @law("moves with the obstacle")
    def check_shift(self, rng: np.random.Generator) -> None:
        """Shift obstacle and points."""
        case = self.case
        shift = rng.uniform(-5.0, 5.0, case.size)
        if self._differ(replace(case, mean=case.mean + shift), self.points + shift):
            raise case.fail("the region must move with the obstacle")

    @law(
        "turns with the obstacle",
        lambda region: region.rotation_invariant,
        "it declares rotation_invariant = False",
    )
    def check_turn(self, rng: np.random.Generator) -> None:
        """Turn or mirror obstacle and points."""
        case = self.case
        turn = np.linalg.qr(rng.standard_normal((case.size, case.size)))[0]
        covariance = turn @ case.covariance @ turn.T
        covariance = 0.5 * (covariance + covariance.T)
        other = replace(case, mean=turn @ case.mean, covariance=covariance)
        if self._differ(other, self.points @ turn.T):
            raise case.fail(
                "the region must turn with the obstacle, or declare rotation_invariant = False"
            )

    def _differ(self, other: RegionCase, places: Array) -> bool:
        """Return whether points changed sides when the obstacle moved along with them."""
        surely, maybe = self.sides
        inside = other.contains(places)
        return bool(((surely & ~inside) | (~maybe & inside)).any())

    @law(
        "relation to the exact sum",
        lambda region: region.relation is not Relation.NONE,
        "it declares no relation",
    )
    def check_relation(self) -> None:
        """Compare with the ellipse plus the disc."""
        case, inside = self.case, self.inside
        relation, gauge = case.region.relation, case.gauge(self.points)
        if relation in (Relation.INNER, Relation.EXACT) and (gauge[inside] > 1 + _NEAR).any():
            raise case.fail(f"declared {relation}, but it holds points outside the exact sum")
        if relation in (Relation.OUTER, Relation.EXACT) and (gauge[~inside] < 1 - _NEAR).any():
            raise case.fail(f"declared {relation}, but it leaves out points of the exact sum")

    @law(
        "guarantee of the risk",
        lambda region: region.guarantee is not Guarantee.NONE,
        "it declares no guarantee",
    )
    def check_guarantee(self) -> None:
        """Compute the collision probability along the boundary."""
        case = self.case
        worst = float(collision_probability(self.reach, case.covariance, case.margin).max())
        if worst > case.tail * (1 + 1e-6):
            raise case.fail(
                f"declared guarantee {case.region.guarantee}, but the collision risk on the "
                f"boundary reaches {worst:.3g}"
            )

    @law("area")
    def check_area(self, rng: np.random.Generator) -> None:
        """Compare with the boundary in the plane, and with random points in space."""
        case = self.case
        if not self.usual:
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
                f"area() says {area:.6g}, its counter-clockwise boundary or contains() "
                f"{counted:.6g}"
            )


@dataclass(frozen=True, eq=False)
class _Surroundings:
    """The obstacles and points that the laws of one region share."""

    region: Region
    sizes: tuple[int, ...]
    rng: np.random.Generator

    @cached_property
    def constraints(self) -> dict[int, NumericConstraint]:
        return {size: compile_constraint(self.region, size) for size in self.sizes}

    @cached_property
    def probes(self) -> list[Probe]:
        return [probe for size in self.sizes for probe in self._drawn(size)]

    def _drawn(self, size: int) -> Iterator[Probe]:
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
            yield Probe(case, self.constraints[size], usual, reach, points)

    @law("level and tail are inverse")
    def check_level(self) -> None:
        region = self.region
        for size in self.sizes:
            levels = [region.level(tail, size) for tail in _TAILS]
            usual = [level for level, tail in zip(levels, _TAILS, strict=True) if tail <= 0.5]
            growing = (np.diff(levels) >= 0).all() and (np.diff(usual) > 0).all()
            assert np.isfinite(levels).all() and growing, (
                f"{region!r}: level must grow as the tail shrinks; got {levels}"
            )
            for tail, level in zip(_TAILS, levels, strict=True):
                back = region.tail(level, size)
                # Some regions do not shrink any further for large tails: they keep more.
                kept = back <= tail * (1 + 1e-6) and (tail > 0.5 or back >= tail * (1 - 1e-6))
                assert kept, f"{region!r}: tail(level({tail:g})) is {back:g} in {size}-D"

    @law("degenerate covariances")
    def check_degenerate(self) -> None:
        for size in self.sizes:
            line, disc = [1.0] + [0.0] * (size - 1), [1.0] * (size - 1) + [1e-4]
            for deviations in ([0.0] * size, line, disc):
                for margin, tail in ((0.0, 0.05), (1.0, 0.05), (0.0, 1e-12), (1.0, 1.0 - 1e-9)):
                    self._check_flat(np.array(deviations), margin, tail)

    def _check_flat(self, deviations: Array, margin: float, tail: float) -> None:
        """Check one obstacle whose covariance is singular, or nearly so."""
        region, size = self.region, len(deviations)
        mean = np.ones(size)
        points = np.stack([mean, mean + 0.7, mean + np.eye(size)[0], mean + 30.0])
        covariance = turned(np.random.default_rng(size), deviations)
        case = RegionCase(region, mean, covariance, np.asarray(margin), np.asarray(tail))
        if deviations.min() == 0.0 and not region.singular_covariances and _refuses(case):
            return
        if not (np.isfinite(case.parameters).all()):
            raise case.fail("parameters must be finite for degenerate covariances")
        values, gradients, _ = self.constraints[size](points, case.parameters, float(case.level))
        if not (np.isfinite(values).all() and np.isfinite(gradients).all()):
            raise case.fail("constraint and gradient must be finite, at the centre too")
        if tail == 0.05 and values[-1] < 0.0:
            raise case.fail("a point 30 standard deviations away must be outside")


def _refuses(case: RegionCase) -> bool:
    try:
        return case.parameters.size == 0
    except WideberthError:
        return True

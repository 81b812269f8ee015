"""The contract of a StaticRegion, checked on random convex polygons and bodies."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from typing import Any, TypeAlias

import numpy as np

from ..static_region import StaticRegion
from ..values.arrays import Array
from ..values.motion import Pose
from ..values.polygon import best_direction
from .laws import Contract, Law, law, stated

_NEAR = 1e-6
"""m. Bodies closer to touching than this may count as either."""
_TIED = 1e-9
"""Equalities hold to this."""
_MOST = 8
"""Vertices that the checked polygons have room for."""
_BODIES: tuple[tuple[tuple[float, float], ...], ...] = (
    (),
    ((0.6, 0.3), (-0.6, 0.3), (-0.6, -0.3), (0.6, -0.3)),
    ((1.0, 0.0), (-0.2, 0.5), (-0.4, -0.4)),
)
"""A point, a car's rectangle about its centre, and a triangle that is even about nothing."""

Function: TypeAlias = Any
"""A compiled `casadi.Function`."""


@Contract
def check_static_region(
    region: StaticRegion, *, rng: np.random.Generator | None = None
) -> Iterator[Law]:
    """Check the laws of a static region.

    Random convex polygons of 3 to 8 vertices, a point and bodies with corners at random
    headings, with and without spread; the truth is `wideberth.framework.values.polygon`.

    Parameters
    ----------
    region : what to check.
    rng : of the random polygons and poses; a fixed seed by default.

    Raises
    ------
    AssertionError : names every law that does not hold, and where.
    """
    generator = np.random.default_rng(0) if rng is None else rng
    drawn = generator.spawn(1)[0]

    @cache
    def cases() -> list[_Case]:
        return [case for outline in _BODIES for case in _cases(region, outline, drawn)]

    return stated(_Case, region, cases, generator)


def _compiled(region: StaticRegion, outline: tuple[tuple[float, float], ...]) -> Function:
    """Compile the constraint of one pose: inequalities, equalities, slopes by the position."""
    from ..numerics.symbolic import ca

    place, heading = ca.SX.sym("place", 2), ca.SX.sym("heading")
    parameters = ca.SX.sym("parameters", region.parameter_count(_MOST))
    auxiliary = ca.SX.sym("auxiliary", len(region.auxiliary(_MOST, max(len(outline), 1))))
    pose = Pose((place[0], place[1]), heading, outline)
    stated = region.constraint(pose, parameters, auxiliary)
    free, tied = ca.vertcat(*stated.inequalities), ca.vertcat(*stated.equalities)
    everything = ca.vertcat(free, tied)
    slopes = ca.jacobian(free, place)
    bends = ca.jacobian(everything, ca.vertcat(heading, auxiliary))
    outputs: list[Any] = [free, tied, slopes[:, 0], slopes[:, 1], ca.vec(bends)]
    return ca.Function("static", [place, heading, parameters, auxiliary], outputs)


@dataclass(frozen=True, eq=False)
class _Case:
    """One polygon and one body at many poses."""

    region: StaticRegion
    function: Function
    outline: tuple[tuple[float, float], ...]
    polygon: Array
    margin: float
    spread: Array
    places: Array
    headings: Array

    def pose(self, places: Array) -> Pose:
        return Pose((places[:, 0], places[:, 1]), self.headings, self.outline)

    @property
    def parameters(self) -> Array:
        return self.region.parameters(self.polygon, np.asarray(self.margin), self.spread)

    def start(self, places: Array) -> Array:
        numbers = np.broadcast_to(self.parameters, (len(places), self.parameters.shape[-1]))
        return self.region.auxiliary_start(self.pose(places), numbers)

    def clearance(self, places: Array) -> tuple[Array, Array]:
        """Distance beyond the margin, m, and the normal that attains it."""
        bodies = self.pose(places).corner_points()
        distance, normal = best_direction(bodies, self.polygon, self.spread)
        return distance - self.margin, normal

    def state(self, places: Array, auxiliaries: Array | None = None) -> tuple[Array, Array, Array]:
        """Smallest inequality, equalities and slope of the former, each per pose."""
        start = self.start(places) if auxiliaries is None else auxiliaries
        count = len(places)
        numbers = np.tile(self.parameters[:, None], count)
        given = [places.T, self.headings[None], numbers, start.T]
        free, tied, east, north, bends = (
            np.asarray(out.full()) for out in self.function.map(count)(*given)
        )
        if not all(np.isfinite(part).all() for part in (free, tied, east, north, bends)):
            raise self.fail("values and gradients must be finite everywhere")
        least = free.argmin(axis=0)
        each = np.arange(count)
        slopes = np.stack([east[least, each], north[least, each]], axis=-1)
        return free.min(axis=0), tied, slopes

    @law("counts, shapes and bounds")
    def check_numbers(self) -> None:
        """Check counts, shapes and bounds."""
        region, count = self.region, max(len(self.outline), 1)
        declared = region.auxiliary(_MOST, count)
        if not len(declared.lower) == len(declared.upper) == len(declared):
            raise self.fail("auxiliary must have as many bounds as starting values")
        if self.parameters.shape != (region.parameter_count(_MOST),):
            raise self.fail("parameters must return parameter_count numbers")
        start = self.start(self.places)
        if start.shape != (len(self.places), len(declared)):
            raise self.fail(f"auxiliary_start must return (..., {len(declared)})")
        if (start < declared.lower).any() or (start > declared.upper).any():
            raise self.fail("auxiliary_start must keep the bounds of the auxiliaries")

    @law("holds exactly where the body is clear")
    def check_sides(self) -> None:
        """Check equalities, and that the constraint holds exactly where the body is clear."""
        values, ties, _ = self.state(self.places)
        if np.abs(ties).max(initial=0.0) > _TIED:
            raise self.fail("auxiliary_start must satisfy the equalities")
        free, _ = self.clearance(self.places)
        wrong = ((values >= 0.0) != (free >= 0.0)) & (np.abs(free) > _NEAR)
        if wrong.any():
            where = self.places[wrong][0].tolist()
            raise self.fail(f"the constraint and the true clearance differ at {where}")

    @law("no auxiliary proves too much")
    def check_others(self, rng: np.random.Generator) -> None:
        """Check that auxiliaries of other positions, same heading, prove nothing false."""
        moved = self.places + rng.normal(0.0, 1.0, self.places.shape)
        other, _, _ = self.state(self.places, self.start(moved))
        free, _ = self.clearance(self.places)
        if ((other >= 0.0) & (free < -_NEAR)).any():
            raise self.fail("auxiliaries that are not the best must not prove more than they do")

    @law("slope at the boundary")
    def check_slope(self) -> None:
        """Check that the slope where a body touches the margin leads away from the polygon."""
        places = self.places.copy()
        for _ in range(4):  # one would do but for rounding: the normal leads to the boundary
            free, normal = self.clearance(places)
            places -= free[:, None] * normal
        free, _ = self.clearance(places)
        touching = np.abs(free) < _NEAR
        if not touching.any():
            raise self.fail("no pose touches the margin: the polygon is out of reach")
        _, _, slopes = self.state(places)
        size = np.hypot(slopes[:, 0], slopes[:, 1])[:, None]
        extent = self.margin + float(np.ptp(self.polygon, axis=0).max())
        if (size[touching] * extent < 1e-3).any():
            raise self.fail("at the boundary the gradient must not vanish")
        # At a corner there are many normals; a step of 1 mm along any gains 1 mm.
        gained, _ = self.clearance(places + 1e-3 * slopes / np.maximum(size, 1e-300))
        if (gained[touching] < 0.9e-3).any():
            raise self.fail("at the boundary the gradient must lead away from the polygon")

    def fail(self, law: str) -> AssertionError:
        return AssertionError(
            f"{law} (polygon {self.polygon.tolist()}, body "
            f"{self.outline}, margin {self.margin:g}, spread {self.spread.tolist()})"
        )


def _cases(
    region: StaticRegion, outline: tuple[tuple[float, float], ...], rng: np.random.Generator
) -> Iterator[_Case]:
    """Draw polygons of every number of vertices, with margins and spreads in turn."""
    function = _compiled(region, outline)
    for count in range(3, _MOST + 1):
        for deviations in ((0.0, 0.0), (0.4, 0.1), (0.5, 0.0)):
            turn = np.linalg.qr(rng.standard_normal((2, 2)))[0]
            root = turn * deviations
            size = float(rng.choice([0.3, 1.0, 4.0]))
            polygon = _convex(count, rng) * size + rng.uniform(-20.0, 20.0, 2)
            padded = np.concatenate([polygon, np.repeat(polygon[-1:], _MOST - count, axis=0)])
            reach = (2.0 * size + 1.5) * rng.uniform(-1.0, 1.0, (60, 2))
            places = np.concatenate([polygon.mean(axis=0) + reach, polygon])
            headings = rng.uniform(-np.pi, np.pi, len(places))
            margin = 0.0 if outline and count % 2 else float(rng.uniform(0.05, 0.8))
            spread = root @ root.T
            yield _Case(region, function, outline, padded, margin, spread, places, headings)


def _convex(count: int, rng: np.random.Generator) -> Array:
    """Draw points on an ellipse in order, not all on one side: a convex polygon."""
    angle = (np.arange(count) + rng.uniform(-0.3, 0.3, count)) * 2.0 * np.pi / count
    turn = np.linalg.qr(rng.standard_normal((2, 2)))[0]
    turn[:, 1] *= np.sign(np.linalg.det(turn))  # a reflection would turn it clockwise
    circle = np.stack([np.cos(angle), rng.uniform(0.2, 1.0) * np.sin(angle)], axis=-1)
    return np.asarray(circle @ turn.T, dtype=np.float64)

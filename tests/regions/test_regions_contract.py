"""Every built-in region keeps the public contract; regions that lie about themselves do not."""

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
import pytest

from wideberth.framework.plugins import registry
from wideberth.framework.region import Auxiliary, Bounded, Constraint, Guarantee, Region, Relation
from wideberth.framework.testing.region import check_region
from wideberth.framework.values.forecast import GaussianObstacle
from wideberth.framework.values.motion import Pose
from wideberth.regions.mahalanobis_ellipse import MahalanobisEllipse
from wideberth.tests.helpers.contracts import Contract
from wideberth.tests.helpers.region_variants import variants

BUILT_IN = [
    one for name in registry.names("regions") for one in variants(registry.load("regions", name))
]
CONTRACT = Contract.of(BUILT_IN, check_region.laws)


@pytest.mark.parametrize(("region", "law"), CONTRACT.cases())
def test_contract(region: str, law: str) -> None:
    CONTRACT.check(region, law)


@dataclass(frozen=True)
class Pretender(Bounded):
    """The paper's ellipse behind other claims or with one method broken."""

    broken: str = ""
    relation: ClassVar[Relation] = Relation.NONE
    guarantee: ClassVar[Guarantee] = Guarantee.NONE
    inner: ClassVar[MahalanobisEllipse] = MahalanobisEllipse()

    def parameters(self, obstacle: GaussianObstacle, margin: Any) -> Any:
        if self.broken == "rotation":
            kept = np.diagonal(obstacle.covariance, axis1=-2, axis2=-1)[..., None]
            obstacle = GaussianObstacle(obstacle.mean, kept * np.eye(2))
        if self.broken == "margin":
            margin = 1.0 / (np.asarray(margin) + 0.1)
        return self.inner.parameters(obstacle, margin)

    def parameter_count(self, dimension: int) -> int:
        return self.inner.parameter_count(dimension)

    def constraint(self, pose: Pose, parameters: Any, level: Any, auxiliary: Any) -> Constraint:
        stated = self.inner.constraint(pose, parameters, level, auxiliary)
        (value,) = stated.inequalities
        if self.broken == "symbolic":
            return Constraint((value - 0.05,))
        if self.broken == "auxiliary":
            return Constraint((value + auxiliary[0] ** 2,))
        if self.broken == "far":  # NaN beyond three times the size
            return Constraint((value * (1.1 - value) ** 0.5,))
        if self.broken == "beyond":
            return Constraint((value + 1e-12 * (level + 1.0) ** 0.5,))
        if self.broken == "gradient":
            return Constraint((value * value * value,))
        return stated

    def auxiliary(self, dimension: int) -> Auxiliary:
        declared = Auxiliary((-np.inf,), (1.0,), (0.0,))
        return declared if self.broken == "auxiliary" else Auxiliary()

    def contains(self, points: Any, parameters: Any, level: Any) -> Any:
        return self.inner.contains(points, parameters, level)

    def boundary(self, parameters: Any, level: float, count: int) -> Any:
        points = self.inner.boundary(parameters, level, count)
        return points[::-1] if self.broken == "clockwise" else points

    def area(self, parameters: Any, level: Any) -> Any:
        return self.inner.area(parameters, level) * (1.01 if self.broken == "area" else 1.0)

    def outer_radius(self, deviations: Any, margin: Any, level: Any) -> Any:
        share = 0.99 if self.broken == "radius" else 1.0
        return share * self.inner.outer_radius(deviations, margin, level)

    def level(self, tail: float, dimension: int = 2) -> float:
        level = self.inner.level(tail, dimension)
        return np.nan if self.broken == "level" and tail > 0.9999 else level

    def tail(self, level: float, dimension: int = 2) -> float:
        return self.inner.tail(level, dimension) ** (1.1 if self.broken == "tail" else 1.0)


class CallsItselfOuter(Pretender):
    relation: ClassVar[Relation] = Relation.OUTER


class CallsItselfExact(Pretender):
    relation: ClassVar[Relation] = Relation.EXACT


class Thick(Pretender):
    """Inner but for thin covariances: to them it adds a millimetre."""

    relation: ClassVar[Relation] = Relation.INNER

    def parameters(self, obstacle: GaussianObstacle, margin: Any) -> Any:
        thin = np.linalg.cond(obstacle.covariance) > 1e4
        return self.inner.parameters(obstacle, np.asarray(margin) + 1e-3 * thin)


class Shrunk(Pretender):
    """Ignores most of the level, yet promises its content."""

    guarantee: ClassVar[Guarantee] = Guarantee.CONTENT

    def parameters(self, obstacle: GaussianObstacle, margin: Any) -> Any:
        small = GaussianObstacle(obstacle.mean, obstacle.covariance * 1e-2)
        return self.inner.parameters(small, margin)


@pytest.mark.parametrize(
    ("region", "law"),
    [
        (Pretender("symbolic"), r"symbolic constraint and contains"),
        (Pretender("gradient"), r"gradient must be finite"),
        (Pretender("rotation"), r"must turn with the obstacle"),
        (Pretender("margin"), r"grow with the margin"),
        (Pretender("clockwise"), r"counter-clockwise"),
        (Pretender("radius"), r"outer_radius is"),
        (Pretender("area"), r"area\(\) says"),
        (Pretender("tail"), r"tail\(level"),
        (Pretender("level"), r"level must grow"),
        (Pretender("auxiliary"), r"no auxiliary may"),
        (Pretender("far"), r"must be finite"),
        (Pretender("beyond"), r"finite also where auxiliaries and level are"),
        (Thick(), r"outside the exact sum"),
        (CallsItselfOuter(), r"leaves out points"),
        (CallsItselfExact(), r"leaves out points"),
        (Shrunk(), r"collision risk on the boundary"),
    ],
    ids=repr,
)
def test_a_broken_law_is_named(region: Region, law: str) -> None:
    with pytest.raises(AssertionError, match=law):
        check_region(region)


def test_an_honest_copy_passes() -> None:
    check_region(Pretender())

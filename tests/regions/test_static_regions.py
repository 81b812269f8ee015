"""Static regions keep their contract and their risk, and IPOPT projects onto them."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
from scipy import special

from wideberth.framework.numerics.symbolic import ca
from wideberth.framework.plugins.registry import load, names
from wideberth.framework.region import Auxiliary, Constraint
from wideberth.framework.static_region import StaticRegion
from wideberth.framework.testing.static_region import check_static_region
from wideberth.framework.values.errors import WideberthError
from wideberth.framework.values.motion import Pose
from wideberth.framework.values.polygon import best_direction
from wideberth.regions.static.dual import Dual
from wideberth.regions.static.separating_line import StaticSeparatingLine
from wideberth.tests.helpers.contracts import Contract

BUILT_IN = [load("static_regions", name)() for name in names("static_regions")]
EXACT = [StaticSeparatingLine(), Dual()]
WALL = np.array([[0.0, 0.0], [3.0, -0.5], [3.5, 1.5], [1.0, 2.5], [-0.5, 1.2]])
PADDED = np.concatenate([WALL, WALL[-1:].repeat(3, axis=0)])
CAR = ((0.6, 0.3), (-0.6, 0.3), (-0.6, -0.3), (0.6, -0.3))
NONE = np.zeros((2, 2))


CONTRACT = Contract.of(BUILT_IN, check_static_region.laws)


@pytest.mark.parametrize(("region", "law"), CONTRACT.cases())
def test_contract(region: str, law: str) -> None:
    CONTRACT.check(region, law)


NUMBERS, SIDES, OTHERS, SLOPE, _ = (
    one.name for one in check_static_region.laws(StaticSeparatingLine())
)


@dataclass(frozen=True)
class Pretender(StaticRegion):
    """The separating line with one law broken."""

    broken: str = ""

    def parameters(self, parts: Any, margin: Any, spread: Any) -> Any:
        if self.broken == "margin":
            margin = 0.9 * margin
        if self.broken == "spread":
            spread = 0.8 * spread
        return StaticSeparatingLine().parameters(parts, margin, spread)

    def parameter_count(self, corners: int) -> int:
        return StaticSeparatingLine().parameter_count(corners) + (self.broken == "count")

    def auxiliary(self, corners: int, outline: int) -> Auxiliary:
        bound = 1.0 if self.broken == "bounds" else np.inf
        return Auxiliary((-bound,), (bound,), (0.0,))

    def auxiliary_start(self, pose: Pose, parameters: Any) -> Any:
        best = StaticSeparatingLine().auxiliary_start(pose, parameters)
        return best + (0.3 if self.broken == "start" else 0.0)

    def constraint(self, pose: Pose, parameters: Any, auxiliary: Any) -> Constraint:
        values = StaticSeparatingLine().constraint(pose, parameters, auxiliary).inequalities
        if self.broken == "slope":
            return Constraint(tuple(value**3 for value in values))
        if self.broken == "finite":  # a distance has no slope where it is zero
            far = ca.sqrt(sum((pose.position[i] - parameters[i]) ** 2 for i in range(2)))
            return Constraint(tuple(value * (1.0 + far) for value in values))
        if self.broken == "corner":
            return Constraint(values[: len(values) // 2])
        ties = (ca.sin(2.0 * auxiliary[0]),) if self.broken == "tie" else ()
        return Constraint(values, ties)


@dataclass(frozen=True)
class Boastful(StaticRegion):
    """Right for the best angle; any other angle proves too much."""

    def parameters(self, parts: Any, margin: Any, spread: Any) -> Any:
        return StaticSeparatingLine().parameters(parts, margin, spread)

    def parameter_count(self, corners: int) -> int:
        return StaticSeparatingLine().parameter_count(corners)

    def auxiliary(self, corners: int, outline: int) -> Auxiliary:
        return Auxiliary((-np.inf,) * 3, (np.inf,) * 3, (0.0,) * 3)

    def auxiliary_start(self, pose: Pose, parameters: Any) -> Any:
        best = StaticSeparatingLine().auxiliary_start(pose, parameters)
        return np.concatenate([best, np.stack(pose.position, axis=-1)], axis=-1)

    def constraint(self, pose: Pose, parameters: Any, auxiliary: Any) -> Constraint:
        values = StaticSeparatingLine().constraint(pose, parameters, auxiliary).inequalities
        x, y = pose.position
        off = (x - auxiliary[1]) ** 2 + (y - auxiliary[2]) ** 2
        return Constraint(tuple(value + off for value in values))


@pytest.mark.parametrize(
    ("region", "law", "words"),
    [
        (Pretender("margin"), SIDES, "true clearance differ"),
        (Pretender("spread"), SIDES, "true clearance differ"),
        (Pretender("corner"), SIDES, "true clearance differ"),
        (Pretender("start"), SIDES, "true clearance differ"),
        (Pretender("count"), NUMBERS, "parameter_count numbers"),
        (Pretender("bounds"), NUMBERS, "keep the bounds"),
        (Pretender("tie"), SIDES, "satisfy the equalities"),
        (Pretender("slope"), SLOPE, "gradient must not vanish"),
        (Pretender("finite"), SIDES, "finite everywhere"),
        (Boastful(), OTHERS, "not the best must not prove more"),
    ],
    ids=repr,
)
def test_a_broken_law_is_named(region: StaticRegion, law: str, words: str) -> None:
    (broken,) = (one for one in check_static_region.laws(region) if one.name == law)
    with pytest.raises(AssertionError, match=words):
        broken.check()


def test_an_honest_copy_passes() -> None:
    check_static_region(Pretender())


# the numbers


def evaluated(region: StaticRegion, outline: Any, margin: float, spread: Any, poses: Any) -> Any:
    """Return the smallest inequality times its scale, m, and the distance it should be."""
    count = len(poses)
    pose = Pose((poses[:, 0], poses[:, 1]), poses[:, 2], outline)
    numbers = region.parameters(PADDED, np.full(count, margin), spread)
    start = region.auxiliary_start(pose, numbers)
    x, p = ca.SX.sym("x", 3), ca.SX.sym("p", numbers.shape[-1])
    a = ca.SX.sym("a", start.shape[-1])
    stated = region.constraint(Pose((x[0], x[1]), x[2], outline), p, a)
    least = -ca.mmax(-ca.vertcat(*stated.inequalities))
    function = ca.Function("least", [x, p, a], [least]).map(count)
    values = function(poses.T, numbers.T, start.T).full().ravel()
    scale = margin + 1.0  # the wall is wider than 2 m
    corners = [np.stack(np.broadcast_arrays(*corner), axis=-1) for corner in pose.corners()]
    distance, _ = best_direction(np.stack(corners, axis=-2), WALL, spread)
    return values * scale, distance - margin


@pytest.mark.parametrize("region", EXACT, ids=repr)
@pytest.mark.parametrize("outline", [(), ((0.5, 0.2),), CAR], ids=len)
@pytest.mark.parametrize("deviations", [(0.0, 0.0), (0.5, 0.2), (0.5, 0.0)])
def test_value_is_the_signed_distance(region: Any, outline: Any, deviations: Any) -> None:
    rng = np.random.default_rng(2)
    root = np.array([[0.8, -0.6], [0.6, 0.8]]) * deviations
    poses = np.concatenate([rng.uniform(-4.0, 6.0, (2000, 2)), rng.uniform(-4, 4, (2000, 1))], 1)
    values, wanted = evaluated(region, outline, 0.3, root @ root.T, poses)
    assert (wanted < 0.0).sum() > 50 and (wanted > 0.0).sum() > 50
    assert np.allclose(values, wanted, atol=5e-9)  # the floor of the deviation: 1e-9 m


@pytest.mark.parametrize("region", EXACT, ids=repr)
def test_batches_of_polygons_and_poses(region: StaticRegion) -> None:
    rng = np.random.default_rng(3)
    parts = PADDED + rng.uniform(-9.0, 9.0, (3, 1, 2))
    numbers = region.parameters(parts, np.array([0.1, 0.2, 0.3]), NONE)
    places, headings = rng.uniform(-5.0, 5.0, (4, 1, 2)), rng.uniform(-3.0, 3.0, (4, 1))
    pose = Pose((places[..., 0], places[..., 1]), headings, CAR)
    start = region.auxiliary_start(pose, numbers)
    assert numbers.shape == (3, region.parameter_count(8))
    assert start.shape == (4, 3, len(region.auxiliary(8, 4)))
    single = Pose((places[2, :, 0], places[2, :, 1]), headings[2], CAR)
    assert np.allclose(region.auxiliary_start(single, numbers[1:2])[0], start[2, 1], atol=1e-12)


def test_equalities_hold_at_flat_corners() -> None:
    """Where two faces turn by little, their multipliers have few digits but the sum has all."""
    flat = np.array([[0.0, 0.0], [1.0, -1e-6], [2.0, -1e-8], [3.0, 1e-3], [3.0, 2.0], [0.0, 2.0]])
    rng = np.random.default_rng(4)
    places = rng.uniform([-1.0, -1.0], [4.0, 0.5], (3000, 2))
    numbers = np.broadcast_to(Dual().parameters(flat, np.asarray(0.1), NONE), (3000, 29))
    lam = Dual().auxiliary_start(Pose.of(places), numbers)
    rows = numbers[0, 17:].reshape(6, 2)
    assert np.abs(((lam @ rows) ** 2).sum(axis=-1) - 1.0).max() < 1e-9 and (lam >= 0.0).all()


@pytest.mark.parametrize("region", EXACT, ids=repr)
@pytest.mark.parametrize(
    ("parts", "margin", "spread", "words"),
    [
        (WALL, -0.1, NONE, "margin"),
        (WALL, np.nan, NONE, "margin"),
        (WALL, [0.1, np.nan], NONE, "margin"),
        (np.stack([WALL, np.full_like(WALL, np.nan)]), 0.1, NONE, "not finite"),
        (WALL * np.nan, 0.1, NONE, "not finite"),
        (WALL[:2], 0.1, NONE, "at least 3 vertices"),
        (WALL[:, :1], 0.1, NONE, "wanted"),
        (WALL, 0.1, np.diag([1.0, -1.0]), "spread.*eigenvalue"),
        (WALL, 0.1, np.array([[1.0, 0.5], [0.0, 1.0]]), "spread.*not symmetric"),
        (WALL, 0.1, np.eye(3), "spread has shape"),
    ],
)
def test_bad_input(region: Any, parts: Any, margin: float, spread: Any, words: str) -> None:
    with pytest.raises(WideberthError, match=words):
        region.parameters(parts, np.asarray(margin), spread)


@pytest.mark.parametrize("region", EXACT, ids=repr)
def test_an_empty_slot_stays_finite(region: Any) -> None:
    """A mask multiplies the constraint of an empty slot by zero: NaN would survive that."""
    numbers = region.parameters(np.zeros((8, 2)), np.asarray(0.0), NONE)
    pose = Pose((np.zeros(1), np.zeros(1)), np.zeros(1), CAR)
    start = region.auxiliary_start(pose, numbers[None])[0]
    x, a = ca.SX.sym("x", 3), ca.SX.sym("a", len(start))
    stated = region.constraint(Pose((x[0], x[1]), x[2], CAR), ca.DM(numbers), a)
    rows = ca.vertcat(*stated.inequalities, *stated.equalities)
    slopes = ca.jacobian(rows, ca.vertcat(x, a))
    function = ca.Function("empty", [x, a], [rows, slopes])
    assert all(np.isfinite(out.full()).all() for out in function(np.zeros(3), start))


def test_a_body_of_two_corners_has_no_faces() -> None:
    with pytest.raises(WideberthError, match="outline has 2 corners"):
        Dual().auxiliary(4, 2)


# in an optimiser, and what a line promises


@pytest.mark.parametrize("region", EXACT, ids=repr)
@pytest.mark.parametrize(
    ("outline", "margin", "deviations"),
    [((), 0.5, (0.0, 0.0)), ((), 0.2, (0.5, 0.1)), (CAR, 0.0, (0.0, 0.0)), (CAR, 0.3, (0.3, 0.2))],
)
def test_projection(region: Any, outline: Any, margin: float, deviations: Any) -> None:
    """IPOPT leaves the polygon for its boundary, from starts outside and inside."""
    rng = np.random.default_rng(5)
    spread = np.diag(np.square(deviations))
    numbers = region.parameters(PADDED, np.asarray(margin), spread)
    declared = region.auxiliary(len(PADDED), max(len(outline), 1))
    x, a = ca.SX.sym("x", 3), ca.SX.sym("a", len(declared))
    target, guess = ca.SX.sym("target", 2), ca.SX.sym("guess", len(declared))
    stated = region.constraint(Pose((x[0], x[1]), x[2], outline), ca.DM(numbers), a)
    cost = ca.sumsqr(x[:2] - target) + 0.1 * x[2] ** 2
    cost += declared.regularisation * ca.sumsqr(a - guess)
    rows = ca.vertcat(*stated.inequalities, *stated.equalities)
    quiet = {"ipopt.print_level": 0, "print_time": False, "ipopt.sb": "yes", "ipopt.tol": 1e-9}
    program = {"x": ca.vertcat(x, a), "f": cost, "g": rows, "p": ca.vertcat(target, guess)}
    solver = ca.nlpsol("projection", "ipopt", program, quiet)
    upper = [np.inf] * len(stated.inequalities) + [0.0] * len(stated.equalities)
    landed = 0
    for index in range(60):
        aim = WALL.mean(axis=0) + rng.uniform(-0.4, 0.4, 2)
        angle, reach = rng.uniform(0.0, 2.0 * np.pi), rng.uniform(3.0, 6.0)
        place = aim + (reach * np.array([np.cos(angle), np.sin(angle)]) if index % 3 else 0.01)
        heading = rng.uniform(-1.0, 1.0)
        pose = Pose((place[:1], place[1:]), np.array([heading]), outline)
        start = region.auxiliary_start(pose, numbers[None])[0]
        solution = solver(
            x0=np.concatenate([place, [heading], start]), p=np.concatenate([aim, start]),
            lbx=[-np.inf] * 3 + list(declared.lower), ubx=np.inf, lbg=0.0, ubg=upper,
        )  # fmt: skip
        found = solution["x"].full().ravel()[:3]
        corners = Pose((found[0], found[1]), found[2], outline).corners()
        distance, _ = best_direction(np.array(corners, dtype=float), WALL, spread)
        landed += abs(float(distance) - margin) < 1e-5
    assert landed >= 57


def test_a_spread_of_the_quantile_keeps_the_risk() -> None:
    """With s = Phi^-1(1 - risk) bodies that touch the margin overlap with at most that risk."""
    rng = np.random.default_rng(6)
    risk, covariance, count = 0.1, np.array([[0.09, 0.03], [0.03, 0.04]]), 4000
    spread = special.ndtri(1.0 - risk) ** 2 * covariance
    body = np.array(CAR)
    shifts = rng.multivariate_normal([0.0, 0.0], covariance, count)
    worst = 0.0
    for _ in range(30):
        turn = rng.uniform(-np.pi, np.pi)
        rotation = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
        there = body @ rotation.T + rng.uniform(-3.0, 5.0, 2)
        for _ in range(4):
            distance, normal = best_direction(there, WALL, spread)
            there = there - (distance - 0.05) * normal
        real, _ = best_direction(there + shifts[:, None], WALL, NONE)
        worst = max(worst, float((real < 0.05).mean()))
    assert 0.8 * risk < worst < risk + 4.0 * np.sqrt(risk * (1.0 - risk) / count)

"""The robot's own uncertainty: closed forms, Monte Carlo, and what the planner makes of it."""

from math import cos, pi, sin
from typing import Any

import numpy as np
import pytest

from wideberth.framework.control.velocity_smoother import VelocitySmoother
from wideberth.framework.mpc.levels.fixed import Fixed
from wideberth.framework.mpc.ocp.progress_robot import ProgressRobot, progress_robot_of
from wideberth.framework.mpc.planner.own_uncertainty import Growth, OwnUncertainty, carried
from wideberth.framework.mpc.planner.planner import Planner
from wideberth.framework.mpc.planner.rollout import brake, carry, follow, stand
from wideberth.framework.plugins.config import build, describe
from wideberth.framework.robot import Robot, SymbolicDrive, step
from wideberth.framework.values.errors import WideberthError
from wideberth.framework.values.footprint import Discs, Outline
from wideberth.framework.values.motion import Detection, Observation, Twist
from wideberth.framework.values.path import Path
from wideberth.framework.values.plan import Plan, Rung
from wideberth.framework.values.polygon import Polygon, separation
from wideberth.predictors.static import Static
from wideberth.regions.minkowski_sum import MinkowskiSum
from wideberth.regions.separating_line import SeparatingLine as Line
from wideberth.regions.static.dual import Dual
from wideberth.regions.static.separating_line import StaticSeparatingLine
from wideberth.robots.holonomic import Holonomic
from wideberth.robots.unicycle import Unicycle
from wideberth.solvers.fatrop import Fatrop

CAR = Outline(((0.55, 0.25), (-0.25, 0.25), (-0.25, -0.25), (0.55, -0.25)))
DISCS = Discs(((0.35, 0.0), (-0.05, 0.0)), 0.25)
DT = 0.5


def covariance(rng: np.random.Generator, deviations: Any) -> np.ndarray:
    """Random correlations with these deviations."""
    size = len(deviations)
    root = rng.standard_normal((size, 2 * size))
    found = root @ root.T
    scale = np.asarray(deviations) / np.sqrt(np.diagonal(found))
    return found * np.outer(scale, scale)


def same(sample: np.ndarray, wanted: np.ndarray, deviations: float = 5.0) -> None:
    """The covariance of a sample (n, D) is the wanted one but for its own scatter."""
    found = np.cov(sample.T)
    own = np.outer(np.diagonal(wanted), np.diagonal(wanted)) + wanted**2
    assert (np.abs(found - wanted) <= deviations * np.sqrt(own / len(sample)) + 1e-15).all()


# how it grows


def test_open_loop_of_a_linear_robot_is_exact() -> None:
    robot, rng = Holonomic(), np.random.default_rng(0)
    start = covariance(rng, (0.3, 0.2, 0.1, 0.05))
    inputs = rng.uniform(-0.3, 0.3, (12, 2))
    states = follow(robot, np.array([1.0, 2.0, 0.1, 0.2]), inputs, DT)
    found = OwnUncertainty(robot, DT, "open-loop", 0.0).spread(start, states, inputs)
    for i in range(12):
        slope = np.eye(4) + (i + 1) * DT * np.eye(4, k=2)
        assert np.allclose(found[i], (slope @ start @ slope.T)[:2, :2], rtol=0.0, atol=1e-13)


def curve(steps: int = 8) -> tuple[np.ndarray, np.ndarray]:
    inputs = np.tile([0.02, 0.03], (steps, 1))
    return follow(Unicycle(), np.array([0.0, 0.0, 0.4, 0.4, -0.05]), inputs, DT), inputs


SMALL = covariance(np.random.default_rng(1), (0.02, 0.03, 0.02, 0.01, 0.01))


def test_open_loop_of_a_unicycle_is_monte_carlo() -> None:
    states, inputs = curve()
    found = OwnUncertainty(Unicycle(), DT, "open-loop", 0.0).spread(SMALL, states, inputs)
    rng = np.random.default_rng(2)
    cloud = tuple(rng.multivariate_normal(states[0], SMALL, 20000).T)
    for control, wanted in zip(inputs, found, strict=True):
        cloud = step(Unicycle(), cloud, tuple(control), DT)
        same(np.stack(cloud[:2], axis=-1), wanted)
    assert np.trace(found[-1]) > 3.0 * np.trace(found[0])


@pytest.mark.parametrize("robot", [Unicycle(), Holonomic()], ids=lambda one: type(one).__name__)
def test_feedback_is_monte_carlo_of_the_closed_loop(robot: Robot) -> None:
    states, inputs = curve()
    start = SMALL
    if isinstance(robot, Holonomic):
        inputs, start = inputs.copy(), SMALL[1:, 1:] * 4.0
        states = follow(robot, np.array([0.0, 0.0, 0.2, 0.3]), inputs, DT)
    found = OwnUncertainty(robot, DT, "feedback", 0.0).spread(start, states, inputs)
    rng = np.random.default_rng(3)
    cloud = rng.multivariate_normal(states[0], start, 2000)
    for following, control, wanted in zip(states[1:], inputs, found, strict=True):
        twist = robot.twist(tuple(following), tuple(control))
        rows = [tuple(float(value) for value in row) for row in cloud]
        cloud = np.array([step(robot, row, robot.drive(row, twist, DT), DT) for row in rows])
        same(cloud[:, :2], wanted)
    free = OwnUncertainty(robot, DT, "open-loop", 0.0).spread(start, states, inputs)
    assert np.trace(found[-1]) < 0.7 * np.trace(free[-1])  # errors of the speed are corrected


def test_a_drive_of_expressions_gives_the_same_feedback_as_one_of_floats() -> None:
    plain = progress_robot_of(Unicycle())
    (able,) = (kind for kind in type(plain).__bases__ if kind is not ProgressRobot)
    assert able is SymbolicDrive
    floats = type("Floats", (ProgressRobot,), {
        name: getattr(plain, name) for name in ("states", "inputs", "dimension")
    })(Unicycle())  # fmt: skip
    states, inputs = curve()
    states, inputs = np.pad(states, ((0, 0), (0, 1))), np.pad(inputs, ((0, 0), (0, 1)))
    known = np.pad(SMALL, (0, 1))
    found, wanted = (
        OwnUncertainty(robot, DT, "feedback", 0.4).spread(known, states, inputs)
        for robot in (plain, floats)
    )
    np.testing.assert_allclose(found, wanted, rtol=1e-12)


def test_no_covariance_and_ignored_are_zero() -> None:
    states, inputs = curve()
    cases: list[tuple[Growth, Any]] = [
        ("ignored", SMALL), ("open-loop", None), ("feedback", 0.0 * SMALL)
    ]  # fmt: skip
    for growth, known in cases:
        found = OwnUncertainty(Unicycle(), DT, growth, 0.5).spread(known, states, inputs)
        assert found.shape == (8, 2, 2) and not found.any()


def test_the_bound_holds_for_every_place_within_reach() -> None:
    rng, reach = np.random.default_rng(4), 0.7
    own = OwnUncertainty(Unicycle(), DT, "open-loop", reach)
    for _ in range(40):
        heading = rng.uniform(-pi, pi)
        states = np.zeros((2, 5))
        states[:, :3] = 3.0, -2.0, heading  # it stands: the derivative is known by pencil
        start = covariance(rng, 10.0 ** rng.uniform(-3.0, 0.0, 5))
        slope = np.eye(5)
        slope[:2, 3], slope[2, 4] = DT * np.array([cos(heading), sin(heading)]), DT
        moved = slope @ start @ slope.T
        found = own.spread(start, states, np.zeros((1, 2)))[0]
        for angle in np.linspace(0.0, 2.0 * pi, 24):
            far = reach * rng.choice([1.0, 0.5])
            arm = far * np.array([-sin(angle + heading), cos(angle + heading)])
            place = np.concatenate([np.eye(2), arm[:, None]], axis=1)
            true = place @ moved[:3, :3] @ place.T
            assert np.linalg.eigvalsh(found - true)[0] > -1e-9 * np.trace(found)
        share = np.geomspace(1e-4, 1e4, 4001)
        turned = reach**2 * moved[2, 2]
        traces = (1.0 + 1.0 / share) * np.trace(moved[:2, :2]) + 2.0 * (1.0 + share) * turned
        assert traces.min() * (1.0 - 1e-4) < np.trace(found) < traces.min() * (1.0 + 1e-9)


# the delay before the command


def test_covariance_is_carried_through_the_delay() -> None:
    rng = np.random.default_rng(5)
    start, state = covariance(rng, (0.1, 0.1, 0.05, 0.05)), np.array([0.0, 0.0, 0.3, 0.1])
    robot, delay = Holonomic(), 0.3

    def coast(x: np.ndarray) -> np.ndarray:
        return carry(robot, x, None, 0.0, delay)

    slope = np.eye(4) + delay * np.eye(4, k=2)
    assert np.allclose(carried(start, coast, state), slope @ start @ slope.T, atol=1e-9)
    smoother = VelocitySmoother.at_rest(Twist((0.3, 0.1)))

    def driven(x: np.ndarray) -> np.ndarray:
        return carry(robot, x, smoother, 0.0, delay)

    # The controller ends the error of the velocity linearly within the first 0.05 s.
    slope = np.zeros((4, 4))
    slope[:2] = np.concatenate([np.eye(2), 0.025 * np.eye(2)], axis=1)
    small = 1e-4 * start  # within the limit of the acceleration
    assert np.allclose(carried(small, driven, state), slope @ small @ slope.T, atol=1e-11)


def test_the_planner_starts_from_the_carried_covariance(monkeypatch: Any) -> None:
    told: list[Any] = []
    spread = OwnUncertainty.spread

    def spy(self: OwnUncertainty, known: Any, states: Any, inputs: Any) -> Any:
        told.append(known)
        return spread(self, known, states, inputs)

    monkeypatch.setattr(OwnUncertainty, "spread", spy)
    made = Planner(Holonomic(), MinkowskiSum(), Static(), Fixed(), Fatrop(), latency=0.2)
    made.set_path(Path(np.array([[0.0, 0.0], [9.0, 0.0]])))
    start = covariance(np.random.default_rng(6), (0.1, 0.1, 0.05, 0.05))
    state = np.array([0.0, 0.0, 0.4, 0.0])
    made.command(Observation(0.0, state, covariance=start))
    slope = np.eye(4) + 0.2 * np.eye(4, k=2)
    assert np.allclose(told[-1], slope @ start @ slope.T, atol=1e-9)
    made.command(Observation(0.5, state))
    assert told[-1] is None


# what the planner makes of it

WALL = Polygon(((1.5, 0.6), (5.0, 0.6), (5.0, 2.0), (1.5, 2.0)), "wall")
GREAT = np.diag([0.04, 0.04, 0.01, 1e-4, 1e-5])


def decided(
    known: np.ndarray | None,
    polygons: tuple[Polygon, ...] = (),
    ahead: bool = True,
    **changes: Any,
) -> Plan:
    settings: dict[str, Any] = {
        "robot": Unicycle(radius=0.65), "region": Line(), "predictor": Static(),
        "level": Fixed(), "solver": Fatrop(), "static_region": StaticSeparatingLine(), **changes,
    }  # fmt: skip
    planner = Planner(**settings)
    planner.set_path(Path(np.array([[0.0, 0.0], [20.0, 0.0]])))
    state = np.array([0.0, 0.0, 0.0, 0.4, 0.0])
    someone = Detection("walker", np.array([4.0, 0.9]), 1e-4 * np.eye(2), 0.3)
    seen = Observation(0.0, state, (someone,) * ahead, known, polygons)
    planner.command(seen)
    plan = planner.plan
    assert plan is not None and plan.rung is Rung.OPTIMAL
    return plan


@pytest.mark.parametrize("growth", ["open-loop", "feedback"])
@pytest.mark.parametrize("footprint", [None, DISCS, CAR], ids=lambda one: type(one).__name__)
def test_no_uncertainty_changes_nothing(growth: str, footprint: Any) -> None:
    robot = Unicycle(radius=0.65, footprint=footprint)
    parts = {"robot": robot, "polygons": (WALL,), "ahead": False, "own_uncertainty": growth}
    bare, zero = decided(None, **parts), decided(np.zeros((5, 5)), **parts)
    ignored = decided(GREAT, **{**parts, "own_uncertainty": "ignored"})
    for plan in (zero, ignored):
        assert np.allclose(plan.states, bare.states, rtol=0.0, atol=1e-9)


@pytest.mark.parametrize("growth", ["open-loop", "feedback"])
def test_uncertainty_keeps_farther_from_obstacles_and_walls(growth: str) -> None:
    place = np.array([4.0, 0.9])
    plans = {
        name: decided(known, own_uncertainty=growth)
        for name, known in (("exact", None), ("some", 0.25 * GREAT), ("great", GREAT))
    }
    apart = [np.linalg.norm(plan.positions - place, axis=1).min() for plan in plans.values()]
    assert apart[0] + 0.1 < apart[1] < apart[2] - 0.1
    for region in (StaticSeparatingLine(), Dual()):
        parts = {"polygons": (WALL,), "ahead": False, "static_region": region}
        beside = [
            decided(known, own_uncertainty=growth, **parts).positions[:, 1].min()
            for known in (None, 0.25 * GREAT, GREAT)
        ]
        assert beside[0] - 0.1 > beside[1] > beside[2] + 0.1


@pytest.mark.parametrize("region", [MinkowskiSum(), Line()], ids=repr)
@pytest.mark.parametrize("footprint", [None, DISCS, CAR], ids=lambda one: type(one).__name__)
def test_the_risk_beside_a_wall_is_what_was_asked_for(region: Any, footprint: Any) -> None:
    """Robots drawn from the covariance that drive the plan blindly touch the wall rarely."""
    robot, tail = Unicycle(radius=0.65, footprint=footprint), 0.05
    known = np.diag([0.01, 0.01, 0.02, 1e-6, 1e-6])
    parts = {"polygons": (WALL,), "ahead": False, "region": region, "level": Fixed(tail)}
    plan = decided(known, robot=robot, **parts)
    rng, count = np.random.default_rng(7), 4000
    cloud = tuple(rng.multivariate_normal(plan.states[0], known, count).T)
    groups, radius = [((0.0, 0.0),)], 0.65
    if isinstance(footprint, Discs):
        groups, radius = [(place,) for place in footprint.centres], footprint.radius
    if isinstance(footprint, Outline):
        groups, radius = [footprint.vertices], 0.0
    risks = []  # of each disc alone: each has a line of its own
    for control in plan.inputs:
        cloud = step(robot, cloud, tuple(control), DT)
        pose = robot.pose(cloud)
        for group in groups:
            body = np.stack([np.stack(pose.offset(place), axis=-1) for place in group], axis=1)
            risks.append((separation(body, WALL.points)[0] < radius).mean())
    assert 0.01 < max(risks) < tail + 4.0 * np.sqrt(tail * (1.0 - tail) / count)


def test_beyond_a_shifted_plan_the_robot_brakes() -> None:
    """A plan of 4 steps: what a shift by so many steps leaves of it, then as `brake` does."""
    robot, start = Unicycle(), np.array([0.0, 0.0, 0.2, 1.0, 0.1])
    inputs = 0.1 * np.arange(1.0, 9.0).reshape(4, 2)
    for share, kept in ((0.0, 4), (0.5, 3), (1.0, 3), (3.2, 0), (4.0, 0), (7.0, 0)):
        found = stand(robot, start, inputs, share, DT)
        last = follow(robot, start, inputs[:kept], DT)[-1]
        np.testing.assert_array_equal(found[:kept], inputs[:kept])
        np.testing.assert_array_equal(found[kept:], brake(robot, last, 4 - kept, DT)[1])


def test_unknown_growth_is_refused() -> None:
    with pytest.raises(WideberthError, match="'sometimes'; wanted one of"):
        decided(None, own_uncertainty="sometimes")
    made = Planner(Unicycle(), MinkowskiSum(), Static(), Fixed(), Fatrop())
    told = describe(made)
    assert told["own_uncertainty"] == "open-loop"
    assert build("controllers", {**told, "own_uncertainty": "feedback"}).own_uncertainty
    with pytest.raises(WideberthError, match=r"own_uncertainty.*'sometimes'"):
        build("controllers", {**told, "own_uncertainty": "sometimes"}, "planner")

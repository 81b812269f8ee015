"""Step i of a plan is held against step i of the forecast, of its own covariance, of all.

Everything here differs from step to step, so that a shift by one step shows.
"""

from dataclasses import replace

import numpy as np
import pytest

from wideberth.controllers.levels.discounted import Discounted
from wideberth.framework.mpc.levels.fixed import Fixed
from wideberth.framework.mpc.ocp.problem import Parameters
from wideberth.framework.mpc.ocp.reference import lay_reference
from wideberth.framework.mpc.ocp.transcription import Guess
from wideberth.framework.mpc.planner.own_uncertainty import OwnUncertainty
from wideberth.framework.mpc.planner.rollout import steer
from wideberth.framework.mpc.planner.verify import violation
from wideberth.framework.mpc.slots.gaussian_discs import ObstacleSet, choose_obstacles
from wideberth.framework.mpc.slots.static_polygons import NONE, Walls, fill_walls
from wideberth.framework.region import Region
from wideberth.framework.values.arrays import Array
from wideberth.framework.values.footprint import Outline
from wideberth.framework.values.forecast import Forecast, GaussianObstacle
from wideberth.framework.values.motion import Detection, Observation, Pose, Truth, Twist
from wideberth.framework.values.path import Path
from wideberth.framework.values.plan import Rung
from wideberth.predictors.oracle import Oracle
from wideberth.regions.mahalanobis_ellipse import MahalanobisEllipse
from wideberth.regions.minkowski_sum import MinkowskiSum
from wideberth.regions.static.separating_line import StaticSeparatingLine
from wideberth.robots.holonomic import Holonomic
from wideberth.robots.unicycle import Unicycle
from wideberth.tests.helpers.planning import planner
from wideberth.tests.helpers.problems import assemble, fill, surroundings, with_auxiliaries

STEPS, DT = 6, 0.5
BENT = Path(np.array([[0.0, 0.0], [1.0, 0.0], [2.0, 0.6], [2.5, 2.0]]))
LEVEL = Discounted(tail=0.05, final_tail=0.5)
STEP = np.arange(1.0, STEPS + 1)
START = np.array([0.0, 0.0, 0.0, 0.5, 0.0])


def wide(first: float, growth: float) -> np.ndarray:
    """Covariances that grow and turn from step to step, (N, 2, 2)."""
    turn = 0.3 * STEP
    vectors = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    vectors = np.moveaxis(vectors, -1, 0)
    values = np.stack([first + growth * STEP, 0.3 * (first + growth * STEP)], axis=-1)
    return np.asarray(np.einsum("nij,nj,nkj->nik", vectors, values, vectors))


def crossing() -> ObstacleSet:
    """Two discs that cross the path ever faster."""
    first = np.stack([2.0 - 0.1 * STEP**2, 1.0 - 0.4 * STEP], axis=-1)
    second = np.stack([1.0 + 0.05 * STEP**2, -2.0 + 0.3 * STEP], axis=-1)
    covariance = np.stack([wide(0.04, 0.02), wide(0.01, 0.05)], axis=1)
    mean = np.stack([first, second], axis=1)
    return ObstacleSet(mean, covariance, np.array([0.4, 0.3]), ("a", "b"))


def filled(region: Region, capacity: int = 2) -> Parameters:
    reference = lay_reference(BENT, 0.2, 0.5, STEPS, DT)
    own = wide(0.005, 0.01)
    return fill(START, reference, crossing(), region, LEVEL, 0.75, capacity, own)


@pytest.mark.parametrize("region", [MahalanobisEllipse(), MinkowskiSum()], ids=repr)
def test_every_step_of_an_instance_is_that_of_the_forecast(region: Region) -> None:
    (found,), obstacles, own = filled(region).slots, crossing(), wide(0.005, 0.01)
    assert found.level is not None
    tails = LEVEL.tails(STEPS)
    for i in range(STEPS):
        for k in range(2):
            disc = GaussianObstacle(obstacles.mean[i, k], obstacles.covariance[i, k] + own[i])
            alone = region.parameters(disc, obstacles.radius[k] + 0.75)
            np.testing.assert_allclose(found.parameters[i, k], alone, atol=1e-12)
            assert found.level[i, k] == pytest.approx(region.level(tails[i]))


def test_a_region_computes_empty_slots_once(monkeypatch: pytest.MonkeyPatch) -> None:
    region, shapes = MahalanobisEllipse(), []
    every_slot = MahalanobisEllipse.parameters

    def parameters(self: MahalanobisEllipse, obstacle: GaussianObstacle, margin: Array) -> Array:
        shapes.append(margin.shape)
        return every_slot(self, obstacle, margin)

    monkeypatch.setattr(MahalanobisEllipse, "parameters", parameters)
    (found,) = filled(region, 10).slots
    assert shapes == [(STEPS, 3)]
    assert found.parameters.shape[:2] == (STEPS, 10)
    unit = every_slot(region, GaussianObstacle(np.zeros(2), np.eye(2)), np.array(1.0))
    np.testing.assert_array_equal(
        found.parameters[:, 2:], np.broadcast_to(unit, (STEPS, 8, len(unit)))
    )
    np.testing.assert_array_equal(found.active, [1.0] * 2 + [0.0] * 8)


def test_every_step_of_the_reference_is_one_step_ahead() -> None:
    """Step i = 1..N is where the path is i dt after the start, and faces as the path there."""
    found = filled(MahalanobisEllipse())
    for i in range(STEPS):
        arc = 0.2 + 0.5 * DT * (i + 1)
        np.testing.assert_allclose(found.reference[i], BENT.at(np.array([arc]))[0])
        before = BENT.direction(np.array([arc - 0.25 * DT]))[0]
        np.testing.assert_allclose(found.direction[i], before)
    ending = lay_reference(BENT, BENT.length - 0.6, 0.5, STEPS, DT)
    np.testing.assert_allclose(ending.speed, [0.5, 0.5, 0.2, 0.0, 0.0, 0.0], atol=1e-9)


def test_a_plan_along_the_reference_costs_nothing() -> None:
    """Cost pairs state i with reference i: one that is a step late or early is dear."""
    robot = Holonomic()
    reference = lay_reference(Path(np.array([[0.0, 0.0], [9.0, 0.0]])), 0.0, 0.5, STEPS, DT)
    start = np.array(robot.state_at(Pose((0.0, 0.0), 0.0), Twist((0.5, 0.0))), dtype=float)
    none = ObstacleSet.none(STEPS, 2)
    region, level = MahalanobisEllipse(), Fixed(0.05)
    parameters = fill(start, reference, none, region, level, 0.75, 0)
    problem = assemble(robot, region, level, horizon=STEPS, dt=DT, capacity=0)
    states, inputs = steer(robot, start, Twist((0.5, 0.0)), STEPS, DT)

    def cost(numbers: Parameters) -> float:
        heads = numbers.heads()
        return sum(float(problem.state_cost(states[i + 1], heads[i])) for i in range(STEPS))

    assert np.abs(inputs).max() < 1e-9
    assert cost(parameters) == pytest.approx(0.0, abs=1e-9)
    assert cost(replace(parameters, reference=np.roll(reference.position, 1, axis=0))) > 1.0


def test_the_check_finds_the_step_at_which_they_meet() -> None:
    """Robot and obstacle are in one place at step 4 alone, and near each other before."""
    robot, region, level = Unicycle(), MahalanobisEllipse(), Fixed(0.05)
    states, inputs = steer(robot, START, Twist((0.5, 0.0)), STEPS, DT)
    mean = np.stack([np.full(STEPS, states[4, 0]), 2.0 * (STEP - 4.0)], axis=-1)[:, None]
    covariance = np.tile(1e-8 * np.eye(2), (STEPS, 1, 1, 1))
    obstacles = ObstacleSet(mean, covariance, np.array([0.4]), ("a",))
    reference = lay_reference(BENT, 0.0, 0.5, STEPS, DT)
    parameters = fill(START, reference, obstacles, region, level, 0.75, 1)
    problem = assemble(robot, region, level, horizon=STEPS, dt=DT, capacity=1)
    found = violation(problem, parameters, Guess.bare(states, inputs, float("nan")))
    assert (found.regions[:, 0] > 1e-6).tolist() == [False, False, False, True, False, False]
    breach = found.breach(("a",))
    assert breach is not None and breach.step == 4
    touch = surroundings(robot, region, None, obstacles, NONE, 0.0)
    depth = touch.overlap(states)
    np.testing.assert_allclose(depth, [0.0, 0.0, 0.0, 1.15, 0.0, 0.0], atol=1e-9)


def test_the_stop_is_asked_of_the_last_state_alone() -> None:
    """Who brakes moves before; who coasts breaks it at the last step."""
    robot, region, level = Unicycle(), MahalanobisEllipse(), Fixed(0.05)
    none, reference = ObstacleSet.none(STEPS, 2), lay_reference(BENT, 0.0, 0.5, STEPS, DT)
    parameters = fill(START, reference, none, region, level, 0.75, 0)
    problem = assemble(robot, region, level, horizon=STEPS, dt=DT, capacity=0, stop_at_end=True)
    for speed, broken in ((0.0, []), (0.5, [STEPS - 1])):
        states, inputs = steer(robot, START, Twist((speed, 0.0)), STEPS, DT)
        assert states[1, 3] > 0.1
        found = violation(problem, parameters, Guess.bare(states, inputs, float("nan")))
        assert np.flatnonzero(found.motion > 1e-6).tolist() == broken
    states[-1, 3:] = 0.0  # at rest at last, which breaks the dynamics by 0.5 m/s and no more
    found = violation(problem, parameters, Guess.bare(states, inputs, float("nan")))
    assert found.motion[-1] == pytest.approx(states[-2, 3], abs=1e-6)


def test_auxiliaries_suit_the_pose_of_their_own_step() -> None:
    robot, region = Unicycle(), MinkowskiSum()
    parameters = filled(region)
    states, inputs = steer(robot, START, Twist((0.5, 0.0), 0.2), STEPS, DT)
    guess = Guess.bare(states, inputs, float("nan"))
    found = with_auxiliaries(robot, region, parameters, guess).auxiliaries[0]
    (discs,) = parameters.slots
    assert discs.level is not None
    for i in range(STEPS):
        pose = Pose(tuple(states[i + 1, :2]))
        for k in range(2):
            level = discs.level[i, k]
            alone = region.auxiliary_start(pose, discs.parameters[i, k], level)
            np.testing.assert_allclose(found[i, k], alone, rtol=1e-9)
    assert np.ptp(found[:, 0]) > 1e-3


def test_walls_are_enlarged_by_the_uncertainty_of_their_own_step() -> None:
    region = StaticSeparatingLine()
    triangle = np.array([[1.0, 1.0], [2.0, 1.0], [2.0, 2.0], [2.0, 2.0]])
    walls = Walls(triangle[None], ("wall",), triangle[None], ("wall",))
    spread = wide(0.01, 0.02)
    parameters = filled(MahalanobisEllipse())
    found = fill_walls(walls, region, 0.75, spread)
    for i in range(STEPS):
        alone = region.parameters(triangle, np.array(0.75), spread[i])
        np.testing.assert_allclose(found.parameters[i, 0], alone, atol=1e-12)
    # and the auxiliaries of walls are those of the pose of their step
    robot = replace(Unicycle(), footprint=Outline(((-0.4, -0.3), (0.4, -0.3), (0.0, 0.4))))
    states, inputs = steer(robot, START, Twist((0.5, 0.0), 0.3), STEPS, DT)
    guess = with_auxiliaries(
        robot,
        MahalanobisEllipse(),
        replace(parameters, slots=(*parameters.slots, found)),
        Guess.bare(states, inputs, float("nan")),
        region,
    )
    for i in range(STEPS):
        pose = Pose(tuple(states[i + 1, :2]), states[i + 1, 2], robot.footprint.vertices)
        alone = region.auxiliary_start(pose, found.parameters[i, 0])
        np.testing.assert_allclose(guess.auxiliaries[1][i, 0], alone, atol=1e-9)


def test_own_uncertainty_begins_one_step_ahead() -> None:
    """Position and velocity known to P_0: Var p(i dt) = P_p + (i dt)^2 P_v, i = 1..N."""
    robot = Holonomic()
    start = np.array(robot.state_at(Pose((0.0, 0.0), 0.0), Twist((0.5, 0.0))), dtype=float)
    states, inputs = steer(robot, start, Twist((0.5, 0.0)), STEPS, DT)
    known = np.diag([0.01, 0.02, 0.04, 0.03])
    found = OwnUncertainty(robot, DT, "open-loop", 0.0).spread(known, states, inputs)
    for i in range(STEPS):
        time = DT * (i + 1)
        want = np.diag([0.01 + time**2 * 0.04, 0.02 + time**2 * 0.03])
        np.testing.assert_allclose(found[i], want, atol=1e-12)


def test_obstacles_are_chosen_by_where_they_are_when_the_robot_is_near() -> None:
    """One crosses in front, where the robot is at the same step; one where it was long ago."""
    route = np.stack([0.5 * STEP, np.zeros(STEPS)], axis=-1)
    meets = np.stack([np.full(STEPS, 1.5), 1.5 * (STEP - 3.0)], axis=-1)
    late = np.stack([np.full(STEPS, 0.5), 1.5 * (6.0 - STEP)], axis=-1)
    forecast = Forecast.single(np.stack([late, meets]), np.tile(np.eye(2), (2, STEPS, 1, 1)), DT)
    discs = ObstacleSet.of(forecast, ("late", "meets"), np.zeros(2))
    found, _ = choose_obstacles(discs, route[None], 1)
    assert found.ids == ("meets",) and found.left_out == ("late",)
    np.testing.assert_array_equal(found.mean[:, 0], meets)


def test_the_plan_keeps_clear_of_where_the_obstacle_then_is() -> None:
    """A runner of 2 m/s, known exactly: 1 m from step to step, so that a step is no detail.

    At every step the plan is outside of the region round the true place, and somewhere on its
    boundary; held against the places a step before or after, it is not.
    """
    made = planner(
        predictor=Oracle(spread=0.001), region=MinkowskiSum(), level=Fixed(0.05), penalty=None
    )
    times = np.arange(0.0, 20.0, 0.1)
    way = np.stack([np.full(len(times), 3.0), 8.2 - 2.0 * times + 0.1 * times**2], axis=-1)
    for stamp in (0.0, 0.5):
        place = [np.interp(stamp, times, column) for column in way.T]
        seen = Detection("runner", np.array(place), 1e-6 * np.eye(2), 0.75)
        state = np.array([0.5 * stamp, 0.0, 0.0, 0.5, 0.0])
        made.command(Observation(stamp, state, (seen,), truth=Truth(times, {"runner": way})))
        plan = made.plan
        assert plan is not None and plan.rung is Rung.OPTIMAL, plan.reason
        clock = plan.stamp + plan.dt * np.arange(1, len(plan.positions))
        least = []
        for shift in (0.0, -0.5, 0.5):
            there = np.transpose([np.interp(clock + shift, times, column) for column in way.T])
            least.append(np.linalg.norm(plan.positions[1:] - there, axis=1).min())
        assert least[0] == pytest.approx(1.5 + 0.001 * MinkowskiSum().level(0.05), abs=2e-3)
        assert min(least[1:]) < 1.45
        there = np.transpose([np.interp(clock, times, column) for column in way.T])
        assert plan.forecast is not None
        np.testing.assert_allclose(plan.forecast.mean[0, 0], there, atol=1e-9)

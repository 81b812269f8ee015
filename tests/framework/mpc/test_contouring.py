"""Contouring: the curve, the problem in any form and for any robot, and what it is for."""

import pickle
from typing import Any

import numpy as np
import pytest

from wideberth.controllers.costs.contouring import Contouring
from wideberth.controllers.costs.curve import curve_at, curve_width, lay_curve
from wideberth.framework import names
from wideberth.framework.mpc.costs.base import Cost
from wideberth.framework.mpc.costs.tracking import Tracking
from wideberth.framework.mpc.levels.fixed import Fixed
from wideberth.framework.mpc.ocp.progress_robot import progress_robot_of
from wideberth.framework.mpc.planner.cycle import PlannerState, Services
from wideberth.framework.mpc.planner.cycle import step as decide
from wideberth.framework.mpc.planner.planner import Planner
from wideberth.framework.mpc.planner.settings import PlannerSettings
from wideberth.framework.numerics.symbolic import ca
from wideberth.framework.plugins.registry import load
from wideberth.framework.robot import Robot, start_state, step
from wideberth.framework.testing import check_robot
from wideberth.framework.values.arrays import Array
from wideberth.framework.values.motion import Detection, Observation
from wideberth.framework.values.path import Path
from wideberth.framework.values.plan import Plan, Rung
from wideberth.predictors.static import Static
from wideberth.regions.minkowski_sum import MinkowskiSum
from wideberth.robots.holonomic import Holonomic
from wideberth.robots.unicycle import Unicycle
from wideberth.solvers.fatrop import Fatrop
from wideberth.solvers.ipopt import Ipopt
from wideberth.tests.helpers.problems import assemble

KNOTS, REACH = 12, 3.75
STRAIGHT = Path(np.array([[0.0, 0.0], [20.0, 0.0]]))
CORNER = Path(np.array([[0.0, 0.0], [5.0, 0.0], [5.0, 6.0]]))
WINDING = Path(np.array([[0.0, 0.0, 0.0], [3.0, 0.0, 1.0], [3.0, 2.0, 1.0], [6.0, 2.3, 0.0]]))

STALLS = {"differential_drive"}
"""Robots with which fatrop comes near the optimum at this corner and stalls there, at a dual
infeasibility of 1e-5: the plan counts as feasible."""


def evaluator(size: int) -> Any:
    numbers, theta = ca.SX.sym("numbers", curve_width(KNOTS, size)), ca.SX.sym("theta")
    place, slope, share = curve_at(numbers, theta, KNOTS)
    rate = ca.jacobian(place, theta)
    return ca.Function("curve", [numbers, theta], [place, slope, share, rate])


@pytest.mark.parametrize("path", [CORNER, WINDING], ids=["2-D", "3-D"])
def test_the_curve_is_the_b_spline_of_the_path(path: Path) -> None:
    from scipy.interpolate import BSpline

    curve = evaluator(path.points.shape[1])
    for arc in (0.0, 1.0, 2.2, 4.0):
        numbers = lay_curve(path, arc, REACH, KNOTS)
        h = numbers[1]
        arcs = h * np.arange(-30, 60)
        beyond = arcs - np.clip(arcs, 0.0, path.length)
        points = path.at(arcs) + beyond[:, None] * path.direction(arcs)
        spline = BSpline(h * np.arange(-32, 62), points, 3)
        for theta in np.linspace(arc - h, min(arc + REACH + h, path.length - h), 23):
            place, slope, share, rate = (np.asarray(v).ravel() for v in curve(numbers, theta))
            np.testing.assert_allclose(place, spline(theta), atol=1e-12)
            np.testing.assert_allclose(slope, spline(theta, 1), atol=1e-12)
            np.testing.assert_allclose(rate, slope * share, atol=1e-12)
            assert np.linalg.norm(slope) <= 1.0 + 1e-12


def test_the_curve_ends_in_the_goal_and_goes_straight_on_elsewhere() -> None:
    curve = evaluator(2)
    numbers = lay_curve(STRAIGHT, 18.0, REACH, KNOTS)
    h = numbers[1]
    for theta in (20.0 + h, 22.0, 100.0):
        place, slope, share, _ = (np.asarray(v).ravel() for v in curve(numbers, theta))
        np.testing.assert_allclose(place, [20.0, 0.0], atol=1e-9)
        np.testing.assert_allclose(slope, [1.0, 0.0], atol=1e-12)
        assert share == pytest.approx(0.0, abs=1e-9)
    for arc, theta in ((0.0, -7.0), (0.0, 3.0), (4.0, 15.0), (18.0, 1.0)):
        place = np.asarray(curve(lay_curve(STRAIGHT, arc, REACH, KNOTS), theta)[0]).ravel()
        np.testing.assert_allclose(place, [theta, 0.0], atol=1e-12)


def test_the_curve_leaves_a_corner_by_what_is_said_and_stays_where_it_is() -> None:
    curve = evaluator(2)
    h = lay_curve(CORNER, 0.0, REACH, KNOTS)[1]
    corner = Path(np.array([[0.0, 0.0], [10 * h, 0.0], [10 * h, 9.0]]))
    places = [
        np.asarray(curve(lay_curve(corner, arc, REACH, KNOTS), 10 * h)[0]).ravel()
        for arc in (10 * h - 3.0, 10 * h - 1.0, 10 * h + 0.3)
    ]
    expected = h * np.sqrt(2.0) / 6.0
    assert np.linalg.norm(places[0] - [10 * h, 0.0]) == pytest.approx(expected, abs=1e-12)
    np.testing.assert_allclose(places, places[:1] * 3, atol=1e-12)


def test_the_price_is_the_formula() -> None:
    """On a straight path along (0.6, 0.8), whose curve and tangent are known."""
    cost, direction = Contouring(), np.array([0.6, 0.8])
    path = Path(np.array([np.zeros(2), 40.0 * direction]))
    problem = assemble(
        Unicycle(), MinkowskiSum(), Fixed(), horizon=15, dt=0.5, capacity=0, cost=cost
    )
    reference = cost.lay(path, 10.0, 0.5, 15, 0.5)
    head = np.concatenate(
        [reference.position[3], reference.direction[3], [reference.speed[3]], reference.curve[3]]
    )
    theta, rate, weights = 11.3, 0.35, cost.weights
    x, u = np.array([6.5, 9.4, 0.7, 0.4, 0.1, theta]), np.array([0.2, -0.05, rate])
    error = x[:2] - theta * direction
    along, across = error @ direction, error @ [-0.8, 0.6]
    by_state = weights.position * across**2 + cost.lag * along**2
    by_input = cost.rate * (rate - 0.5) ** 2 + weights.speed * (x[3] - rate) ** 2
    by_input += weights.acceleration * u[0] ** 2 + weights.yaw_acceleration * u[1] ** 2
    assert float(problem.state_cost(x, head)) == pytest.approx(by_state)
    assert float(problem.input_cost(x, u, head)) == pytest.approx(by_input)
    assert (problem.states, problem.inputs) == (6, 3)
    assert problem.heading == 2


@pytest.mark.parametrize("name", names("robots"))
def test_a_follower_is_a_robot(name: str) -> None:
    robot: Robot = load("robots", name)()
    check_robot(progress_robot_of(robot))
    again = pickle.loads(pickle.dumps(progress_robot_of(robot)))
    assert again.robot == robot and again.states[-1].name == "theta"


def drive(
    cost: Cost,
    path: Path,
    state: Array,
    ticks: int,
    robot: Robot | None = None,
    gate: tuple[int, float] | None = None,
    **settings: Any,
) -> tuple[Array, list[Plan]]:
    """Close the loop at the steps; a gate is an obstacle of 3 m that is there for some ticks."""
    robot = robot or Unicycle()
    settings = {"solver": Fatrop(), "penalty": 1e5, **settings}
    planner = Planner(robot, MinkowskiSum(), Static(), Fixed(), cost=cost, **settings)
    planner.set_path(path)
    states, plans = [np.array(state, dtype=float)], []
    for k in range(ticks):
        seen = ()
        if gate is not None and k < gate[0]:
            seen = (Detection("gate", np.array([gate[1], 0.0]), 1e-4 * np.eye(2), 3.0),)
        planner.command(Observation(0.5 * k, states[-1], seen))
        assert planner.plan is not None
        plans.append(planner.plan)
        states.append(np.array(step(robot, tuple(states[-1]), tuple(planner.plan.inputs[0]), 0.5)))
    return np.array(states), plans


@pytest.mark.parametrize("name", names("robots"))
def test_any_robot_drives_along_a_corner(name: str) -> None:
    robot: Robot = load("robots", name)()
    path = CORNER if robot.dimension == 2 else Path(WINDING.points * 2.0)
    place, direction = path.at(np.array(3.0)), path.direction(np.array(3.0))
    start = start_state(robot, tuple(place), tuple(direction), 0.5)[0]
    _, (exact,) = drive(Contouring(), path, np.array(start), 1, robot, solver=Ipopt(), starts=())
    _, (plan,) = drive(Contouring(), path, np.array(start), 1, robot, starts=())
    assert exact.rung is Rung.OPTIMAL
    assert plan.rung is Rung.OPTIMAL or name in STALLS
    assert plan.violation < 1e-6 and plan.states.shape == (16, len(robot.states))
    assert plan.cost == pytest.approx(exact.cost, rel=0.1 if name in STALLS else 1e-4, abs=1e-3)


def test_on_a_free_path_both_costs_drive_the_same() -> None:
    """On the path at the reference speed either cost is zero. Beside it both price the distance
    by w_p; the lag, and the speed over ground while turning, tell them apart in second order."""
    for offset, tolerance in ((0.0, 1e-4), (0.5, 0.02)):
        start = np.array([0.0, offset, 0.0, 0.5, 0.0])
        one, two = (drive(cost, STRAIGHT, start, 24)[0] for cost in (Tracking(), Contouring()))
        assert np.abs(one[:, :2] - two[:, :2]).max() < tolerance
        assert two[-1, 3] == pytest.approx(0.5, abs=1e-3)


def test_a_robot_that_had_to_wait_does_not_hurry() -> None:
    """Blocked for 22 s, of which it stands more than 10 s; then it drives on as it always does."""
    states, _ = drive(Contouring(), STRAIGHT, np.array([0, 0, 0, 0.5, 0.0]), 64, gate=(44, 6.0))
    speed = states[:, 3]
    assert (np.abs(speed[15:44]) < 0.05).sum() >= 20
    assert speed.max() < 0.5 + 1e-3
    assert speed[-1] > 0.49
    assert (np.diff(speed[45:]) > -1e-6).all()


def test_a_corner_is_rounded_and_the_robot_stops_at_the_goal() -> None:
    start = np.array([2.0, 0.0, 0.3, 0.0])
    states, plans = drive(Contouring(), CORNER, start, 56, Holonomic())
    aside = [np.linalg.norm(CORNER.at(np.array(CORNER.project(x[:2]))) - x[:2]) for x in states]
    assert all(plan.rung is Rung.OPTIMAL for plan in plans)
    assert max(aside) < 0.3
    assert np.linalg.norm(states[-1, :2] - CORNER.goal) < 0.05
    assert np.abs(states[-1, 2:]).max() < 0.02


def test_the_last_inputs_have_a_progress_as_the_robot_has() -> None:
    """None at first; then those of the last plan, with a speed along the curve."""
    own = PlannerSettings(
        Unicycle(), MinkowskiSum(), Static(), Fixed(), Fatrop(), cost=Contouring(), penalty=1e5
    )
    services, state = Services.of(own), PlannerState.initial(own, STRAIGHT)
    for tick in range(2):
        seen = Observation(0.5 * tick, np.array([0.25 * tick, 0.0, 0.0, 0.5, 0.0]))
        state, decision = decide(own, state, seen, services)
        assert decision.solved is not None
        inputs = decision.solved.instance.last_inputs
        if tick == 0:
            assert inputs is None
        else:
            assert inputs is not None and inputs.shape == (own.horizon, 3)
            np.testing.assert_allclose(inputs[:-1, 2], 0.5, atol=1e-2)


def test_the_same_calls_give_the_same_plans() -> None:
    start = np.array([3.0, 0.0, 0.0, 0.5, 0.0])
    one, two = (drive(Contouring(), CORNER, start, 5, gate=(5, 9.0))[0] for _ in range(2))
    assert np.array_equal(one, two)

"""A cost with a price on jumps of the velocity, and the problem that knows the last command."""

import numpy as np
import pytest

from wideberth import recommended
from wideberth.controllers.costs.smooth_tracking import SmoothTracking
from wideberth.experiments.engine.closed_loop import play
from wideberth.framework.mpc.assembly import assemble
from wideberth.framework.mpc.costs.base import Cost, Weights
from wideberth.framework.mpc.costs.tracking import Tracking
from wideberth.framework.mpc.levels.fixed import Fixed
from wideberth.framework.mpc.ocp.command_robot import command_robot_of
from wideberth.framework.mpc.ocp.problem import Problem
from wideberth.framework.numerics.symbolic import ca
from wideberth.framework.robot import Robot, step
from wideberth.robots import Holonomic, HolonomicVelocity, Unicycle, UnicycleVelocity
from wideberth.simulation.engine.settings import Settings
from wideberth.simulation.measures.summary import summarise
from wideberth.simulation.scenarios.antipodal_swap import AntipodalSwap

DT = 0.5
WEIGHTS = Weights(position=3.0, speed=5.0, acceleration=7.0, yaw_acceleration=11.0)


def problem(robot: Robot, cost: Cost) -> Problem:
    return assemble(robot, (), Fixed(), horizon=3, dt=DT, rooms=(), cost=cost)


@pytest.mark.parametrize("robot", [Unicycle(), Holonomic()])
def test_it_is_tracking_for_a_robot_whose_velocity_is_part_of_its_state(robot: Robot) -> None:
    rng, usual = np.random.default_rng(0), problem(robot, Tracking(WEIGHTS))
    smooth = problem(robot, SmoothTracking(WEIGHTS))
    x, last, u = rng.normal(size=(3, max(len(robot.states), 2)))[:, : len(robot.states)]
    last, u = last[: len(robot.inputs)], u[: len(robot.inputs)]
    reference = rng.normal(size=usual.input_cost.size1_in(2))
    price = float(smooth.input_cost(np.append(x, last), u, reference))
    assert price == pytest.approx(float(usual.input_cost(x, u, reference)), rel=1e-12)


def test_it_prices_the_jump_of_a_velocity_that_is_the_input() -> None:
    robot = UnicycleVelocity(radius=0.3)
    usual, smooth = problem(robot, Tracking(WEIGHTS)), problem(robot, SmoothTracking(WEIGHTS))
    x, last, u = np.array([1.0, 2.0, 0.3]), np.array([0.2, -0.1]), np.array([0.5, 0.3])
    reference = np.zeros(usual.input_cost.size1_in(2))
    more = float(smooth.input_cost(np.append(x, last), u, reference))
    more -= float(usual.input_cost(x, u, reference))
    assert more == pytest.approx(7.0 * (0.3 / DT) ** 2 + 11.0 * (0.4 / DT) ** 2, rel=1e-12)


@pytest.mark.parametrize("robot", [UnicycleVelocity(), HolonomicVelocity(), Unicycle()])
def test_a_step_ends_with_its_own_input(robot: Robot) -> None:
    rng, model = np.random.default_rng(1), command_robot_of(robot, DT)
    x, u = rng.normal(size=len(robot.states)), rng.normal(size=len(robot.inputs))
    start = (*x, *rng.normal(size=len(u)))
    wanted = (*step(robot, tuple(x), tuple(u), DT), *u)
    np.testing.assert_allclose(step(model, start, tuple(u), DT), wanted, rtol=1e-14)
    symbols = ca.SX.sym("x", len(start))
    following = ca.vertcat(*step(model, tuple(ca.vertsplit(symbols)), tuple(u), DT))
    found = ca.Function("step", [symbols], [following])(start)
    np.testing.assert_allclose(np.array(found).ravel(), wanted, rtol=1e-14)


def test_robots_whose_velocity_acts_at_once_pass_each_other_without_zigzag() -> None:
    """They turned by up to 60 degrees from one period to the next, and touched."""
    robot = HolonomicVelocity(radius=0.3)
    planner = recommended(robot, 0.5, quiet=True)
    settings = Settings(plant_step=0.05, time_limit=60.0)
    episode = play(AntipodalSwap(robots=4), robot, planner, settings, seed=100)
    measured = summarise(episode, 0.05)
    assert measured["ended"] == "goals" and not measured["collision"]
    for agent in episode.agents:
        assert agent.commands is not None
        jumps = np.linalg.norm(np.diff(agent.commands.linear, axis=0), axis=1)
        assert jumps.max() < 0.35  # m/s; 0.5 at 60 degrees, and 1.0 where it turns back

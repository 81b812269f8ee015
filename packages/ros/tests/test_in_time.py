"""A plan that comes late is followed from where it has got to, and to its end."""

import numpy as np
import pytest

from wideberth import Command, Observation, Path, recommended
from wideberth.framework.control.velocity_smoother import VelocitySmoother
from wideberth.framework.values.motion import Twist
from wideberth.framework.values.plan import Plan
from wideberth.robots import Unicycle
from wideberth_ros.in_time import VelocityInTime

ROBOT = Unicycle(radius=0.3, max_yaw_rate=1.0, max_yaw_acceleration=1.0)
REST = Twist((0.0, 0.0))


@pytest.fixture(scope="module", name="decision")
def fixture_decision() -> tuple[Command, Plan]:
    """A robot that sets out on a path with a bend."""
    planner = recommended(ROBOT, 0.5, quiet=True, dt=0.25)
    planner.set_path(Path(np.array([(0.0, 0.0), (1.0, 0.0), (1.0, 3.0)])))
    command = planner.command(Observation(10.0, np.zeros(5)))
    assert planner.plan is not None and planner.plan.stamp == 10.0
    return command, planner.plan


def numbers(twist: Twist) -> tuple[float, ...]:
    return (*map(float, twist.linear), float(twist.angular))


def planned(plan: Plan, time: float) -> np.ndarray:
    """Forward speed and yaw rate that a plan has at a time; at its end it has stopped."""
    clock = plan.stamp + plan.dt * np.arange(len(plan.states))
    return np.array([np.interp(time, clock, plan.states[:, i]) for i in (3, 4)])


def test_in_time_it_is_the_smoother(decision: tuple[Command, Plan]) -> None:
    command, plan = decision
    wanted, smoother = VelocityInTime(ROBOT, REST, 9.0), VelocitySmoother.at_rest(REST, 9.0)
    wanted.aim(command, 10.02, plan)
    smoother = smoother.aim(command, 10.02)
    for time in np.arange(10.02, 10.245, 0.01):
        assert numbers(wanted.at(time)) == numbers(smoother.at(time))


@pytest.mark.parametrize("late", [0.0, 0.3, 0.9, 2.0])
def test_a_late_plan_is_followed_in_its_own_time(
    late: float, decision: tuple[Command, Plan]
) -> None:
    """Soon after it has come, and for as long as it has steps."""
    command, plan = decision
    wanted = VelocityInTime(ROBOT, REST, 10.0)
    wanted.aim(command, 10.0 + late, plan)
    last = plan.stamp + plan.dt * (len(plan.inputs) - 1)
    for time in np.arange(10.0 + late, last, 0.05):
        twist = wanted.at(time)
        if time > 10.0 + late + 2.0 * plan.dt:
            found = np.array([twist.linear[0], twist.angular], dtype=float)
            near = [planned(plan, one) for one in (time - plan.dt, time, time + plan.dt)]
            assert (found >= np.min(near, axis=0) - 1e-9).all()
            assert (found <= np.max(near, axis=0) + 1e-9).all()
    turned = np.abs(plan.states[:, 4]).max()
    assert turned > 0.2  # a command that is held would not turn in time


def test_beyond_its_end_it_stands(decision: tuple[Command, Plan]) -> None:
    command, plan = decision
    wanted = VelocityInTime(ROBOT, REST, 10.0)
    wanted.aim(command, 10.0, plan)
    end = plan.stamp + plan.dt * len(plan.inputs)
    for time in np.arange(10.0, end + 2.0 * plan.dt, 0.05):
        wanted.at(time)
    assert not any(numbers(wanted.at(end + 2.0 * plan.dt)))


def test_a_command_that_is_not_the_plans_is_held(decision: tuple[Command, Plan]) -> None:
    _, plan = decision
    for given in (plan, None):
        wanted = VelocityInTime(ROBOT, REST, 10.0)
        wanted.aim(Command((0.1, 0.0), -0.2), 10.0, given)
        assert {numbers(wanted.at(time)) for time in (10.0, 11.0, 40.0)} == {(0.1, 0.0, -0.2)}

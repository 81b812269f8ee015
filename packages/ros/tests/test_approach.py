"""A robot near the end of its path: it neither passes the end nor circles it."""

from collections.abc import Callable
from math import cos, hypot, sin

import numpy as np
import pytest

from wideberth import Observation, Path, names, recommended
from wideberth.framework.control.command_limits import within_reach
from wideberth.framework.control.end_of_path import LEFT, SHARE
from wideberth.framework.control.velocity_smoother import VelocitySmoother
from wideberth.framework.plugins.config import build
from wideberth.framework.robot import Robot, start_state, step
from wideberth.framework.values.motion import Command, Pose, Twist
from wideberth.robots import Bicycle, Unicycle
from wideberth_ros.end_of_path import Approach

ROBOT = Unicycle(radius=0.3, max_yaw_rate=1.0, max_yaw_acceleration=1.0)
TICK, PERIOD, NEAR = 0.05, 0.2, 0.25
"""s between two commands and between two plans, and m of tolerance: the node's."""
PATH = Path(np.array([(0.0, 0.0), (6.0, 0.0)]))
FAST = Twist((100.0, 0.0), 0.3)


def drive(
    robot: Robot,
    decide: Callable[[Observation], Command],
    start: tuple[float, float, float],
    speed: float,
    approach: Approach | None,
) -> tuple[bool, float, float]:
    """Drive until it is near the end; return whether it came there, and its speed and turn."""
    x, y, heading = start
    state, twist = start_state(robot, (x, y), (cos(heading), sin(heading)), speed)
    smoother, turned = VelocitySmoother.at_rest(twist), 0.0
    for k in range(800):
        now, pose = k * TICK, robot.pose(state)
        if k % round(PERIOD / TICK) == 0:
            command = within_reach(robot, decide(Observation(now, np.array(state))))
            smoother = smoother.aim(command, now)
        aim = smoother.at(now + TICK)
        if approach is not None:
            aim = approach.limited(PATH, pose, aim)
        control = robot.drive(state, aim, TICK)
        state = tuple(float(value) for value in step(robot, state, control, TICK))
        found = robot.twist(state, control)
        turned += abs(float(found.angular)) * TICK
        if hypot(*(np.array(robot.pose(state).position) - PATH.goal)) <= NEAR:
            return True, float(found.linear[0]), turned
    return False, float(found.linear[0]), turned


@pytest.mark.parametrize("turn", [0.0, 0.3, 1.2, 1.9, -2.7, np.pi])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_the_limit_is_the_circle_through_the_end(turn: float, sign: float) -> None:
    rng = np.random.default_rng(0)
    away, aim = rng.uniform(0.3, 0.9), rng.uniform(-np.pi, np.pi)
    place = PATH.goal - away * np.array([cos(aim), sin(aim)])
    heading = aim - turn
    wanted = Twist((sign * 100.0, 0.0), 0.3)
    found = Approach(ROBOT).limited(PATH, Pose(tuple(place), heading), wanted)
    speed = abs(float(found.linear[0]))
    assert found.linear[0] * sign > 0.0 and found.angular == wanted.angular
    brakes = np.sqrt(2.0 * SHARE * ROBOT.max_acceleration * max(away, 6.0 - min(place[0], 6.0)))
    if speed < brakes - 1e-9:
        radius = speed / (SHARE * ROBOT.max_yaw_rate)
        side = np.array([-sin(heading), cos(heading)])
        gaps = [hypot(*(place + one * radius * side - PATH.goal)) for one in (1.0, -1.0)]
        assert np.abs(np.array(gaps) - radius).min() < 1e-9
    else:
        assert speed == pytest.approx(brakes) and abs(sin(turn)) < 0.5


def test_what_keeps_the_limits_stays_the_same() -> None:
    approach, slow = Approach(ROBOT), Twist((0.05, 0.0), 1.0)
    assert approach.limited(PATH, Pose((6.0, 0.3), 0.0), slow) is slow
    for place in ((np.nan, 0.0), (1e300, 0.0)):
        assert approach.limited(PATH, Pose(place, 0.0), FAST) is FAST
    here = approach.limited(PATH, Pose((6.0, 0.0), 0.0), FAST)
    assert here.linear == (0.0, 0.0) and here.angular == 0.0, "it has nothing to turn for"
    far = Pose((6.0 - 2.0 * LEFT, 0.5), 1.5)  # it may pass by the end of a longer path
    assert approach.limited(PATH, far, FAST).linear[0] > 1.0


@pytest.mark.parametrize("name", names("robots"))
@pytest.mark.parametrize("speed", [0.5, 2.0])
def test_a_controller_that_never_brakes_stands_at_the_end(name: str, speed: float) -> None:
    if build("robots", name).dimension != 2:
        return
    robot = recommended(name, speed, quiet=True).robot
    approach = Approach(robot)
    came, found, _ = drive(robot, lambda _: Command((speed, 0.0)), (0.0, 0.0, 0.0), 0.0, approach)
    brakes = SHARE * getattr(robot, "max_acceleration", np.inf)
    assert came and found**2 / (2.0 * brakes) <= 2.0 * NEAR


@pytest.mark.parametrize("speed", [0.7, -0.7])
def test_a_robot_that_turns_as_fast_as_it_can_does_not_circle_the_end(speed: float) -> None:
    side = 1.0 if speed > 0.0 else -1.0

    def turning(seen: Observation) -> Command:
        away = PATH.goal - seen.state[:2]
        across = cos(seen.state[2]) * away[1] - sin(seen.state[2]) * away[0]
        return Command((speed, 0.0), float(np.copysign(1.0, side * across)))

    beside = (6.0 - 0.6 * side, -0.6 * side, 0.0)
    came, _, turned = drive(ROBOT, turning, beside, speed, None)
    assert not came and turned > 4.0 * np.pi
    came, _, turned = drive(ROBOT, turning, beside, speed, Approach(ROBOT))
    assert came and turned < 1.5 * np.pi


@pytest.mark.parametrize("start", [(6.0, 0.4, 0.0), (6.3, -0.4, 3.0), (5.5, 0.6, 0.0)])
def test_the_recommended_planner_turns_onto_an_end_that_it_would_circle(
    start: tuple[float, float, float],
) -> None:
    """As after it has made way for somebody near the end."""
    planner = recommended(ROBOT, 0.5, quiet=True, dt=0.25, period=PERIOD)
    found = []
    for approach in (None, Approach(ROBOT)):
        planner.reset()
        planner.set_path(PATH)
        came, _, turned = drive(ROBOT, planner.command, start, 0.5, approach)
        assert came
        found.append(turned)
    assert found[0] > 4.4 and found[1] < 3.5


def test_a_car_is_limited_by_its_brakes_alone() -> None:
    """Its circle does not shrink with its speed."""
    found = Approach(Bicycle()).limited(PATH, Pose((6.0, 0.5), 0.0), FAST)
    assert found.linear[0] == pytest.approx(np.sqrt(2.0 * SHARE * 0.7 * 0.5))

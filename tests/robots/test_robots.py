"""Robots: the contract, closed forms, and limits that couple."""

from functools import partial
from importlib import import_module
from math import atan, cos, pi, sin, tan

import numpy as np
import pytest

from wideberth.framework.control.command_limits import broken_limit, within_reach
from wideberth.framework.control.velocity_smoother import VelocitySmoother
from wideberth.framework.numerics.integration import runge_kutta
from wideberth.framework.robot import Bounds, step
from wideberth.framework.testing.laws import findings
from wideberth.framework.testing.robot import check_robot
from wideberth.framework.values.errors import WideberthError
from wideberth.framework.values.motion import Command, Pose, Twist
from wideberth.robots import BUILT_IN
from wideberth.robots.bicycle import Bicycle
from wideberth.robots.differential_drive import DifferentialDrive
from wideberth.robots.holonomic import Holonomic
from wideberth.robots.holonomic_velocity import HolonomicVelocity
from wideberth.robots.unicycle import Unicycle
from wideberth.robots.unicycle_velocity import UnicycleVelocity
from wideberth.tests.helpers.contracts import Contract


def robot_of(name):
    module, cls = BUILT_IN[name].split(":")
    return getattr(import_module(module), cls)


ROBOTS = {name: robot_of(name) for name in sorted(BUILT_IN)} | {
    f"{name}, small": partial(robot_of(name), radius=0.2, max_speed=1.7)
    for name in sorted(BUILT_IN)
}
AHEAD = ("bicycle", "differential_drive", "unicycle", "unicycle_velocity")
"""Robots with a speed ahead, and so with one backwards."""
ROBOTS |= {
    f"{name}, {back:g} m/s back": partial(robot_of(name), max_reverse_speed=back)
    for name in AHEAD
    for back in (0.0, 0.2)
}
CONTRACT = Contract(ROBOTS, check_robot.laws)


@pytest.mark.parametrize(("name", "law"), CONTRACT.cases())
def test_contract(name, law):
    CONTRACT.check(name, law)


@pytest.mark.parametrize("name", sorted(BUILT_IN))
def test_bad_parameters_name_themselves(name):
    with pytest.raises(WideberthError, match=r"radius is -1"):
        robot_of(name)(radius=-1.0)
    with pytest.raises(WideberthError, match=r"max_speed"):
        robot_of(name)(max_speed=0.0)


@pytest.mark.parametrize("name", AHEAD)
@pytest.mark.parametrize("back", [None, 0.0, 0.2])
def test_a_robot_drives_backwards_as_fast_as_it_may(name, back):
    """Asked for more it holds that; a command for more breaks its limits, and is cut to them."""
    robot = robot_of(name)(max_reverse_speed=back)
    least = -robot.max_speed if back is None else -back
    state = robot.state_at(Pose((0.0, 0.0), 0.0), Twist((robot.max_speed, 0.0)))
    for _ in range(100):
        control = robot.drive(state, Twist((-9.0, 0.0)), 0.05)
        state = step(robot, state, control, 0.05)
    assert float(robot.twist(state, control).linear[0]) == pytest.approx(least, abs=1e-12)
    assert broken_limit(robot, Command((least, 0.0))) == ""
    beyond = Command((least - 0.1, 0.0))
    assert "can do by 0.1" in broken_limit(robot, beyond)
    assert within_reach(robot, beyond).linear[0] == pytest.approx(least, abs=1e-12)


@pytest.mark.parametrize("name", AHEAD)
def test_no_limit_backwards_is_the_limit_ahead(name):
    """To the last digit: results of before do not change."""
    kind = robot_of(name)
    plain, stated = kind(), kind(max_reverse_speed=kind().max_speed)
    state, control = (0.1,) * len(kind.states), (0.05,) * len(kind.inputs)
    for one in (plain, stated):
        bounds = one.state_bounds(), one.input_bounds()
        assert all(own.lower == tuple(-value for value in own.upper) for own in bounds)
        assert one.constraints(state, control) == plain.constraints(state, control)


@pytest.mark.parametrize("name", AHEAD)
@pytest.mark.parametrize("back", [-0.1, 5.0, float("nan")])
def test_absurd_speeds_backwards_are_refused(name, back):
    with pytest.raises(WideberthError, match=rf"{name}.max_reverse_speed is"):
        robot_of(name)(max_reverse_speed=back)


def test_steering_in_degrees_is_refused():
    with pytest.raises(WideberthError, match="radians"):
        Bicycle(max_steering=30.0)


def test_runge_kutta_against_the_matrix_exponential():
    """x'' = -x: one step is the Taylor polynomial of degree four of the rotation."""

    def swing(state, control):
        return (state[1], -state[0])

    h = 0.3
    moved = runge_kutta(swing, (1.0, 0.0), (), h)
    assert moved == pytest.approx((1 - h**2 / 2 + h**4 / 24, -h + h**3 / 6), abs=1e-15)
    fine = runge_kutta(swing, (1.0, 0.0), (), pi, substeps=200)
    assert fine == pytest.approx((-1.0, 0.0), abs=1e-8)


def test_step_refuses_no_time():
    with pytest.raises(WideberthError, match="dt"):
        step(Unicycle(), (0.0,) * 5, (0.0, 0.0), 0.0)
    with pytest.raises(WideberthError, match="substeps"):
        step(Unicycle(), (0.0,) * 5, (0.0, 0.0), 0.1, substeps=0)


@pytest.mark.parametrize(
    ("robot", "v", "omega"),
    [(Unicycle(), 0.5, 0.2), (DifferentialDrive(), 0.5, 0.2), (Bicycle(), 0.5, 0.2)],
)
def test_constant_twist_drives_a_circle(robot, v, omega):
    state = robot.state_at(Pose((1.0, 2.0), 0.3), Twist((v, 0.0), omega))
    end = robot.pose(step(robot, state, (0.0, 0.0), 4.0, substeps=100))
    turn = 0.3 + 4.0 * omega
    exact = (1 + v / omega * (sin(turn) - sin(0.3)), 2 - v / omega * (cos(turn) - cos(0.3)))
    assert end.position == pytest.approx(exact, abs=1e-9)
    assert end.heading == pytest.approx(turn, abs=1e-12)


def test_velocities_as_input_drive_the_same_circle():
    """At once, and at rest as soon as they are 0."""
    robot, v, omega = UnicycleVelocity(), 0.5, 0.2
    end = step(robot, (1.0, 2.0, 0.3), (v, omega), 4.0, substeps=100)
    turn = 0.3 + 4.0 * omega
    exact = (1 + v / omega * (sin(turn) - sin(0.3)), 2 - v / omega * (cos(turn) - cos(0.3)), turn)
    assert end == pytest.approx(exact, abs=1e-9)
    assert robot.drive(end, Twist((2.0, 1.0), -3.0), 0.1) == (0.8, -0.7)
    assert step(robot, end, (0.0, 0.0), 4.0) == pytest.approx(end)


def test_holonomic_follows_the_parabola():
    end = step(Holonomic(), (0.0, 0.0, 0.1, 0.2), (0.3, -0.1), 2.0)
    assert end == pytest.approx((0.2 + 0.6, 0.4 - 0.2, 0.7, 0.0), abs=1e-14)
    assert step(HolonomicVelocity(), (0.0, 1.0), (0.3, -0.1), 2.0) == pytest.approx((0.6, 0.8))


def test_paper_limits():
    robot = Unicycle()
    assert robot.state_bounds().upper[3:] == (0.7, 0.3)
    assert robot.input_bounds().upper == (0.7, 0.1)
    assert robot.radius == 0.75


def test_differential_drive_can_do_what_the_unicycle_can():
    robot = DifferentialDrive()
    for v in (-0.7, 0.7):
        for omega in (-0.3, 0.3):
            state = robot.state_at(Pose((0.0, 0.0), 0.0), Twist((v, 0.0), omega))
            upper = robot.state_bounds().upper
            assert all(abs(s) <= u + 1e-12 for s, u in zip(state, upper, strict=True))
            assert min(robot.constraints(state, (0.0, 0.0))) >= -1e-12
    after = robot.drive((0.0, 0.0, 0.0, 0.0, 0.0), Twist((0.7, 0.0), 0.3), 0.1)
    assert robot.acceleration((0.0,) * 5, after).linear[0] == pytest.approx(0.7)
    assert robot.acceleration((0.0,) * 5, after).angular == pytest.approx(0.1)


def test_wheel_limits_couple_speed_and_yaw_rate():
    """With slow wheels a fast turn is driven slower on the same curve."""
    robot = DifferentialDrive(max_wheel_speed=0.6)
    check_robot(robot)
    wanted, state = Twist((0.7, 0.0), 0.3), (0.0,) * 5
    for _ in range(200):
        state = step(robot, state, robot.drive(state, wanted, 0.05), 0.05)
    twist = robot.twist(state, (0.0, 0.0))
    assert max(map(abs, state[3:])) == pytest.approx(0.6, abs=1e-9)
    assert twist.angular / twist.linear[0] == pytest.approx(0.3 / 0.7, abs=1e-9)


def test_wheel_acceleration_couples_too():
    check_robot(DifferentialDrive(max_wheel_speed=0.7, max_wheel_acceleration=0.3))


def test_bicycle_yaw_rate_and_standing():
    robot = Bicycle(wheelbase=2.0)
    state = (0.0, 0.0, 0.0, 0.6, 0.3)
    assert robot.twist(state, (0.0, 0.0)).angular == pytest.approx(0.6 * tan(0.3) / 2.0)
    still = robot.state_at(Pose((0.0, 0.0), 1.0), Twist((0.0, 0.0), 0.2))
    assert still[4] == 0.0
    back = robot.state_at(Pose((0.0, 0.0), 1.0), Twist((-0.5, 0.0), 0.1))
    assert back[4] == pytest.approx(atan(2.0 * 0.1 / -0.5))
    held = robot.drive(state, Twist((0.0, 0.0), 0.0), 0.1)
    assert held == pytest.approx((-0.7, 0.0))
    turned = robot.drive((0.0,) * 5, Twist((0.0, 0.0), 0.2), 0.1)
    assert turned == pytest.approx((0.0, 0.3))


def test_holonomic_limits_are_norms():
    robot = Holonomic(max_speed=0.5)
    inputs = robot.drive((0.0, 0.0, 0.0, 0.0), Twist((3.0, 4.0)), 100.0)
    assert inputs == pytest.approx((0.003, 0.004))
    assert np.hypot(*robot.drive((0.0,) * 4, Twist((3.0, 4.0)), 0.01)) == pytest.approx(0.7)
    assert HolonomicVelocity().drive((0.0, 0.0), Twist((3.0, 4.0)), 1.0) == pytest.approx(
        (0.42, 0.56)
    )


def test_smoother_ramps_and_stays_continuous():
    smoother = VelocitySmoother.at_rest(Twist((0.2, 0.0), 0.1))
    assert smoother.values(3.0) == (0.2, 0.0, 0.1)
    first = smoother.aim(Command((0.4, 0.0), 0.0, ramp=0.5), 1.0)
    assert first.values(1.25) == pytest.approx((0.3, 0.0, 0.05))
    assert first.values(0.5) == first.values(1.0) == (0.2, 0.0, 0.1)
    assert first.values(1.5) == (0.4, 0.0, 0.0)
    # On time: starts at the previous command. Early: starts where the ramp is.
    assert first.aim(Command((0.0, 0.0)), 1.5).start == (0.4, 0.0, 0.0)
    early = first.aim(Command((0.0, 0.0), ramp=0.5), 1.25)
    assert early.values(1.25) == pytest.approx(first.values(1.25))
    assert first.aim(Command((0.0, 0.0)), 1.2).at(1.2).linear == (0.0, 0.0)


def test_smoother_refuses_a_negative_ramp():
    with pytest.raises(WideberthError, match="ramp"):
        VelocitySmoother.at_rest(Twist((0.0, 0.0))).aim(Command((0.0, 0.0), ramp=-1.0), 0.0)


@pytest.mark.parametrize(
    ("method", "value", "law"),
    [
        ("twist", lambda self, x, u: Twist((2 * x[3], 0.0), x[4]), "pose changes"),
        ("acceleration", lambda self, x, u: Twist((0.0, 0.0), u[1]), "twist changes"),
        ("state_bounds", lambda self: Bounds.symmetric(*[np.inf] * 3, 1.4, 0.3), "it moves"),
        ("drive", lambda self, x, twist, dt: (9.0, 0.0), "input bound"),
        ("drive", lambda self, x, twist, dt: (0.7, 0.0), "state bound"),
        ("drive", lambda self, x, twist, dt: (0.0, 0.0), "drive ends at"),
        ("state_at", lambda self, p, t: (*p.position, 0.0, t.linear[0], t.angular), "state_at"),
    ],
)
def test_check_robot_finds_what_is_broken(monkeypatch, method, value, law):
    monkeypatch.setattr(Unicycle, method, value)
    with pytest.raises(AssertionError, match=law):
        check_robot(Unicycle())


def test_check_robot_lets_a_robot_steer_fast():
    """In a second its wheel would turn beyond its bounds, where tan has a pole."""
    check_robot(Bicycle(max_steering_rate=1.0))
    check_robot(Bicycle(wheelbase=0.3, max_speed=1.5, max_steering=1.0, max_steering_rate=5.0))


def test_check_robot_finds_a_kink(monkeypatch):
    monkeypatch.setattr(
        Unicycle,
        "derivative",
        lambda self, x, u: (*kinked(x), x[4], u[0], u[1]),
    )
    with pytest.raises(AssertionError, match="derivative is not smooth"):
        check_robot(Unicycle())


def kinked(state):
    """Return a velocity that drops to nothing when the robot turns right."""
    speed = state[3] * (state[4] > 0)
    return speed * np.cos(state[2]), speed * np.sin(state[2])


@pytest.mark.parametrize("method", ["state_at", "drive"])
def test_check_robot_lets_it_stand(monkeypatch, method):
    """The curvature omega / v of a robot that stands is no number."""
    good = getattr(Unicycle, method)

    def divides(self, first, second, *duration):
        twist = first if isinstance(first, Twist) else second
        _ = float(twist.angular) / float(twist.linear[0])
        return good(self, first, second, *duration)

    monkeypatch.setattr(Unicycle, method, divides)
    broken = [
        law.name for law, problem in findings(check_robot.laws(Unicycle())) if problem is not None
    ]
    assert "standing" in broken


@pytest.mark.parametrize("speed", [5e-324, 1e-310, -1e-310])
def test_a_bicycle_turns_its_wheels_at_any_speed(speed: float) -> None:
    """A yaw rate that its curvature cannot give asks for all the steering there is."""
    robot = Bicycle()
    state = (0.0, 0.0, 0.0, 0.0, 0.0)
    rate = robot.drive(state, Twist((np.float64(speed), 0.0), 0.5), 1e3)[1]
    assert rate == pytest.approx(np.copysign(robot.max_steering, speed) / 1e3)


def test_check_robot_finds_a_drive_that_backs_though_it_may_not(monkeypatch):
    """Twists that the robot can have never ask for that, so that a law of its own is needed."""
    symmetric = Unicycle()
    monkeypatch.setattr(Unicycle, "drive", lambda self, *asked: UNBOUND(symmetric, *asked))
    broken = [law for law, problem in findings(check_robot.laws(Unicycle(max_reverse_speed=0.0)))
              if problem is not None]  # fmt: skip
    assert [law.name for law in broken] == ["drive stays within the limits whatever is asked"]


UNBOUND = Unicycle.drive

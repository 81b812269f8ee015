"""The fast model of slipping wheels: its equations, and the physics that it was fitted to."""

import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from wideberth import WideberthError
from wideberth.framework.values.motion import Twist
from wideberth.simulation.sensing.perceived import WheelSample
from wideberth_perception.physics.body import LARGE, SkidSteerBody
from wideberth_perception.physics.calibration import fitted, measured, suggested_yaw_gain
from wideberth_perception.physics.scene import PhysicalRobot, PhysicalScene
from wideberth_perception.physics.sensors import InertialUnit, WheelEncoders
from wideberth_perception.physics.slip import SlipModel, slip_of
from wideberth_perception.physics.world import PhysicsWorld, SlippingWorld, WheelDrive

SMALL = SkidSteerBody()
NONE = SlipModel(0.44, np.array([0.1]), np.array([1.0]), np.array([0.0]), lag=1e-9)
SOME = SlipModel(
    0.44, np.array([0.1, 0.5]), np.array([0.5, 0.6]), np.array([0.02, 0.1]), 0.99, 0.05
)
TICK = 0.02


def test_without_slip_a_robot_drives_a_circle() -> None:
    pose, twist = np.array([1.0, 2.0, 0.5]), np.zeros(3)
    forward, turn, seconds = 0.6, 0.8, 3.0
    aside = 0.5 * 0.44 * turn
    for _ in range(10):
        pose, twist = NONE.moved(pose, twist, forward - aside, forward + aside, seconds / 10)
    radius, end = forward / turn, 0.5 + turn * seconds
    centre = np.array([1.0 - radius * np.sin(0.5), 2.0 + radius * np.cos(0.5)])
    circle = centre + radius * np.array([np.sin(end), -np.cos(end)])
    assert pose == pytest.approx([*circle, end], abs=1e-7)
    assert twist == pytest.approx([forward, 0.0, turn])


@pytest.mark.parametrize("sense", [1.0, -1.0])
def test_steady_motion_is_read_off_the_table(sense: float) -> None:
    """omega_d = 0.3 lies half way between the rates 0.1 and 0.5."""
    aside = 0.5 * 0.44 * 0.3 * sense
    ahead, lateral, turn = SOME.steady(0.5 - aside, 0.5 + aside)
    assert turn == pytest.approx(sense * 0.55 * 0.3)
    assert ahead == pytest.approx(0.99 * 0.5)
    assert lateral == pytest.approx(-0.06 * ahead * turn)
    backwards = SOME.steady(-0.5 - aside, -0.5 + aside)
    assert backwards == pytest.approx([-ahead, -lateral, turn])


def test_the_way_between_is_that_of_the_differential_equation() -> None:
    steady = SOME.steady(0.2, 0.5)

    def rate(_: float, state: np.ndarray) -> np.ndarray:
        _, _, heading, ahead, aside, turn = state
        moved = (
            ahead * np.cos(heading) - aside * np.sin(heading),
            ahead * np.sin(heading) + aside * np.cos(heading), turn,
        )  # fmt: skip
        return np.array([*moved, *((steady - state[3:]) / SOME.lag)])

    start = np.array([0.0, 0.0, 0.7, 0.25, 0.05, -0.4])
    end = solve_ivp(rate, (0.0, TICK), start, rtol=1e-10, atol=1e-12).y[:, -1]
    pose, twist = SOME.moved(start[:3], start[3:], 0.2, 0.5, TICK)
    assert twist == pytest.approx(end[3:], abs=1e-9)
    bound = SOME.lag * TICK * np.hypot(*(steady - start[3:])[:2]) * 0.4
    assert np.abs(pose - end[:3]).max() < bound
    assert bound < 0.05 * np.abs(end[:2] - start[:2]).max()  # the bound says something


def test_many_robots_are_each_of_them_alone() -> None:
    rng = np.random.default_rng(5)
    pose, twist = rng.standard_normal((2, 7, 3))
    left, right = rng.standard_normal((2, 7))
    poses, twists = SOME.moved(pose, twist, left, right, TICK)
    for index in range(7):
        alone = SOME.moved(pose[index], twist[index], left[index], right[index], TICK)
        assert np.allclose(alone, (poses[index], twists[index]), atol=1e-15)


@pytest.mark.parametrize("body", [SMALL, LARGE], ids=["small", "large"])
def test_the_tables_are_those_of_the_physics(body: SkidSteerBody) -> None:
    pytest.importorskip("mujoco", reason="pip install 'wideberth[perception]'")
    model, again = slip_of(body), fitted(body, measured(body))
    assert np.array_equal(again.rates, model.rates)
    assert np.abs(again.gains - model.gains).max() < 0.01
    assert np.abs(again.aside - model.aside).max() < 0.02
    assert again.forward == pytest.approx(model.forward, abs=2e-4)
    assert suggested_yaw_gain(model) == pytest.approx(body.yaw_gain, abs=0.01)


@pytest.mark.parametrize("looped", [False, True], ids=["open", "yaw-rate loop"])
@pytest.mark.parametrize("body", [SMALL, LARGE], ids=["small", "large"])
def test_unseen_drives_end_where_they_end_in_the_physics(
    body: SkidSteerBody, *, looped: bool
) -> None:
    """20 s with a new speed and yaw rate every 4 s: within 5 % of the way and 0.1 rad."""
    pytest.importorskip("mujoco", reason="pip install 'wideberth[perception]'")
    quiet = InertialUnit(rate_deviation=0.0, rate_bias=0.0, rate_walk=0.0)
    model, off = slip_of(body), []
    for seed in range(4):
        rng = np.random.default_rng(seed)
        pose, twist = np.array([0.0, 0.0, rng.uniform(-np.pi, np.pi)]), np.zeros(3)
        robot = PhysicalRobot("a", body, pose, (quiet,) if looped else ())
        world, drive, way = PhysicsWorld(PhysicalScene((robot,)), rng), WheelDrive(body), 0.0
        wanted, given = np.zeros(2), np.zeros(2)
        for step in range(1000):
            if step % 200 == 0:
                wanted = np.array([rng.uniform(0.2, 0.6), rng.uniform(-0.3, 0.3)])
            given = given + np.clip(wanted - given, (-0.014, -0.006), (0.014, 0.006))
            command = Twist((given[0], 0.0), given[1])
            world.command("a", command)
            world.advance(TICK)
            drive.command(command, 0.0)
            speeds = drive.wheel_speeds(float(twist[2]) if looped else None, TICK)
            left, right = body.wheel_radius * np.array(speeds)
            pose, twist = model.moved(pose, twist, left, right, TICK)
            truth = world.truth("a")
            way += TICK * abs(truth.twist[0])
            off.append(truth.twist - twist)
        error = truth.pose - pose
        assert np.hypot(*error[:2]) < 0.05 * way
        assert abs(np.angle(np.exp(1j * error[2]))) < 0.1
    assert (np.sqrt(np.mean(np.square(off), axis=0)) < (0.015, 0.015, 0.03)).all()


@pytest.mark.parametrize("looped", [False, True], ids=["open", "yaw-rate loop"])
def test_a_world_of_the_model_moves_and_senses_as_it(*, looped: bool) -> None:
    pytest.importorskip("mujoco", reason="pip install 'wideberth[perception]'")
    quiet = InertialUnit(rate=250.0, rate_deviation=0.0, rate_bias=0.0, rate_walk=0.0)
    sensors = (WheelEncoders(rate=250.0), *((quiet,) if looped else ()))
    start = np.array([1.0, 2.0, 0.7])
    robot = PhysicalRobot("a", LARGE, start, sensors)
    world = SlippingWorld(PhysicalScene((robot,)), np.random.default_rng(0))
    model, drive, angle = slip_of(LARGE), WheelDrive(LARGE), 0.0
    pose, twist, gyro = start, np.zeros(3), None  # nothing is read before the first step
    for turn in (0.2, -0.3):
        command = Twist((0.5, 0.0), turn)
        world.command("a", command)
        drive.command(command, 0.0)
        world.advance(1.0)
        for _ in range(250):
            left, right = drive.wheel_speeds(gyro, 0.004)
            rims = LARGE.wheel_radius * left, LARGE.wheel_radius * right
            pose, twist = model.moved(pose, twist, *rims, 0.004)
            gyro = float(twist[2]) if looped else None
            angle += left * 0.004
        truth = world.truth("a")
        assert truth.pose == pytest.approx(pose, abs=1e-6)
        assert truth.twist == pytest.approx(twist, abs=1e-6)
        wheels = [one for one in world.samples_due()["a"] if isinstance(one, WheelSample)]
        assert wheels[-1].angles[0] == pytest.approx(angle, abs=0.001)
    strange = PhysicalRobot("b", replace(LARGE, mass=70.0))
    other = SlippingWorld(PhysicalScene((strange,)), np.random.default_rng(0))
    with pytest.raises(WideberthError, match="no slip model was fitted"):
        other.advance(0.1)


def test_a_body_that_was_not_measured_is_refused() -> None:
    assert slip_of(replace(LARGE, hull="box", yaw_gain=1.0)) is slip_of(LARGE)
    with pytest.raises(WideberthError, match=r"measure one .* fitted\(body, measured\(body\)\)"):
        slip_of(replace(SMALL, mass=20.0))
    with pytest.raises(WideberthError, match=r"rates are \[0.2, 0.1\]; wanted one at least"):
        replace(SOME, rates=np.array([0.2, 0.1]))
    with pytest.raises(WideberthError, match=r"gains has shape \(1,\); wanted \(2,\)"):
        replace(SOME, gains=np.ones(1))
    with pytest.raises(WideberthError, match="lag is 0"):
        replace(SOME, lag=0.0)


def test_it_needs_no_mujoco() -> None:
    code = (
        "import sys; sys.modules['mujoco'] = None\n"
        "from wideberth_perception.physics.body import LARGE\n"
        "from wideberth_perception.physics.slip import slip_of\n"
        "print(slip_of(LARGE).steady(0.5, 0.5)[0])"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=60
    )
    assert float(done.stdout) == pytest.approx(0.4996)

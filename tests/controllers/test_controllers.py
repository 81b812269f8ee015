"""Every controller in the room keeps the contract, and the robot's limits."""

from functools import partial
from importlib.util import find_spec
from inspect import isfunction

import numpy as np
import pytest

from wideberth.controllers.reactive import Neighbours, Reactive
from wideberth.controllers.steering import PathGuide, steer, top_speed, velocity_of
from wideberth.framework.control.command_limits import attained
from wideberth.framework.controller import Controller
from wideberth.framework.plugins.config import build, describe
from wideberth.framework.plugins.registry import load, names
from wideberth.framework.robot import step
from wideberth.framework.testing.controller import check_controller
from wideberth.framework.values.errors import WideberthError
from wideberth.framework.values.motion import Detection, Observation, Pose, Twist
from wideberth.framework.values.path import Path
from wideberth.robots.bicycle import Bicycle
from wideberth.robots.holonomic import Holonomic
from wideberth.robots.holonomic_3d import Holonomic3D
from wideberth.robots.holonomic_velocity import HolonomicVelocity
from wideberth.robots.unicycle import Unicycle
from wideberth.tests.helpers.contracts import Contract

ROBOTS = ["unicycle", "differential_drive", "bicycle", "holonomic", "holonomic_velocity"]
KINDS = {name: load("controllers", name) for name in names("controllers")}
PRESETS = ("linearized_chance", "lmpcc", "mpc_constant_velocity")
MISSING = {"orca"} if find_spec("pyrvo") is None else set()
REACTIVE = [name for name, kind in KINDS.items() if issubclass(kind, Reactive)]
REACTIVE = [name for name in REACTIVE if name not in MISSING]
QUICK: dict[str, dict[str, int]] = {
    "bilevel_orca": {"horizon": 2, "most_people": 2},
}
"""Settings with which a controller keeps the same laws in less time."""


def detection(name, place, radius=0.3, age=0.0):
    return Detection(name, np.array(place, dtype=float), np.zeros((2, 2)), radius, age)


def state_of(robot, place=(0.0, 0.0), heading=0.0, speed=0.0):
    linear = (speed, 0.0)
    return np.array(robot.state_at(Pose(place, heading), Twist(linear)), dtype=float)


def ready(name, robot, **settings):
    made = build("controllers", {"type": name, "robot": robot, **QUICK.get(name, {}), **settings})
    made.set_path(Path(np.array([[0.0, 0.0], [5.0, 0.0], [5.0, 5.0]])))
    return made


CONTRACT = Contract(
    {
        f"{name}, {robot}": partial(
            build, "controllers", {"type": name, "robot": robot, **QUICK.get(name, {})}
        )
        for name in REACTIVE
        for robot in ROBOTS
    },
    check_controller.laws,
)


@pytest.mark.parametrize(("name", "law"), CONTRACT.cases())
def test_contract(name, law):
    CONTRACT.check(name, law)


@pytest.mark.parametrize("name", [*REACTIVE, *PRESETS])
def test_config_round_trip(name):
    made = build("controllers", {"type": name, "robot": "unicycle"})
    config = describe(made)
    assert config["type"] == ("mpc" if name in PRESETS else name)
    assert config["robot"] == describe(Unicycle())
    assert describe(build("controllers", config)) == config


@pytest.mark.parametrize("robot", ROBOTS)
@pytest.mark.parametrize("name", REACTIVE)
def test_commands_stay_within_the_limits(name, robot):
    """Asked for more than it can, in crowds and near walls, a robot is told what it can do."""
    model = build("robots", robot)
    controller = ready(name, robot, reference_speed=5.0, period=0.2)
    rng = np.random.default_rng(5)
    for i in range(20):
        crowd = tuple(detection(f"p{k}", rng.normal(size=2) * 2.0) for k in range(5))
        state = state_of(model, tuple(rng.normal(size=2)), rng.uniform(-4.0, 4.0), 0.5)
        command = controller.command(Observation(0.2 * i, state, crowd))
        assert not controller.reason
        wanted = np.array([*command.linear, command.omega])
        assert np.hypot(*command.linear) <= model.max_speed + 1e-9
        held = attained(model, state, [command.twist])[0]  # the robot can have this very twist
        np.testing.assert_allclose(held, wanted, atol=1e-9)


@pytest.mark.parametrize("name", REACTIVE)
def test_wrong_use_raises_and_bad_numbers_stand_still(name):
    controller = build("controllers", {"type": name, "robot": "unicycle"})
    seen = Observation(0.0, state_of(Unicycle()))
    with pytest.raises(WideberthError, match="call set_path before command"):
        controller.command(seen)
    controller.set_path(Path(np.array([[0.0, 0.0], [5.0, 0.0]])))
    with pytest.raises(WideberthError, match=r"wanted \d of this robot: x, y"):
        controller.command(Observation(0.1, np.zeros(3)))
    assert controller.command(Observation(0.1, np.full(5, np.nan))).linear == (0.0, 0.0)
    assert "the observation's state is" in controller.reason
    controller.command(Observation(0.2, state_of(Unicycle())))
    assert controller.reason == "" and controller.last_plan is None
    with pytest.raises(WideberthError, match="3 columns; the robot moves in 2 dimensions"):
        controller.set_path(Path(np.array([[0.0, 0.0, 0.0], [5.0, 0.0, 0.0]])))
    with pytest.raises(WideberthError, match="moves in 3 dimensions: take mpc or one of"):
        build("controllers", {"type": name, "robot": "holonomic_3d"})
    with pytest.raises(WideberthError, match="period is 0; wanted a finite number above 0"):
        build("controllers", {"type": name, "robot": "unicycle", "period": 0.0})


def test_neighbours_are_carried_on():
    known = Neighbours(1.0)
    state = np.zeros(2)
    known.take(Observation(0.0, state, (detection("a", (0, 0)), detection("b", (1, 1), 0.5))))
    ids, places, velocities, radii = known.now()
    assert ids == ("a", "b") and not velocities.any() and radii.tolist() == [0.3, 0.5]
    # Measured 0.1 s ago, 0.4 s after the first time; "b" is not seen.
    known.take(Observation(0.5, state, (detection("a", (0.4, 0.0), age=0.1),)))
    _, places, velocities, _ = known.now()
    np.testing.assert_allclose(velocities, [[1.0, 0.0], [0.0, 0.0]])
    np.testing.assert_allclose(places, [[0.5, 0.0], [1.0, 1.0]])
    known.take(Observation(1.2, state, ()))
    assert known.now()[0] == ("a",)
    np.testing.assert_allclose(known.now()[1], [[1.2, 0.0]])
    known.take(Observation(0.3, state, (detection("a", (0, 0)), detection("a", (2, 2)))))
    assert set(known.now()[0]) == {"#1", "#2"} and not known.now()[2].any()  # the clock went back
    known.take(Observation(0.4, state, (Detection("high", np.zeros(3), np.eye(3), 0.1),)))
    assert "high" in known.now()[0] and not known.placeless
    known.take(Observation(0.5, state, (Detection("low", np.zeros(1), np.eye(1), 0.1),)))
    assert "low" not in known.now()[0] and known.placeless == ("low",)
    known.reset()
    assert known.now()[1].shape == (0, 2)


def test_steering_turns_before_it_drives():
    robot = Unicycle()
    still = state_of(robot)
    command = steer(robot, still, np.array([0.5, 0.0]), 2.0)
    assert command.linear == (0.5, 0.0) and command.omega == 0.0
    command = steer(robot, still, np.array([0.0, 0.5]), 2.0)
    assert abs(command.linear[0]) < 1e-12 and command.omega == pytest.approx(0.3)
    aside = 0.5 * np.array([np.cos(0.01), np.sin(0.01)])
    command = steer(robot, still, aside, 2.0)
    assert command.linear[0] == pytest.approx(0.5 * np.cos(0.01))
    assert command.omega == pytest.approx(0.02)  # k e
    aside = 0.5 * np.array([np.cos(0.1), np.sin(0.1)])
    command = steer(robot, still, aside, 2.0)
    assert command.omega == pytest.approx(np.sqrt(2 * 0.1 * 0.1), rel=1e-3)  # stops in time
    behind = steer(robot, still, np.array([-0.5, 1e-3]), 2.0)
    assert behind.linear[0] == 0.0 and behind.omega > 0.0
    # A car turns only as it drives: back towards what is behind, at 0.3 of the speed at least.
    car = Bicycle()
    assert steer(car, state_of(car), np.array([-0.5, 0.0]), 2.0).linear[0] == pytest.approx(-0.5)
    ahead = Bicycle(max_reverse_speed=0.0)  # which has to set off to turn at all
    assert steer(ahead, state_of(ahead), np.array([-0.5, 0.1]), 2.0).linear[0] > 0.0
    beside = steer(car, state_of(car), np.array([1e-9, 0.5]), 2.0)
    assert beside.linear[0] == pytest.approx(0.15) and beside.omega > 0.0
    assert steer(robot, still, np.zeros(2), 2.0).omega == 0.0


def test_robots_without_heading_take_the_velocity_as_it_is():
    for robot in (Holonomic(), HolonomicVelocity()):
        command = steer(robot, state_of(robot), np.array([0.3, -0.4]), 2.0)
        np.testing.assert_allclose(command.linear, (0.3, -0.4))
        command = steer(robot, state_of(robot), np.array([3.0, -4.0]), 2.0)
        np.testing.assert_allclose(command.linear, (0.42, -0.56))
        assert top_speed(robot, state_of(robot)) == pytest.approx(0.7)
    assert velocity_of(HolonomicVelocity(), np.zeros(2)) is None
    turned = velocity_of(Unicycle(), state_of(Unicycle(), heading=np.pi / 2, speed=0.4))
    np.testing.assert_allclose(turned, (0.0, 0.4), atol=1e-15)


def test_guide_looks_ahead_along_the_path_and_slows_down():
    guide = PathGuide()
    assert guide.ahead(np.zeros(2), 1.0) is None
    assert not guide.velocity(np.zeros(2), 1.0, 0.5).any()
    guide.follow(Path(np.array([[0.0, 0.0], [4.0, 0.0], [4.0, 3.0]])))
    carrot, way = guide.ahead(np.array([2.0, 1.0]), 3.0)
    np.testing.assert_allclose(carrot, (4.0, 1.0))  # 2 m to the corner, 1 m beyond
    assert way == pytest.approx(2.0 + 2.0)
    np.testing.assert_allclose(guide.velocity(np.array([2.0, 1.0]), 3.0, 0.5), (0.5, 0.0))
    carrot, way = guide.ahead(np.array([0.0, 0.0]), np.inf)
    np.testing.assert_allclose(carrot, (4.0, 3.0))
    assert way == pytest.approx(5.0)
    near = guide.velocity(np.array([4.0, 2.9]), np.inf, 0.5)
    np.testing.assert_allclose(near, (0.0, 0.1))  # 0.1 m in 1 s
    assert not guide.velocity(np.array([4.0, 3.0]), np.inf, 0.5).any()


@pytest.mark.parametrize("points", [
    ((0.0, 0.0), (4.0, 0.0), (-1.0, 0.0)), ((0.0, 0.0), (4.0, 0.0), (4.0, 0.1), (0.0, 0.1)),
    ((0.0, 0.0), (4.0, 0.0), (4.0, 2.0), (4.0, 0.0), (8.0, 0.0)),
])  # fmt: skip
@pytest.mark.parametrize("name", ["pure_pursuit", "dynamic_window", "social_force"])
def test_a_path_back_over_itself_is_followed_to_its_end(name, points):
    controller = build("controllers", {"type": name, "robot": "holonomic"})
    path = Path(points)
    controller.set_path(path)
    state = np.zeros(4)
    for k in range(450):
        if k % 10 == 0:
            controller.set_path(Path(path.points + 0.0001 * (k // 10)))
        command = controller.command(Observation(0.1 * k, state))
        control = controller.robot.drive(tuple(state), command.twist, 0.1)
        state = np.array(step(controller.robot, tuple(state), control, 0.1))
    np.testing.assert_allclose(state, (*path.goal, 0.0, 0.0), atol=0.1)


def test_presets_drive_in_space():
    for name in PRESETS:
        assert build("controllers", {"type": name, "robot": "holonomic_3d"}).robot == Holonomic3D()


@pytest.mark.parametrize("name", KINDS)
def test_at_most_one_class_stands_between_a_controller_and_the_interface(name):
    """It defines each of its methods once: no final class overrides another's code."""
    above = [kind for kind in KINDS[name].__mro__ if issubclass(kind, Controller)]
    assert above[0] is KINDS[name] and above[-1] is Controller and len(above) <= 3
    for method, own in vars(KINDS[name]).items():
        inherited = next((vars(kind)[method] for kind in above[1:] if method in vars(kind)), None)
        if isfunction(own) and isfunction(inherited) and not method.startswith("__"):
            assert getattr(inherited, "__isabstractmethod__", False), method

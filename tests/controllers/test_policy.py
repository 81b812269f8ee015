"""Policies as controllers, what they see, and the actions they give."""

import sys
from importlib import import_module
from pathlib import Path as File

import numpy as np
import pytest

from wideberth.controllers.policy import Policy
from wideberth.controllers.policy_observer import ObservationSpec, PolicyObserver
from wideberth.controllers.velocity_box import VelocityBox
from wideberth.framework import names
from wideberth.framework.controller import fresh
from wideberth.framework.plugins.config import build, describe
from wideberth.framework.plugins.registry import load
from wideberth.framework.testing import check_controller
from wideberth.framework.values.errors import WideberthError
from wideberth.framework.values.motion import Command, Detection, Observation, Twist
from wideberth.framework.values.path import Path
from wideberth.framework.values.polygon import Polygon
from wideberth.predictors.kalman import Kalman
from wideberth.robots.holonomic_velocity import HolonomicVelocity
from wideberth.robots.unicycle import Unicycle

PARTICLE = HolonomicVelocity(radius=0.3)
EAST = Path([[0.0, 0.0], [5.0, 0.0]])


@pytest.fixture(autouse=True)
def policies(monkeypatch):
    monkeypatch.syspath_prepend(str(File(__file__).parents[1] / "helpers"))
    return import_module("sample_policies")


@pytest.mark.parametrize("name", names("robots"))
def test_every_robot_has_a_box_that_its_drive_keeps(name):
    """No twist that the robot drives itself into lies outside, and each limit can be had."""
    robot = load("robots", name)()
    box = VelocityBox.of(robot)
    assert (box.high <= 1.0).all() and (box.high > 0.5).all()
    size = robot.dimension
    for component, limit in zip(box.components, box.limits, strict=True):
        reached = []
        for sign in (1.0, -1.0):
            values = np.zeros(size + 1)
            values[component] = sign * 100.0
            if component == size and robot.pose((0.0,) * len(robot.states)).heading is not None:
                values[0] = 100.0 if name == "bicycle" else 0.0  # which turns only as it drives
            wanted = Twist(tuple(values[:-1]), values[-1])
            state = tuple(0.0 for _ in robot.states)
            control = robot.drive(state, wanted, 1024.0)
            rates = robot.derivative(state, control)
            later = tuple(x + 1024.0 * r for x, r in zip(state, rates, strict=True))
            found = robot.twist(later, control)
            reached.append(abs([*found.linear, found.angular][component]))
        assert max(reached) <= limit * (1 + 1e-9)
        assert max(reached) == pytest.approx(limit) or name in ("bicycle", "differential_drive")


def test_a_box_ends_where_the_robot_may_not_drive_backwards():
    """An action for that stands still, and the actions that a policy may choose end there."""
    box = VelocityBox.of(Unicycle(max_speed=1.0, max_yaw_rate=2.0, max_reverse_speed=0.25))
    assert (box.low.tolist(), box.high.tolist()) == ([-0.25, -1.0], [1.0, 1.0])
    assert box.command([-1.0, 0.5]) == Command((-0.25, 0.0), 1.0)
    assert VelocityBox.of(Unicycle(max_reverse_speed=0.0)).command([-1.0, 0.0]).linear == (0, 0)


def test_commands_go_through_actions_unharmed():
    rng = np.random.default_rng(0)
    box = VelocityBox.of(Unicycle(max_speed=1.37, max_yaw_rate=2.9))
    assert box.units.tolist() == [2.0, 4.0]
    for v, omega in rng.uniform(-1.0, 1.0, (200, 2)) * [1.37, 2.9]:
        again = box.command(box.action(Twist((v, 0.0), omega)))
        assert again.linear == (v, 0.0) and again.omega == omega
    assert box.command([5.0, -5.0]) == Command((1.37, 0.0), -2.9)
    with pytest.raises(WideberthError, match="action"):
        box.command([0.0])
    endless = Unicycle(max_speed=1e300)
    with pytest.raises(WideberthError, match="without limit"):
        VelocityBox.of(endless)


def seen(stamp, places, state=(0.0, 0.0), age=0.0, polygons=()):
    found = tuple(
        Detection(name, np.array(place, float), 1e-4 * np.eye(2), 0.4, age)
        for name, place in places.items()
    )
    return Observation(stamp, np.array(state), found, polygons=polygons)


def test_the_nearest_are_shown_with_their_velocities():
    view = PolicyObserver(PARTICLE, 0.5, ObservationSpec(obstacles=2, reach=6.0))
    view.follow(EAST)
    for k in range(3):
        t = 0.5 * k
        last = seen(t, {"a": (3.0 - t, 0), "b": (0, 2.0 + 0.4 * t), "far": (0, 50), "c": (5, 0)})
        view.take(last)
    shown = view.show(last)
    np.testing.assert_allclose(shown["positions"], [[2.0, 0.0], [0.0, 2.4]])
    np.testing.assert_allclose(shown["velocities"], [[-1.0, 0.0], [0.0, 0.4]], atol=1e-12)
    assert shown["present"].tolist() == [1.0, 1.0] and shown["radii"].tolist() == [0.4, 0.4]
    view.take(last := seen(1.5, {}))
    np.testing.assert_allclose(view.show(last)["positions"][0], [1.5, 0.0])  # carried on
    view.take(last := seen(9.0, {}))
    assert view.show(last)["present"].tolist() == [0.0, 0.0]


def test_a_late_measurement_is_carried_to_now():
    view = PolicyObserver(PARTICLE, 0.5, ObservationSpec(obstacles=1))
    view.follow(EAST)
    for t in (0.0, 0.5, 1.0):
        view.take(last := seen(t, {"a": (2.0 + t - 0.25, 1.0)}, age=0.25))
    np.testing.assert_allclose(view.show(last)["positions"][0], [3.0, 1.0])


def test_own_velocity_goal_heading_and_walls():
    robot = Unicycle(radius=0.3)
    view = PolicyObserver(robot, 0.5, ObservationSpec(walls=2, reach=3.0))
    view.follow(EAST)
    wall = Polygon(((0, 1), (2, 1), (2, 2), (0, 2)), "wall")
    view.take(last := seen(0.0, {}, (1.0, 0.5, np.pi / 2, 0.4, -0.1), polygons=(wall,)))
    shown = view.show(last)
    np.testing.assert_allclose(shown["heading"], [0.0, 1.0], atol=1e-12)
    np.testing.assert_allclose(shown["velocity"], [0.4, -0.2])  # the unit of 0.3 rad/s is 0.5
    np.testing.assert_allclose(shown["walls"], [[0.0, 0.5], [0.0, 0.0]], atol=1e-12)
    assert shown["walls_present"].tolist() == [1.0, 0.0]
    np.testing.assert_allclose(np.linalg.norm(shown["goal"]), 3.0)
    np.testing.assert_allclose(shown["goal"] / 3.0, [4.0, -0.5] / np.hypot(4.0, 0.5))
    particle = PolicyObserver(PARTICLE, 0.5, ObservationSpec())
    particle.follow(EAST)
    particle.commanded(Command((0.3, 0.1)))
    particle.take(last := seen(0.0, {}))
    np.testing.assert_allclose(particle.show(last)["velocity"], [0.3, 0.1])


def test_forecasts_are_those_of_the_predictor():
    predictor = Kalman()
    view = PolicyObserver(
        PARTICLE, 0.5, ObservationSpec(obstacles=2, predictor=predictor, steps=3)
    )
    view.follow(EAST)
    for k in range(8):
        view.take(last := seen(0.5 * k, {"a": (4.0 - 0.25 * k, 1.0)}, (0.5, 0.0)))
    shown = view.show(last)
    steps = 4.0 - 0.25 * np.arange(8.0, 11.0) - 0.5
    np.testing.assert_allclose(shown["forecast_mean"][0, :, 0], steps, atol=0.02)
    spread = shown["forecast_covariance"][0, :, 0, 0]
    assert (np.diff(spread) > 0).all() and not shown["forecast_mean"][1].any()


@pytest.mark.parametrize("robot", ["holonomic_velocity", "unicycle", "holonomic_3d"])
def test_a_policy_keeps_the_laws_of_a_controller(robot):
    made = build("robots", robot)
    size = len(VelocityBox.of(made).components)
    name = {2: "to_goal", 3: "to_goal"}[size]
    check_controller(Policy(made, f"sample_policies:{name}"))


def test_failure_is_a_stop_with_a_reason():
    for name, text in (("wrong_size", "shape"), ("raises", "RuntimeError: no weights")):
        controller = Policy(PARTICLE, f"sample_policies:{name}")
        controller.set_path(EAST)
        assert controller.command(seen(0.0, {})) == Command((0.0, 0.0))
        assert text in controller.reason
    controller = Policy(PARTICLE, "sample_policies:to_goal")
    with pytest.raises(WideberthError, match="no path is set"):
        controller.command(seen(0.0, {}))
    with pytest.raises(WideberthError, match="columns"):
        controller.set_path(Path([[0, 0, 0], [1, 0, 0]]))


def test_config_round_trip_and_names():
    config = {"type": "wideberth.controllers.policy:Policy", "robot": "holonomic_velocity",
              "policy": "sample_policies:to_goal", "sight": {"obstacles": 3}}  # fmt: skip
    made = build("controllers", config)
    again = build("controllers", describe(made))
    assert describe(again) == describe(made) and again.sight == ObservationSpec(obstacles=3)
    assert fresh(made) is not made and fresh(made).policy == made.policy
    assert "sample_policies" in sys.modules
    for wrong in (
        "sample_policies",
        "sample_policies:nothing",
        "no_module:f",
        "sample_policies:LEARNT",
    ):
        with pytest.raises(WideberthError, match="module:function"):
            Policy(PARTICLE, wrong)
    with pytest.raises(WideberthError, match=r"sight\.obstacles"):
        ObservationSpec(obstacles=0)

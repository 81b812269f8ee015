"""Which commands keep the contract of a controller, and what wrong types meet at construction."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest

from wideberth.controllers.velocity_box import VelocityBox
from wideberth.framework.control.command_limits import (
    ALLOWANCE,
    broken_limit,
    turns_on_the_spot,
    within_reach,
)
from wideberth.framework.controller import checked_ready, checked_use
from wideberth.framework.plugins.config import build
from wideberth.framework.plugins.registry import names
from wideberth.framework.robot import Robot
from wideberth.framework.testing import check_controller
from wideberth.framework.values.errors import WideberthError
from wideberth.framework.values.motion import (
    Command,
    Detection,
    Observation,
    checked_numbers,
)
from wideberth.framework.values.path import Path
from wideberth.robots.bicycle import Bicycle
from wideberth.robots.holonomic_velocity import HolonomicVelocity
from wideberth.robots.unicycle import Unicycle
from wideberth.tests.helpers.straight import Straight

ROBOTS = [build("robots", name) for name in names("robots")]


@pytest.mark.parametrize("robot", ROBOTS, ids=lambda robot: type(robot).__name__)
def test_a_robots_own_velocities_keep_the_contract_and_others_do_not(robot: Robot) -> None:
    """Held against the bounds of state and input, not against the code that is examined."""
    rng = np.random.default_rng(3)
    box = VelocityBox.of(robot)
    limits = np.zeros(robot.dimension + 1)
    limits[list(box.components)] = box.limits
    for _ in range(200):
        drawn = limits * rng.uniform(-3.0, 3.0, len(limits))
        command = Command(tuple(map(float, drawn[:-1])), float(drawn[-1]), ramp=0.5)
        if (np.abs(drawn) > limits + 2 * ALLOWANCE).any():
            assert broken_limit(robot, command)
        nearest = within_reach(robot, command)
        assert broken_limit(robot, nearest) == ""
        assert nearest.ramp == command.ramp
        found = np.array([*nearest.linear, nearest.omega])
        assert (np.abs(found) <= limits + ALLOWANCE).all()
        assert within_reach(robot, nearest) is nearest  # unharmed, to the last digit
    still = Command((0.0,) * robot.dimension)
    assert broken_limit(robot, still) == ""


def test_limits_that_couple_components_count() -> None:
    assert broken_limit(HolonomicVelocity(), Command((0.49, 0.49))) == ""  # norm 0.69 of 0.7
    assert "can do by 0.105" in broken_limit(HolonomicVelocity(), Command((0.6, 0.6)))
    nearest = within_reach(HolonomicVelocity(), Command((3.0, 4.0)))
    assert nearest.linear == pytest.approx((0.42, 0.56))
    assert "can do by 0.1" in broken_limit(Bicycle(), Command((0.0, 0.0), 0.1))
    assert "can do by 0.1" in broken_limit(Unicycle(), Command((0.1, 0.1)))
    assert broken_limit(Unicycle(), Command((-0.7, 0.0), 0.3)) == ""
    assert "by 0.05" in broken_limit(Unicycle(), Command((0.75, 0.0)))
    assert "by 0.1" in broken_limit(Unicycle(), Command((0.0, 0.0), -0.4))


@pytest.mark.parametrize(
    ("command", "words"),
    [
        (None, "it is a NoneType; wanted a Command"),
        (Command((0.1,)), "it has 1 linear components; wanted 2"),
        (Command((np.nan, 0.0)), "wanted finite numbers"),
        (Command((0.0, 0.0), np.inf), "wanted finite numbers"),
        (Command((0.0, 0.0), ramp=-0.1), "a ramp of at least 0 s"),
        (Command((1e300, 0.0), -1e300), "beyond what the robot can do"),
    ],
)
def test_what_is_wrong_with_a_command_is_said(command: Any, words: str) -> None:
    assert words in broken_limit(Unicycle(), command)
    if isinstance(command, Command):
        assert broken_limit(Unicycle(), within_reach(Unicycle(), command)) == ""


@dataclass(eq=False)
class Goes(Straight):
    """Uses nothing but the goal, and checks what it is asked, or not."""

    speed: float = 0.5
    careful: bool = True
    goal = None

    def command(self, observation: Observation) -> Command:
        if self.careful:
            checked_ready(self.goal)
            checked_use(HolonomicVelocity(), observation)
        if observation.flaw:
            return Command((0.0, 0.0))
        self.seen = []
        way = self.goal - observation.state[:2]
        found = self.speed * way / np.abs(way).max()
        return Command((float(found[0]), float(found[1])))


def test_the_contract_check_finds_commands_beyond_the_limits_and_wrong_use() -> None:
    robot = HolonomicVelocity()
    check_controller(Goes(speed=0.49), robot)
    with pytest.raises(AssertionError, match=r"it is .*beyond what"):
        check_controller(Goes(speed=0.9), robot)
    with pytest.raises(AssertionError, match="wrong use raised TypeError"):
        check_controller(Goes(careful=False), robot)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"stamp": "1.0"}, "observation.stamp is '1.0'; wanted a number"),
        ({"stamp": None}, "observation.stamp is None; wanted a number"),
        ({"stamp": [0.0]}, "observation.stamp is"),
        ({"state": "01234"}, "observation.state is not an array of numbers"),
        ({"state": ["0", "0"]}, "observation.state is not an array of numbers"),
        ({"state": [0.0, None]}, "observation.state is not an array of numbers"),
        ({"state": 1.0}, "observation.state has shape"),
        ({"covariance": np.eye(2)}, "observation.covariance has shape|covariance has shape"),
        ({"detections": 3}, "observation.detections is 3; wanted a tuple"),
        ({"detections": ("a",)}, "observation.detections holds a str; wanted Detection"),
        ({"polygons": ("a",)}, "observation.polygons holds a str; wanted Polygon"),
        ({"truth": {}}, "observation.truth is"),
    ],
)
def test_an_observation_of_wrong_types_is_refused(change: dict[str, Any], words: str) -> None:
    good = Observation(0.0, np.zeros(5))
    with pytest.raises(WideberthError, match=words):
        replace(good, **change)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"ident": 7}, "detection.ident is 7; wanted a str"),
        ({"position": "ab"}, "detection.position is not an array of numbers"),
        ({"position": np.zeros((1, 2))}, "detection.position has shape"),
        ({"covariance": np.eye(3)}, "covariance has shape"),
        ({"radius": "0.3"}, "detection.radius is '0.3'; wanted a number"),
        ({"age": None}, "detection.age is None; wanted a number"),
    ],
)
def test_a_detection_of_wrong_types_is_refused(change: dict[str, Any], words: str) -> None:
    with pytest.raises(WideberthError, match=words):
        replace(Detection("a", np.zeros(2), np.eye(2), 0.3), **change)


@pytest.mark.parametrize("name", ["pure_pursuit", "orca", "social_force", "constant_velocity"])
def test_rivals_stop_while_an_obstacle_without_a_place_is_seen(name: str) -> None:
    robot = build("robots", "unicycle")
    made = build("controllers", {"type": name, "robot": robot})
    made.set_path(Path(np.array([[0.0, 0.0], [9.0, 0.0]])))
    lost = Detection("lost", [np.nan, 0.0], np.eye(2), 0.3)
    for stamp in (0.0, made.period):
        command = made.command(Observation(stamp, np.zeros(5), (lost,)))
        assert (*command.linear, command.omega) == (0.0, 0.0, 0.0)
        assert "seen without a place: 'lost'" in made.reason


def test_the_robots_own_numbers_alone_are_refused() -> None:
    bad = Detection("b", np.full(2, np.nan), -np.eye(2), -0.3)
    checked_numbers(Observation(0.0, np.zeros(5), (bad,)))
    with pytest.raises(WideberthError, match="the observation's stamp is inf"):
        checked_numbers(Observation(np.inf, np.zeros(5)))


def test_who_can_turn_on_the_spot() -> None:
    found = {name: build("robots", name) for name in names("robots")}
    turns = [name for name, one in found.items()
             if turns_on_the_spot(one, np.zeros(len(one.states)))]  # fmt: skip
    assert sorted(turns) == ["differential_drive", "unicycle", "unicycle_velocity"]

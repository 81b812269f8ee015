"""Manoeuvres keep what a robot can do, hold what they hold, and stop where they should."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from wideberth.controllers.judging import manoeuvres
from wideberth.controllers.judging.manoeuvres import (
    AFTERWARDS,
    FASTER,
    HELD,
    SPEEDS,
    TURNS,
    driven,
)
from wideberth.framework.plugins.config import build
from wideberth.framework.robot import Robot, start_state, step
from wideberth.framework.values.arrays import Array
from wideberth.framework.values.plan import TOLERANCE
from wideberth.robots.unicycle import Unicycle

DT, STEPS, SPEED = 0.2, 12, 0.6
AHEAD = (3.0, 1.0, 0.5)
ROBOTS: dict[str, dict[str, Any]] = {
    "unicycle": {},
    "agile unicycle": {"max_acceleration": 3.0, "max_yaw_rate": 3.0, "max_yaw_acceleration": 10.0},
    "unicycle never backwards": {"max_reverse_speed": 0.0},
    "unicycle_velocity": {},
    "unicycle_velocity never backwards": {"max_reverse_speed": 0.0},
    "differential_drive": {},
    "bicycle": {},
    "holonomic_velocity": {},
    "holonomic": {},
    "holonomic_3d": {},
}
WRITTEN = len(SPEEDS) * len(TURNS) * len(HELD) * len(AFTERWARDS)


def made(name: str) -> Robot:
    kind = next(word for word in name.split() if "_" in word or word in ROBOTS)
    robot: Robot = build("robots", {"type": kind, **ROBOTS[name]})
    return robot


def begun(robot: Robot, speed: float) -> Array:
    """Return the state of a robot that drives aslant at the origin."""
    rest = (0.0,) * (robot.dimension - 2)
    state, _ = start_state(robot, (0.0, 0.0, *rest), (0.6, 0.8, *rest), speed)
    return np.array(state, dtype=np.float64)


def everything(
    robot: Robot, speed: float = 0.4, place: tuple[float, ...] = AHEAD, steps: int = STEPS
) -> tuple[Array, Array]:
    target = np.array(place[: robot.dimension])
    return driven(robot, begun(robot, speed), target, SPEED, steps, DT)


@pytest.mark.parametrize("speed", [0.0, 0.4])
@pytest.mark.parametrize("name", ROBOTS)
def test_every_manoeuvre_keeps_the_limits_of_the_robot(name: str, speed: float) -> None:
    robot = made(name)
    states, inputs = everything(robot, speed)
    assert states.shape == (WRITTEN, STEPS + 1, len(robot.states))
    assert inputs.shape == (WRITTEN, STEPS, len(robot.inputs))
    pairs = ((states, robot.state_bounds()), (inputs, robot.input_bounds()))
    for values, bounds in pairs:
        assert (values <= np.array(bounds.upper) + TOLERANCE).all()
        assert (values >= np.array(bounds.lower) - TOLERANCE).all()
    control = tuple(np.moveaxis(inputs, -1, 0))
    for some in (states[:, :-1], states[:, 1:]):
        for limit in robot.constraints(tuple(np.moveaxis(some, -1, 0)), control):
            assert np.min(limit) >= -TOLERANCE


@pytest.mark.parametrize("name", ROBOTS)
def test_every_manoeuvre_is_what_its_inputs_drive(name: str) -> None:
    robot = made(name)
    states, inputs = everything(robot)
    now = tuple(np.moveaxis(np.repeat(begun(robot, 0.4)[None], WRITTEN, 0), -1, 0))
    for n in range(STEPS):
        now = step(robot, now, tuple(np.moveaxis(inputs[:, n], -1, 0)), DT)
        assert np.stack(np.broadcast_arrays(*now), -1) == pytest.approx(states[:, n + 1], abs=1e-9)


@pytest.mark.parametrize("name", [one for one in ROBOTS if one.split()[0] != "holonomic_3d"])
def test_compiled_manoeuvres_are_those_driven_one_by_one(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    robot = made(name)
    found = everything(robot)
    monkeypatch.setattr(manoeuvres, "SymbolicDrive", ())
    for one, other in zip(found, everything(robot), strict=True):
        assert one == pytest.approx(other, abs=1e-7)


@pytest.mark.parametrize("held", HELD)
def test_a_twist_is_held_for_its_time_and_not_longer(held: float) -> None:
    """With velocities as inputs the twist is there at once, and what follows is another one."""
    robot = made("unicycle_velocity")
    _, inputs = everything(robot)
    fastest = min(0.8, FASTER * SPEED)
    twists = [(share * fastest, turn * 0.7) for share in SPEEDS for turn in TURNS]
    shape = len(twists), len(HELD), len(AFTERWARDS), STEPS, 2
    family = inputs.reshape(shape)[:, HELD.index(held)]
    steps = round(held / DT)
    for twist, own in zip(twists, family, strict=True):
        assert own[:, :steps] == pytest.approx(np.broadcast_to(twist, own[:, :steps].shape))
        assert (own[:, steps, 0] >= 0.0).all()
        assert own[0, steps:] == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("name", ROBOTS)
def test_manoeuvres_without_a_speed_afterwards_stand_at_the_end(name: str) -> None:
    robot = made(name)
    states, inputs = everything(robot, steps=40)
    last = states[:: len(AFTERWARDS), -2:]
    assert last[:, 1, : robot.dimension] == pytest.approx(last[:, 0, : robot.dimension], abs=1e-6)
    assert np.isfinite(inputs).all()


@pytest.mark.parametrize("speed", [0.0, 0.4])
@pytest.mark.parametrize("place", [AHEAD, (-3.0, 0.5, -0.5)], ids=["ahead", "behind"])
@pytest.mark.parametrize("name", [name for name in ROBOTS if name != "bicycle"])
def test_what_follows_ends_at_the_target_and_does_not_circle(
    name: str, place: tuple[float, ...], speed: float
) -> None:
    """Whatever was held first, and where the robot looks."""
    robot = made(name)
    states, _ = everything(robot, speed, place, steps=150)
    after = states[len(AFTERWARDS) - 1 :: len(AFTERWARDS)]
    away = after[..., : robot.dimension] - np.array(place[: robot.dimension])
    assert np.linalg.norm(away, axis=2).min(axis=1).max() < 0.35


def test_a_car_turns_towards_what_is_behind_it_instead_of_waiting() -> None:
    """It turns only as it goes; its circle is 2.4 m wide."""
    robot = made("bicycle")
    states, _ = everything(robot, 0.0, (-2.0, -2.0), steps=60)
    after = states[len(AFTERWARDS) - 1 :: len(AFTERWARDS), -30:]
    assert (after[:, :, 3] > 0.1).all()
    assert (np.abs(np.diff(after[:, [0, -1], 2])) > 0.3).all()


@pytest.mark.parametrize("name", ["unicycle", "bicycle", "holonomic_velocity", "holonomic_3d"])
def test_a_target_that_is_reached_leaves_finite_numbers(name: str) -> None:
    robot = made(name)
    for state in everything(robot, 0.0, (0.0, 0.0, 0.0)):
        assert np.isfinite(state).all()


def test_the_same_manoeuvres_have_the_same_bytes() -> None:
    first = everything(Unicycle())
    everything(replace(Unicycle(), max_speed=0.3))
    for one, other in zip(first, everything(Unicycle()), strict=True):
        assert one.tobytes() == other.tobytes()

"""In contact the robot stops or leaves, on whichever side it is touched, and never speeds up."""

from dataclasses import replace
from math import cos, pi, sin
from typing import Any

import numpy as np
import pytest

from wideberth.framework.mpc.planner import cycle
from wideberth.framework.mpc.planner.in_contact import LEAVING, InContact, expected_now
from wideberth.framework.mpc.planner.planner import Planner
from wideberth.framework.mpc.planner.rollout import brake, steer
from wideberth.framework.plugins.config import build
from wideberth.framework.robot import Robot, start_state, step
from wideberth.framework.testing.controller import check_controller
from wideberth.framework.values.arrays import Array
from wideberth.framework.values.footprint import Outline
from wideberth.framework.values.forecast import Forecast
from wideberth.framework.values.motion import Detection, Observation, Twist
from wideberth.framework.values.plan import Plan
from wideberth.framework.values.tracks import Tracks
from wideberth.predictors.constant_velocity import ConstantVelocity
from wideberth.robots.unicycle import Unicycle
from wideberth.tests.helpers.planning import planner

ROBOT = Unicycle(0.3, 1.5, 1.0, 1.0, 2.0)
HOLONOMIC = build("robots", {"type": "holonomic", "radius": 0.3})
VELOCITY = build("robots", {"type": "holonomic_velocity", "radius": 0.3})
RADIUS, DT = 0.3, 0.25
SIDES = {
    "ahead": (0.5, 0.0), "behind": (-0.5, 0.0), "left": (0.0, 0.5), "right": (0.0, -0.5),
    "aslant": (0.4, 0.3), "deep": (0.1, 0.0), "deep behind": (-0.1, 0.05), "centred": (0.0, 0.0),
}  # fmt: skip
MOVING = {"still": (0.0, 0.0), "along": (1.0, 0.0), "against": (-1.3, 0.0), "across": (0.0, 1.0)}


def made(robot: Robot = ROBOT, **changes: Any) -> Planner:
    known = {"reference_speed": 1.0, "predictor": ConstantVelocity(), "period": DT, "dt": DT}
    return planner(robot=robot, **known, **changes)


def met(
    one: Planner, speed: float, offset: tuple[float, ...], velocity: tuple[float, ...]
) -> tuple[float, Plan]:
    """Speed that is commanded to a robot that a person has just come upon."""
    for back in (2.0, 1.0, 0.0):
        time = -DT * back
        state, _ = start_state(one.robot, [5.0 + speed * time, 0.0], [1.0, 0.0], speed)
        place = np.array([5.0, 0.0]) + offset + time * np.array(velocity)
        who = Detection("a", place, 1e-6 * np.eye(2), RADIUS)
        seen = Observation(10.0 + time, np.array(state), (who,))
        if back:
            one.remember(seen)
    command = one.command(seen)
    assert one.plan is not None
    return float(np.hypot(*command.linear)), one.plan


def speeds(robot: Robot, plan: Plan) -> Array:
    twist = robot.twist(tuple(plan.states[1:].T), tuple(plan.inputs.T))
    return np.asarray(np.hypot(*np.broadcast_arrays(*twist.linear)), dtype=np.float64)


@pytest.mark.parametrize("speed", [0.0, 0.1, 0.5, 1.0])
@pytest.mark.parametrize("side", SIDES)
def test_in_contact_the_robot_stops_or_leaves(side: str, speed: float) -> None:
    """By geometry alone: no faster, and no step beyond braking but away from the person."""
    straight, _ = brake(ROBOT, np.array([5.0, 0.0, 0.0, speed, 0.0]), 15, DT)
    hardest = np.linalg.norm(np.diff(straight[:, :2], axis=0), axis=1)
    person = np.array([5.0, 0.0]) + SIDES[side]
    one = made()
    for velocity in MOVING.values():
        one.reset()
        commanded, plan = met(one, speed, SIDES[side], velocity)
        assert commanded <= max(speed, LEAVING) + 1e-3
        assert "in contact with 'a': the robot stops or leaves" in plan.reason
        moved = np.diff(plan.positions, axis=0)
        length = np.linalg.norm(moved, axis=1)
        for k, (place, go) in enumerate(zip(plan.positions, moved, strict=False)):
            if np.linalg.norm(place - person) > RADIUS + ROBOT.radius:
                break
            assert speeds(ROBOT, plan)[k] <= max(speed, LEAVING) + 1e-3
            if length[k] > hardest[k] + 1e-3:
                slow = length[k] <= (LEAVING + 1e-3) * DT
                share = 0.0 if slow else 0.5
                assert go @ (person - place) / length[k] <= -share * RADIUS + 1e-6


@pytest.mark.parametrize("side", ["ahead", "aslant", "left", "centred", "deep"])
def test_a_robot_that_leads_nowhere_away_brakes_at_once(side: str) -> None:
    for speed in (0.5, 1.0):
        commanded, plan = met(made(), speed, SIDES[side], (0.0, 0.0))
        assert commanded <= speed - 0.9 * DT  # of 1 m/s^2
        assert "neither stops for 'a' nor leaves it" in plan.reason


def test_who_pushes_from_behind_is_left_at_the_present_speed() -> None:
    commanded, plan = met(made(), 1.0, (-0.5, 0.0), (1.5, 0.0))
    assert 0.9 < commanded <= 1.0 + 1e-3
    assert plan.positions[-1, 0] > 5.5
    commanded, plan = met(made(), 0.0, (0.5, 0.0), (0.0, 0.0))
    assert 0.1 < commanded <= LEAVING + 1e-3 and plan.positions[-1, 0] < 4.9


@pytest.mark.parametrize("robot", [HOLONOMIC, VELOCITY], ids=["holonomic", "velocity"])
def test_a_robot_without_heading_keeps_the_same_rule(robot: Robot) -> None:
    """One whose input is the velocity is at rest as a plan begins: it can stop at once."""
    for offset in SIDES.values():
        one = made(robot)
        commanded, _ = met(one, 0.5, offset, (0.0, 0.0))
        fastest = 0.5 if robot is HOLONOMIC else LEAVING
        assert commanded <= fastest + 1e-3


def test_regions_that_overlap_are_no_contact(monkeypatch: pytest.MonkeyPatch) -> None:
    """2 cm between the bodies: the plan is the same with the rule and without, to the byte."""
    found = [met(made(), 0.8, (0.62, 0.0), (0.0, 0.0))]
    assert found[0][1].violation > 0.5 and "in contact" not in found[0][1].reason
    monkeypatch.setattr(cycle, "_in_contact", lambda *_: None)
    found.append(met(made(), 0.8, (0.62, 0.0), (0.0, 0.0)))
    assert found[0][0] == found[1][0]
    np.testing.assert_array_equal(found[0][1].states, found[1][1].states)


# the rule itself

START = np.array([0.0, 0.0, 0.0, 1.0, 0.0])


def rule(
    *places: tuple[float, float], robot: Robot = ROBOT, start: Array = START,
    placeless: tuple[str, ...] = (),
) -> InContact | None:  # fmt: skip
    names = tuple(f"o{i}" for i in range(len(places)))
    others = names, np.array(places).reshape(-1, 2), np.full(len(places), RADIUS)
    return InContact.of(robot, start, others, placeless, 8, DT)


def pressed(
    found: InContact | None, twist: Twist, start: Array = START, robot: Robot = ROBOT
) -> float:
    assert found is not None
    states, inputs = steer(robot, start, twist, 8, DT)
    return float(found.pressed(robot, states, inputs).max())


def test_contact_is_between_bodies_touching_ones_included() -> None:
    assert rule() is None and rule((0.6001, 0.0), (0.0, 0.7)) is None
    found = rule((3.0, 0.0), (0.6, 0.0))
    assert found is not None and found.names == ("o1",) and found.name == "o1"
    assert found.fastest == 1.0 and str(found) == (
        "in contact with 'o1': the robot stops or leaves"
    )
    slow = rule((0.5, 0.0), start=np.zeros(5))
    assert slow is not None and slow.fastest == LEAVING


@pytest.mark.parametrize("angle", [0.0, 0.4 * pi, 0.5 * pi, 0.6 * pi, 0.65 * pi, 0.7 * pi, pi])
def test_away_is_where_a_quarter_of_the_width_is_ahead_at_most(angle: float) -> None:
    """Straight on at 1 m/s past a disc at that angle, 0.5 m from the middle of the robot."""
    place = 0.5 * cos(angle), 0.5 * sin(angle)
    ahead = (place[0] + RADIUS) / (2.0 * RADIUS)
    assert (pressed(rule(place), Twist((1.0, 0.0))) > 0.0) == (ahead > 0.25)
    assert pressed(rule(place), Twist((0.0, 0.0))) == 0.0
    assert pressed(rule(place), Twist((1.5, 0.0))) > 0.04  # faster than now


def test_everyone_in_contact_counts_and_nobody_once_they_are_apart() -> None:
    assert pressed(rule((-0.5, 0.0)), Twist((1.0, 0.0))) == 0.0
    assert pressed(rule((-0.5, 0.0), (0.5, 0.0)), Twist((1.0, 0.0))) > 0.0
    found = rule((-0.59, 0.0))
    assert found is not None
    states, inputs = steer(ROBOT, START, Twist((1.5, 0.0)), 8, DT)
    late = found.pressed(ROBOT, states, inputs)
    assert late[0] > 0.0 and not late[1:].any()


def test_who_has_no_place_leaves_braking_alone() -> None:
    found = rule(placeless=("a", "b"))
    assert str(found) == "'a', 'b' seen without a place: the robot stops"
    assert pressed(found, Twist((0.0, 0.0))) == 0.0
    for twist in (
        Twist((1.0, 0.0)),
        Twist((0.5, 0.0)),
        Twist((-1.0, 0.0)),
        Twist((0.0, 0.0), 1.0),
    ):
        assert pressed(found, twist) > 0.0


def test_a_body_with_corners_does_not_turn_into_anybody() -> None:
    bar = Outline(((-0.9, -0.2), (0.9, -0.2), (0.9, 0.2), (-0.9, 0.2)))
    robot = replace(ROBOT, radius=1.0, footprint=bar)
    rest = np.zeros(5)
    beside = rule((0.7, 0.45), robot=robot, start=rest)
    assert pressed(beside, Twist((0.0, 0.0), 0.5), rest, robot) > 0.0
    assert pressed(beside, Twist((0.0, 0.0), -0.5), rest, robot) == 0.0
    assert rule((0.7, 0.55), robot=robot, start=rest) is None  # within its disc, and clear of it


def test_who_is_where_as_a_plan_begins() -> None:
    """Between the newest measurement and the plan's first step; else where the forecast begins."""
    positions = np.array([[[0.0, 0.0], [1.0, 0.0]], [[0.0, 0.0], [np.nan, np.nan]]])
    tracks = Tracks(positions, 0.5, ("a", "b"), np.full(2, RADIUS), np.tile(np.eye(2), (2, 1, 1)))
    mean = np.array([[[1.75, 0.0], [2.0, 0.0]], [[3.0, 1.0], [4.0, 1.0]]])
    forecast = Forecast.single(mean, np.tile(np.eye(2), (2, 2, 1, 1)), 0.5)
    names, places, radii = expected_now(tracks, forecast, 0.25, 2)
    assert names == ("a", "b") and radii.tolist() == [RADIUS, RADIUS]
    np.testing.assert_allclose(places, [[1.25, 0.0], [2.0, 1.0]])
    assert expected_now(None, None, 0.0, 2)[0] == ()


@pytest.mark.parametrize("angle", [0.45 * pi, 0.5 * pi, 0.55 * pi])
def test_slowly_less_than_half_may_lie_ahead(angle: float) -> None:
    place, slow = (0.5 * cos(angle), 0.5 * sin(angle)), np.array([0.0, 0.0, 0.0, 0.2, 0.0])
    found = pressed(rule(place, start=slow), Twist((0.2, 0.0)), slow)
    assert (found > 0.0) == (angle < 0.51 * pi)
    assert pressed(rule((0.0, 0.0), start=slow), Twist((0.2, 0.0)), slow) > 0.0


def test_a_robot_that_stands_in_contact_leaves_and_does_not_stay_on_its_last_plan() -> None:
    one, state = made(), np.array([0.0, 0.0, 0.0, 0.0, 0.0])
    who = (Detection("a", np.array([0.45, 0.1]), 1e-6 * np.eye(2), RADIUS),)
    for k in range(8):
        one.command(Observation(DT * k, state, who))
        assert one.plan is not None
        state = np.array(step(ROBOT, tuple(state), tuple(one.plan.inputs[0]), DT))
    assert np.linalg.norm(state[:2] - who[0].position) > RADIUS + ROBOT.radius


def test_the_contract_check_finds_a_planner_without_the_rule(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    wanted = ("what is seen and cannot be used is an obstacle", "no faster in contact")
    found = [law for law in check_controller.laws(made()) if law.name in wanted]
    for law in found:
        law.check()
    monkeypatch.setattr(cycle, "_in_contact", lambda *_: None)
    for law, words in zip(found, ("without a place", "in contact with an obstacle"), strict=True):
        with pytest.raises(AssertionError, match=words):
            law.check()

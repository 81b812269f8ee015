"""Somebody is seen, and a number is of no use: the planner does not drive through them."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from wideberth.framework.mpc.planner.planner import Planner
from wideberth.framework.robot import step
from wideberth.framework.values.arrays import Array
from wideberth.framework.values.motion import Detection, Observation
from wideberth.framework.values.plan import Rung
from wideberth.predictors.constant_velocity import ConstantVelocity
from wideberth.robots.unicycle import Unicycle
from wideberth.tests.helpers.planning import planner

ROBOT = Unicycle(0.3, 1.5, 1.0, 1.0, 2.0)
DT, PLACE, RADIUS = 0.25, np.array([4.0, 0.1]), 0.3
GOOD = Detection("a", PLACE, 1e-4 * np.eye(2), RADIUS)


def made() -> Planner:
    known = {"reference_speed": 1.0, "predictor": ConstantVelocity(), "period": DT}
    return planner(robot=ROBOT, dt=DT, margin=0.1, **known)


def driven(one: Planner, seen: Callable[[int], tuple[Detection, ...]], ticks: int = 24) -> Array:
    """States of the robot at 1 m/s along the x axis, which follows its plans."""
    states = [np.array([0.0, 0.0, 0.0, 1.0, 0.0])]
    for k in range(ticks):
        one.command(Observation(DT * k, states[-1], seen(k)))
        assert one.plan is not None
        states.append(np.array(step(ROBOT, states[-1], one.plan.inputs[0], DT)))
    return np.array(states)


def clearance(states: Array) -> float:
    """The least distance between the bodies, m, also between the steps."""
    share = np.linspace(0.0, 1.0, 11)[:, None, None]
    between = states[:-1, :2] + share * np.diff(states[:, :2], axis=0)
    return float(np.linalg.norm(between - PLACE, axis=2).min() - RADIUS - ROBOT.radius)


BAD: list[dict[str, Any]] = [
    {"radius": -0.3},
    {"radius": np.nan},
    {"radius": np.inf},
    {"radius": 1e12},
    {"covariance": -np.eye(2)},
    {"covariance": np.full((2, 2), np.nan)},
    {"covariance": np.array([[1.0, 0.9], [0.0, 1.0]])},
    {"age": -0.05},
    {"position": [*PLACE, 1.0], "covariance": np.eye(3)},
    {"position": [*PLACE, np.nan], "covariance": None, "radius": np.nan},
    {"velocity": [np.nan, 0.0], "state_covariance": np.eye(4)},
]


@pytest.mark.parametrize("bad", BAD, ids=str)
def test_who_is_seen_badly_is_not_driven_through(bad: dict[str, Any]) -> None:
    one = made()
    states = driven(one, lambda k: (replace(GOOD, **bad),))
    assert clearance(states) > 0.0
    assert one.plan is not None and one.plan.ids == ("a",)
    assert "detection 'a' taken in part: " in one.plan.reason


@pytest.mark.parametrize(
    "bad",
    [{"position": [np.nan, 0.0]}, {"position": [1e200, 0.0]}, {"age": np.nan}, {"age": 1.7e9}],
)
def test_the_last_good_place_stands_in_until_it_is_forgotten(bad: dict[str, Any]) -> None:
    one = made()
    lost = replace(GOOD, **bad)
    states = driven(one, lambda k: (lost if k > 2 else GOOD,), 9)
    assert one.plan is not None and one.plan.ids == ("a",) and clearance(states) > 0.0
    assert "its last measurement stands in" in one.plan.reason
    # without one the robot stops, and stays
    states = driven(one, lambda k: (lost,), 30)
    assert clearance(states) > 0.0 and states[-1, 3] == pytest.approx(0.0, abs=1e-6)


def test_between_the_last_place_and_none_no_cycle_is_blind() -> None:
    """In every cycle the person is in the plan, or the robot brakes for one without a place."""
    one, lost = made(), replace(GOOD, position=[np.nan, np.nan])
    place, ids = replace(GOOD, position=[1.2, 0.0]), []
    for k in range(20):  # forgotten after 3 s
        state = np.array([0.0, 0.0, 0.0, 0.0, 0.0])
        one.command(Observation(DT * k, state, (place if k < 2 else lost,)))
        assert one.plan is not None
        assert one.plan.ids == ("a",) or one.plan.rung is Rung.BRAKE, k
        ids.append(one.plan.ids)
    assert ids[2] == ("a",) and ids[-1] == ()


def test_who_has_no_place_makes_the_robot_stop_for_as_long_as_they_are_seen() -> None:
    one, straight = made(), (replace(GOOD, position=[np.nan, np.nan]),)
    states = driven(one, lambda k: straight, 8)
    np.testing.assert_allclose(states[:5, 3], [1.0, 0.75, 0.5, 0.25, 0.0], atol=1e-9)
    assert np.abs(states[5:, 3:]).max() < 1e-9
    assert one.plan is not None and one.plan.rung is Rung.BRAKE
    assert "'a' seen without a place: the robot stops" in one.plan.reason
    one.command(Observation(2.0, states[-1], ()))
    assert one.plan.rung is Rung.OPTIMAL and one.plan.reason == ""


def test_who_is_seen_twice_under_one_name_is_two_obstacles() -> None:
    one = made()
    other = replace(GOOD, position=[4.0, 2.0])
    states = driven(one, lambda k: (GOOD, other) if k % 2 else (other, GOOD))
    assert clearance(states) > 0.0
    assert one.plan is not None and set(one.plan.ids) == {"#1", "#2"}

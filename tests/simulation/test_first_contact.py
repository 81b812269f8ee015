"""Each kind of first contact by a made-up episode, and a change of it that is another kind."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from wideberth.framework.risk.collision_probability import collision_probability
from wideberth.framework.robot import Robot
from wideberth.framework.values.arrays import Array
from wideberth.framework.values.forecast import Forecast
from wideberth.framework.values.plan import Plan, Rung, Situation, Status
from wideberth.framework.values.polygon import Polygon
from wideberth.metrics.gaps import BodyMotion
from wideberth.regions.mahalanobis_ellipse import MahalanobisEllipse
from wideberth.robots.holonomic_velocity import HolonomicVelocity
from wideberth.simulation.log.episode_log import AgentLog, CommandLog, Episode
from wideberth.simulation.measures.avoidable import _held, _Tried
from wideberth.simulation.measures.first_contact import (
    KINDS,
    LEADS,
    contact_columns,
    decision,
    first_contact,
    lead_column,
    plan_at,
)

TIMES = np.linspace(0.0, 6.0, 301)
STAMPS = np.arange(0.0, 6.0, 0.25)
ROBOT = HolonomicVelocity(0.3, 1.0)
Way = list[tuple[float, float, float]]
"""Time, s, and place, m, of the corners of a way."""


def body(name: str, way: Way, plans: tuple[Plan, ...] = ()) -> AgentLog:
    """Goes from corner to corner with 0.3 m of radius; the robot decides four times a second."""
    corners = np.array(way)
    places = np.stack([np.interp(TIMES, corners[:, 0], axis) for axis in corners[:, 1:].T], axis=1)
    speeds = np.linalg.norm(np.gradient(places, TIMES, axis=0), axis=1)
    still, stamps = 0.0 * TIMES, STAMPS if name == "robot" else np.zeros(0)
    none = np.zeros(len(stamps))
    commands = CommandLog(stamps, stamps, np.zeros((len(stamps), 2)), none, none)
    kind = "robot" if name == "robot" else "person"
    return AgentLog(
        name, kind, 0.3, places, still, speeds, still, (), 0.5, 0.25, np.nan, 0, commands, plans
    )


def episode(*bodies: AgentLog, polygons: tuple[Polygon, ...] = ()) -> Episode:
    return Episode(TIMES, bodies, "time limit", 0.25, 0, polygons=polygons)


def columns(
    *bodies: AgentLog, held: float | bool = np.nan, robot: Robot = ROBOT, **more: Any
) -> dict[str, Any]:
    """Return the columns, where another motion held the level at every lead or at none."""
    level = {lead_column("level_held", lead): held for lead in LEADS}
    return contact_columns(episode(*bodies, **more), {"robot": robot}, level)


def facts(found: dict[str, Any]) -> set[str]:
    """Names of what holds."""
    return {kind for kind in KINDS if found[f"contact_{kind}"] is True}


def turning(when: float, angle: float) -> AgentLog:
    """Comes down at 0.8 m/s, and after a turn to the right by so much reaches (2, 0) at 4 s."""
    way = np.array([0.0, -1.0]), np.array([-np.sin(angle), -np.cos(angle)])
    corner = np.array([2.0, 0.0]) - 0.8 * (4.0 - when) * way[1]
    ends = corner - 0.8 * when * way[0], corner + 0.8 * (6.0 - when) * way[1]
    return body("other", [(0.0, *ends[0]), (when, *corner), (6.0, *ends[1])])


EAST: Way = [(0.0, 0.0, 0.0), (6.0, 3.0, 0.0)]
"""The robot, at (2, 0) after 4 s."""


@pytest.mark.parametrize(
    "when, angle, kind",
    [
        (2.5, 90.0, "turned"), (3.0, 61.0, "turned"), (3.0, 59.0, "other"),
        (1.9, 90.0, "turned_earlier"), (1.0, 61.0, "turned_earlier"), (0.4, 90.0, "other"),
    ],
)  # fmt: skip
def test_the_other_turned_by_enough_and_of_late(when: float, angle: float, kind: str) -> None:
    found = columns(body("robot", EAST), turning(when, np.radians(angle)))
    assert facts(found) == {kind} - {"other"} and found["contact_kind"] == kind
    assert found["contact_with"] == "other" and 3.0 < found["contact_time"] < 4.0
    if kind == "turned":
        assert found["contact_turn"] == pytest.approx(np.radians(angle), abs=1e-6)
        before = found["contact_time"] - when
        assert found["contact_turn_before"] == pytest.approx(before, abs=0.101)
    else:
        assert np.isnan(found["contact_turn_before"])


def test_who_stops_and_goes_back_has_turned_and_who_only_stops_has_not() -> None:
    back = body("other", [(0.0, 6.0, 0.0), (3.0, 4.5, 0.0), (3.5, 4.5, 0.0), (6.0, 1.0, 0.0)])
    away = body("other", [(0.0, 1.0, 0.0), (3.0, 4.0, 0.0), (3.4, 4.0, 0.0), (6.0, 0.0, 0.0)])
    stays = body("other", [(0.0, 0.0, 2.0), (3.0, 2.0, 0.0), (6.0, 2.0, 0.0)])
    assert "turned" not in facts(columns(body("robot", EAST), back))
    assert "turned" in facts(columns(body("robot", EAST), away))
    assert "turned" not in facts(columns(body("robot", EAST), stays))


def test_who_comes_faster_than_the_robot_can_leave() -> None:
    def coming(speed: float) -> AgentLog:
        return body("other", [(0.0, 2.0 + 4.0 * speed, 0.0), (6.0, 2.0 - 2.0 * speed, 0.0)])

    assert facts(columns(body("robot", EAST), coming(1.05))) == {"faster"}
    assert facts(columns(body("robot", EAST), coming(0.95))) == set()
    faster = HolonomicVelocity(0.3, 1.2)
    assert facts(columns(body("robot", EAST), coming(1.05), robot=faster)) == set()
    hurries = body("other", [(0.0, 4.5, 0.0), (2.7, 2.3, 0.0), (3.3, 1.5, 0.0), (6.0, 0.0, 0.0)])
    brakes = body("other", [(0.0, 6.0, 0.0), (2.4, 2.4, 0.0), (6.0, 1.0, 0.0)])
    last = [columns(body("robot", EAST), other) for other in (hurries, brakes)]
    assert [facts(found) for found in last] == [{"faster"}, set()]
    assert last[0]["contact_time"] == pytest.approx(2.89, abs=0.021)
    across = body("other", [(0.0, 2.4, -6.0), (6.0, 2.4, 3.0)])  # the robot drives into its side
    assert facts(columns(body("robot", EAST), across)) == set()


@pytest.mark.parametrize(
    "east, north, between",
    [(-1.15, 0.0, True), (-1.25, 0.0, False), (-0.1, 1.15, True), (0.1, 1.15, False)],
)
def test_the_robot_is_between_two(east: float, north: float, between: bool) -> None:
    """It is 0.6 m wide; the other comes from the east, where it has all but come to a halt."""
    robot = body("robot", [(0.0, 1.9, 0.0), (3.0, 2.0, 0.0), (6.0, 2.2, 0.0)])
    ahead = body("other", [(0.0, 5.0, 0.0), (6.0, 0.2, 0.0)])
    place = np.interp(columns(robot, ahead)["contact_time"], [3.0, 6.0], [2.0, 2.2])
    x = place + east
    third = body("third", [(0.0, x, north), (6.0, x, north)])
    assert facts(columns(robot, ahead, third)) == ({"between"} if between else set())


def test_who_stands_is_walked_into() -> None:
    coming = body("other", [(0.0, 5.0, 0.0), (6.0, 0.2, 0.0)])
    stands = columns(body("robot", [(0.0, 1.0, 0.0), (1.0, 2.0, 0.0), (6.0, 2.0, 0.0)]), coming)
    assert facts(stands) == {"stood"} and stands["contact_kind"] == "stood"
    time = stands["contact_time"]
    late = body("robot", [(0.0, 1.0, 0.0), (time - 0.3, 2.0, 0.0), (6.0, 2.0, 0.0)])
    assert facts(columns(late, coming)) == set()


def plan(stamp: float, places: Array, **more: Any) -> Plan:
    """A plan of steps of 0.25 s that holds 90 % of the other."""
    steps = len(places) - 1
    level = np.full((steps, 1), 2.0)
    return replace(
        Plan(
            stamp, 0.25, places, np.zeros((steps, 2)), places, places[1:],
            np.zeros((steps, 1, 0)), level, level, np.full((steps, 1), 0.9), ("other",),
            Status.SOLVED, Rung.OPTIMAL,
        ),
        **more,
    )  # fmt: skip


def planning(along: bool = True, **more: Any) -> tuple[AgentLog, AgentLog]:
    """Meet head-on at x = 2 m and 3.25 s or so; each plan is along the way, or stays behind."""
    ahead = 0.25 * np.arange(11)
    found = []
    for stamp in STAMPS:
        places = 0.5 * (stamp + ahead if along else np.full(11, min(stamp, 1.0)))
        aside = 0.0 * ahead if along else np.minimum(0.4 * ahead, 0.8)
        found.append(plan(stamp, np.stack([places, aside], axis=1), **more))
    way: Way = [(0.0, 4.5, 0.0), (6.0, -0.3, 0.0)]
    return body("robot", EAST, tuple(found)), body("other", way)


def test_a_level_is_given_up_though_another_motion_holds_it() -> None:
    """The plan goes by its violation here: 0.01, where 0.0001 counts as kept."""
    entering = planning(violation=0.01)
    assert facts(columns(*entering, held=True)) == {"gave_up_level"}
    assert facts(columns(*entering, held=False)) == set()
    assert facts(columns(*planning(), held=True)) == set()
    robot, other = planning()
    once = [replace(one, violation=0.01) if one.stamp == 1.5 else one for one in robot.plans]
    found = columns(replace(robot, plans=tuple(once)), other, held=True)
    assert facts(found) == {"gave_up_level"}
    assert [found[lead_column("plan_gave_way", lead)] for lead in LEADS] == [
        False, True, False, False, False
    ]  # fmt: skip
    unknown = columns(*entering)
    assert facts(unknown) == set() and np.isnan(unknown["contact_gave_up_level"])


def test_the_plan_was_right_and_not_driven() -> None:
    found = columns(*planning(along=False))
    assert facts(found) == {"not_driven"} and found["plan_clear_1s"] is True
    assert columns(*planning())["contact_not_driven"] is False
    along, other = planning()
    once = planning(along=False)[0].plans[6:7]  # at 1.5 s, of a contact at 3 s
    mixed = replace(along, plans=(*along.plans[:6], *once, *along.plans[7:]))
    assert facts(columns(mixed, other)) == {"not_driven"}
    without = columns(body("robot", EAST), planning()[1])
    assert np.isnan(without["contact_not_driven"]) and without["contact_kind"] == "other"


def test_the_first_kind_that_holds_counts_and_the_others_stay_known() -> None:
    robot, other = planning(along=False, violation=0.01)
    both = columns(robot, other, held=True)
    assert facts(both) == {"gave_up_level", "not_driven"}
    assert both["contact_kind"] == "gave_up_level"
    assert list(KINDS) == [
        "turned", "faster", "between", "stood", "gave_up_level", "not_driven", "turned_earlier",
    ]  # fmt: skip


def test_nothing_is_known_where_nothing_touches() -> None:
    found = columns(body("robot", EAST), body("other", [(0.0, 0.0, 5.0), (6.0, 0.0, 5.0)]))
    assert {value for value in found.values() if isinstance(value, str)} == {""}
    numbers = [value for value in found.values() if not isinstance(value, str)]
    assert len(numbers) > 30 and np.isnan(numbers).all()
    wall = Polygon(((3.0, -9.0), (4.0, -9.0), (4.0, 9.0), (3.0, 9.0)), "wall")
    touched = columns(body("robot", EAST), polygons=(wall,))
    assert set(touched) == set(found)
    assert touched["contact_with"] == "wall" and touched["contact_kind"] == "other"


def test_two_that_touch_are_named_robot_first() -> None:
    far, near = turning(2.5, 1.0), body("near", [(0.0, 1.0, 0.0), (6.0, 1.0, 0.0)])
    found = first_contact(episode(far, near, body("robot", EAST)))
    assert found is not None and (found.robot, found.other) == ("robot", "near")
    assert found.robots == ("robot",) and found.time == pytest.approx(0.8, abs=0.021)


def test_what_a_forecast_expected() -> None:
    """It errs by 0.5 m to the north, of a deviation of 0.25 m, between two of its steps."""
    robot, other = planning()
    time = columns(robot, other)["contact_time"]
    stamp = STAMPS[(STAMPS >= time - 1.0) & (STAMPS < time)][0]
    steps = stamp + 0.25 * np.arange(1, 11)
    truth = np.stack([4.5 - 0.8 * steps, 0.0 * steps], axis=1)
    covariance = np.broadcast_to(np.diag([0.2, 0.25]) ** 2, (1, 10, 2, 2))
    forecast = Forecast.single((truth + np.array([0.0, 0.5]))[None], covariance, 0.25)
    plans = tuple(replace(one, forecast=forecast, tracked=("other",)) for one in robot.plans)
    found = columns(replace(robot, plans=plans), other)
    assert found["forecast_error_1s"] == pytest.approx(0.5)
    assert found["forecast_deviations_1s"] == pytest.approx(2.0)
    offset = np.array([4.5 - 0.8 * time - 0.5 * time, 0.5])
    risk = collision_probability(offset[None], covariance[0, :1], np.array([0.6]))[0]
    assert 0.1 < risk < 0.9 and found["forecast_risk_1s"] == pytest.approx(risk, rel=1e-4)
    assert found["plan_rung_1s"] == "optimal" and found["plan_gave_way_1s"] is False
    short = tuple(replace(one, forecast=forecast.cut(2)[0]) for one in plans)
    assert np.isnan(columns(replace(robot, plans=short), other)["forecast_error_1s"])


def test_what_a_forecast_of_two_modes_expected() -> None:
    """Modes 1 m to either side of the truth, 1 to 3: 0.5 m off, of a variance of 0.25 + 0.75."""
    robot, other = planning()
    time = columns(robot, other)["contact_time"]
    there = np.array([4.5 - 0.8 * time, 0.0])
    mean = np.broadcast_to(there + np.array([[0.0, 1.0], [0.0, -1.0]])[:, None], (2, 10, 2))
    covariance = np.broadcast_to(0.25 * np.eye(2), (1, 2, 10, 2, 2))
    weight = np.array([[0.25, 0.75]])
    forecast = Forecast(mean[None], covariance, weight, 0.25, (None,))
    plans = tuple(replace(one, forecast=forecast, tracked=("other",)) for one in robot.plans)
    found = columns(replace(robot, plans=plans), other)
    assert found["forecast_error_1s"] == pytest.approx(0.5)
    assert found["forecast_deviations_1s"] == pytest.approx(0.5)
    robot_place = np.array([0.5 * time, 0.0])
    each = collision_probability(
        mean[:, 0] - robot_place, covariance[0, :, 0], np.array([0.6, 0.6])
    )
    assert found["forecast_risk_1s"] == pytest.approx(weight[0] @ each, rel=1e-4)


def test_the_plan_of_a_lead_is_that_of_its_first_decision() -> None:
    log = planning()[0]
    assert decision(log, 3.0, 1.5) == 1.5 and decision(log, 3.1, 0.5) == 2.75
    assert decision(log, 3.0, 0.2) is None
    for lead in LEADS:
        found = plan_at(log, 3.1, lead)
        assert found is not None and found.stamp == decision(log, 3.1, lead)
    assert plan_at(log, 3.0, 0.2) is None
    assert plan_at(replace(log, plans=log.plans[:2]), 3.0, 1.0) is None


def test_leads_make_names_of_columns() -> None:
    assert lead_column("avoidable", 2.0) == "avoidable_2s"
    assert lead_column("avoidable", 0.75, "_reacting") == "avoidable_0_75s_reacting"


@pytest.mark.parametrize("north, held", [(0.0, False), (1.11, True), (1.09, False)])
def test_a_motion_holds_the_level_aimed_at(north: float, held: bool) -> None:
    """One goes east, one stays; the other is forecast at (1, north) and at the start.

    0.6 m of bodies and two deviations of 0.25 m are kept clear; the level that was held, 0,
    would let both pass.
    """
    clock = np.linspace(2.0, 4.0, 101)
    east = np.stack([clock - 2.0, 0.0 * clock], axis=1)
    stays = np.zeros((101, 2))
    mean = np.full((2, 10, 2), (1.0, north))
    mean[1] = (0.0, -north)
    forecast = Forecast.single(mean, np.broadcast_to(0.25**2 * np.eye(2), (2, 10, 2, 2)), 0.25)
    level = np.full((10, 2), 2.0)
    made = plan(
        2.0, np.zeros((11, 2)), forecast=forecast, tracked=("other", "third"),
        ids=("third", "other"), level=0.0 * level, target=level,
        situation=Situation(MahalanobisEllipse(), 0.3, np.array([0.3, 0.3]), 0.3),
    )  # fmt: skip
    tried = [
        _Tried(None, BodyMotion(0.3, way, 0.0 * clock), 0.0)  # type: ignore[arg-type]
        for way in (east, stays)
    ]
    record = replace(episode(), times=np.concatenate([[0.0], clock]))
    assert _held(made, tried, record, 1) is held
    assert _held(replace(made, situation=None), tried, record, 1) is None

"""Summary and rows of an episode that was written by hand, against numbers found by hand."""

from dataclasses import replace
from math import inf, isnan, nan

import numpy as np
import pytest

from wideberth.framework.values.arrays import Array
from wideberth.framework.values.forecast import Forecast
from wideberth.framework.values.path import Path
from wideberth.framework.values.plan import GivenWay, Plan, Rung, Status
from wideberth.framework.values.polygon import Polygon
from wideberth.simulation.log.episode_log import AgentLog, CommandLog, Episode
from wideberth.simulation.measures.summary import (
    clearances,
    forecast_coverage,
    passing,
    robot_rows,
    summarise,
)

TIMES = np.linspace(0.0, 8.0, 33)
NOBODY = np.zeros((2, 0))
COMMANDS = CommandLog(
    np.array([0.0, 0.5, 1.0]), np.array([0.2, 1.0, 1.7]), np.zeros((3, 2)), np.zeros(3), np.ones(3)
)
POST = Polygon(((5.0, -0.5), (6.0, -0.5), (6.0, 0.5), (5.0, 0.5)), "post")


def at(*knots: tuple[float, float, float]) -> Array:
    """Positions of one who goes straight from knot to knot, each (time, x, y)."""
    time, *places = np.array(knots).T
    return np.stack([np.interp(TIMES, time, place) for place in places], axis=-1)


def robot(name: str, places: Array, path: Array, reached: float, *plans: Plan) -> AgentLog:
    nothing = np.zeros(len(TIMES))
    return AgentLog(
        name, "robot", 0.1, places, nothing, nothing, nothing, ((0.0, Path(path)),), 1.0, 0.5,
        reached, 2, COMMANDS, plans,
    )  # fmt: skip


def plan(rung: Rung, content: float, fallback: str | None = None) -> Plan:
    """Of two steps that aim at the level 2 before one obstacle that stays where it is."""
    held = np.full((2, 1), content)
    spread = np.tile(0.01 * np.eye(2), (1, 2, 1, 1))
    forecast = Forecast.single(np.tile([9.0, 9.0], (1, 2, 1)), spread, 0.5, (fallback,))
    return Plan(
        1.0, 0.5, np.zeros((3, 2)), np.zeros((2, 2)), np.zeros((3, 2)), np.zeros((2, 2)),
        np.zeros((2, 1, 0)), np.full((2, 1), 2.0), np.full((2, 1), 2.0), held, ("walker",),
        Status.SOLVED, rung, iterations=4, forecast=forecast, tracked=("walker",),
    )  # fmt: skip


def episode(reached: float = nan) -> Episode:
    """Go over a crossing: "east" behind "north", which swerves by 0.3 m after it.

    East arrives after 5 s instead of 4 and then goes home; the walker leaves the place where it
    is forecast, standing, between both steps.
    """
    best, late = plan(Rung.OPTIMAL, 0.95), plan(Rung.SHIFTED, 0.9, "no history")
    yielding = [GivenWay(0.05, held, "content", 1, "walker") for held in (0.2, 0.4)]
    late = replace(late, violation=0.3, given_way=yielding[0], level=np.full((2, 1), 1.5))
    stopped = replace(plan(Rung.BRAKE, 0.0), reason="out of order", violation=nan, iterations=0)
    stopped = replace(stopped, level=NOBODY, target=NOBODY, content=NOBODY, forecast=None)
    east = robot(
        "east", at((0, 0, 0), (5, 4, 0), (6, 4, 3)), np.array([[0.0, 0.0], [4.0, 0.0]]), 5.0,
        best, late, stopped,
    )  # fmt: skip
    places = at((0, 2, -2), (2, 2, 0), (2.5, 2.3, 0.4), (3, 2, 0.8), (4.25, 2, 2))
    mild = replace(best, violation=0.01, given_way=yielding[1], content=np.full((2, 1), 0.6))
    north = robot("north", places, np.array([[2.0, -2.0], [2.0, 2.0]]), reached, mild)
    walker = replace(
        robot("walker", at((0, 9, 9), (1.5, 9, 9), (1.75, 99, 9)), np.eye(2), nan),
        kind="person", plans=(), paths=(),
    )  # fmt: skip
    return Episode(TIMES, (east, north, walker), "time limit", 0.25, 0, polygons=(POST,))


def test_the_row_of_a_robot_that_arrived() -> None:
    """What it does after its arrival does not count, but where it comes close does."""
    east, north = robot_rows(episode())
    wanted = {
        "robot": "east", "time": 5.0, "time_ratio": 1.25, "extra_time": 1.0, "length": 4.0,
        "length_ratio": 1.0, "deviation": 0.0, "plans": 3, "fallbacks": 2, "rung_optimal": 1,
        "rung_shifted": 1, "rung_brake": 1, "rung_least": 0, "violation": 0.3,
        "iterations": 8.0 / 3.0, "named_forecasts": 0.5, "deadline_misses": 1,
        "skipped_ticks": 2, "below_reference": 0.5, "least_content": 0.9,
    }  # fmt: skip
    assert {key: east[key] for key in wanted} == pytest.approx(wanted)
    assert "holds 80 %" in east["gave_way"] and "holds 60 %" in north["gave_way"]
    assert isnan(north["time"]) and north["time_ratio"] == north["extra_time"] == inf
    assert north["length_ratio"] == pytest.approx(4.2 / 4.0)
    assert north["deviation"] == pytest.approx(0.3)
    assert north["fallbacks"] == 0 and north["violation"] == 0.01


def test_the_summary_holds_sums_and_the_worst() -> None:
    found = summarise(episode())
    wanted = {
        "ended": "time limit", "duration": 8.0, "success": False, "collision": False,
        "deadlock": True, "time_ratio_worst": inf, "length_ratio_worst": 1.05,
        "below_reference": 2.0 / 3.0, "least_content": 0.6, "plans": 4, "fallbacks": 2,
        "deadline_misses": 2, "violation_worst": 0.3, "named_forecasts": 2.0 / 3.0,
        "coverage": 0.5, "coverage_first": 1.0, "coverage_last": 0.0, "first": "north",
        "yields": "east", "errors": "1 plans: out of order",
    }  # fmt: skip
    assert {key: found[key] for key in wanted} == pytest.approx(wanted)
    assert "holds 60 %" in found["gave_way"]
    arrived = summarise(replace(episode(8.0), ended="goals"))
    assert arrived["success"] and not arrived["deadlock"]
    assert arrived["time_ratio_worst"] == pytest.approx(2.0)
    assert arrived["extra_time_worst"] == pytest.approx(4.0)
    hasty = replace(episode(8.0).robots[1], speed=nan)
    east, _, walker = episode().agents
    unknown = replace(episode(), agents=(east, hasty, walker))
    assert isnan(summarise(unknown)["time_ratio_worst"])


def test_clearance_is_the_least_of_all_time() -> None:
    """Of two robots that both move, and of one that comes as near a post as 0.9 m."""
    played = episode()
    found = clearances(played)
    assert set(found) == {
        ("east", "north"), ("east", "walker"), ("north", "walker"), ("east", "post"),
        ("north", "post"),
    }  # fmt: skip
    dense = np.linspace(0.0, 8.0, 80_001)
    places = [
        [np.interp(dense, TIMES, log.positions[:, i]) for i in (0, 1)] for log in played.robots
    ]
    apart = np.hypot(*(np.array(places[0]) - np.array(places[1]))).min() - 0.2
    assert found["east", "north"] == pytest.approx(apart, abs=1e-6)
    assert found["east", "post"] == pytest.approx(0.9)
    assert robot_rows(played)[0]["clearance"] == summarise(played)["clearance"]
    assert summarise(played)["clearance"] == found["east", "north"] > 0.0
    wide = tuple(replace(log, radius=0.3) for log in played.agents)
    hit = summarise(replace(played, agents=wide, polygons=(), ended="goals"))
    assert hit["collision"] and not hit["success"]
    one = replace(played.agents[0], plans=())
    alone = summarise(replace(played, agents=(one,), polygons=()))
    assert alone["clearance"] == inf and not alone["collision"]


def test_head_on_who_goes_further_aside_yields() -> None:
    """By 5 cm at least; alone, or with a third robot, nobody does."""
    way, back = np.array([[0.0, 0.0], [4.0, 0.0]]), np.array([[4.0, 0.0], [0.0, 0.0]])
    for aside, yields in ((0.3, "two"), (0.14, ""), (0.02, "one")):
        one = robot("one", at((0, 0, 0), (4, 2, -0.1), (8, 4, 0)), way, 8.0)
        two = robot("two", at((0, 4, 0), (4, 2, aside), (8, 0, 0)), back, 8.0)
        met = Episode(TIMES, (one, two), "goals", 0.25, 0)
        assert passing(met) == {"first": "", "yields": yields}
        for some in ((one,), (one, two, replace(two, name="three"))):
            assert passing(replace(met, agents=some)) == {"first": "", "yields": ""}
    east, north, _ = episode().agents
    swapped = Episode(TIMES, (north, east), "goals", 0.25, 0)
    assert passing(swapped) == {"first": "north", "yields": "east"}
    away = replace(north, positions=north.positions[:1].repeat(len(TIMES), axis=0))
    assert passing(replace(swapped, agents=(away, east))) == {"first": "east", "yields": "north"}


def forecasting(offsets: list[float], weight: list[float], covariance: float = 0.01) -> Episode:
    """A robot that once forecast the walker, who stays; each mode and step off by so much."""
    places = np.array([9.0, 9.0]) + np.stack([offsets, np.zeros(len(offsets))], axis=-1)
    modes = np.stack([places, places + 50.0])[None]
    spread = np.tile(covariance * np.eye(2), (1, 2, len(offsets), 1, 1))
    own = replace(
        plan(Rung.SHIFTED, 0.95),
        forecast=Forecast(modes, spread, np.array([weight]), 0.5, (None,)),
    )
    alone, *_ = episode().agents
    stays = at((0, 9, 9), (8, 9, 9))
    walker = replace(alone, name="walker", kind="person", plans=(), paths=(), positions=stays)
    return Episode(TIMES, (replace(alone, plans=(own,)), walker), "time limit", 0.25, 0)


def test_coverage_is_of_the_heaviest_mode_at_each_step() -> None:
    """A content of 95 % unless another is asked for; each offset is of a tail known exactly."""
    offsets = [float(0.1 * np.sqrt(-2.0 * np.log(tail))) for tail in (0.2, 0.04, 0.07, 0.01)]
    held = forecasting(offsets, [0.7, 0.3])
    found = summarise(held)
    assert found["coverage"] == pytest.approx(0.5) and found["coverage_first"] == 1.0
    assert found["coverage_last"] == 0.0
    assert summarise(forecasting(offsets[:3], [0.7, 0.3]))["coverage_last"] == 1.0
    assert summarise(held, 0.1)["coverage"] == pytest.approx(0.25)
    assert summarise(forecasting(offsets, [0.3, 0.7]))["coverage"] == 0.0
    share, number, overall = forecast_coverage(held, 0.05)
    assert share.tolist() == [1.0, 0.0, 1.0, 0.0] and number.tolist() == [1.0] * 4
    assert overall == pytest.approx(0.5)
    (one, walker) = held.agents
    late = replace(one, plans=(replace(one.plans[0], stamp=7.0),))  # two steps are known
    assert summarise(replace(held, agents=(late, walker)))["coverage"] == pytest.approx(0.5)
    over = replace(one, plans=(replace(one.plans[0], stamp=8.0),))
    assert isnan(summarise(replace(held, agents=(over, walker)))["coverage"])
    none = replace(held, agents=(replace(one, plans=()), walker))
    share, number, overall = forecast_coverage(none, 0.05)
    assert share.size == number.size == 0 and isnan(overall)
    row = summarise(none)
    assert isnan(row["coverage_first"]) and isnan(row["coverage_last"])
    assert row["violation_worst"] == 0.0 and row["fallbacks"] == 0
    assert summarise(held)["fallbacks"] == 1


def test_who_was_never_there_is_never_near() -> None:
    held = forecasting([0.0], [1.0, 0.0])
    one, walker = held.agents
    gone = np.full_like(walker.positions, np.nan)
    assert clearances(replace(held, agents=(one, replace(walker, positions=gone)))) == {
        ("east", "walker"): inf
    }
    gone[4:9] = walker.positions[4:9]
    partly = clearances(replace(held, agents=(one, replace(walker, positions=gone))))
    assert 5.0 < partly["east", "walker"] < 20.0


def test_a_robot_that_never_arrives_is_later_than_one_of_unknown_speed() -> None:
    east, north, walker = episode(8.0).agents
    unknown, never = replace(east, speed=nan), replace(north, reached=nan)
    for both in ((unknown, never), (never, unknown)):
        found = summarise(replace(episode(), agents=(*both, walker)))
        assert found["time_ratio_worst"] == found["extra_time_worst"] == inf


def test_the_commonest_of_several_reasons_is_named() -> None:
    east, *others = episode().agents
    stops = [replace(east.plans[2], reason=words) for words in ("a", "b", "b", "c")]
    found = summarise(replace(episode(), agents=(replace(east, plans=tuple(stops)), *others)))
    assert found["errors"] == "4 plans: b"


def test_nobody_passes_a_crossing_that_nobody_reaches() -> None:
    """Nor one that both pass at once; in space, where paths miss, the wider one yields."""
    east, north, _ = episode().agents
    stood = [
        replace(one, positions=one.positions[:1].repeat(len(TIMES), axis=0))
        for one in (east, north)
    ]
    met = Episode(TIMES, tuple(stood), "time limit", 0.25, 0)
    assert passing(met) == {"first": "", "yields": ""}
    along = [
        robot("one", at((0, -2, 0), (8, 2, 0)), np.array([[-2.0, 0.0], [2.0, 0.0]]), 8.0),
        robot("two", at((0, 0, -2), (8, 0, 2)), np.array([[0.0, -2.0], [0.0, 2.0]]), 8.0),
    ]
    at_once = replace(met, agents=tuple(along))
    assert passing(at_once) == {"first": "", "yields": ""}
    wide = ((0, 0), (0, 1))
    aloft = [
        replace(
            one, positions=np.pad(one.positions, wide) + np.array([0.0, 0.0, height]),
            paths=((0.0, Path(np.pad(one.paths[0][1].points, wide))),),
        )
        for one, height in zip(along, (0.0, 0.2), strict=True)
    ]  # fmt: skip
    assert passing(replace(met, agents=tuple(aloft))) == {"first": "", "yields": "two"}

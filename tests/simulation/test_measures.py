"""The columns of an episode written by hand: of whom, until when, and of which plan."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from wideberth.experiments.studies.episode_statistics import infeasible
from wideberth.framework.risk.collision_probability import collision_probability
from wideberth.framework.values.arrays import Array
from wideberth.framework.values.forecast import Forecast
from wideberth.framework.values.path import Path
from wideberth.framework.values.plan import GivenWay, Plan, Rung, Situation, Status
from wideberth.metrics import comfort
from wideberth.regions.mahalanobis_ellipse import MahalanobisEllipse
from wideberth.simulation.log.episode_log import AgentLog, CommandLog, Episode
from wideberth.simulation.measures.episode_measures import Sampled, measures
from wideberth.simulation.measures.plan_calibration import (
    Judged,
    between_steps,
    promises,
    successors,
)

TIMES = np.linspace(0.0, 4.0, 41)
EMPTY = CommandLog(np.zeros(0), np.zeros(0), np.zeros((0, 2)), np.zeros(0), np.zeros(0))
CERTAIN = np.zeros((2, 2))


def agent(name: str, places: Array, kind: str = "robot", reached: float = np.nan) -> AgentLog:
    """Drives where it is told with 0.5 m of radius, looking east."""
    unknown = np.full(len(TIMES), np.nan)
    return AgentLog(
        name, kind, 0.5, places, np.zeros(len(TIMES)), unknown, np.zeros(len(TIMES)),
        ((0.0, Path(np.array([[0.0, 0.0], [4.0, 0.0]]))),), 1.0, 0.5, reached, 0, EMPTY, (),
    )  # fmt: skip


def east(speed: float = 1.0, north: float = 0.0) -> Array:
    return np.stack([speed * TIMES, np.full(len(TIMES), north)], axis=1)


def plan(stamp: float, positions: Array, mean: Array, covariance: Array, content: float) -> Plan:
    """A plan of N steps of 1 s round one obstacle named other."""
    steps = len(positions) - 1
    wide = np.broadcast_to(covariance, (1, steps, 2, 2))
    level = np.full((steps, 1), 2.0)
    return Plan(
        stamp, 1.0, positions, np.zeros((steps, 2)), positions, positions[1:],
        np.zeros((steps, 1, 0)), level, level, np.full((steps, 1), content), ("other",),
        Status.SOLVED, Rung.OPTIMAL, forecast=Forecast.single(mean[None], wide, 1.0),
        tracked=("other",),
    )  # fmt: skip


@pytest.fixture
def episode() -> Episode:
    """A robot drives east; somebody stands 1.5 m north of the middle of its way."""
    person = agent("other", np.broadcast_to([2.0, 1.5], (41, 2)).copy(), "person")
    return Episode(TIMES, (agent("robot", east()), person), "time limit", 0.25, 0)


def test_one_robot_and_one_who_stands(episode: Episode) -> None:
    row = measures(episode, 0.05, 60.0)
    assert row["outcome"] == "timeout" and row["penalised_time"] == 60.0
    away = np.hypot(np.linspace(-2.0, 2.0, 41), 1.5) - 1.0
    assert row["distance_min"] == pytest.approx(0.5)
    assert row["distance_mean"] == pytest.approx(away.mean())
    assert row["zone_personal"] == pytest.approx(np.mean((away >= 0.45) & (away < 1.2)))
    assert row["zone_intimate"] == row["intrusion_share"] == row["zone_public"] == 0.0
    assert row["time_to_collision_min"] == np.inf
    standing = np.exp(-0.5 * ((away[:-1] + 1.0) / 0.5) ** 2)  # round, of 0.5 m
    assert row["personal_space"] == pytest.approx(standing.mean())
    assert row["speed_mean"] == pytest.approx(1.0)
    assert row["speed_deviation"] == pytest.approx(0.0, abs=1e-9)
    assert row["cross_track_max"] == row["heading_change"] == row["not_moving"] == 0.0


def test_a_robot_counts_until_it_is_there(episode: Episode) -> None:
    early = replace(episode.robots[0], reached=1.0)
    row = measures(replace(episode, agents=(early, episode.agents[1])), 0.05, 60.0)
    assert row["distance_min"] == pytest.approx(np.hypot(1.0, 1.5) - 1.0)
    assert len(Sampled.of(episode, early).positions) == 11


def test_several_robots_are_joined() -> None:
    slow, fast = agent("slow", east(0.5, 2.0)), agent("fast", east(1.0))
    both = Episode(TIMES, (slow, fast), "goals", 0.25, 0)
    row = measures(both, 0.05, 60.0)
    assert row["speed_mean"] == pytest.approx(0.75)  # the mean of both
    assert row["cross_track_max"] == pytest.approx(2.0)  # the worst
    assert row["distance_min"] == pytest.approx(1.0)
    behind = agent("slow", np.stack([TIMES - 2.0, 0 * TIMES], axis=1) * 2.0)
    hit = measures(replace(both, agents=(behind, fast)), 0.05, 60.0)
    assert hit["outcome"] == "collision" and hit["contacts_by_robot"] == 1
    assert hit["contacts_by_other"] == 1  # seen from the other robot
    assert np.isnan(hit["success_time"])


def test_walls_count_in_the_outcome_alone(episode: Episode) -> None:
    from wideberth.framework.values.polygon import Polygon

    wall = Polygon(((1.0, -1.0), (2.0, -1.0), (2.0, -0.3), (1.0, -0.3)))
    row = measures(replace(episode, polygons=(replace(wall, name="wall"),)), 0.05, 60.0)
    assert row["outcome"] == "collision" and row["distance_min"] == pytest.approx(0.5)


def test_promises_of_a_plan_that_is_kept(episode: Episode) -> None:
    """Two plans along the way that is driven, with a forecast that is right about the place."""
    there, wide = np.array([2.0, 1.5]), 0.3 * np.eye(2)
    plans = tuple(
        plan(
            stamp, np.array([[stamp + i, 0.0] for i in range(3)]), np.array([there] * 2), wide, 0.9
        )
        for stamp in (0.0, 1.0)
    )
    log = replace(episode.robots[0], plans=plans)
    row = promises(replace(episode, agents=(log, episode.agents[1])), log, 0.05)
    risk = collision_probability(
        there - np.array([[1.0, 0.0], [2.0, 0.0], [2.0, 0.0], [3.0, 0.0]]), wide, 1.0
    )
    assert row["plan_change"] == pytest.approx(0.0)
    assert row["step_risk"] == pytest.approx(risk.mean(), rel=1e-4)
    assert row["plan_risk_mean"] == pytest.approx(risk.max(), rel=1e-4) == row["plan_risk_max"]
    # The first steps are to x = 1 and x = 2.
    assert row["episode_risk"] == pytest.approx(1.0 - (1.0 - risk[0]) * (1.0 - risk[1]), rel=1e-4)
    assert row["step_touched"] == row["episode_touched"] == row["tail_observed"] == 0.0
    assert row["tail_nominal"] == pytest.approx(0.1)
    assert row["region_area"] == pytest.approx(np.pi * 0.3 * -2.0 * np.log(0.05))


def test_promises_that_were_wrong(episode: Episode) -> None:
    """The forecast is certain of a place where nobody is; the plan goes through who stands."""
    through = np.array([[0.0, 0.0], [2.0, 1.0], [2.0, 1.5]])
    wrong = plan(3.5, through, np.array([[9.0, 9.0]] * 2), CERTAIN, 0.95)
    log = replace(episode.robots[0], plans=(replace(wrong, stamp=0.0), wrong))
    row = promises(replace(episode, agents=(log, episode.agents[1])), log, 0.05)
    # Of the second plan no step is known: the episode ends before.
    assert row["step_touched"] == row["episode_touched"] == row["tail_observed"] == 1.0
    assert row["step_risk"] == row["episode_risk"] == row["region_area"] == 0.0
    assert np.isnan(row["plan_change"])


def test_feasible_problems_followed_by_infeasible_ones_are_counted(episode: Episode) -> None:
    """Of eight plans two break a constraint, one was held against nothing, one gives way."""
    good = plan(0.0, np.zeros((3, 2)), np.zeros((2, 2)), CERTAIN, 0.95)
    late = replace(good, rung=Rung.SHIFTED)  # a plan all the same
    bad, unknown = replace(good, violation=0.2), replace(good, violation=np.nan)
    low = replace(good, given_way=GivenWay(0.05, 0.3, "content", 2, "other"))
    plans = (good, bad, late, good, unknown, bad, low, good)
    found = {
        "feasible_successors": 4, "infeasible_successors": 2,
        "aimed_successors": 3, "lowered_successors": 2,
    }  # fmt: skip
    assert successors(plans) == found
    log = replace(episode.robots[0], plans=plans)
    twice = replace(log, name="another")
    row = measures(replace(episode, agents=(log, twice, episode.agents[1])), 0.05, 60.0)
    assert {name: row[name] for name in found} == {name: 2 * n for name, n in found.items()}
    per = infeasible([row, {**row, "feasible_successors": 12, "aimed_successors": 14}])
    assert per == {
        "infeasible_successors_per_10000": pytest.approx(1e4 * 8 / 20),
        "lowered_successors_per_10000": pytest.approx(1e4 * 8 / 20),
    }
    assert np.isnan(list(infeasible([{name: 0 for name in found}]).values())).all()


def test_entries_between_steps_are_those_of_plans_that_keep_their_regions(
    episode: Episode,
) -> None:
    """Of a disc of radius 1 m around one who stands, a chord of 1.2 m loses 0.2 m."""
    path = episode.robots[0].paths[0][1]
    around = Situation(MahalanobisEllipse(), 0.5, np.array([0.5]), 0.5, path=path)
    stands = np.zeros((3, 2))
    chord = np.array([[-1.8, 0.8], [-0.6, 0.8], [0.6, 0.8], [1.8, 0.8]])
    passes = replace(plan(0.0, chord, stands, CERTAIN, 0.95), situation=around)
    clear = replace(
        plan(0.0, chord + np.array([0.0, 0.3]), stands, CERTAIN, 0.95), situation=around
    )
    broken, unknown = replace(passes, violation=0.2), replace(passes, situation=None)
    found = between_steps((passes, clear, clear, broken, unknown))
    assert found == {
        "between_share": pytest.approx(1.0 / 3.0),
        "between_depth": pytest.approx(0.2),
    }
    assert np.isnan(list(between_steps((broken, unknown)).values())).all()


def test_without_plans_nothing_is_promised(episode: Episode) -> None:
    row = promises(episode, episode.robots[0], 0.05)
    assert all(np.isnan(value) for value in row.values())


def drives(times: Array, *knots: tuple[float, float, float]) -> Array:
    """Positions of one who goes straight from knot to knot, each (time, x, y)."""
    time, *places = np.array(knots).T
    return np.stack([np.interp(times, time, place) for place in places], axis=-1)


def of_two(times: Array, robot: Array, other: Array, reached: float = np.nan) -> Episode:
    """A robot and somebody else over any instants."""
    one, two = (
        replace(
            agent(name, places, kind, reached if kind == "robot" else np.nan),
            headings=np.zeros(len(times)), yaw_rates=np.zeros(len(times)),
        )
        for name, places, kind in (("robot", robot, "robot"), ("other", other, "person"))
    )  # fmt: skip
    return Episode(times, (one, two), "time limit", 0.25, 0)


def of_robot(played: Episode, **changes: Any) -> Episode:
    """Say otherwise what the log of the robot holds."""
    return replace(played, agents=(replace(played.robots[0], **changes), *played.agents[1:]))


def test_a_robot_that_meets_somebody_head_on() -> None:
    """Both at 1 m/s on one line, 10 m apart, with 1 m of both radii, seen every 0.25 s."""
    times = 0.25 * np.arange(17)
    played = of_two(
        times, drives(times, (0, 0, 0), (4, 4, 0)), drives(times, (0, 10, 0), (4, 6, 0))
    )
    row = measures(played, 0.05, 60.0)
    assert row["time_to_collision_min"] == pytest.approx((10.0 - 2.0 * 3.75 - 1.0) / 2.0)
    ahead = np.exp(-0.5 * ((10.0 - 2.0 * times[:-1]) / 2.0) ** 2)  # 2 s of its way, in front
    assert row["personal_space"] == pytest.approx(ahead.mean())
    sampled = Sampled.of(played, played.robots[0])
    assert sampled.step == 0.25 and len(sampled.positions) == 17
    work = comfort.social_work(sampled.positions, sampled.others, 0.25)
    assert row["social_work"] == pytest.approx(work) and work > 0.0
    wide = ((0, 0), (0, 1))
    aloft = [replace(one, positions=np.pad(one.positions, wide)) for one in played.agents]
    high = replace(played, agents=tuple(aloft))
    up = ((0.0, Path(np.array([[0.0, 0.0, 0.0], [4.0, 0.0, 0.0]]))),)
    flown = measures(of_robot(high, paths=up), 0.05, 60.0)
    assert np.isnan(flown["social_work"])
    assert flown["distance_min"] == pytest.approx(row["distance_min"]) == pytest.approx(1.0)


def test_a_robot_that_stands_still_for_5_s_is_frozen() -> None:
    """It drifts aside by 0.5 m in 2 s, then turns by a right angle where it stands."""
    times = 0.25 * np.arange(29)
    played = of_two(times, drives(times, (0, 0, 0), (2, 2, 0.5)), np.full((29, 2), 9.0))
    turning = of_robot(played, headings=np.interp(times, [0.0, 2.0, 7.0], [0.0, 0.0, np.pi / 2]))
    row = measures(turning, 0.05, 60.0)
    assert row["frozen"] and row["freeze_share"] == pytest.approx(5.0 / 7.0)
    assert row["heading_change"] == pytest.approx(np.pi / 2)
    assert row["cross_track_max"] == pytest.approx(0.5)
    assert row["cross_track_mean"] == pytest.approx((0.0625 * 36 + 0.5 * 20) / 29)
    in_part = of_robot(played, headings=np.where(times < 6.9, turning.robots[0].headings, np.nan))
    assert measures(in_part, 0.05, 60.0)["heading_change"] == 0.0  # of its course, then
    # A moment less on end is not 5 s.
    assert not measures(replace(played, times=times * (1.0 - 1e-6)), 0.05, 60.0)["frozen"]
    late = of_two(times, drives(times, (0, 0, 0), (2.25, 2, 0.5)), np.full((29, 2), 9.0))
    assert not measures(late, 0.05, 60.0)["frozen"]


def test_contacts_count_until_the_robot_is_there() -> None:
    """At 1 m/s it drives into somebody who stands: 1 m apart from 3.5 s on."""
    times = 0.5 * np.arange(9)
    way = drives(times, (0, 0, 0), (4, 4, 0))
    for reached, met in ((3.0, 0), (3.5, 1), (np.nan, 1)):
        played = of_two(times, way, np.tile([4.25, 0.0], (9, 1)), reached)
        row = measures(replace(played, ended="goals"), 0.05, 60.0)
        assert (row["contacts_by_robot"], row["contacts_by_other"]) == (met, 0), reached
        assert row["outcome"] == "collision" and row["penalised_time"] == 60.0
    there = of_two(times, way, np.full((9, 2), 9.0), 3.5)
    row = measures(replace(there, ended="goals"), 0.05, 60.0)
    assert row["outcome"] == "success" and row["penalised_time"] == row["success_time"] == 3.5


def test_a_robot_that_is_there_at_once_counts_for_one_step() -> None:
    """Somebody whom it touches later is no contact; below two samples the step is the usual."""
    times = 0.25 * np.arange(9)
    way = drives(times, (0, 0, 0), (2, 2, 0))
    at_once = of_two(times, way, np.tile([1.2, 0.0], (9, 1)), 0.0)
    sampled = Sampled.of(at_once, at_once.robots[0])
    assert sampled.positions.tolist() == [[0.0, 0.0], [0.25, 0.0]] and sampled.step == 0.25
    assert sampled.contacts == (0, 0)
    brief = of_two(np.array([0.0, 0.05]), way[:2], way[:2] + 5.0)
    one = Sampled.of(brief, brief.robots[0])
    assert len(one.positions) == 1 and one.step == 0.1


def many_steps(rng: np.random.Generator) -> tuple[Episode, AgentLog]:
    """A robot whose three plans of three steps of 0.5 s go among six who move.

    Kept clear of by one mode are a, b, and "late" from where it is known.
    """
    east_ward = np.stack([np.linspace(0.0, 4.0, 41), np.zeros(41)], axis=1)
    moving = {
        name: rng.uniform(-3.0, 3.0, 2) + TIMES[:, None] * rng.uniform(-1.0, 1.0, 2)
        for name in ("a", "b", "late", "mixed", "nearly", "twice")
    }
    moving["late"][TIMES < 1.3] = np.nan
    moving["late"][TIMES < 1.3, 1] = 0.0  # one coordinate is not enough
    plans = []
    for stamp, forecast_steps in ((0.5, 4), (1.7, 2), (3.0 - 4e-10, 3)):
        mean = rng.uniform(-3.0, 3.0, (6, 2, forecast_steps, 2))
        root = rng.uniform(-0.7, 0.7, (6, 2, forecast_steps, 2, 2))
        covariance = root @ root.swapaxes(-1, -2) + 0.05 * np.eye(2)
        weight = np.array(
            [[0.0, 1.0], [1.0, 0.0], [1.0, 0.0], [0.4, 0.6], [1.0 - 1e-7, 1e-7], [1.0, 0.0]]
        )
        start = np.array([stamp, 0.2])
        positions = start + 0.5 * np.arange(4)[:, None] * rng.uniform(0.5, 1.5, 2)
        ids = ("twice", "b", "late", "a", "twice", "mixed", "nearly")
        plans.append(
            replace(
                plan(stamp, positions, np.zeros((3, 2)), CERTAIN, 0.5), dt=0.5, ids=ids,
                content=rng.uniform(0.3, 0.7, (3, 7)), tracked=tuple(moving),
                forecast=Forecast(mean, covariance, weight, 0.5, (None,) * 6),
            )
        )  # fmt: skip
    log = replace(agent("robot", east_ward), plans=tuple(plans))
    others = [replace(agent(name, way, "person"), radius=0.2) for name, way in moving.items()]
    return Episode(TIMES, (log, *others), "time limit", 0.25, 0), log


def judged_by_hand(episode: Episode, log: AgentLog, own: Plan) -> dict[str, Any]:
    """What `Judged` holds, obstacle by obstacle and step by step."""
    forecast = own.forecast
    assert forecast is not None
    found: dict[str, Any] = {"risk": [], "touched": [], "known": [], "tail": [], "outside": []}
    for step in range(min(3, forecast.steps)):
        time, place, free, hit = own.stamp + 0.5 * (step + 1), own.positions[step + 1], 1.0, False
        for o, name in enumerate(own.tracked):
            truth = episode.at(episode.agent(name), np.array([time]))[0]
            chance = collision_probability(
                forecast.mean[o, :, step] - place, forecast.covariance[o, :, step], 0.7
            )
            free *= 1.0 - float(forecast.weight[o] @ chance)
            hit |= bool(np.hypot(*(truth - place)) < 0.7)
        found["risk"].append(1.0 - free)
        found["touched"].append(hit)
        found["known"].append(time < 4.0 + 9e-10)
    for name, mode in (("a", 1), ("b", 0), ("late", 0)):
        o, content = own.tracked.index(name), own.content[0, own.ids.index(name)]
        there = episode.at(episode.agent(name), np.array([own.stamp + 0.5]))[0]
        if np.isnan(there).any():
            continue
        gap = there - forecast.mean[o, mode, 0]
        square = gap @ np.linalg.solve(forecast.covariance[o, mode, 0], gap)
        found["tail"].append(1.0 - content)
        found["outside"].append(1.0 - np.exp(-0.5 * square) > content)
    return found


def test_plans_are_judged_as_by_hand() -> None:
    """Their forecasts reach further than the plan, less far, and beyond the episode's end."""
    for seed in range(12):
        episode, log = many_steps(np.random.default_rng(seed))
        by_hand = [judged_by_hand(episode, log, one) for one in log.plans]
        for own, wanted in zip(log.plans, by_hand, strict=True):
            judged = Judged.of(episode, log, own, 0.05)
            assert judged is not None and judged.area.shape[2] == len(wanted["risk"])
            for name, values in wanted.items():
                np.testing.assert_allclose(
                    getattr(judged, name), values, 1e-4, 1e-12, err_msg=name
                )
        row = promises(episode, log, 0.05)
        risks = [np.array(one["risk"]) for one in by_hand]
        assert row["plan_risk_max"] == pytest.approx(max(r.max() for r in risks), rel=1e-4)
        safe = np.prod([1.0 - r[0] for r in risks])
        assert row["episode_risk"] == pytest.approx(1.0 - safe, rel=1e-4)
        touched = [one["touched"] for one in by_hand]
        assert row["episode_touched"] == float(any(one[0] for one in touched))
        assert row["step_touched"] == np.mean(np.concatenate([*touched[:2], touched[2][:2]]))
        outside = np.concatenate([one["outside"] for one in by_hand])
        assert row["tail_observed"] == outside.mean()


def test_a_plan_whose_first_step_alone_is_known_counts(episode: Episode) -> None:
    """And one of which the clock is a moment too late does not."""
    still = np.array([[3.0, 0.0], [3.5, 0.0], [3.5, 0.0]])
    own = plan(3.0, still, np.full((2, 2), 2.0), 0.3 * np.eye(2), 0.9)
    for stamp, driven in ((3.0, True), (3.0 + 1e-6, False)):
        log = replace(episode.robots[0], plans=(replace(own, stamp=stamp),))
        row = promises(replace(episode, agents=(log, episode.agents[1])), log, 0.05)
        assert np.isfinite(row["episode_risk"]) == driven == np.isfinite(row["episode_touched"])
    without = [replace(own, forecast=None), replace(own, tracked=())]
    assert [Judged.of(episode, episode.robots[0], one, 0.05) for one in without] == [None, None]

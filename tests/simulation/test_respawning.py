"""People who come anew: where and when, who sees them, and what the log says of it."""

from itertools import pairwise

import numpy as np
import pytest

from wideberth.framework.values.errors import WideberthError
from wideberth.framework.values.path import Path
from wideberth.robots.holonomic_velocity import HolonomicVelocity
from wideberth.routes.walls import box
from wideberth.simulation.engine.agents import PathChange, ReplayAgent, RobotAgent
from wideberth.simulation.engine.episode import run_episode
from wideberth.simulation.engine.settings import Settings
from wideberth.simulation.log.episode_log import Episode
from wideberth.simulation.measures.episode_measures import measures
from wideberth.simulation.measures.summary import clearances, summarise
from wideberth.simulation.sensing.channel import Channel
from wideberth.tests.helpers.straight import Straight

BODY = HolonomicVelocity(radius=0.3, max_speed=1.0)
STEP = 0.1


def agent(name, start, end, speed=1.0, **more):
    path = Path(np.array([start, end], dtype=np.float64))
    return RobotAgent(name, BODY, Straight(speed), path, speed, **more)


def played(*agents, time=12.0, noise=0.0, delay=0.0, **more):
    channel = Channel(noise, 0.0, delay)
    settings = Settings(time_limit=time, plant_step=STEP, history=1.0, channel=channel)
    return run_episode(agents, settings, seed=3, **more)


def aside(**more):
    """A robot that is never in the way of the people along the x axis."""
    return agent("robot", (0, 20), (40, 20), **more)


def walker(**more):
    return agent("p", (0, 0), (3, 0), person=True, respawn=True, **more)


def there(log):
    return np.isfinite(log.positions).all(axis=1)


def lives(episode):
    return [log for log in episode.agents if log.name.startswith("p")]


def test_who_arrives_appears_at_the_start_the_next_step():
    episode = played(aside(), walker(), agent("b", (9, 0), (9, 3), person=True))
    found = lives(episode)
    assert [log.name for log in found] == ["p", "p (2)", "p (3)", "p (4)", "p (5)"]
    assert [log.name for log in episode.agents[:3]] == ["robot", "p", "b"]  # newcomers are last
    for log, after in pairwise(found):
        last, first = np.flatnonzero(there(log))[-1], np.flatnonzero(there(after))[0]
        assert first == last + 1
        assert episode.times[last] == pytest.approx(log.reached)
        assert np.linalg.norm(log.positions[last] - [3.0, 0.0]) <= episode.goal_tolerance
        assert after.positions[first].tolist() == [0.0, 0.0]
        assert after.paths[0][0] == episode.times[first]
        assert after.commands.stamp[0] == pytest.approx(np.ceil(4 * episode.times[first]) / 4)
        assert log.commands.stamp[-1] <= log.reached + 1e-9
    # 3 m less the tolerance at 1 m/s, then one step.
    assert np.diff([log.paths[0][0] for log in found]) == pytest.approx(2.8 + STEP, abs=STEP)


def test_the_number_of_people_never_falls():
    crowd = [
        agent(name, (x, y), (x + 2, -y), speed, person=True, respawn=True, phase=phase)
        for name, x, y, speed, phase in (
            ("p", 0, 0.5, 1.0, 0.0), ("q", 0.5, -2, 0.7, 0.1), ("s", 1, 2, 0.9, 0.2),
        )
    ]  # fmt: skip
    episode = played(aside(), *crowd, time=25.0)
    people = [log for log in episode.agents if log.kind == "person"]
    assert len(people) > 9
    assert (np.sum([there(log) for log in people], axis=0) == 3).all()


def test_a_name_that_is_taken_is_left_out():
    crowd = [walker(), agent("p (2)", (0, 9), (3, 9), person=True, respawn=True)]
    others = [ReplayAgent("p (3)", np.array([0.0, 99.0]), np.full((2, 2), -40.0), 0.2)]
    block = box((50.0, 50.0), (51.0, 51.0), "p (4)")
    episode = played(aside(), *crowd, others=others, polygons=(block,))
    moving = [log.name for log in episode.agents if log.kind == "person"]
    assert moving == [
        *("p", "p (2)", "p (5)", "p (2) (2)", "p (6)", "p (2) (3)", "p (7)", "p (2) (4)"),
        *("p (8)", "p (2) (5)"),
    ]
    assert len(clearances(episode)) == len(moving) + 2


@pytest.mark.parametrize("noise", [0.0, 0.01])
def test_without_it_nothing_changes(noise):
    def made(respawn):
        people = [agent("p", (0, 0), (30, 0), person=True, respawn=respawn)]
        return played(aside(), *people, noise=noise).to_bytes()

    assert made(True) == made(False)  # nobody arrives
    standing = played(aside(), agent("p", (0, 0), (3, 0), person=True))
    assert len(standing.agents) == 2 and there(standing.agents[1]).all()


@pytest.mark.parametrize("noise", [0.0, 1e-6])
@pytest.mark.parametrize("delay", [0.0, 0.3, 0.25])
def test_nobody_is_seen_to_jump(noise, delay):
    robot = aside()
    episode = played(robot, walker(), noise=noise, delay=delay)
    seen = {}
    for observation in robot.controller.seen:
        moment = observation.stamp - delay
        names = [one.ident for one in observation.detections]
        if moment > 0.0 and np.abs(episode.times - moment).min() < 1e-9:
            places = {log.name: episode.at(log, [moment])[0] for log in lives(episode)}
            assert names == [name for name, place in places.items() if np.isfinite(place).all()]
        assert len(names) <= 1
        for one in observation.detections:
            seen.setdefault(one.ident, []).append((moment, *one.position))
    assert list(seen) == [log.name for log in lives(episode)]
    for rows in map(np.array, seen.values()):
        moved = np.linalg.norm(np.diff(rows[:, 1:], axis=0), axis=1)
        assert (moved <= np.diff(rows[:, 0]) * 1.0 + 1e-4).all()


def test_the_oracle_knows_no_more_than_one_of_them_at_a_time():
    robot = aside(truth=True)
    played(robot, walker(), delay=0.3)
    later = robot.controller.seen[-1]
    assert set(later.truth.positions) == {"p", "p (2)", "p (3)", "p (4)", "p (5)"}
    for observation in robot.controller.seen:
        known = np.array([np.isfinite(way[:, 0]) for way in observation.truth.positions.values()])
        assert known.sum(axis=0).max() == 1
        now = np.searchsorted(observation.truth.times, observation.stamp - 1e-6)
        assert known[:, now].any()  # the one who is there now
        assert not known[:, -1].any()  # but is gone by its end


def test_a_start_near_a_robot_is_waited_for():
    # The robot passes the start within 5 m until 10 s; the person stands at the goal until then.
    robot = agent("robot", (-5, 1), (25, 1))
    episode = played(robot, walker(), time=20.0)
    first, second = lives(episode)[:2]
    moment = second.paths[0][0]
    away = np.linalg.norm(episode.at(episode.robots[0], [moment])[0])
    assert first.reached < 3.1 and 5.0 <= away < 5.0 + STEP + 1e-9
    assert np.linalg.norm(episode.at(first, [moment - STEP])[0] - [3.0, 0.0]) < 0.01
    assert clearances(episode)["robot", "p (2)"] > 0.0


@pytest.mark.parametrize("still", ["person", "recorded"])
def test_a_taken_start_is_waited_for(still):
    crowd, others = [walker()], []
    if still == "person":
        crowd.append(agent("b", (0.5, -2.0), (0.5, 0.0), person=True))
    else:
        others = [ReplayAgent("b", np.array([0.0, 6.0, 6.5]), np.full((3, 2), 0.2), 0.2)]
    episode = played(aside(), *crowd, others=others)
    names = [log.name for log in lives(episode)]
    assert names == (["p"] if still == "person" else ["p", "p (2)", "p (3)"])
    if still == "recorded":
        assert lives(episode)[1].paths[0][0] == pytest.approx(6.6, abs=0.02)


def test_no_collision_on_the_way_back():
    # When the person returns from (0, 12) to (0, 0), the robot is between the two, at (0, 6).
    robot = agent("robot", (-12, 6), (12, 6))
    episode = played(robot, agent("p", (0, 0), (0, 12), person=True, respawn=True), time=24.0)
    back = lives(episode)[1].paths[0][0]
    assert abs(episode.at(episode.robots[0], [back])[0, 0]) < 0.3
    found = clearances(episode)
    # (0, t) and (t - 12, 6) are nearest after 9 s, sqrt(18) m apart; then (0, t - back).
    assert found["robot", "p"] == pytest.approx(np.sqrt(18.0) - 0.6, abs=1e-6)
    assert found["robot", "p (2)"] == pytest.approx((back - 6.0) / np.sqrt(2.0) - 0.6, abs=1e-6)
    row = summarise(episode)
    assert row["success"] and row["clearance"] == pytest.approx(min(found.values()))
    made = measures(episode, 0.05, 60.0)
    assert made["distance_min"] == pytest.approx(min(found.values()), abs=0.02)
    assert made["contacts_by_robot"] == made["contacts_by_other"] == 0


def test_it_repeats_and_is_read_again():
    def made():
        return played(aside(phase=0.1), walker(phase=0.2), noise=0.01)

    episode = made()
    assert made().to_bytes() == episode.to_bytes()
    again = Episode.from_bytes(episode.to_bytes())
    assert again.to_bytes() == episode.to_bytes()
    assert [log.name for log in again.agents] == [log.name for log in episode.agents]


def test_a_new_path_for_who_has_left_reaches_nobody():
    elsewhere = Path(np.array([[0.0, 0.0], [0.0, 9.0]]))
    plain, changed = (
        played(aside(), walker(), changes=changes)
        for changes in ((), (PathChange(4.0, "p", elsewhere),))
    )
    assert len(lives(changed)) == 5
    for one, other in zip(lives(plain), lives(changed), strict=True):
        assert np.array_equal(one.positions, other.positions, equal_nan=True)


def test_robots_do_not_come_anew():
    with pytest.raises(WideberthError, match="robot is a robot and would respawn"):
        aside(respawn=True)

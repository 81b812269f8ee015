"""People of an episode: they decide, but are not what is examined."""

from dataclasses import dataclass

import numpy as np
import pytest

from wideberth.experiments.engine.closed_loop import play
from wideberth.framework.values.errors import WideberthError
from wideberth.framework.values.path import Path
from wideberth.robots.holonomic_velocity import HolonomicVelocity
from wideberth.simulation.engine.agents import RobotAgent
from wideberth.simulation.engine.episode import run_episode
from wideberth.simulation.engine.settings import Settings
from wideberth.simulation.log.episode_log import Episode
from wideberth.simulation.measures.summary import clearances, summarise
from wideberth.simulation.scenarios.base import Placement, Scenario
from wideberth.simulation.sensing.channel import Channel
from wideberth.tests.helpers.straight import Straight

BODY = HolonomicVelocity(radius=0.3, max_speed=1.0)
QUIET = Settings(time_limit=20.0, plant_step=0.25, history=0.0, channel=Channel(noise=0.0))


def agent(name, start, end, controller=None, **more):
    path = Path(np.array([start, end], dtype=np.float64))
    return RobotAgent(name, BODY, controller or Straight(), path, 0.0, **more)


def test_an_episode_ends_with_its_robots():
    robot = agent("robot", (0, 0), (4, 0))
    slow = agent("slow", (0, 5), (40, 5), person=True)
    episode = run_episode([robot, slow], QUIET)
    assert episode.ended == "goals"
    assert episode.duration == pytest.approx(3.75, abs=0.26)  # 4 m less the tolerance, at 1 m/s
    assert [log.kind for log in episode.agents] == ["robot", "person"]
    assert [log.name for log in episode.robots] == ["robot"]


def test_standing_robots_are_a_deadlock_whoever_walks():
    robot = agent("robot", (0, 0), (4, 0), Straight(speed=0.0))
    walker = agent("walker", (0, 5), (40, 5), person=True)
    assert run_episode([robot, walker], QUIET).ended == "deadlock"


def test_invisible_robots_are_seen_by_robots_alone():
    robots = [agent("a", (0, 0), (2, 0), visible=False), agent("b", (0, 2), (2, 2))]
    person = agent("p", (0, 4), (2, 4), person=True)
    run_episode([*robots, person], QUIET)
    assert robots[0].controller.first_seen == ("b", "p")
    assert robots[1].controller.first_seen == ("a", "p")
    assert person.controller.first_seen == ("b",)


def test_people_may_touch_each_other_unnoticed():
    settings = Settings(**{**vars(QUIET), "stop_on_collision": True})
    people = [
        agent("p", (0, 5), (6, 5), person=True),
        agent("q", (6, 5), (0, 5), person=True),
    ]
    calm = run_episode([agent("robot", (0, 0), (6, 0)), *people], settings)
    assert calm.ended == "goals" and not summarise(calm)["collision"]
    assert ("p", "q") not in clearances(calm) and ("robot", "p") in clearances(calm)
    hit = run_episode([agent("robot", (6, 5), (0, 5)), people[0]], settings)
    assert hit.ended == "collision" and summarise(hit)["collision"]


def test_a_crowd_alone_is_no_episode():
    with pytest.raises(WideberthError, match="no robot"):
        run_episode([agent("p", (0, 0), (1, 0), person=True)], QUIET)


def test_saved_people_are_read_again():
    made = run_episode(
        [agent("r", (0, 0), (1, 0)), agent("p", (0, 4), (2, 4), person=True)], QUIET
    )
    again = Episode.from_bytes(made.to_bytes())
    assert [log.kind for log in again.agents] == ["robot", "person"]
    assert again.to_bytes() == made.to_bytes()


@dataclass(frozen=True)
class Meeting(Scenario):
    """A robot and a person head-on; the offset is drawn."""

    def build(self, rng):
        way = Path(np.array([[0.0, rng.uniform(2.0, 3.0)], [4.0, 2.0]]))
        return (Placement("robot", way, 0.0, visible=False),)

    def people(self, rng, placements):
        return (agent("p", (4, rng.uniform(-1, 0)), (0, 0), person=True),)


def test_play_casts_people():
    first, second = (play(Meeting(), BODY, Straight(), QUIET, 3) for _ in range(2))
    assert first.to_bytes() == second.to_bytes()
    assert [log.kind for log in first.agents] == ["robot", "person"]
    assert play(Meeting(), BODY, Straight(), QUIET, 4).to_bytes() != first.to_bytes()

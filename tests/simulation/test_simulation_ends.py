"""How an episode ends or never begins: goals, collision, deadlock, and what is refused."""

from dataclasses import replace

import numpy as np
import pytest

from wideberth.framework.values.errors import WideberthError
from wideberth.framework.values.motion import Command
from wideberth.framework.values.path import Path
from wideberth.robots.unicycle import Unicycle
from wideberth.simulation.engine.agents import ReplayAgent, RobotAgent
from wideberth.simulation.engine.episode import run_episode
from wideberth.simulation.engine.settings import Settings
from wideberth.simulation.measures.summary import summarise
from wideberth.simulation.sensing.channel import Channel
from wideberth.tests.helpers.pursuit import EAST, QUICK, Pursuit, agent, opposite
from wideberth.tests.oracles.episode_ends import deadlock_time


def test_head_on_collides_and_can_stop_there():
    pair = [agent("a"), agent("b", opposite())]
    episode = run_episode(pair, QUICK)
    row = summarise(episode)
    assert row["collision"] and not row["success"] and episode.ended == "goals"
    assert row["clearance"] == pytest.approx(-1.5, abs=1e-6)
    pair = [agent("a"), agent("b", opposite())]
    stopped = run_episode(pair, replace(QUICK, stop_on_collision=True))
    assert stopped.ended == "collision"
    # Surfaces meet when 5 - 2 * 0.5 t = 1.5.
    assert stopped.duration == pytest.approx(3.5, abs=0.021)


def test_standing_still_is_a_deadlock(monkeypatch):
    monkeypatch.setattr(Pursuit, "command", lambda self, seen: Command((0.0, 0.0), ramp=0.5))
    episode = run_episode([agent("a"), agent("b", opposite())], QUICK)
    assert episode.ended == "deadlock" and summarise(episode)["deadlock"]
    speeds = np.array([log.speeds for log in episode.robots])
    done = np.zeros(speeds.shape, bool)
    assert deadlock_time(episode.times, speeds, done) == pytest.approx(episode.duration)
    creeping = replace(QUICK, time_limit=5.0)
    assert run_episode([agent("a"), agent("b", opposite())], creeping).ended == "time limit"


def test_a_command_that_is_not_finite_stops_with_a_message(monkeypatch):
    monkeypatch.setattr(Pursuit, "command", lambda self, seen: Command((np.nan, 0.0)))
    with pytest.raises(WideberthError, match="controller of a"):
        run_episode([agent("a")], QUICK)


SHARED = Pursuit(Unicycle())


def sharing(name):
    return RobotAgent(name, Unicycle(), SHARED, EAST)


@pytest.mark.parametrize(
    ("build", "message"),
    [
        (lambda: run_episode([], QUICK), "no robot"),
        (lambda: run_episode([agent("a"), agent("a")], QUICK), "'a'"),
        (lambda: agent("a", phase=0.5), "period"),
        (lambda: agent("a", Path(np.eye(3))), "dimensions"),
        (lambda: Settings(time_limit=0.0), "time_limit"),
        (lambda: Settings(solve_time="never"), "'measured'"),
        (lambda: Settings(solve_time=-0.1), "solve_time"),
        (lambda: Channel(noise=-1.0), "noise"),
        (lambda: Channel(dropout=1.0), "dropout"),
        (lambda: ReplayAgent("w", [0.0, 0.0], np.zeros((2, 2)), 0.3), "later"),
        (lambda: ReplayAgent("w", [0.0, 1.0], np.zeros((2, 2)), -0.3), "radius"),
        (lambda: run_episode([agent("a")], QUICK, seed=-1), "seed"),
        (lambda: run_episode([sharing("a"), sharing("b")], QUICK), "share one controller"),
    ],
)
def test_bad_input_names_the_cure(build, message):
    with pytest.raises(WideberthError, match=message):
        build()

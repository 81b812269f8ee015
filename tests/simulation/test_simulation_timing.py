"""Time that a decision takes in an episode: commands that come late, and what is measured."""

from dataclasses import replace

import numpy as np
import pytest

from wideberth.framework.values.path import Path
from wideberth.robots.holonomic import Holonomic
from wideberth.simulation.engine.agents import PathChange
from wideberth.simulation.engine.episode import run_episode
from wideberth.simulation.measures.summary import robot_rows, time_rows
from wideberth.tests.helpers.pursuit import QUICK, agent


def test_constant_solve_time_delays_commands():
    episode = run_episode([agent("a")], replace(QUICK, solve_time=0.3))
    log = episode.agent("a").commands
    assert log.effect - log.stamp == pytest.approx(0.3)
    assert np.diff(log.stamp) == pytest.approx(0.5)
    assert episode.agent("a").skipped == 0


def test_late_commands_are_misses_and_the_old_one_holds():
    """Solving takes 0.7 s at a period of 0.5 s: every other tick passes by."""
    corner = Path(np.array([[0.0, 0.0], [0.0, 5.0]]))
    change = PathChange(0.0, "a", corner)
    slow = agent("a", robot=Holonomic())
    episode = run_episode([slow], replace(QUICK, solve_time=0.7), changes=[change])
    log = episode.agent("a")
    assert np.diff(log.commands.stamp) == pytest.approx(1.0)
    assert robot_rows(episode)[0]["deadline_misses"] == len(log.commands)
    assert log.skipped == len(log.commands)
    before = episode.times <= 0.7
    assert log.positions[before, 0] == pytest.approx(0.5 * episode.times[before])
    assert abs(log.positions[before, 1]).max() < 1e-12


def test_measured_solve_time_is_what_it_took():
    slow = agent("a", seconds=0.02)
    episode = run_episode([slow], replace(QUICK, solve_time="measured", time_limit=2.0))
    log = episode.agent("a").commands
    assert log.effect - log.stamp == pytest.approx(episode.plan_seconds["a"])
    assert (episode.plan_seconds["a"] >= 0.02).all()
    assert time_rows(episode)[0]["max"] == max(episode.plan_seconds["a"])
    assert all(plan.seconds == 0.0 for plan in episode.agent("a").plans)

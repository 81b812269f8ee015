"""What controllers in an episode are shown: history, delay, noise, and the truth."""

from dataclasses import replace

import numpy as np
import pytest

from wideberth.simulation.engine.agents import ReplayAgent
from wideberth.simulation.engine.episode import run_episode
from wideberth.simulation.engine.settings import Settings
from wideberth.simulation.sensing.channel import Channel
from wideberth.tests.helpers.pursuit import QUICK, agent, opposite


def test_history_shows_the_others_coming():
    first, second = agent("a", phase=0.2), agent("b", opposite(), phase=0.3)
    settings = Settings(history=4.0, time_limit=1.0, channel=Channel(noise=0.0))
    run_episode([first, second], settings)
    seen = first.controller.remembered
    assert [o.stamp for o in seen] == pytest.approx(np.arange(-3.8, 0.0, 0.5))
    for observation in seen:
        assert observation.detections[0].position[0] == pytest.approx(5 - 0.5 * observation.stamp)
        assert observation.state[0] == pytest.approx(0.5 * observation.stamp)
        assert observation.state[3] == pytest.approx(0.5)
    assert [o.stamp for o in first.controller.asked] == pytest.approx([0.2, 0.7])


def test_delay_shows_where_it_was():
    settings = Settings(history=1.0, time_limit=3.0, channel=Channel(noise=0.0, delay=0.33))
    first = agent("a", phase=0.1)
    run_episode([first, agent("b", opposite())], settings)
    for observation in first.controller.asked:
        detection = observation.detections[0]
        assert detection.age == 0.33
        expected = 5 - 0.5 * (observation.stamp - 0.33)
        assert detection.position[0] == pytest.approx(expected, abs=1e-9)


def test_noise_has_its_size_and_does_not_hang_on_order():
    channel = Channel(noise=0.1, dropout=0.25)
    here = [("x", np.zeros(2), 0.3), ("y", np.ones(2), 0.3), ("gone", np.full(2, np.nan), 0.3)]
    draws = [channel.detections(3, "a", tick, here) for tick in range(-500, 1500)]
    errors = np.array([d.position - (d.ident == "y") for seen in draws for d in seen])
    count = errors.size
    assert abs(len(errors) / 4000 - 0.75) < 3 * np.sqrt(0.75 * 0.25 / 4000)
    assert abs(errors.mean()) < 3 * 0.1 / np.sqrt(count)
    assert abs(errors.std() - 0.1) < 3 * 0.1 / np.sqrt(2 * count)
    assert draws[0][0].covariance == pytest.approx(0.01 * np.eye(2))
    other = channel.detections(3, "a", 7, here[::-1])
    assert {d.ident: tuple(d.position) for d in other} == {
        d.ident: tuple(d.position) for d in channel.detections(3, "a", 7, here)
    }
    assert {d.ident for seen in draws for d in seen} == {"x", "y"}


def test_oracle_is_told_paths_plans_and_recordings():
    """Before a plan: the path at reference speed. After: the plan, then straight on."""
    walker = ReplayAgent("w", np.arange(0.0, 20.0), np.full((20, 2), 9.0), 0.3)
    first = agent("a", truth=True, phase=0.2)
    second = agent("b", opposite(1.0), phase=0.4)
    blind = agent("c", opposite(-2.0), planning=False)
    run_episode([first, second, blind], replace(QUICK, time_limit=2.0), others=[walker])
    asked = first.controller.asked
    assert [o.truth is None for o in first.controller.remembered] == [True] * 4
    assert second.controller.asked[0].truth is None
    for observation in asked:
        truth = observation.truth
        assert truth.times[0] <= observation.stamp - 1 < observation.stamp + 12 <= truth.times[-1]
        straight = 5 - 0.5 * truth.times
        ends = np.maximum(straight, 0.0) if observation.stamp < 0.4 else straight
        assert truth.positions["b"][:, 0] == pytest.approx(ends, abs=1e-6)
        assert truth.positions["c"][:, 0] == pytest.approx(np.maximum(5 - 0.5 * truth.times, 0.0))
        assert (truth.positions["w"][truth.times > 0.01] == 9.0).all()
        assert np.isnan(truth.positions["w"][truth.times < -0.01]).all()

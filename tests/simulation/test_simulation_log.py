"""The log of an episode: the same bytes for the same seed, files, and its summary."""

from dataclasses import dataclass, replace
from types import SimpleNamespace

import numpy as np
import pytest

from wideberth.framework.plugins.config import describe
from wideberth.framework.values.errors import WideberthError
from wideberth.framework.values.path import Path
from wideberth.regions.minkowski_sum import MinkowskiSum
from wideberth.robots.holonomic import Holonomic
from wideberth.simulation.engine.agents import ScriptedAgent
from wideberth.simulation.engine.episode import run_episode
from wideberth.simulation.log import episode_log
from wideberth.simulation.log.episode_log import Episode, _Packer, _region_of, _Unpacker
from wideberth.simulation.measures.summary import summarise
from wideberth.tests.helpers.pursuit import QUICK, agent, opposite


def test_same_seed_same_bytes():
    def once(seed):
        pair = [agent("a", phase=0.1), agent("b", opposite(0.4), phase=0.35)]
        return run_episode(pair, QUICK, seed=seed).to_bytes()

    assert once(1) == once(1)
    assert once(1) != once(2)


def test_order_of_robots_does_not_matter():
    def once(turned):
        pair = [agent("a"), agent("b", opposite(0.4), robot=Holonomic())]
        return run_episode(pair[::-1] if turned else pair, QUICK)

    one, two = once(False), once(True)
    for name in ("a", "b"):
        assert np.array_equal(one.agent(name).positions, two.agent(name).positions)
        for first, second in zip(one.agent(name).plans, two.agent(name).plans, strict=True):
            assert np.array_equal(first.forecast.mean, second.forecast.mean)


def test_saved_episode_reads_back_whole():
    walker = ScriptedAgent("s", opposite(2.0), 0.4, 0.3)
    pair = [agent("a"), agent("b", opposite(0.5), planning=False)]
    episode = run_episode(pair, QUICK, seed=4, others=[walker])
    again = Episode.from_bytes(episode.to_bytes())
    assert again.to_bytes() == episode.to_bytes()
    assert np.array_equal(again.times, episode.times)
    plan, other = episode.agent("a").plans[3], again.agent("a").plans[3]
    assert plan.ids == other.ids and plan.iterations == other.iterations == 7
    assert np.array_equal(plan.forecast.covariance, other.forecast.covariance)
    assert again.agent("b").plans == () and len(again.agent("b").commands) > 5
    assert again.plan_seconds == {}
    assert repr(summarise(again)) == repr(summarise(episode))


def test_other_files_are_refused():
    with pytest.raises(WideberthError, match="not a saved episode"):
        Episode.from_bytes(b"frame id x y")
    with pytest.raises(WideberthError, match="not a saved episode"):
        Episode.from_bytes(b"")
    whole = run_episode([agent("a")], replace(QUICK, time_limit=1.0)).to_bytes()
    with pytest.raises(WideberthError, match="not a saved episode"):
        Episode.from_bytes(whole[: len(whole) // 2])


def test_a_newer_version_is_refused(monkeypatch):
    from wideberth.simulation.log import episode_log

    episode = run_episode([agent("a")], replace(QUICK, time_limit=1.0))
    monkeypatch.setattr(episode_log, "VERSION", 2)
    data = episode.to_bytes()
    monkeypatch.setattr(episode_log, "VERSION", 1)
    with pytest.raises(WideberthError, match="version 2"):
        Episode.from_bytes(data)


def test_coverage_and_forecast_share_come_from_the_log():
    """The stub says "it stays where it is, +- 1 m": right for a scripted agent at rest."""
    still = ScriptedAgent("s", opposite(9.0), 0.0, 0.3)
    episode = run_episode([agent("a")], QUICK, others=[still])
    row = summarise(episode)
    assert row["coverage"] == row["coverage_first"] == row["coverage_last"] == 1.0
    assert row["named_forecasts"] == 1.0
    assert row["below_reference"] == 1.0 and row["fallbacks"] == 0
    assert row["least_content"] == 0.9 and row["gave_way"] == ""
    fast = ScriptedAgent("s", Path(np.array([[-50.0, 9.0], [50.0, 9.0]])), 4.0, 0.3)
    row = summarise(run_episode([agent("a")], QUICK, others=[fast]))
    assert row["coverage_first"] == 1.0 and row["coverage_last"] == 0.0


def test_arrays_are_put_into_one_vector_and_taken_out_again():
    pack, arrays = _Packer(), (np.arange(6.0).reshape(2, 3), np.zeros((0, 2)), 7.0)
    places = [pack.put(one) for one in arrays]
    numbers = pack.numbers()
    assert numbers.tolist() == [0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 7.0]
    for place, one in zip(places, arrays, strict=True):
        np.testing.assert_array_equal(_Unpacker(numbers).get(place), one)
    assert _Packer().numbers().shape == (0,)


def test_the_region_of_plans_is_kept_if_a_config_can_name_it():
    def plans(*regions):
        found = [SimpleNamespace(situation=one and SimpleNamespace(region=one)) for one in regions]
        return SimpleNamespace(plans=found)

    assert _region_of(plans(None, MinkowskiSum())) == describe(MinkowskiSum())
    assert _region_of(plans(None)) is None

    @dataclass(frozen=True)
    class Unnamed:
        """Of no room."""

    assert _region_of(plans(Unnamed())) is None


def test_an_episode_is_drawn_in_as_many_dimensions_as_it_was_driven(monkeypatch):
    asked = []
    monkeypatch.setattr(episode_log, "picture", lambda draw, *given: asked.append(given))
    for size in (2, 3):
        robot = SimpleNamespace(positions=np.zeros((4, size)))
        Episode.plot(SimpleNamespace(_draw=None, agents=(robot,)))
    assert asked == [(2, None), (3, None)]

"""The benchmark of forecasts among simulated people: the same past for all, and known errors."""

from importlib import import_module
from pathlib import Path

import numpy as np
import pytest

from wideberth.predictors.static import Static
from wideberth.simulation.log.episode_log import Episode

FOLDER = Path(__file__).resolve().parents[2] / "benchmarks"


@pytest.fixture
def script(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.syspath_prepend(str(FOLDER))
    return import_module("crowd_forecasts")


def test_a_line_for_each_predictor(script, monkeypatch, capsys):
    pytest.importorskip("pyrvo")
    monkeypatch.setattr(script, "BEGIN", 2.0)
    monkeypatch.setattr(script, "LIMIT", 8.0)
    monkeypatch.setattr(script, "PREDICTORS", {"kalman": "kalman", "ours": "reacting_people"})
    script.main(cells=((3, 0.05),), seeds=(3, 4))
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == 3
    assert "kalman" in lines[1] and "+0 % (+0 to +0)" in lines[1]
    assert "ours" in lines[2]


def test_who_stays_is_off_by_the_way(script, monkeypatch):
    pytest.importorskip("pyrvo")
    monkeypatch.setattr(script, "BEGIN", 2.0)
    monkeypatch.setattr(script, "NOISE", 1e-9)
    episode, kinds = script.crowd(2, 0.05, 5)
    assert isinstance(episode, Episode)
    found = script.measure({"static": Static()}, episode, kinds, 5)
    (error,) = found["static"].seeds
    grid = script.DT * np.arange(int(episode.times[-1] / script.DT) + 1)
    rows = [r for r in range(10, len(grid) - script.STEPS) if r % 10 == 0]
    ways = []
    for one in episode.agents[1:]:
        place = np.stack([np.interp(grid, episode.times, axis) for axis in one.positions.T], 1)
        ways += [np.linalg.norm(place[r + 1 : r + 11] - place[r], axis=1).mean() for r in rows]
    assert error == pytest.approx(np.mean(ways), abs=1e-6)
    assert sum(map(len, found["static"].kinds.values())) == 2 * len(rows)


def test_the_interval_of_a_constant_ratio_is_a_point(script):
    base = np.array([0.4, 0.6, 0.5])
    assert script.interval(0.8 * base, base) == pytest.approx((-0.2, -0.2, -0.2))
    share, low, high = script.interval([0.5, 0.7, 0.3], base)
    assert share == pytest.approx(0.0)
    assert low < 0.0 < high

"""Scenarios: what is drawn lies in its range and means what the docstring says."""

import pickle

import numpy as np
import pytest

from wideberth.framework.values.errors import WideberthError
from wideberth.metrics import episode as metrics
from wideberth.simulation.scenarios import chicken_game, crossing
from wideberth.simulation.scenarios.chicken_game import ChickenGame
from wideberth.simulation.scenarios.crossing import Crossing


def drawn(scenario, seed):
    return scenario.build(np.random.default_rng(seed))


@pytest.mark.parametrize("scenario", [ChickenGame(), Crossing()])
def test_seed_decides(scenario):
    assert repr(drawn(scenario, 3)) == repr(drawn(scenario, 3))
    assert repr(drawn(scenario, 3)) != repr(drawn(scenario, 4))
    assert pickle.loads(pickle.dumps(scenario)) == scenario


@pytest.mark.parametrize("scenario", [ChickenGame(), Crossing()])
def test_start_distance_and_phase_lie_in_their_ranges(scenario):
    distances = []
    for seed in range(200):
        one, two = drawn(scenario, seed)
        gap = one.path.points[0] - two.path.points[0]
        along_x = isinstance(scenario, ChickenGame)
        distances.append(abs(gap[0]) if along_x else np.linalg.norm(gap))
        assert one.speed == two.speed == 0.5 and one.name != two.name
        assert 0 <= one.phase < 1 and 0 <= two.phase < 1
    assert 12 - 1e-9 <= min(distances) < 12.5 and 19.5 < max(distances) <= 20 + 1e-9


def test_chicken_game_lag_is_the_difference_of_arrival_at_the_middle(monkeypatch):
    monkeypatch.setattr(chicken_game, "LAG", (1.5, 1.5))
    game = ChickenGame(distance=(15.0, 15.0), offset=(0.4, 0.4))
    sides = set()
    for seed in range(20):
        left, right = drawn(game, seed)
        waits = [abs(p.path.points[0][0]) / p.speed for p in (left, right)]
        assert waits[1] - waits[0] == pytest.approx(1.5)
        assert left.path.points[0][1] - right.path.points[0][1] == pytest.approx(
            0.4 * np.sign(left.path.points[0][1])
        )
        assert metrics.crossing_point(left.path, right.path) is None
        sides.add(left.path.points[0][1] > 0)
    assert sides == {True, False}


def test_crossing_lag_is_the_difference_of_arrival_at_the_crossing(monkeypatch):
    monkeypatch.setattr(crossing, "DISTANCE", (14.0, 14.0))
    monkeypatch.setattr(crossing, "LAG", (-2.0, -2.0))
    scene = Crossing()
    lower, upper = drawn(scene, 1)
    one, two = metrics.crossing_point(lower.path, upper.path)
    assert (two - one) / 0.5 == pytest.approx(-2.0)
    assert np.hypot(one, two) == pytest.approx(14.0)
    steps = lower.path.points[1] - lower.path.points[0], upper.path.points[1]
    assert steps[0] @ (steps[1] - upper.path.points[0]) == 0.0


@pytest.mark.parametrize(
    ("build", "message"),
    [
        (lambda: ChickenGame(distance=(20.0, 12.0)), "distance"),
        (lambda: ChickenGame(offset=(-0.1, 0.5)), "offset"),
        (lambda: ChickenGame(distance=(12.0,)), "two numbers"),
    ],
)
def test_bad_ranges_name_themselves(build, message):
    with pytest.raises(WideberthError, match=message):
        build()

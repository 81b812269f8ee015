"""The training of the shipped network: the same script, in brief."""

from importlib import import_module
from pathlib import Path

import numpy as np
import pytest

from wideberth.framework.plugins.config import load_plugin
from wideberth.predictors.core import adam
from wideberth.predictors.kalman import Kalman
from wideberth.predictors.social_attention import SocialAttention

FOLDER = Path(__file__).resolve().parents[2] / "benchmarks"


@pytest.fixture
def scripts(monkeypatch: pytest.MonkeyPatch):
    pytest.importorskip("pyrvo")
    monkeypatch.syspath_prepend(str(FOLDER))
    return import_module("crowd_training"), import_module("crowd_forecasts")


def test_what_is_saved_forecasts_and_has_few_digits(scripts, monkeypatch, tmp_path):
    training, forecasts = scripts
    monkeypatch.setattr(forecasts, "LIMIT", 8.0)
    monkeypatch.setattr(adam, "UPDATES", 2)
    monkeypatch.setattr(adam, "BATCH", 8)
    path = tmp_path / "crowd.json"
    brief = SocialAttention(observed=4, predicted=6, rounds=1)
    training.main(str(path), {(3, 0.05): 1, (2, 0.02): 1}, brief)
    saved = load_plugin(path, "predictors")
    assert saved.rounds == 1 and saved.fitted.observed == 4
    numbers = [number for layer in saved.fitted.layers for number in layer.bias]
    assert all(number == float(f"{number:.5g}") for number in numbers)
    scene = training.scene_of(forecasts.crowd(3, 0.05, 1)[0], 1)
    assert scene.ids[0] == "robot" and len(scene) == 4
    assert saved.predict(scene, 5).fallback == (None,) * 4


def test_the_shipped_network_is_nearer_than_kalman_among_such_people(scripts):
    _, forecasts = scripts
    episode, kinds = forecasts.crowd(10, 0.1, 3)
    both = {"kalman": Kalman(), "ours": SocialAttention()}
    found = forecasts.measure(both, episode, kinds, 3)
    assert found["ours"].seeds[0] < 0.85 * found["kalman"].seeds[0]
    assert 0.8 < np.mean(found["ours"].inside) < 1.0

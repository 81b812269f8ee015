"""What was learnt survives the file: fitted and updated predictors come back equal."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from wideberth.framework.plugins.config import build, describe, load_plugin, save_plugin
from wideberth.framework.plugins.registry import load, names
from wideberth.framework.plugins.yamlfile import dump, parse
from wideberth.framework.predictor import Adaptive, Fittable, Predictor
from wideberth.framework.values.tracks import Tracks
from wideberth.predictors.functional_constant import FunctionalConstant
from wideberth.predictors.mixture_density import MixtureDensity
from wideberth.predictors.single_gaussian import SingleGaussian

LEARNERS = [name for name in names("predictors") if issubclass(load("predictors", name), Fittable)]
ADAPTING = [name for name in names("predictors") if issubclass(load("predictors", name), Adaptive)]
SHORT: dict[str, Fittable] = {
    "functional_constant": FunctionalConstant(tail=0.2, steps=4),
    "mixture_density": MixtureDensity(rounds=1),
    "single_gaussian": SingleGaussian(MixtureDensity(rounds=1)),
}
"""A network trained for a moment has as many numbers as any other; so have scales of 4 steps, of
which the crowds have enough moments."""
FEW = {"bayesian_var": 6, "cascade": 12, "coordinated_turn": 3, "imm": 3}
"""People per recording for those whose fit is a long search."""


def crowd(seed: int, rows: int = 40) -> Tracks:
    """People whose velocity drifts."""
    rng = np.random.default_rng(seed)
    velocity = rng.normal(0, 0.7, (30, 1, 2)) + np.cumsum(rng.normal(0, 0.05, (30, rows, 2)), 1)
    positions = np.cumsum(0.4 * velocity, axis=1) + rng.normal(0, 0.01, (30, rows, 2))
    noise = np.tile(1e-4 * np.eye(2), (30, 1, 1))
    return Tracks(positions, 0.4, tuple(map(str, range(30))), np.full(30, 0.3), noise)


def same(first: Predictor, second: Predictor, tracks: Tracks) -> None:
    assert repr(second) == repr(first) and describe(second) == describe(first)
    one, two = first.predict(tracks, 5), second.predict(tracks, 5)
    assert np.array_equal(one.mean, two.mean) and np.array_equal(one.covariance, two.covariance)
    assert one.fallback == two.fallback


@pytest.mark.parametrize("name", LEARNERS)
def test_fitted_predictors_come_back_equal(name: str, tmp_path: Path) -> None:
    predictor = SHORT.get(name) or load("predictors", name)()
    people = list(range(FEW.get(name, 30)))
    fitted = predictor.fit([crowd(seed).select(people) for seed in (0, 1)])
    path = save_plugin(tmp_path / "p.json", "predictors", fitted)
    same(fitted, load_plugin(path, "predictors"), crowd(2))
    same(fitted, build("predictors", {"saved": str(path)}), crowd(2))
    same(fitted, build("predictors", parse(dump(describe(fitted)), "a result's config")), crowd(2))


@pytest.mark.parametrize("name", ADAPTING)
def test_updated_predictors_come_back_equal_and_go_on(name: str, tmp_path: Path) -> None:
    run = crowd(3)
    rows = [
        replace(run, positions=run.positions[:, end - 10 : end], stamp=0.4 * end)
        for end in range(10, 30)
    ]
    updated = load("predictors", name)()
    for seen in rows[:-1]:
        updated = updated.update(seen)
    again = load_plugin(save_plugin(tmp_path / "p.json", "predictors", updated), "predictors")
    same(updated, again, rows[-1])
    same(updated.update(rows[-1]), again.update(rows[-1]), rows[-1])

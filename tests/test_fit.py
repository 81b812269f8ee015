"""`wideberth fit`: recordings in, a saved predictor out, and refusals that tell the way."""

import os
import sys
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Self

import numpy as np
import pytest

from wideberth.experiments import cli
from wideberth.experiments.crowd import DATA
from wideberth.experiments.fitting import learnt, read_files
from wideberth.framework import registry
from wideberth.framework.errors import WideberthError
from wideberth.framework.forecast import Forecast, Scene
from wideberth.framework.predictor import Fittable
from wideberth.framework.recordings import read_tracks
from wideberth.framework.registry import ROOMS, register
from wideberth.framework.saved import load_plugin
from wideberth.framework.tracks import Tracks
from wideberth.framework.windows import cut_windows
from wideberth.predictors.static import Static

CROWD = str(DATA / "crowd.txt")
ROBOT = str(DATA / "robot.txt")


@dataclass(frozen=True)
class Speeds:
    windows: int
    mean: tuple[float, ...]
    noise: float


@dataclass(frozen=True)
class Pacer(Fittable):
    """Learns the mean step along each axis."""

    fitted: Speeds | None = None
    samples: int = 2

    def fit(self, dataset: "list[Tracks]") -> Self:  # type: ignore[override]
        windows = [cut_windows(scene, self.samples, 1) for scene in dataset]
        steps = np.concatenate([one.future[:, 0] - one.tracks.positions[:, -1] for one in windows])
        mean = tuple(steps.mean(axis=0).tolist())
        noise = float(dataset[0].noise[0, 0, 0])
        return replace(self, fitted=Speeds(len(steps), mean, noise))

    def predict(self, tracks: Tracks, steps: int, scene: Scene | None = None) -> Forecast:
        return Static().predict(tracks, steps, scene)


@pytest.fixture(autouse=True)
def _place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(os, "environ", dict(os.environ))
    monkeypatch.setattr(registry, "_registered", {room: {} for room in ROOMS})
    register("predictors", "pacer")(Pacer)


@pytest.fixture
def shell(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]):  # type: ignore[no-untyped-def]
    def call(*arguments: str) -> tuple[int, str, str]:
        monkeypatch.setattr(sys, "path", list(sys.path))
        with pytest.raises(SystemExit) as end:
            cli.main(list(arguments))
        printed = capsys.readouterr()
        code = end.value.code
        return (code if isinstance(code, int) else 0), printed.out, printed.err

    return call


def brute_force(path: str, dt: float) -> tuple[int, np.ndarray]:
    """Steps between three rows in a row, counted one by one."""
    steps = []
    for track in read_tracks(path, dt=dt).positions:
        for k in range(2, len(track)):
            if np.isfinite(track[k - 2 : k + 1]).all():
                steps.append(track[k] - track[k - 1])
    return len(steps), np.mean(steps, axis=0)


def test_what_is_fitted_is_saved_and_said(shell) -> None:  # type: ignore[no-untyped-def]
    code, out, error = shell("fit", "pacer", CROWD, "--dt", "0.4", "--out", "p.json")
    assert code == 0, error
    fitted = load_plugin("p.json", "predictor")
    count, mean = brute_force(CROWD, 0.4)
    assert fitted.fitted.windows == count and fitted.fitted.noise == 0.05**2
    assert np.allclose(fitted.fitted.mean, mean, rtol=1e-12)
    assert f"learnt fitted.windows: {count}\n" in out
    assert "learnt fitted.mean: 2 numbers" in out and "samples" not in out.split("learnt", 1)[1]
    assert f"{CROWD}: " in out and "tracks usable" in out
    assert "written: p.json; in a config, predictor: {saved: p.json}" in out


def test_a_config_file_its_overrides_and_a_saved_one_are_taken(shell) -> None:  # type: ignore[no-untyped-def]
    Path("c.yaml").write_text("type: pacer\nsamples: 3\n")
    arguments = ("--dt", "0.5", "--noise", "0.01", "--set", "samples=4")
    code, out, error = shell("fit", "c.yaml", CROWD, ROBOT, *arguments, "--out", "p.json")
    assert code == 0, error
    first = load_plugin("p.json", "predictor")
    assert first.samples == 4 and first.fitted.noise == 0.01**2
    assert out.count("tracks usable") == 2
    Path("again.yaml").write_text("saved: p.json\n")
    code, _, error = shell("fit", "again.yaml", ROBOT, "--dt", "0.5", "--out", "q.json")
    assert code == 0, error
    second = load_plugin("q.json", "predictor")
    assert second.samples == 4 and second.fitted.windows < first.fitted.windows


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("kalmann", CROWD), "did you mean 'kalman'"),
        (("static", CROWD), "static learns nothing from recordings"),
        (("static", CROWD), "those that do: .*pacer"),
        (("cascade", CROWD, "--set", "stages=[{predictor: static}]"), "cascade learnt nothing"),
        (("pacer", "none.txt"), r"none\.txt cannot be read"),
        (("pacer", CROWD, CROWD), "given twice"),
        (("pacer", CROWD, "--out", "none/p.json"), "its folder does not exist"),
        (("pacer", CROWD, "--dt", "0"), "dt is 0"),
        (("pacer", CROWD, "--set", "samples=0"), "observed is 0"),
        (("pacer", CROWD, "--set", "size=0"), "unknown key 'size'"),
    ],
)
def test_refusals(shell, arguments: tuple[str, ...], words: str) -> None:  # type: ignore[no-untyped-def]
    import re

    code, _, error = shell("fit", "--dt", "0.4", "--out", "p.json", *arguments)
    assert code == 2 and re.search(words, error.replace("\n", " ")), error
    assert not Path("p.json").exists()


def test_no_file_is_refused() -> None:
    with pytest.raises(WideberthError, match="wanted one text file at least"):
        read_files([], 0.4)


def test_learnt_walks_into_nested_predictors() -> None:
    fitted = replace(Pacer(), fitted=Speeds(7, (1.0, 2.0), 0.1))
    assert learnt(Pacer(), fitted) == [
        "fitted.windows: 7", "fitted.mean: 2 numbers", "fitted.noise: 0.1",
    ]  # fmt: skip
    before = {"stages": [{"base": {"table": None}}, {"base": 1}]}
    after = {"stages": [{"base": {"table": [[1.0, 2.0], [3.0, 4.0]]}}, {"base": 1}]}
    assert learnt(before, after) == ["stages.0.base.table: 4 numbers"]

"""`wideberth fit`: recordings in, a saved predictor out, and refusals that tell the way."""

import math
import os
import subprocess
import sys
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Self

import numpy as np
import pytest

from wideberth.experiments.cli import app as cli
from wideberth.experiments.cli.fitting import learnt, read_files
from wideberth.experiments.studies.crowd import DATA
from wideberth.framework.plugins import registry
from wideberth.framework.plugins.config import load_plugin
from wideberth.framework.plugins.registry import ROOMS, register
from wideberth.framework.predictor import Fittable
from wideberth.framework.values.errors import WideberthError
from wideberth.framework.values.forecast import Forecast, Scene
from wideberth.framework.values.tracks import Tracks
from wideberth.predictors.data.recordings import read_tracks
from wideberth.predictors.data.windows import cut_windows
from wideberth.predictors.static import Static

CROWD = str(DATA / "crowd.txt")
ROBOT = str(DATA / "robot.txt")


FORGOT = """
from dataclasses import dataclass
from wideberth.framework.predictor import Fittable

@dataclass(frozen=True)
class NoneFit(Fittable):
    def fit(self, dataset):
        pass
    def predict(self, tracks, steps, scene=None):
        pass
"""
MINE = """
from dataclasses import dataclass, replace
from wideberth.framework.predictor import Fittable
from wideberth.framework.plugins.registry import register
from wideberth.predictors.static import Static

@register("predictors", "mine")
@dataclass(frozen=True)
class Mine(Fittable):
    people: int = 0
    def fit(self, dataset):
        return replace(self, people=sum(map(len, dataset)))
    def predict(self, tracks, steps, scene=None):
        return Static().predict(tracks, steps, scene)
"""


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


def walking_speed(path: str) -> float:
    recording = read_tracks(path, dt=0.4)
    speeds = [
        math.dist(*pair) / 0.4
        for track in recording.positions
        for pair in pairwise(track.tolist())
    ]
    return float(np.median([speed for speed in speeds if speed > 0.1]))


def test_what_is_fitted_is_saved_and_said(shell) -> None:  # type: ignore[no-untyped-def]
    code, out, error = shell("fit", "pacer", CROWD, "--dt", "0.4", "--out", "p.json")
    assert code == 0, error
    fitted = load_plugin("p.json", "predictor")
    count, mean = brute_force(CROWD, 0.4)
    assert fitted.fitted.windows == count
    # The file was made with 1 cm; nobody says so.
    estimate = read_tracks(CROWD, dt=0.4).noise
    assert fitted.fitted.noise == estimate.deviation**2 and abs(estimate.deviation - 0.01) < 0.002
    assert np.allclose(fitted.fitted.mean, mean, rtol=1e-12)
    assert f"learnt fitted.windows: {count}\n" in out
    assert "learnt fitted.mean: 2 numbers" in out and "samples" not in out.split("learnt", 1)[1]
    assert f"{CROWD}: " in out and "tracks usable" in out
    assert f"  {estimate.text}\n" in out
    assert f"median speed of those who move: {walking_speed(CROWD):.3g} m/s\n" in out
    assert "is dt right" not in out
    assert "written: p.json; in a config, predictor: {saved: p.json} and plugins: [" in out


def test_a_config_file_its_overrides_and_a_saved_one_are_taken(shell) -> None:  # type: ignore[no-untyped-def]
    Path("c.yaml").write_text("type: pacer\nsamples: 3\n")
    arguments = ("--dt", "0.5", "--noise", "0.03", "--set", "samples=4")
    code, out, error = shell("fit", "c.yaml", CROWD, ROBOT, *arguments, "--out", "p.json")
    assert code == 0, error
    first = load_plugin("p.json", "predictor")
    assert first.samples == 4 and first.fitted.noise == 0.03**2
    assert out.count("tracks usable") == 2
    assert out.count("measurement noise stated as 0.03 m") == 2
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
        (
            ("single_gaussian", CROWD, "--set", "base={type: smoothed, base: kalman}"),
            "single_gaussian learnt nothing: no part that its fit reaches",
        ),
        (("pacer", "none.txt"), r"none\.txt cannot be read"),
        (("pacer", "."), r"a folder without a file \*\.txt; .* as in \*\.csv"),
        (("none.json", CROWD), r"no such file: none\.json"),
        (("walkers/none", CROWD), "no such file: walkers/none"),
        (("odd.yaml", CROWD), r"odd\.yaml: unknown key 'savd': did you mean 'saved'"),
        (("nothing.yaml", CROWD), r"nothing\.yaml: empty; wanted type: NAME"),
        (
            ("forgot:NoneFit", CROWD),
            "the fit of forgot:NoneFit returned None; wanted a fitted copy",
        ),
        (("pacer", CROWD, "--noise", "-0.1"), "noise is -0.1"),
        (("pacer", CROWD, "--noise", "nan"), "noise is nan"),
        (("pacer", CROWD, "--noise", "5"), "noise is 5 m; wanted at most 1"),
        (("pacer", CROWD, CROWD), "given twice"),
        (("pacer", CROWD, "--out", "none/p.json"), "its folder does not exist"),
        (("pacer", CROWD, "--dt", "0"), "dt is 0"),
        (("pacer", CROWD, "--set", "samples=0"), "observed is 0"),
        (("pacer", CROWD, "--set", "size=0"), "unknown key 'size'"),
    ],
)
def test_refusals(shell, arguments: tuple[str, ...], words: str) -> None:  # type: ignore[no-untyped-def]
    import re

    Path("odd.yaml").write_text("savd: p.json\n")
    Path("nothing.yaml").write_text("{}\n")
    Path("forgot.py").write_text(FORGOT)
    code, _, error = shell("fit", "--dt", "0.4", "--out", "p.json", *arguments)
    assert code == 2 and re.search(words, error.replace("\n", " ")), error
    assert not Path("p.json").exists()


def test_a_wrong_dt_or_unit_is_noticed(shell) -> None:  # type: ignore[no-untyped-def]
    code, out, _ = shell("fit", "pacer", CROWD, "--dt", "0.04", "--out", "p.json")
    assert code == 0 and out.count("is dt right, are positions in metres?") == 1
    assert "  warning: median speed " in out
    small = read_tracks(CROWD, dt=0.4).positions * 1000.0
    Path("mm.txt").write_text(
        "".join(
            f"{row} {who} {x} {y}\n"
            for who, track in enumerate(small)
            for row, (x, y) in enumerate(track)
            if np.isfinite(x)
        )
    )
    code, out, error = shell("fit", "pacer", "mm.txt", "--dt", "0.4", "--out", "q.json")
    assert code == 2 and error.count("Error:") == 1 and not out
    asked = "m/s of those who move: is dt right, are positions in metres? dt is 0.4 s; wanted"
    assert error.startswith("Error: mm.txt: median speed ") and f"963 {asked}" in error
    code, out, error = shell("fit", "pacer", CROWD, "--dt", "400", "--out", "q.json")
    assert (code, out, error) == (2, "", "Error: dt is 400 s; is it in ms?\n")
    Path("few.txt").write_text("0 1 2 3\n")
    code, _, error = shell("fit", "pacer", "few.txt", "--dt", "0.4", "--out", "q.json")
    assert code == 2 and "few.txt holds no usable track: 0 of 1" in error


def test_what_stays_as_it_was_is_said_and_written(shell) -> None:  # type: ignore[no-untyped-def]
    rest = (CROWD, str(DATA / "plaza.txt"), "--dt", "0.4", "--out")
    for arguments in (("kalman",), ("adaptive_conformal", "--set", "base.base=static")):
        code, _, error = shell("fit", *arguments, *rest, "p.json")
        assert code == 0, error
        code, out, error = shell("fit", "p.json", *rest, "q.json")
        assert code == 0, error
        assert "learnt nothing new: every number is what it was before" in out
        assert Path("q.json").read_bytes() == Path("p.json").read_bytes()


def test_what_may_stand_for_the_predictor_and_the_recordings(shell) -> None:  # type: ignore[no-untyped-def]
    Path("places").mkdir()
    for name in ("a.txt", "b.txt"):
        Path("places", name).write_bytes(Path(CROWD).read_bytes())
    Path("inner.yaml").write_text("predictor: {type: pacer, samples: 3}\n")
    Path("name.yaml").write_text("predictor: pacer\nplugins: []\n")
    rest = ("places", "--dt", "0.4", "--out")
    assert shell("fit", "inner.yaml", *rest, "one.json")[0] == 0
    assert shell("fit", "name.yaml", *rest, "two.json", "--set", "samples=3")[0] == 0
    assert shell("fit", "one.json", *rest, "four.json", "--set", "samples=4")[0] == 0
    first, second, third = (
        load_plugin(file, "predictor") for file in ("one.json", "two.json", "four.json")
    )
    assert first == second and (first.samples, third.samples) == (3, 4)
    windows = read_files(["places"], 0.4)
    assert list(windows) == ["places/a.txt", "places/b.txt"]
    assert third.fitted.windows < first.fitted.windows
    for target in ("one.json", "inner.yaml", "name.yaml"):
        code, out, error = shell("check", "predictor", target)
        assert code == 0 and "keeps the laws of predictors" in out, error
    code, _, error = shell("check", "predictor", "none.json")
    assert code == 2 and "no such file: none.json" in error


def test_home_is_expanded(shell, monkeypatch: pytest.MonkeyPatch) -> None:  # type: ignore[no-untyped-def]
    monkeypatch.setenv("HOME", str(Path.cwd()))
    Path("people.txt").write_bytes(Path(CROWD).read_bytes())
    code, _, error = shell("fit", "pacer", "~/people.txt", "--dt", "0.4", "--out", "~/p.json")
    assert code == 0, error
    Path("again.yaml").write_text("saved: ~/p.json\n")
    assert shell("fit", "~/again.yaml", CROWD, "--dt", "0.4", "--out", "q.json")[0] == 0
    assert load_plugin("~/q.json", "predictor") == load_plugin("p.json", "predictor")


def test_the_hint_names_what_a_registered_one_needs() -> None:
    """In another process, which knows of no registration, the printed config builds it."""
    Path("mine.py").write_text(MINE)
    Path("fresh.yaml").write_text("type: mine\nplugins: [mine]\n")
    for target in ("fresh.yaml", "mine:Mine"):
        done = command("fit", target, CROWD, "--dt", "0.4", "--out", "p.json")
        hint = "predictor: {saved: p.json} and plugins: [mine]\n"
        assert done.returncode == 0 and done.stdout.endswith(hint), done.stderr
        Path("c.yaml").write_text("predictor: {saved: p.json}\nplugins: [mine]\n")
        done = command("check", "predictor", "c.yaml")
        assert done.returncode == 0, done.stderr


def command(*arguments: str) -> "subprocess.CompletedProcess[str]":
    script = "from wideberth.experiments.cli.app import main; main()"
    return subprocess.run(
        [sys.executable, "-c", script, *arguments], capture_output=True, text=True, check=False
    )


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

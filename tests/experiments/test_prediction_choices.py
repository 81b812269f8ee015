"""What the prediction benchmark is asked for: which predictors, which scenes, fitted or not."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Self

import numpy as np
import pytest

from wideberth.experiments.cli.fitting import described
from wideberth.experiments.engine import runner
from wideberth.experiments.engine.base import Row
from wideberth.experiments.engine.shipped_configs import read_experiment
from wideberth.experiments.studies.prediction_benchmark import PredictionBenchmark
from wideberth.experiments.studies.prediction_data import (
    PredictionData,
    Protocol,
    SceneFiles,
    longest_stretch,
    shown_windows,
)
from wideberth.framework.plugins.config import save_plugin
from wideberth.framework.predictor import Fittable, Predictor
from wideberth.framework.values.arrays import Array
from wideberth.framework.values.errors import WideberthError
from wideberth.framework.values.forecast import Forecast, Scene
from wideberth.framework.values.tracks import Tracks
from wideberth.predictors.constant_velocity import ConstantVelocity
from wideberth.predictors.data.recordings import Recording, usual_speed
from wideberth.predictors.kalman import Kalman
from wideberth.predictors.single_gaussian import SingleGaussian

SMALL = Protocol(observed=3, predicted=4, draws=9)
LAST: dict[str, Predictor] = {"last": ConstantVelocity(window=1)}


@dataclass(frozen=True)
class Counter(Fittable):
    """Knows from how many recordings it has learnt, and tells by its reason."""

    recordings: int = -1

    def fit(self, dataset: "list[Tracks]") -> Self:  # type: ignore[override]
        return replace(self, recordings=len(dataset))

    def predict(self, tracks: Tracks, steps: int, scene: Scene | None = None) -> Forecast:
        forecast = ConstantVelocity().predict(tracks, steps)
        word = "never" if self.recordings < 0 else "I" * self.recordings
        return replace(forecast, fallback=(f"learnt {word}",) * len(tracks))


def straight(speed: float, count: int = 3, rows: int = 12, dt: float = 0.4) -> Array:
    """(O, T, 2): people side by side who walk along x."""
    clock = dt * np.arange(rows)
    tracks = [np.stack([speed * clock, 0 * clock + 2.0 * i], axis=1) for i in range(count)]
    return np.array(tracks, dtype=np.float64)


def write(folder: Path, *files: str, tracks: Array | None = None) -> PredictionData:
    """Write the same tracks into several files of rows `frame id x y`."""
    positions = straight(1.25) if tracks is None else tracks
    lines = [
        f"{10 * row} {who} {x!r} {y!r}"
        for who, track in enumerate(positions.tolist())
        for row, (x, y) in enumerate(track)
        if np.isfinite(x)
    ]
    for file in files:
        (folder / file).write_text("\n".join(lines) + "\n")
    return PredictionData(str(folder))


def benchmark(data: PredictionData, **more: Any) -> PredictionBenchmark:
    settings: dict[str, Any] = {"predictors": LAST, "registered": False, "protocol": SMALL}
    return PredictionBenchmark(data=data, **{**settings, **more})


def rows_of(experiment: PredictionBenchmark) -> list[Row]:
    return [row for task in experiment.tasks() for row in experiment.measure(task).rows]


def failure(experiment: PredictionBenchmark) -> str:
    with pytest.raises(WideberthError) as raised:
        experiment.tasks()
    return str(raised.value)


def test_chosen_predictors_are_scored_and_no_others(tmp_path: Path) -> None:
    data = write(tmp_path, "a.txt")
    everything = benchmark(data, registered=True)
    assert everything.family()[0] == "last" and "oracle" not in everything.family()
    some = replace(everything, chosen=("static", "last"))
    assert [task.name for task in some.tasks()] == ["static a", "last a"]
    assert replace(some, registered=False).family() == ["static", "last"]
    assert replace(some, chosen=("oracle",)).family() == ["oracle"]  # though left out
    many = ("static", "last", "kalman", "imm")
    assert replace(some, chosen=many).quick().family() == list(many)
    assert len(everything.quick().family()) == 3
    message = failure(replace(some, chosen=("kalmann",)))
    assert "chosen: unknown predictor 'kalmann': did you mean 'kalman'" in message
    message = failure(replace(some, as_given=("lst",)))
    assert "as_given: unknown predictor 'lst': did you mean 'last'" in message
    message = failure(replace(some, chosen=("mine:Own",)))
    assert """--set 'predictors.own={type: "mine:Own"}'""" in message
    assert "'chosen' names predictors" in failure(replace(some, only=("kalman",)))
    assert "'chosen'" not in failure(replace(some, only=("nowhere",)))


def test_what_is_given_fitted_is_not_fitted_anew(tmp_path: Path) -> None:
    data = write(tmp_path, "a.txt", "b.txt", "c.txt")
    given: dict[str, Predictor] = {"mine": Counter(5), "new": Counter(), **LAST}
    experiment = benchmark(data, predictors=given, as_given=("mine",))
    rows = rows_of(experiment)
    said = {(row["predictor"], row["fitted"]) for row in rows}
    assert said == {
        ("mine", "as given"),
        ("new", "fitted to 2 recordings"),
        ("last", "nothing to fit"),
    }
    reasons = {row["predictor"]: row["reasons"] for row in rows if row["step"] == "all"}
    assert reasons["mine"] == "100.0%: learnt IIIII" and reasons["new"] == "100.0%: learnt II"
    lines = experiment.summary(rows)
    assert [line["fitted"] for line in lines] == 4 * ["as given", "yes", None]
    assert "fitted to 2 recordings" in lines[1]["notes"]
    assert {row["fitted"] for row in rows_of(replace(experiment, fit=False))} == {
        "as given",
        "nothing to fit",
    }


def test_a_saved_predictor_is_scored_as_it_was_saved(tmp_path: Path) -> None:
    folder = tmp_path / "recordings"
    folder.mkdir()
    write(folder, "a.txt", tracks=straight(1.25, rows=8))
    write(folder, "b.txt", tracks=straight(1.25, count=12, rows=40))  # enough to learn from
    file = save_plugin(tmp_path / "mine.json", "predictor", Kalman(acceleration_density=7.0))
    experiment, _ = read_experiment(
        "prediction_benchmark",
        [
            f"data.root={folder}",
            f"predictors.mine={{saved: {file}}}",
            "as_given=[mine]",
            "chosen=[mine]",
            "only=[a]",
            "protocol={observed: 3, predicted: 4, draws: 9}",
        ],
    )
    assert isinstance(experiment, PredictionBenchmark)
    direct = benchmark(
        experiment.data, predictors={"mine": Kalman(acceleration_density=7.0)},
        fit=False, only=("a",),
    )  # fmt: skip
    areas = [[row["area_m2"] for row in rows_of(one)] for one in (experiment, direct)]
    assert areas[0] == areas[1]
    anew = rows_of(replace(experiment, as_given=()))
    assert anew[0]["fitted"] == "fitted to 1 recording"
    assert [row["area_m2"] for row in anew] != areas[0]


def test_some_files_of_a_dataset(tmp_path: Path) -> None:
    """The way out that the message names is one."""
    known = {name: SceneFiles((f"{name}.txt",)) for name in ("east", "west", "north")}
    data = replace(write(tmp_path, "east.txt", "north.txt", "mine.txt"), scenes=known)
    experiment = benchmark(data, predictors={"counter": Counter()})
    message = failure(experiment)
    assert "data.scenes.west" in message and "no file 'west.txt'" in message
    assert "'only=[east, north]'" in message and "'data.scenes={}'" in message
    some = replace(experiment, only=("east", "north"))
    assert {row["fitted"] for row in rows_of(some)} == {"fitted to 1 recording (west not there)"}
    assert [path.name for path in some.inputs()] == ["east.txt", "north.txt"]
    assert "no file 'west.txt'" in failure(replace(experiment, only=("west",)))
    every = replace(data, scenes={})
    assert list(every.found()) == ["east", "mine", "north"]
    emptied, _ = read_experiment("prediction_benchmark", ["data.scenes={}"])
    assert isinstance(emptied, PredictionBenchmark) and emptied.data.scenes == {}


def test_shipped_scenes_are_of_one_kind() -> None:
    scenes = {}
    for name in ("prediction_benchmark", "prediction_robots", "prediction_schoeller"):
        experiment, _ = read_experiment(name, [])
        assert isinstance(experiment, PredictionBenchmark)
        scenes[name] = list(experiment.scored())
    crowds = ["crowd", "plaza"]
    assert list(scenes.values()) == [crowds, ["robot"], crowds]


def test_too_short_recordings_are_told_with_the_way_out(tmp_path: Path) -> None:
    tracks = straight(1.0, rows=30)
    tracks[:, 6::7] = np.nan  # at most 6 rows in a row
    write(tmp_path, "short.txt", tracks=tracks)
    data = write(tmp_path, "long.txt")
    message = failure(benchmark(data))
    assert "3 + 4 consecutive rows of 0.4 s: its longest track has 6;" in message
    assert "--set 'only=[long]'" in message
    assert benchmark(data, only=("long",)).tasks()
    assert "only=" not in failure(benchmark(data, only=("short",)))


def test_longest_stretch_and_usual_speed_of_made_tracks() -> None:
    rng = np.random.default_rng(0)
    positions = rng.standard_normal((5, 40, 2))
    positions[rng.random((5, 40)) < 0.3] = np.nan
    names, times = tuple("abcde"), np.array(0.4 * np.arange(40), dtype=np.float64)
    gaps = Recording(0.4, times, names, positions, (None,) * 5)
    runs = [
        len(run)
        for track in np.isfinite(positions[..., 0])
        for run in "".join("x" if seen else " " for seen in track).split()
    ]
    assert longest_stretch(gaps) == max(runs)
    walk, stand = straight(1.25, count=2, rows=40), straight(0.0, count=3, rows=40)
    both = Recording(0.4, times, names, np.concatenate([walk, stand]), (None,) * 5)
    assert usual_speed([both]) == pytest.approx(1.25, rel=1e-9)  # the standing do not count
    still = replace(both, positions=np.zeros((5, 40, 2)))
    assert np.isnan(usual_speed([still]))
    slow = replace(both, positions=both.positions * 0.05)  # robots of 0.0625 m/s
    assert usual_speed([slow]) == pytest.approx(0.0625, rel=1e-9)
    assert "median speed of those who move: 0.0625 m/s" in described(slow)
    assert "all stand still" in described(still) and "nan" not in described(still)


def test_no_line_says_fitted_where_nothing_learns(tmp_path: Path) -> None:
    data = write(tmp_path, "a.txt", "b.txt")
    given: dict[str, Predictor] = {"mine": SingleGaussian(base=ConstantVelocity()), **LAST}
    rows = rows_of(benchmark(data, predictors=given))
    assert {row["fitted"] for row in rows} == {"nothing to fit"}
    assert not any("fit" in row["protocol"] for row in rows)


def test_a_wrong_time_between_rows_is_told(tmp_path: Path) -> None:
    data = write(tmp_path, "a.txt", "b.txt")
    right = benchmark(data)
    first, scene, *_ = (line["notes"] for line in right.summary(rows_of(right)))
    assert "is dt right" not in first
    assert "median speed 1.25 m/s of those who move" in scene
    tenth = benchmark(replace(data, dt=0.04))
    rows = rows_of(tenth)
    assert rows[0]["speed_mps"] == pytest.approx(12.5)
    notes = [line["notes"] for line in tenth.summary(rows)]
    said = "a: median speed 12.5 m/s of those who move: is dt right, are positions in metres?"
    assert said in notes[0] and said in notes[1] and "b: median" in notes[0]
    small = replace(data, dt=0.0004)  # as if all were in millimetres
    with pytest.raises(
        WideberthError, match=r"a\.txt: median speed 1\.25e\+03 m/s .* in metres\?"
    ):
        small.read(small.found()["a"])
    with pytest.raises(WideberthError, match=r"^data\.dt is 400 s; is it in ms\?$"):
        replace(data, dt=400.0)
    with pytest.raises(WideberthError, match=r"^dt is 400 s; is it in ms\?$"):
        SceneFiles(("a.txt",), dt=400.0)


def test_one_scene_has_each_line_once_and_its_figures_no_means(tmp_path: Path) -> None:
    (tmp_path / "data").mkdir()
    experiment = benchmark(write(tmp_path / "data", "a.txt"))
    result = runner.run(experiment, tmp_path / "out")
    assert [line["scene"] for line in experiment.summary(result.rows)] == ["a"]
    assert {path.stem for path in runner.draw(result.folder)} >= {"coverage", "forecasts_usual"}


def test_the_forecasts_drawn_are_of_somebody_who_moves(tmp_path: Path) -> None:
    tracks = np.concatenate([straight(0.0, count=20), straight(1.25, count=2)])
    data = write(tmp_path, "a.txt", tracks=tracks)
    (recording,) = data.read(SceneFiles(("a.txt",)))
    shown = shown_windows(data, recording, SMALL, (0.0, 0.5, 1.0))
    assert {ident for _, ident in shown} <= {"20", "21"} and len(shown) == 3
    write(tmp_path, "a.txt", tracks=straight(0.0))
    (recording,) = data.read(SceneFiles(("a.txt",)))
    assert len(shown_windows(data, recording, SMALL, (0.5,))) == 1  # nobody moves

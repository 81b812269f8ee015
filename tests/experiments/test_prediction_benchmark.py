"""The prediction benchmark: its windows by brute force, who may learn from what, its files."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Self

import numpy as np
import pytest

from wideberth.experiments.engine import runner
from wideberth.experiments.engine.base import Row
from wideberth.experiments.engine.csv_tables import read_table
from wideberth.experiments.engine.shipped_configs import read_experiment
from wideberth.experiments.studies.crowd import DATA
from wideberth.experiments.studies.prediction_benchmark import PredictionBenchmark
from wideberth.experiments.studies.prediction_data import (
    PredictionData,
    Protocol,
    SceneFiles,
    moments,
    window_places,
)
from wideberth.framework.predictor import Adaptive, Fittable, Predictor
from wideberth.framework.values.arrays import Array
from wideberth.framework.values.errors import WideberthError
from wideberth.framework.values.forecast import Forecast, Scene
from wideberth.framework.values.tracks import Tracks
from wideberth.predictors.constant_velocity import ConstantVelocity
from wideberth.predictors.data.recordings import Recording

SMALL = Protocol(observed=3, predicted=4, draws=19)


def write(folder: Path, name: str, tracks: dict[str, Array], step: int = 10) -> None:
    """Write tracks, (T, 2) with NaN where unseen, as rows `frame id x y`."""
    lines = [
        f"{step * row} {ident} {x!r} {y!r}"
        for ident, positions in tracks.items()
        for row, (x, y) in enumerate(positions.tolist())
        if np.isfinite(x)
    ]
    folder.mkdir(exist_ok=True)
    (folder / name).write_text("\n".join(lines) + "\n")


def wanderers(seed: int, count: int = 4, rows: int = 30, gaps: bool = False) -> dict[str, Array]:
    rng = np.random.default_rng(seed)
    walks = np.cumsum(0.3 * rng.standard_normal((count, rows, 2)), axis=1)
    if gaps:
        walks[rng.random((count, rows)) < 0.1] = np.nan
    return {str(seed * 100 + i): walk for i, walk in enumerate(walks)}


@dataclass(frozen=True)
class Spy(Fittable):
    """Tells by its reason whom it was fitted to."""

    learnt: str = "nobody"

    def fit(self, dataset: "list[Tracks]") -> Self:  # type: ignore[override]
        firsts = sorted({ident[:-2] for scene in dataset for ident in scene.ids})
        return replace(self, learnt="/".join(f"scene{first}x" for first in firsts))

    def predict(self, tracks: Tracks, steps: int, scene: Scene | None = None) -> Forecast:
        assert scene is None
        mean = np.repeat(np.nan_to_num(tracks.positions[:, -1:]), steps, axis=1)
        spread = np.tile(np.eye(2), (len(tracks), steps, 1, 1))
        reasons = (f"learnt from {self.learnt}",) * len(tracks)
        return Forecast.single(mean, spread, tracks.dt, reasons)


@dataclass(frozen=True)
class Diary(Adaptive):
    """Notes the rows that it was shown; only forecasts after exactly the rows so far."""

    rows: tuple[float, ...] = ()

    def update(self, tracks: Tracks, scene: Scene | None = None) -> Self:
        return replace(self, rows=(*self.rows, tracks.stamp))

    def predict(self, tracks: Tracks, steps: int, scene: Scene | None = None) -> Forecast:
        shown = [round(stamp / tracks.dt) for stamp in self.rows]
        assert shown == list(range(round(tracks.stamp / tracks.dt) + 1))
        return ConstantVelocity(window=1).predict(tracks, steps)


def brute_force(recording: Recording, how: Protocol) -> list[tuple[int, int, int]]:
    """(row, track, rows that follow) of every window, by looking at one sample at a time."""
    found = []
    for row in range(len(recording.times)):
        for track in range(len(recording.ids)):

            def seen(at: int, who: int = track) -> bool:
                inside = 0 <= at < len(recording.times)
                return inside and bool(np.isfinite(recording.positions[who, at]).all())

            if not all(seen(row - back) for back in range(how.observed)):
                continue
            ahead = 0
            while ahead < how.predicted and seen(row + 1 + ahead):
                ahead += 1
            if ahead >= (how.predicted if how.windows == "full" else 2):
                found.append((row, track, ahead))
    return found


@pytest.mark.parametrize("windows", ["full", "schoeller"])
def test_windows_by_brute_force(tmp_path: Path, windows: str) -> None:
    write(tmp_path, "a.txt", wanderers(1, gaps=True))
    data = PredictionData(str(tmp_path))
    (recording,) = data.read(SceneFiles(("a.txt",)))
    how = replace(SMALL, windows=windows)
    wanted = brute_force(recording, how)
    places = window_places(data, recording, how)
    assert [tuple(place) for place in places.tolist()] == [(o, row) for row, o, _ in wanted]
    assert 0 < len(wanted) < 4 * 24  # the gaps matter
    ahead = {(row, track): known for row, track, known in wanted}
    for moment in moments(data, recording, how):
        here = np.flatnonzero(np.isfinite(recording.positions[:, moment.row, 0]))
        assert moment.tracks.ids == tuple(recording.ids[i] for i in here)  # everybody seen
        assert moment.tracks.positions.shape[1] == how.observed
        assert moment.tracks.stamp == pytest.approx(0.4 * moment.row)
        for index, truth in zip(moment.scored, moment.truth, strict=True):
            track = recording.ids.index(moment.tracks.ids[index])
            known = ahead.pop((moment.row, track))
            assert np.isfinite(truth).all(axis=1).sum() == known
            real = recording.positions[track, moment.row + 1 : moment.row + 1 + known]
            np.testing.assert_array_equal(truth[:known], real)
    assert not ahead


def rows_of(experiment: PredictionBenchmark) -> list[Row]:
    return [row for task in experiment.tasks() for row in experiment.measure(task).rows]


@pytest.mark.parametrize("windows", ["full", "schoeller"])
def test_errors_by_brute_force(tmp_path: Path, windows: str) -> None:
    """ADE and FDE of the last step's velocity, against a loop over windows and steps."""
    write(tmp_path, "a.txt", wanderers(2, gaps=True))
    how = replace(SMALL, windows=windows)
    data = PredictionData(str(tmp_path))
    experiment = PredictionBenchmark(
        {"cv": ConstantVelocity(window=1)}, registered=False, data=data, protocol=how
    )
    (recording,) = data.read(SceneFiles(("a.txt",)))
    means, finals, firsts = [], [], []
    for row, track, ahead in brute_force(recording, how):
        at = recording.positions[track]
        gaps = [
            float(np.linalg.norm(at[row] + h * (at[row] - at[row - 1]) - at[row + h]))
            for h in range(1, ahead + 1)
        ]
        means.append(np.mean(gaps))
        finals.append(gaps[-1])
        firsts.append(gaps[0])
    rows = {row["step"]: row for row in rows_of(experiment) if row["slice"] == "all"}
    assert rows["all"]["windows"] == rows[1]["windows"] == len(means)
    assert rows["all"]["error_m"] == pytest.approx(np.mean(means), rel=1e-8)
    assert rows["all"]["median_m"] == pytest.approx(np.median(means), rel=1e-8)
    assert rows["all"]["final_m"] == pytest.approx(np.mean(finals), rel=1e-8)
    assert rows[1]["error_m"] == pytest.approx(np.mean(firsts), rel=1e-8)
    assert (rows[4]["windows"] < len(means)) == (windows == "schoeller")


def test_who_learns_from_whom(tmp_path: Path) -> None:
    for first in range(1, 7):
        write(tmp_path, f"{first}.txt", wanderers(first))
    scenes = {
        "one": SceneFiles(("1.txt", "2.txt")),
        "three": SceneFiles(("3.txt",)),
        "again": SceneFiles(("4.txt",), role="secondary", site="three"),
        "more": SceneFiles(("5.txt",), role="training"),
        "beside": SceneFiles(("6.txt",), role="training", site="three"),
    }
    data = PredictionData(str(tmp_path), scenes)
    experiment = PredictionBenchmark({"spy": Spy()}, registered=False, data=data, protocol=SMALL)
    rows = [row for row in rows_of(experiment) if row["step"] == "all"]
    reasons = {row["scene"]: row["reasons"] for row in rows if row["slice"] == "all"}
    assert reasons == {
        "one": "100.0%: learnt from scene3x/scene5x/scene6x",
        "three": "100.0%: learnt from scene1x/scene2x/scene5x",
        "again": "100.0%: learnt from scene1x/scene2x/scene5x",
    }
    lines = experiment.summary(rows_of(experiment))
    assert [line["scene"] for line in lines] == ["mean of 2", "one", "three", "again"]
    pair = [row for row in rows if row["scene"] in ("one", "three") and row["slice"] == "all"]
    mean = np.mean([row["error_m"] for row in pair])
    assert lines[0]["ade_m"] == pytest.approx(mean, rel=1e-8)
    unfitted = rows_of(replace(experiment, fit=False, only=("one",)))
    assert unfitted[0]["fitted"] == "as given"


def test_what_cannot_be_fitted_is_scored_and_named(tmp_path: Path) -> None:
    @dataclass(frozen=True)
    class Greedy(Fittable):
        def fit(self, dataset: "list[Tracks]") -> Self:  # type: ignore[override]
            raise WideberthError("greedy.fit: 0 windows; wanted at least 9")

        def predict(self, tracks: Tracks, steps: int, scene: Scene | None = None) -> Forecast:
            return ConstantVelocity().predict(tracks, steps)

    write(tmp_path, "a.txt", wanderers(1))
    predictors: dict[str, Predictor] = {"greedy": Greedy()}
    alone = PredictionBenchmark(
        predictors, registered=False, data=PredictionData(str(tmp_path)), protocol=SMALL
    )
    assert alone.summary(rows_of(alone))[0]["notes"].endswith("; not fitted: no other scene")
    write(tmp_path, "b.txt", wanderers(2))
    notes = alone.summary(rows_of(alone))[0]["notes"]
    assert notes.endswith("; not fitted: greedy.fit: 0 windows; wanted at least 9")


def test_what_adapts_sees_every_row_once_and_starts_anew(tmp_path: Path) -> None:
    """`Diary` refuses to forecast if it was shown anything but the rows up to now."""
    write(tmp_path, "a.txt", wanderers(1, gaps=True))
    write(tmp_path, "b.txt", wanderers(2, gaps=True))
    data = PredictionData(str(tmp_path), {"both": SceneFiles(("a.txt", "b.txt"))})
    how = replace(SMALL, stride=3)
    predictors: dict[str, Predictor] = {"diary": Diary()}
    experiment = PredictionBenchmark(predictors, registered=False, data=data, protocol=how)
    rows = rows_of(experiment)
    windows = sum(
        row % 3 == 0 for one in data.read(data.scenes["both"]) for row, *_ in brute_force(one, how)
    )
    (together,) = (row for row in rows if row["slice"] == "all" and row["step"] == "all")
    assert together["windows"] == windows > 0


def test_those_who_stop_are_scored_apart(tmp_path: Path) -> None:
    clock = 0.4 * np.arange(30)
    walk = np.array([1.2 * clock, 0 * clock], dtype=np.float64).T
    halt = np.array([1.2 * np.minimum(clock, 4.0), 0 * clock], dtype=np.float64).T
    write(tmp_path, "a.txt", {"walks": walk, "halts": halt})
    experiment = PredictionBenchmark(
        {"cv": ConstantVelocity(window=1)}, registered=False,
        data=PredictionData(str(tmp_path)), protocol=SMALL,
    )  # fmt: skip
    stops = [row for row in rows_of(experiment) if row["slice"] == "stops"]
    # The stop is at row 10. Of those who walk at rows 7 to 10 the forecast overshoots by what
    # is left of the 1.6 s: 0.4, 0.8, 1.2 and 1.6 s of 1.2 m/s.
    assert [row["windows"] for row in stops] == [4]
    assert stops[0]["final_m"] == pytest.approx(1.2 * np.mean([0.4, 0.8, 1.2, 1.6]), rel=1e-6)


def test_bad_input_is_refused_before_any_work(tmp_path: Path) -> None:
    def failure(data: PredictionData, **more: object) -> str:
        experiment = PredictionBenchmark(registered=False, data=data, **more)  # type: ignore[arg-type]
        with pytest.raises(WideberthError) as raised:
            experiment.tasks()
        return str(raised.value)

    assert "is no folder" in failure(PredictionData(str(tmp_path / "nowhere")))
    assert "holds no file '*.txt'" in failure(PredictionData(str(tmp_path)))
    assert "set data.pattern" in failure(PredictionData(str(tmp_path)))
    write(tmp_path, "a.txt", wanderers(1))
    assert "and the file in data.pattern" in failure(PredictionData(str(tmp_path / "a.txt")))
    scenes = {"first": SceneFiles(("a.txt",)), "second": SceneFiles(("b.txt",))}
    assert "second" in failure(PredictionData(str(tmp_path), scenes))
    assert "holds no file 'b.txt'" in failure(PredictionData(str(tmp_path), scenes))
    foreign = PredictionData(str(tmp_path), {"second": SceneFiles(("b.txt",))})
    assert list(foreign.found()) == ["a"]  # another dataset: every file is a scene
    long = Protocol(observed=20, predicted=12)
    assert "no window of 20 + 12" in failure(foreign, protocol=long)
    assert "did you mean 'a'" in failure(foreign, only=("aa",))
    (tmp_path / "c.txt").write_text("1 2 3\n")
    assert "c.txt, line 1: 3 columns" in failure(foreign)
    with pytest.raises(WideberthError, match="predicted is 1"):
        Protocol(predicted=1)
    with pytest.raises(WideberthError, match="files is empty"):
        SceneFiles(())


@pytest.mark.parametrize("name", ["prediction_benchmark", "prediction_robots"])
def test_shipped_configs_run_quickly_and_repeat(name: str, tmp_path: Path) -> None:
    experiment, _ = read_experiment(name, ["registered=false"])
    assert isinstance(experiment, PredictionBenchmark)
    few = dict(list(experiment.predictors.items())[:1]) or {"cv": ConstantVelocity()}
    small = replace(experiment, predictors={**few, "last": ConstantVelocity(window=1)})
    first = runner.run(small, tmp_path / "first", quick=True)
    second = runner.run(small, tmp_path / "second", quick=True)
    for file in ("table.csv", "summary.csv"):
        assert (first.folder / file).read_bytes() == (second.folder / file).read_bytes()
    assert {row["predictor"] for row in first.rows} == {*few, "last"}
    assert len({row["scene"] for row in first.rows}) == 1
    assert all(str(row["protocol"]).endswith("floor 0.01 m") for row in first.rows)
    assert len(first.times) == 2 and first.times[0]["predict_us_per_obstacle"] > 0
    drawn = runner.draw(first.folder)
    kinds = {"calibration", "coverage", "coverage_by_speed", "error", "area"}
    kinds |= {"forecasts_usual", "forecasts_surprising"}
    assert {path.stem for path in drawn} == kinds
    assert {path.suffix for path in drawn} == {".png", ".pdf"}
    summary = read_table(first.folder / "summary.csv")
    assert str(first.rows[0]["protocol"]) in summary[0]["notes"]


def test_schoeller_is_shipped_with_its_protocol() -> None:
    experiment, _ = read_experiment("prediction_schoeller", [])
    assert isinstance(experiment, PredictionBenchmark)
    assert experiment.protocol.windows == "schoeller" and not experiment.fit
    assert [path.parent for path in experiment.inputs()] == [DATA] * len(experiment.inputs())


def test_scenes_of_one_name_are_all_there(tmp_path: Path) -> None:
    for name in ("hall.txt", "hall.csv", "yard.txt"):
        write(tmp_path, name, wanderers(3))
    write(tmp_path / "night", "yard.txt", wanderers(4))
    every = PredictionData(str(tmp_path), pattern="**/*.*")
    assert list(every.found()) == ["hall.csv", "hall.txt", "night/yard.txt", "yard.txt"]
    assert list(PredictionData(str(tmp_path)).found()) == ["hall", "yard"]


def test_patterns_with_folders_look_there(tmp_path: Path) -> None:
    write(tmp_path, "yard.txt", wanderers(3))
    for seed, day in enumerate(("day_1", "day_2")):
        write(tmp_path / day, "yard.txt", wanderers(seed, rows=20))
        write(tmp_path / day, f"hall{day[-1]}.txt", wanderers(seed))
    data = PredictionData(str(tmp_path), pattern="day_*/yard.txt")
    scenes = data.found()
    assert list(scenes) == ["day_1/yard.txt", "day_2/yard.txt"]
    assert [len(one.times) for scene in scenes.values() for one in data.read(scene)] == [20, 20]
    assert data.size(scenes["day_1/yard.txt"]) > 0
    assert list(PredictionData(str(tmp_path), pattern="day_*/hall*").found()) == ["hall1", "hall2"]
    last: dict[str, Predictor] = {"cv": ConstantVelocity(window=1)}
    experiment = PredictionBenchmark(last, registered=False, data=data, protocol=SMALL)
    folder = runner.run(experiment, tmp_path / "out").folder
    assert {row["scene"] for row in read_table(folder / "table.csv")} == {*scenes}
    assert runner.draw(folder)


@pytest.mark.parametrize("pattern", ["", "/tmp/*.txt", "../*.txt"])
def test_patterns_that_leave_the_folder_are_refused(tmp_path: Path, pattern: str) -> None:
    write(tmp_path, "a.txt", wanderers(3))
    write(tmp_path / "inside", "b.txt", wanderers(3))
    with pytest.raises(WideberthError, match=r"data\.pattern is .*; wanted one relative to the"):
        PredictionData(str(tmp_path / "inside"), pattern=pattern).found()

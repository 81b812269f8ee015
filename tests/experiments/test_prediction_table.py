"""Lines of the prediction benchmark's table: areas that do not flatter, classes of speed."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from wideberth.experiments.engine.base import Row
from wideberth.experiments.studies.prediction_benchmark import PredictionBenchmark
from wideberth.experiments.studies.prediction_data import PredictionData, Protocol
from wideberth.framework.predictor import Predictor
from wideberth.framework.values.errors import WideberthError
from wideberth.framework.values.forecast import Forecast, Scene
from wideberth.framework.values.tracks import Tracks
from wideberth.metrics.episode import content_bound

HOW = Protocol(observed=4, predicted=3, draws=9)
ROWS, DT = 7, 0.4
"""As many rows as one window has."""


@dataclass(frozen=True)
class Sized(Predictor):
    """Everybody walks on; the region of the k-th at step h has an area of k^2 h m^2."""

    wrong: str = ""

    def predict(self, tracks: Tracks, steps: int, scene: Scene | None = None) -> Forecast:
        step = tracks.positions[:, -1] - tracks.positions[:, -2]
        ahead = np.arange(1, steps + 1)
        mean = tracks.positions[:, -1:] + ahead[:, None] * step[:, None]
        mean = mean + 99.0 * np.array([ident == self.wrong for ident in tracks.ids])[:, None, None]
        area = np.array([int(ident) ** 2 for ident in tracks.ids])[:, None] * ahead
        variance = area / (np.pi * content_bound(2, 0.05))
        spread = variance[..., None, None] * np.eye(2)
        return Forecast.single(mean, spread, tracks.dt, (None,) * len(tracks))


def written(folder: Path, name: str, speeds: list[float]) -> None:
    """People 1, 2, ... side by side, each at a constant speed."""
    lines = [
        f"{10 * row} {who + 1} {DT * row * speed!r} {5.0 * who!r}"
        for who, speed in enumerate(speeds)
        for row in range(ROWS)
    ]
    (folder / name).write_text("\n".join(lines) + "\n")


def benchmark(folder: Path, **how: Any) -> PredictionBenchmark:
    return PredictionBenchmark(
        {"sized": Sized(wrong="3")}, registered=False, data=PredictionData(str(folder)),
        protocol=replace(HOW, **how),
    )  # fmt: skip


def rows_of(experiment: PredictionBenchmark) -> list[Row]:
    return [row for task in experiment.tasks() for row in experiment.measure(task).rows]


def test_areas_have_a_median_a_90th_percentile_and_a_mean_at_every_step(tmp_path: Path) -> None:
    written(tmp_path, "a.txt", [1.0] * 20)
    experiment = benchmark(tmp_path)
    rows = rows_of(experiment)
    areas = np.arange(1, 21) ** 2
    for h in (1, 2, 3):
        (row,) = (row for row in rows if row["slice"] == "all" and row["step"] == h)
        assert row["area_m2"] == pytest.approx(h * np.median(areas), rel=1e-8)
        assert row["area_90_m2"] == pytest.approx(h * np.quantile(areas, 0.9), rel=1e-8)
        assert row["area_mean_m2"] == pytest.approx(h * np.mean(areas), rel=1e-8)
    (line,) = experiment.summary(rows)
    assert line["area_mean_m2"] == pytest.approx(3 * np.mean(areas), rel=1e-8)
    assert line["area_90_m2"] == pytest.approx(3 * np.quantile(areas, 0.9), rel=1e-8)


def test_each_class_of_speed_is_scored_by_itself_at_every_step(tmp_path: Path) -> None:
    """One person stands, two are slow, three walk, one is fast; a slow one is forecast wrongly."""
    written(tmp_path, "a.txt", [0.0, 0.1, 0.4, 0.5, 1.0, 1.4, 1.6])
    experiment = benchmark(tmp_path)
    rows = rows_of(experiment)
    counts = {"standing": 1, "slow": 2, "walking": 3, "fast": 1}
    covers = {"standing": 1.0, "slow": 0.5, "walking": 1.0, "fast": 1.0}
    for name, count in counts.items():
        some = [row for row in rows if row["slice"] == name]
        assert [row["step"] for row in some] == [1, 2, 3, "all"]
        assert {row["windows"] for row in some} == {count}
        assert {row["cover_95"] for row in some} == {covers[name]}
    bounds = {
        row["slice"]: (row["from_mps"], row["below_mps"]) for row in rows if "from_mps" in row
    }
    assert bounds == {
        "standing": (0.0, 0.1),
        "slow": (0.1, 0.5),
        "walking": (0.5, 1.5),
        "fast": (1.5, None),
    }
    (line,) = experiment.summary(rows)
    assert {name: line[f"cover_95_{name}"] for name in counts} == covers
    assert "slow 0.1 to 0.5 m/s, walking 0.5 to 1.5 m/s, fast from 1.5 m/s on" in line["notes"]
    assert line["cover_95_steps"] == "0.857 to 0.857"  # of all windows, whatever their class


def test_a_class_that_a_scene_lacks_is_the_mean_of_the_others(tmp_path: Path) -> None:
    written(tmp_path, "a.txt", [1.0, 1.0, 0.2])
    written(tmp_path, "b.txt", [1.0, 1.0])
    experiment = benchmark(tmp_path, speeds={"slow": 0.0, "quick": 0.5, "never": 9.0})
    lines = experiment.summary(rows_of(experiment))
    assert [line["cover_95_slow"] for line in lines] == [0.0, 0.0, None]
    assert [line["cover_95_quick"] for line in lines] == [1.0, 1.0, 1.0]
    assert not any("cover_95_never" in line for line in lines)


def test_the_speed_is_that_of_the_last_three_seconds_at_most(tmp_path: Path) -> None:
    """Noise of single samples does not make a standing person walk, nor does an earlier walk."""
    x = np.concatenate([np.arange(8.0, 1.0, -1.0), np.zeros(10)])  # walks, then stands
    x[13] += 0.3  # one sample is wrong by 0.3 m: 0.75 m/s from row to row
    lines = [f"{10 * row} 1 {value!r} 0.0" for row, value in enumerate(x.tolist())]
    (tmp_path / "a.txt").write_text("\n".join(lines) + "\n")
    experiment = benchmark(tmp_path, observed=15, predicted=2)
    rows = rows_of(experiment)
    assert {row["slice"] for row in rows if row["slice"] != "stops"} == {"all", "standing"}


@pytest.mark.parametrize(
    ("speeds", "words"),
    [({"slow": 0.1}, "0 for the first"), ({"a": 0.0, "b": 0.0}, "more from each"),
     ({"a": 0.0, "b": float("inf")}, "more from each"), ({"all": 0.0}, "class 'all'"),
     ({"stops": 0.0}, "class 'stops'")],
)  # fmt: skip
def test_classes_that_are_none_are_refused(speeds: dict[str, float], words: str) -> None:
    with pytest.raises(WideberthError, match=words):
        Protocol(speeds=speeds)
    assert Protocol(speeds={}).speeds == {}

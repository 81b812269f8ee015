"""Sets of forecasts as Parquet: the same to the bit, readable by others, errors of other files."""

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pandas
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from wideberth.framework.values.arrays import Array
from wideberth.framework.values.errors import WideberthError
from wideberth.framework.values.forecast import Forecast
from wideberth.framework.values.tracks import Tracks
from wideberth.predictors.data.forecast_sets import Predicted, read_forecasts, write_forecasts
from wideberth.predictors.kalman import Kalman

pyarrow: Any = pytest.importorskip("pyarrow")
parquet: Any = pytest.importorskip("pyarrow.parquet")

NUMBERS = st.floats(-1e6, 1e6, width=64)
TIMES = st.floats(1e-3, 1e3)
WORDS = st.text(max_size=5)


def same(first: Array, second: Array) -> bool:
    """Whether two arrays have one shape and the same bits; the sign of a zero counts."""
    return first.shape == second.shape and first.tobytes() == second.tobytes()


def equal(first: Predicted, second: Predicted) -> bool:
    (seen, made), (other, read) = first, second
    pairs = (
        *((seen.positions, other.positions), (seen.radius, other.radius)),
        *((seen.noise, other.noise), (made.mean, read.mean)),
        *((made.covariance, read.covariance), (made.weight, read.weight)),
    )
    plain = (seen.dt, seen.ids, seen.stamp, made.dt, made.fallback)
    return plain == (other.dt, other.ids, other.stamp, read.dt, read.fallback) and all(
        same(*pair) for pair in pairs
    )


def covariances(draw: st.DrawFn, shape: tuple[int, ...], size: int) -> Array:
    root = draw(arrays(np.float64, (*shape, size, size), elements=st.floats(-10, 10)))
    return np.asarray(root @ np.swapaxes(root, -1, -2))


@st.composite
def predicted(draw: st.DrawFn, size: int) -> Predicted:
    """Any tracks and any forecast of them: gaps, several modes, two clocks, any names."""
    count, modes, steps, samples = (draw(st.integers(1, most)) for most in (3, 3, 4, 4))
    positions = draw(arrays(np.float64, (count, samples, size), elements=NUMBERS))
    positions[draw(arrays(np.bool_, (count, samples)))] = np.nan
    ids = tuple(draw(st.lists(WORDS, min_size=count, max_size=count, unique=True)))
    radius = draw(arrays(np.float64, count, elements=st.floats(0, 5)))
    noise, stamp = covariances(draw, (count,), size), draw(NUMBERS)
    tracks = Tracks(positions, draw(TIMES), ids, radius, noise, stamp)
    raw = draw(arrays(np.float64, (count, modes), elements=st.floats(0.01, 1)))
    reasons = st.lists(st.none() | WORDS, min_size=count, max_size=count)
    forecast = Forecast(
        draw(arrays(np.float64, (count, modes, steps, size), elements=NUMBERS)),
        covariances(draw, (count, modes, steps), size),
        raw / raw.sum(axis=1, keepdims=True),
        draw(TIMES),
        tuple(draw(reasons)),
    )
    return tracks, forecast


@settings(deadline=None, suppress_health_check=[HealthCheck.too_slow], max_examples=50)
@given(st.data(), st.sampled_from([2, 3]))
def test_what_is_written_is_read_to_the_bit(
    tmp_path_factory: pytest.TempPathFactory, data: st.DataObject, size: int
) -> None:
    path = tmp_path_factory.mktemp("set") / "forecasts.parquet"
    given_set = data.draw(st.lists(predicted(size), min_size=1, max_size=3))
    write_forecasts(path, given_set)
    found = read_forecasts(path)
    assert len(found) == len(given_set)
    assert all(map(equal, found, given_set))


def walker(ids: tuple[str, ...] = ("b", "a"), size: int = 2, samples: int = 6) -> Tracks:
    rng = np.random.default_rng(len(ids) + size)
    walk = 0.4 * np.cumsum(rng.normal(1, 0.1, (len(ids), samples, size)), axis=1)
    noise = np.tile(1e-4 * np.eye(size), (len(ids), 1, 1))
    return Tracks(walk, 0.4, ids, np.full(len(ids), 0.3), noise, 7.0)


@pytest.fixture
def pair() -> Predicted:
    tracks = walker()
    return tracks, Kalman().predict(tracks, 3)


@pytest.fixture
def written(pair: Predicted, tmp_path: Path) -> Path:
    return write_forecasts(tmp_path / "f.parquet", [pair, pair])


def test_rows_in_any_order_are_read_alike(written: Path, pair: Predicted, tmp_path: Path) -> None:
    """Obstacles keep the order of their first rows, so that these stay in front here."""
    table = parquet.read_table(written)
    rest = np.random.default_rng(0).permutation(np.arange(1, table.num_rows))
    parquet.write_table(table.take([0, *rest.tolist()]), tmp_path / "mixed.parquet")
    for tracks, forecast in read_forecasts(tmp_path / "mixed.parquet"):
        who = [tracks.ids.index(name) for name in pair[0].ids]
        assert same(tracks.positions[who], pair[0].positions)
        assert same(forecast.covariance[who], pair[1].covariance)


def test_another_tool_reads_the_table(written: Path, pair: Predicted) -> None:
    table = pandas.read_parquet(written)
    assert len(table) == 2 * 2 * (6 + 3)
    ahead = table[(table["forecast"] == 1) & (table["step"] == 2) & (table["obstacle"] == "a")]
    (row,) = ahead.to_dict("records")
    tracks, forecast = pair
    assert (row["x"], row["y"]) == tuple(forecast.mean[1, 0, 1])
    assert row["covariance_xy"] == forecast.covariance[1, 0, 1, 0, 1]
    assert row["time"] == pytest.approx(7.8) and row["weight"] == 1.0 and row["radius"] == 0.3
    newest = table[(table["step"] == 0) & (table["obstacle"] == "a")]
    assert newest["x"].tolist() == [tracks.positions[1, -1, 0]] * 2


def test_sets_that_make_no_table(pair: Predicted, tmp_path: Path) -> None:
    path = tmp_path / "f.parquet"
    tracks, forecast = pair
    space = walker(size=3)
    with pytest.raises(WideberthError, match=r"no forecast; wanted one at least"):
        write_forecasts(path, [])
    with pytest.raises(WideberthError, match=r"forecasts in 2 and in 3 dimensions; wanted"):
        write_forecasts(path, [pair, (space, Kalman().predict(space, 3))])
    with pytest.raises(WideberthError, match=r"forecast 1 has 0 obstacles.*: leave it out"):
        write_forecasts(path, [pair, (tracks.select([]), Kalman().predict(tracks.select([]), 3))])
    with pytest.raises(WideberthError, match=r"and its tracks 1 in 2; wanted the tracks that"):
        write_forecasts(path, [(tracks.select([0]), forecast)])
    assert not path.exists()


def changed(table: Any, name: str, values: Any) -> Any:
    place = table.column_names.index(name)
    return table.set_column(place, table.schema.field(name).with_type(values.type), values)


def first_value(table: Any, name: str, value: Any) -> Any:
    values = table.column(name).to_pylist()
    return changed(table, name, pyarrow.array([value, *values[1:]], table.column(name).type))


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda t: t.drop_columns("weight"), r"has no column 'weight', but forecast, .*; wanted"),
        (
            lambda t: changed(t, "step", t.column("step").cast("int32")),
            r"step is int32; wanted int",
        ),
        (lambda t: first_value(t, "x", None), r"x is null in 1 rows"),
        (lambda t: t.slice(1), r"forecast 0: 11 rows of 2 obstacles, 1 modes and 6 steps.*wanted"),
        (lambda t: t.slice(0, 12), r"forecast 0: 0 rows of 2 obstacles, 0 modes and 0 steps"),
        (lambda t: t.slice(0, 0), r"has 0 rows; wanted 1 to 100000000"),
        (lambda t: first_value(t, "step", -9), r"forecast 0: 12 rows of 2 obs.*and 7 steps"),
        (lambda t: first_value(t, "dt", 0.5), r"forecast 0: dt differs between the rows of one"),
        (lambda t: first_value(t, "radius", 0.5), r"radius differs between the steps of an obs"),
        (lambda t: first_value(t, "covariance_xx", -1.0), r"forecast 0: tracks\.noise"),
        (
            lambda t: t.replace_schema_metadata({}),
            r"f\.parquet has format None; wanted 'wideberth/forecasts'",
        ),
        (
            lambda t: t.replace_schema_metadata(
                {"wideberth": '{"format": "wideberth/forecasts", "version": 2}'}
            ),
            r"f\.parquet has version 2; this package reads 1 to 1",
        ),
    ],
)
def test_tables_that_hold_no_forecasts(change: Any, words: str, written: Path) -> None:
    parquet.write_table(change(parquet.read_table(written)), written)
    with pytest.raises(WideberthError, match=words):
        read_forecasts(written)


@pytest.mark.parametrize("data", [b"", b"PAR1", b"forecast,obstacle\n0,a\n"])
def test_other_files(data: bytes, tmp_path: Path) -> None:
    path = tmp_path / "f.parquet"
    path.write_bytes(data)
    with pytest.raises(WideberthError, match=r"f\.parquet is no Parquet file, or damaged: "):
        read_forecasts(path)


def test_a_table_of_results_is_another_format(tmp_path: Path) -> None:
    path = tmp_path / "table.parquet"
    parquet.write_table(pyarrow.table({"forecast": [1]}), path)
    with pytest.raises(WideberthError, match=r"has format None; wanted 'wideberth/forecasts'"):
        read_forecasts(path)


def test_a_truncated_file_and_one_that_cannot_be_written(written: Path, pair: Predicted) -> None:
    data = written.read_bytes()
    written.write_bytes(data[: len(data) // 2])
    with pytest.raises(WideberthError, match=r"is no Parquet file, or damaged"):
        read_forecasts(written)
    with pytest.raises(WideberthError, match=r"cannot be written"):
        write_forecasts(written.parent / "none" / "f.parquet", [pair])


def test_without_the_extra_a_line_names_it(
    pair: Predicted, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "pyarrow.parquet", None)
    for work in (lambda: write_forecasts(tmp_path / "f", [pair]), lambda: read_forecasts("f")):
        with pytest.raises(
            WideberthError, match=r"forecasts as Parquet need PyArrow.*\[parquet\]"
        ):
            work()

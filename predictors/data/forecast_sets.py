"""Sets of forecasts as Parquet, with what they were predicted from."""

import io
import json
from collections.abc import Iterable
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

from ...framework.plugins.extras import from_extra
from ...framework.plugins.io import read_bytes, stamped, unstamped, write_bytes
from ...framework.tracking.resampling import MOST_CELLS
from ...framework.values.arrays import Array
from ...framework.values.errors import WideberthError
from ...framework.values.forecast import Forecast
from ...framework.values.tracks import Tracks

Predicted: TypeAlias = tuple[Tracks, Forecast]
"""What was observed, and what was predicted from it."""
Columns: TypeAlias = dict[str, Any]
"""Name of a column -> its values, an array (K,)."""

KIND, VERSION = "forecasts", 1
MARK = b"wideberth"
"""Key of the format and its version, as JSON, in the metadata of the file's schema."""
MOST_BYTES = 2**30
"""Bytes of a file."""
NEED = "forecasts as Parquet need PyArrow"
AXES = "xyz"
WHOLE, TEXT = ("forecast", "mode", "step"), ("obstacle", "fallback")
FLOATS = ("stamp", "dt", "time", "weight", "radius")
"""Columns by type; those of positions and covariances hold floats too."""


def _names(size: int) -> tuple[list[str], list[str]]:
    """Return the columns of a position and those of a covariance in D dimensions."""
    axes = AXES[:size]
    return list(axes), [f"covariance_{first}{second}" for first in axes for second in axes]


def write_forecasts(path: str | Path, forecasts: Iterable[Predicted]) -> Path:
    """Write forecasts, and the tracks that they were predicted from, as one long table.

    It has a row for each forecast, obstacle, mode and step, and one for each observed sample:

    ============================ ===========================================================
    ``forecast``                 number of the forecast in the set, from 0
    ``obstacle``                 its identity
    ``mode``                     from 0; 0 where observed
    ``step``                     1 to N where predicted; 0 newest sample, -1 the one before
    ``stamp``                    s, time of the newest sample
    ``dt``                       s between steps; where observed, between samples
    ``time``                     s, ``stamp + step * dt``
    ``weight``                   of the mode; 1 where observed
    ``x``, ``y``, ``z``          m, mean or observed position (``z`` in space only); NaN: unseen
    ``covariance_xx``, ``_xy``.. m^2, of the prediction, or of one measurement
    ``radius``                   m, of the obstacle
    ``fallback``                 why the named method was not used; null where it was
    ============================ ===========================================================

    `read_forecasts` returns the same values to the bit. Neither the joint covariance over the
    horizon nor what a tracker states of velocities is kept.

    Parameters
    ----------
    path : of the file, which is written whole or not at all.
    forecasts : pairs of tracks and forecast, all in 2 or all in 3 dimensions.

    Raises
    ------
    WideberthError : the extra ``parquet`` is missing, no forecast, one of no obstacle, sample or
        step, tracks that are not the forecast's, or the file cannot be written.
    """
    parquet = from_extra("pyarrow.parquet", "parquet", NEED)
    parts = [_columns(number, *pair) for number, pair in enumerate(forecasts)]
    if len({frozenset(part) for part in parts}) != 1:
        found = "no forecast" if not parts else "forecasts in 2 and in 3 dimensions"
        raise WideberthError(f"{path}: {found}; wanted one at least, and all in one dimension")
    columns = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
    schema = _schema(3 if "z" in columns else 2)
    table = from_extra("pyarrow", "parquet", NEED).table(columns, schema)
    buffer = io.BytesIO()
    parquet.write_table(table, buffer, compression="zstd")
    return write_bytes(Path(path), buffer.getvalue())


def _schema(size: int) -> Any:
    """Return the names and types of the columns in D dimensions, with the format's version."""
    pyarrow = from_extra("pyarrow", "parquet", NEED)
    places, spreads = _names(size)
    kinds = {
        pyarrow.int64(): WHOLE,
        pyarrow.string(): TEXT,
        pyarrow.float64(): (*FLOATS, *places, *spreads),
    }
    fields = [pyarrow.field(name, kind) for kind, names in kinds.items() for name in names]
    return pyarrow.schema(fields, {MARK: json.dumps(stamped(KIND, VERSION, {}))})


def _columns(number: int, tracks: Tracks, forecast: Forecast) -> Columns:
    """Return the rows of one forecast, what was observed first."""
    count, modes, steps, size = forecast.mean.shape
    samples = tracks.positions.shape[1]
    if not (count and modes and steps and samples):
        raise WideberthError(
            f"forecast {number} has {count} obstacles, {modes} modes, {steps} steps and {samples} "
            "samples; wanted one of each at least: leave it out"
        )
    if (len(tracks), tracks.dimension) != (count, size):
        raise WideberthError(
            f"forecast {number} has {count} obstacles in {size} dimensions, and its tracks "
            f"{len(tracks)} in {tracks.dimension}; wanted the tracks that it was predicted from"
        )
    past, future = np.full(count * samples, 1.0), np.full(count * modes * steps, 1.0)
    who = np.concatenate([np.repeat(np.arange(count), n) for n in (samples, modes * steps)])
    step = [
        np.tile(np.arange(1 - samples, 1), count),
        np.tile(np.arange(steps) + 1, count * modes),
    ]
    noise = np.repeat(tracks.noise, samples, axis=0)
    covariance = np.concatenate([noise, forecast.covariance.reshape(-1, size, size)])
    position = np.concatenate(
        [part.reshape(-1, size) for part in (tracks.positions, forecast.mean)]
    )
    mode = np.tile(np.repeat(np.arange(modes), steps), count)
    columns: Columns = {
        "forecast": np.full(len(who), number),
        "obstacle": np.array(tracks.ids, dtype=object)[who],
        "mode": np.concatenate([np.zeros(len(past), dtype=np.int64), mode]),
        "step": np.concatenate(step),
        "stamp": np.full(len(who), float(tracks.stamp)),
        "dt": np.concatenate([tracks.dt * past, forecast.dt * future]),
        "weight": np.concatenate([past, np.repeat(forecast.weight, steps)]),
        "radius": tracks.radius[who],
        "fallback": np.array(forecast.fallback, dtype=object)[who],
    }
    columns["time"] = columns["stamp"] + columns["step"] * columns["dt"]
    places, spreads = _names(size)
    columns |= dict(zip(places, position.T, strict=True))
    return columns | dict(zip(spreads, covariance.reshape(len(who), -1).T, strict=True))


def read_forecasts(path: str | Path) -> tuple[Predicted, ...]:
    """Read the forecasts that `write_forecasts` wrote, each with its tracks.

    Rows may stand in any order; the obstacles of a forecast come in that of their first rows.

    Raises
    ------
    WideberthError : the extra ``parquet`` is missing, no such file, another format, a newer
        version, columns or rows that lack, or values that make no forecast.
    """
    columns = _read(Path(path))
    size = 3 if "z" in columns else 2
    order = np.argsort(columns["forecast"], kind="stable")
    ends = np.flatnonzero(np.diff(columns["forecast"][order])) + 1
    found = []
    for rows in np.split(order, ends):
        part = {name: column[rows] for name, column in columns.items()}
        try:
            found.append(_predicted(part, size))
        except WideberthError as error:
            raise WideberthError(f"{path}, forecast {part['forecast'][0]}: {error}") from None
    return tuple(found)


def _read(path: Path) -> Columns:
    """Return the columns of a file."""
    parquet = from_extra("pyarrow.parquet", "parquet", NEED)
    data = read_bytes(path, MOST_BYTES)
    try:
        file = parquet.ParquetFile(io.BytesIO(data))
        mark = json.loads((file.schema_arrow.metadata or {}).get(MARK, b"null"))
        rows = file.metadata.num_rows
        table = file.read() if 0 < rows <= MOST_CELLS else None
    except Exception as error:  # a damaged file fails in any way
        raise WideberthError(f"{path} is no Parquet file, or damaged: {error}") from None
    unstamped(mark, KIND, VERSION, str(path))
    if table is None:
        raise WideberthError(f"{path} has {rows} rows; wanted 1 to {MOST_CELLS}")
    columns: Columns = {}
    for field in _schema(3 if "z" in table.column_names else 2):
        if field.name not in table.column_names:
            raise WideberthError(
                f"{path} has no column {field.name!r}, but {', '.join(table.column_names)}; "
                "wanted those that write_forecasts writes"
            )
        column = table.column(field.name)
        if column.type != field.type:
            raise WideberthError(f"{path}: {field.name} is {column.type}; wanted {field.type}")
        if column.null_count and field.name != "fallback":
            raise WideberthError(f"{path}: {field.name} is null in {column.null_count} rows")
        columns[field.name] = column.to_numpy()
    return columns


def _predicted(rows: Columns, size: int) -> Predicted:
    """Return the tracks and the forecast that the rows of one forecast hold."""
    names, first, who = np.unique(rows["obstacle"], return_index=True, return_inverse=True)
    rows = rows | {"who": first[who]}  # obstacles in the order of their first rows
    past = _block(rows, rows["step"] <= 0, len(names), size)
    future = _block(rows, rows["step"] > 0, len(names), size)
    steps = past["step"][0, 0], future["step"][0, 0]
    if steps[0][-1] != 0 or steps[1][0] != 1 or (past["mode"] != 0).any():
        raise WideberthError("samples do not end with step 0, or steps do not begin with 1")
    tracks = Tracks(
        past["position"][:, 0],
        _only(past["dt"], "dt"),
        tuple(past["obstacle"][:, 0, 0]),
        _along(past["radius"], "radius")[:, 0],
        past["covariance"][:, 0, 0],
        _only(past["stamp"], "stamp"),
    )
    forecast = Forecast(
        future["position"],
        future["covariance"],
        _along(future["weight"], "weight"),
        _only(future["dt"], "dt"),
        tuple(future["fallback"][:, 0, 0]),
    )
    return tracks, forecast


def _block(rows: Columns, chosen: Any, count: int, size: int) -> Columns:
    """Return some rows by obstacle, mode and step, (O, M, N); refuse what is no full block."""
    keys = [rows[name][chosen] for name in ("step", "mode", "who")]
    modes, steps = len(np.unique(keys[1])), len(np.unique(keys[0]))
    order = np.flatnonzero(chosen)[np.lexsort(keys)]
    if not len(order) or len(order) != count * modes * steps:
        raise WideberthError(
            f"{len(order)} rows of {count} obstacles, {modes} modes and {steps} steps (or "
            "samples, step 0 and before); wanted one row for each of them"
        )
    block = {name: rows[name][order].reshape(count, modes, steps) for name in rows}
    for name, axis, wanted in (("mode", 1, modes), ("step", 2, steps)):
        values = np.moveaxis(block[name], axis, 2)
        expected = values[0, 0, 0] + np.arange(wanted)
        if (values != expected).any():
            raise WideberthError(f"{name} skips or repeats a number; wanted each once")
    places, spreads = _names(size)
    block["position"] = np.stack([block[name] for name in places], axis=-1)
    stacked = np.stack([block[name] for name in spreads], axis=-1)
    return block | {"covariance": stacked.reshape(*stacked.shape[:-1], size, size)}


def _along(values: Array, name: str) -> Array:
    """Return the values of each obstacle and mode, (O, M), of (O, M, N) that are one along N."""
    if (values != values[..., :1]).any():
        raise WideberthError(f"{name} differs between the steps of an obstacle; wanted one value")
    return np.asarray(values[..., 0])


def _only(values: Array, name: str) -> float:
    """Return the one value of all rows."""
    if (values != values[0, 0, 0]).any():
        raise WideberthError(f"{name} differs between the rows of one forecast; wanted one value")
    return float(values[0, 0, 0])

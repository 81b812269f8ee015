"""A result's table for other programs: Parquet, with its origin in the file."""

import io
import json
from collections.abc import Sequence
from hashlib import sha256
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ...framework.plugins.extras import from_extra
from ...framework.plugins.io import read_json, write_bytes
from .csv_tables import read_table
from .inside import inside

if TYPE_CHECKING:
    import pyarrow


def need_parquet() -> None:
    """Raise a `WideberthError` where the extra is missing, before any work."""
    from_extra("pyarrow", "parquet", "Parquet needs PyArrow")


def write_parquet(folder: Path) -> Path:
    """Write table.parquet beside the table.csv of a finished run.

    Columns hold int64, double, bool or text, and null where the CSV is empty; one that mixes
    text with something else is text, as in the CSV. The schema's metadata carries ``config``
    (YAML), ``config_hash`` (SHA-256 of it) and ``provenance`` (JSON: versions, commit, source).
    The same table gives the same bytes with the same version of PyArrow.

    Raises
    ------
    WideberthError : the extra is missing, or the file cannot be written.
    """
    need_parquet()
    import pyarrow
    from pyarrow import parquet

    rows = read_table(inside(folder, "table.csv"))
    config = inside(folder, "config.yaml").read_bytes()
    origin = read_json(inside(folder, "provenance.json"), "provenance", 1)
    names = list(rows[0]) if rows else []
    columns = [_column([row[name] for row in rows]) for name in names]
    metadata = {
        "config": config,
        "config_hash": sha256(config).hexdigest(),
        "provenance": json.dumps(origin, sort_keys=True),
    }
    table = pyarrow.Table.from_arrays(columns, names=names).replace_schema_metadata(metadata)
    buffer = io.BytesIO()
    parquet.write_table(table, buffer, compression="zstd")
    return write_bytes(inside(folder, "table.parquet"), buffer.getvalue())


def _column(values: Sequence[Any]) -> "pyarrow.Array[Any]":
    import pyarrow

    try:
        return pyarrow.array(values)
    except (pyarrow.ArrowInvalid, pyarrow.ArrowTypeError, OverflowError):
        return pyarrow.array([None if value is None else str(value) for value in values])

"""Tables of results as CSV: the same rows give the same bytes, and read back as they were."""

import csv
import io
import re
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, TypeAlias

from ...framework.plugins.io import read_text, write_text
from ...framework.values.errors import WideberthError

Row: TypeAlias = dict[str, Any]
"""One line of a table: column name -> float, int, str, bool or None."""

_DIGITS = 4000
"""Of a number in a table; Python reads whole numbers of 4300. Longer ones are text."""


def write_table(path: Path, rows: Iterable[Mapping[str, Any]]) -> Path:
    """Write rows as CSV; see `table_text` for the format and `write_bytes` for the writing."""
    return write_text(path, table_text(rows))


def table_text(rows: Iterable[Mapping[str, Any]]) -> str:
    """Return rows as CSV text.

    Columns stand in the order in which they first appear; a row that lacks one leaves it
    empty. Floats are written by ``repr`` (the shortest text that reads back as the same
    number); None is an empty cell. Cells hold numbers, text, booleans or None. Text that
    looks like one of the others ("12", "True", "") reads back as that. Cells with commas,
    quotes or line ends, a carriage return alone too, stand in quotes.

    Raises
    ------
    WideberthError : a cell that is none of these.
    """
    rows = list(rows)
    columns = list(dict.fromkeys(name for row in rows for name in row))
    lines = [columns, *([_cell(name, row.get(name)) for name in columns] for row in rows)]
    return "".join(f"{_line(cells)}\n" for cells in lines)


def _line(cells: list[str]) -> str:
    """Return cells as a line of CSV.

    Of the versions of Python's csv module some leave a carriage return without quotes.
    """
    if cells == [""]:
        return '""'  # an empty line would be no row
    return ",".join(
        f'"{cell.replace(chr(34), 2 * chr(34))}"' if re.search(r'[",\r\n]', cell) else cell
        for cell in cells
    )


def _cell(column: str, value: Any) -> str:
    if value is None:
        return ""
    if hasattr(value, "item") and getattr(value, "ndim", 1) == 0:
        value = value.item()  # a NumPy scalar: its repr names its type
    if isinstance(value, bool | int | float):
        return repr(value)
    if isinstance(value, str):
        return value
    raise WideberthError(
        f"column {column!r} holds {type(value).__name__} {value!r}; a table holds numbers, "
        "text, booleans and None: write anything else into a file of its own"
    )


def read_table(path: Path) -> list[dict[str, Any]]:
    """Read a table of `write_table`: numbers, True, False, None (empty) and text.

    Raises
    ------
    WideberthError : no such file, not text, or a line with another number of cells.
    """
    try:
        text = read_text(Path(path), "a CSV file")
    except WideberthError as error:
        raise WideberthError(f"{path} cannot be read as a table: {error}") from None
    return read_rows(text, str(path))


def read_rows(text: str, place: str) -> list[dict[str, Any]]:
    """Return the rows of a table's text; ``place`` begins the error message.

    Raises
    ------
    WideberthError : no CSV, or a line with another number of cells than the header.
    """
    try:
        lines = list(csv.reader(io.StringIO(text)))
    except csv.Error as error:
        raise WideberthError(f"{place} cannot be read as a table: {error}") from None
    if not lines:
        return []
    header = lines[0]
    for number, line in enumerate(lines[1:], start=2):
        if len(line) != len(header):
            raise WideberthError(
                f"{place}, line {number}: {len(line)} cells; wanted {len(header)}, as in the "
                "header"
            )
    return [dict(zip(header, map(_value, line), strict=True)) for line in lines[1:]]


def _value(cell: str) -> Any:
    words = {"": None, "True": True, "False": False}
    if cell in words:
        return words[cell]
    if len(cell) > _DIGITS:
        return cell
    if re.fullmatch(r"-?[0-9]+", cell):
        return int(cell)
    if re.fullmatch(r"-?([0-9]+(\.[0-9]+)?(e[-+]?[0-9]+)?|inf|nan)", cell):
        return float(cell)
    return cell

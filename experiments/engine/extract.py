"""Parts of a result's tables for a paper: some columns, or a pivot; as LaTeX or Markdown."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ...framework.plugins.io import read_table
from ...framework.plugins.registry import unknown
from ...framework.values.errors import WideberthError
from .result import Row, need_frames
from .showing import columns_of, format_cell, headed, markdown_table


@dataclass(frozen=True)
class Extract:
    """Lines chosen from a table.

    Attributes
    ----------
    rows : the lines.
    measure : what the cells of a pivot hold, with its unit; "" without a pivot.
    note : how the cells were condensed; "" if they are the table's own.
    """

    rows: list[Row]
    measure: str = ""
    note: str = ""


def extract(folder: Path, columns: Sequence[str] = (), pivot: Sequence[str] = ()) -> Extract:
    """Return some columns of a result, a pivot of it, or its whole summary.

    The columns are looked for in summary.csv, then in table.csv and times.csv: the first that
    has all of them.

    Parameters
    ----------
    folder : of a finished run.
    columns : names, in the order in which they are wanted.
    pivot : the column that names the lines, the one that names the columns, and the measure
        that fills the cells. Of several lines for one cell the mean is taken.

    Raises
    ------
    WideberthError : an unknown column, not three different names, a measure that is no number.
    """
    if columns and pivot:
        raise WideberthError("--columns and --pivot were both given; a pivot has its own columns")
    if pivot and len(set(pivot)) != 3:
        raise WideberthError(
            f"--pivot is {','.join(pivot)!r}; wanted three different columns: of the lines, of "
            "the columns, and the measure, as in predictor,region,clearance_min_m"
        )
    wanted = list(columns or pivot)
    name, rows = _table_with(folder, wanted)
    if pivot:
        return _pivoted(name, rows, wanted)
    return Extract([{name: row[name] for name in wanted} for row in rows] if wanted else rows)


def _table_with(folder: Path, wanted: Sequence[str]) -> tuple[str, list[Row]]:
    """Return the first table that has all these columns, and its name."""
    known: list[str] = []
    for name in ("summary.csv", "table.csv", "times.csv"):
        rows = read_table(folder / name) if (folder / name).is_file() else []
        if rows and set(wanted) <= set(rows[0]):
            return name, rows
        known += columns_of(rows)
    for column in wanted:
        if column not in known:
            raise WideberthError(unknown("column", column, set(known)))
    raise WideberthError(f"no table of {folder} has all of {', '.join(wanted)}; name fewer")


def _pivoted(name: str, rows: Sequence[Row], pivot: Sequence[str]) -> Extract:
    need_frames()
    import pandas

    lines, across, measure = pivot
    frame: Any = pandas.DataFrame(list(rows))  # pandas' own annotations fit any column
    if not pandas.api.types.is_numeric_dtype(frame[measure]):
        raise WideberthError(
            f"the column {measure!r} holds text; the measure of a pivot is a number"
        )
    cells = frame.groupby([lines, across], sort=False)[measure]
    most = int(cells.size().max())
    table = cells.mean(skipna=False).unstack(sort=False)
    found = [
        {lines: label, **dict(zip(map(str, table.columns), values, strict=True))}
        for label, values in zip(table.index, table.to_numpy().tolist(), strict=True)
    ]
    note = f"each cell is the mean of up to {most} lines of {name}" if most > 1 else ""
    return Extract(found, headed(measure), note)


def markdown_text(chosen: Extract) -> str:
    """Return an extract as a Markdown table with units; the measure of a pivot stands above."""
    above = f"{chosen.measure}\n\n" if chosen.measure else ""
    return above + markdown_table([_titled(row, chosen) for row in chosen.rows])


def latex_text(chosen: Extract) -> str:
    """Return an extract as a LaTeX tabular with units; it needs the package booktabs.

    Raises
    ------
    WideberthError : the extra for data frames is missing.
    """
    need_frames()
    import pandas

    rows = [_titled(row, chosen) for row in chosen.rows]
    words = {name: any(isinstance(row[name], str) for row in rows) for name in columns_of(rows)}
    texts: list[dict[Any, str]] = [
        {name: format_cell(row[name]) for name in words} for row in rows
    ]
    frame = pandas.DataFrame(texts, dtype=str)
    if chosen.measure:
        first, *rest = frame.columns
        frame.columns = pandas.MultiIndex.from_tuples(
            [("", first), *((chosen.measure, name) for name in rest)]
        )
    aligned = "".join("l" if text else "r" for text in words.values())
    text: str = frame.to_latex(
        index=False, escape=True, column_format=aligned, multicolumn_format="c"
    )
    return text.rstrip("\n")


def _titled(row: Row, chosen: Extract) -> Row:
    """Return a line under headers for reading; the labels across a pivot stay what they are."""
    return {
        headed(name) if i == 0 or not chosen.measure else name: value
        for i, (name, value) in enumerate(row.items())
    }

"""Parts of a result's tables for a paper: some columns, or a pivot; as LaTeX or Markdown."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import floor, isfinite, isinf, isnan, log10
from pathlib import Path
from typing import Any

from ...framework.plugins.registry import load, unknown
from ...framework.plugins.yamlfile import read_config
from ...framework.values.errors import WideberthError
from .column_descriptions import shares
from .csv_tables import read_table
from .result import Row, need_frames
from .text_tables import columns_of, format_cell, headed, in_per_cent, main_columns, markdown_table


@dataclass(frozen=True)
class Extract:
    """Lines chosen from a table.

    Attributes
    ----------
    rows : the lines.
    measure : what the cells of a pivot hold, with its unit; "" without a pivot.
    note : how the cells were condensed; "" if they are the table's own.
    shares : columns whose cells are shares.
    """

    rows: list[Row]
    measure: str = ""
    note: str = ""
    shares: frozenset[str] = frozenset()


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
    study = str(read_config(folder / "config.yaml", stored=True).get("type", ""))
    known = shares(study, wanted or columns_of(rows))
    if pivot:
        return _pivoted(name, rows, wanted, wanted[2] in known)
    chosen = [{name: row[name] for name in wanted} for row in rows] if wanted else rows
    return Extract(chosen, shares=known)


def answering(folder: Path, rows: Sequence[Row]) -> list[str]:
    """Return the columns of a result's summary that answer its study's question.

    All of them where the study names none, or is not known here.
    """
    study = str(read_config(folder / "config.yaml", stored=True).get("type", ""))
    try:
        printed = load("experiments", study).printed
    except WideberthError:
        printed = ()
    return main_columns(rows, printed)


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


def _pivoted(name: str, rows: Sequence[Row], pivot: Sequence[str], share: bool) -> Extract:
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
    held = frozenset(map(str, table.columns)) if share else frozenset[str]()
    return Extract(found, headed(measure, share), note, held)


def markdown_text(chosen: Extract) -> str:
    """Return an extract as a Markdown table with units; the measure of a pivot stands above."""
    above = f"{chosen.measure}\n\n" if chosen.measure else ""
    return above + markdown_table([_titled(row, chosen) for row in chosen.rows])


def latex_text(chosen: Extract) -> str:
    """Return an extract as a LaTeX tabular with units; it needs the package booktabs.

    The numbers of a column have the same digits after the point, see `aligned`; what is unknown
    is a dash.

    Raises
    ------
    WideberthError : the extra for data frames is missing.
    """
    need_frames()
    import pandas

    rows = [_titled(row, chosen) for row in chosen.rows]
    columns = {name: [row.get(name) for row in rows] for name in columns_of(rows)}
    words = [any(isinstance(value, str) for value in values) for values in columns.values()]
    frame = pandas.DataFrame(
        {_latex(name): [_latex(text) for text in aligned(own)] for name, own in columns.items()},
        dtype=str,
    )
    if chosen.measure:
        first, *rest = frame.columns
        frame.columns = pandas.MultiIndex.from_tuples(
            [("", first), *((_latex(chosen.measure), name) for name in rest)]
        )
    sides = "".join("l" if text else "r" for text in words)
    text: str = frame.to_latex(
        index=False, escape=False, column_format=sides, multicolumn_format="c"
    )
    return text.rstrip("\n")


_DIGITS, _LEAST, _MORE = 4, 2, 2
"""Digits of the largest number of a column, of the smallest one, and how many that may add."""
_UNKNOWN, _ENDLESS = "\u2013", "\u221e"


def aligned(values: Sequence[Any]) -> list[str]:
    """Return the cells of a column as text; its numbers have the same digits after the point.

    The largest number has four digits, or fewer where none needs them. A number that would be 0
    is stated as smaller than the last digit; an unknown one is a dash.

    Examples
    --------
    >>> aligned([12.3456, 0.5, float("nan"), None])
    ['12.35', '0.50', '–', '']
    >>> aligned([1.0, 0.03125, 2e-9])
    ['1.00000', '0.03125', '<0.00001']
    >>> aligned([3, 12]), aligned(["a", True])
    (['3', '12'], ['a', 'True'])
    """
    numbers = [abs(value) for value in values if _finite(value)]
    decimals = _decimals([number for number in numbers if number])
    return [_aligned(value, decimals) for value in values]


def _finite(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and isfinite(value)


def _decimals(numbers: Sequence[float]) -> int:
    """Return the digits after the point that positive numbers of one column need."""
    if not numbers:
        return 0
    most = max(_fraction(number) for number in numbers)
    large = max(_DIGITS - 1 - floor(log10(max(numbers))), 0)
    small = min(_LEAST - 1 - floor(log10(min(numbers))), large + _MORE)
    return min(most, max(large, small))


def _fraction(number: float) -> int:
    """Return the digits after the point that show four digits of a number, without zeros."""
    places = max(_DIGITS - 1 - floor(log10(number)), 0)
    return len(f"{number:.{places}f}".rstrip("0").partition(".")[2])


def _aligned(value: Any, decimals: int) -> str:
    if not isinstance(value, int | float) or isinstance(value, bool):
        return format_cell(value)
    if isnan(value):
        return _UNKNOWN
    if isinf(value):
        return f"{'-' * (value < 0)}{_ENDLESS}"
    last = 10.0**-decimals
    return f"<{last:.{decimals}f}" if 0.0 < value < 0.5 * last else f"{value:.{decimals}f}"


_SPECIAL = {
    **{sign: f"\\{sign}" for sign in "&%$#_{}"},
    "\\": r"\textbackslash{}", "~": r"\textasciitilde{}", "^": r"\textasciicircum{}",
    "<": "$<$", ">": "$>$", _UNKNOWN: "--", _ENDLESS: r"$\infty$",
}  # fmt: skip
"""Character -> how LaTeX writes it."""


def _latex(text: str) -> str:
    r"""Return text as LaTeX writes it.

    Examples
    --------
    >>> print(_latex("asked 95 % of box_1"), _latex("<0.001"))
    asked 95 \% of box\_1 $<$0.001
    """
    return "".join(_SPECIAL.get(sign, sign) for sign in text)


def _titled(row: Row, chosen: Extract) -> Row:
    """Return a line under headers for reading; the labels across a pivot stay what they are."""
    return {
        headed(name, name in chosen.shares) if i == 0 or not chosen.measure else name: value
        for i, (name, value) in enumerate(in_per_cent(row, chosen.shares).items())
    }

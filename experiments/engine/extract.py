"""Parts of a result's tables for a paper: some columns, or a pivot; as LaTeX or Markdown."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from html import escape
from math import floor, fsum, isfinite, isinf, log10, nan
from pathlib import Path
from statistics import median
from typing import Any

from ...draw.style import MINUS
from ...framework.plugins.registry import as_data, load
from ...framework.plugins.yamlfile import read_config
from ...framework.values.errors import WideberthError, nearest, short
from .column_descriptions import shares
from .csv_tables import Row, read_table
from .inside import inside
from .text_tables import (
    UNKNOWN,
    column_named,
    columns_of,
    format_cell,
    has_words,
    headed,
    in_per_cent,
    main_columns,
    markdown_table,
    plain,
    with_unit,
)


@dataclass(frozen=True)
class Extract:
    """Lines chosen from a table.

    Attributes
    ----------
    rows : the lines.
    measure : what the cells of a pivot hold, with its unit; "" without a pivot.
    note : how the cells were condensed; "" if they are the table's own.
    shares : columns whose cells are shares.
    errors : column -> half of the width of its interval of 95 %, in the unit that is printed; of
        columns that have one.
    """

    rows: list[Row]
    measure: str = ""
    note: str = ""
    shares: frozenset[str] = frozenset()
    errors: Mapping[str, float] = field(default_factory=dict)


def extract(folder: Path, columns: Sequence[str] = (), pivot: Sequence[str] = ()) -> Extract:
    """Return some columns of a result, a pivot of it, or its whole summary.

    The columns are looked for in summary.csv, then in table.csv and times.csv: the first that
    has all of them.

    Parameters
    ----------
    folder : of a finished run.
    columns : names or printed headings, in the order in which they are wanted.
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
    name, rows, wanted = _table_with(folder, wanted)
    study = study_of(folder)
    if pivot:
        return _pivoted(name, rows, wanted, wanted[2] in shares(study, wanted))
    return of_rows(study, rows, wanted or columns_of(rows))


def of_rows(study: str, rows: Sequence[Row], columns: Sequence[str]) -> Extract:
    """Return columns of a study's table, with what is known of them."""
    known = shares(study, columns)
    errors = {name: _error(name, rows, name in known) for name in columns}
    return Extract(
        [{name: row.get(name) for name in columns} for row in rows],
        shares=known,
        errors={name: error for name, error in errors.items() if error},
    )


def study_of(folder: Path) -> str:
    """Return the registered name of a result's study."""
    return str(read_config(inside(folder, "config.yaml")).get("type", ""))


_END = re.compile(r"_(low|high)(?=(_[a-z]+)?$)")
"""What the name of a column adds to that of the quantity that it bounds."""


def _error(column: str, rows: Sequence[Row], share: bool) -> float:
    """Return half of the median width of a column's intervals; 0 where there are none."""
    quantity = _END.sub("", column)
    ends = {
        found[1]: name
        for name in columns_of(rows)
        if (found := _END.search(name)) and _END.sub("", name) == quantity
    }
    widths = [
        row[ends["high"]] - row[ends["low"]]
        for row in rows
        if len(ends) == 2 and all(_finite(row.get(name)) for name in ends.values())
    ]
    half = 0.5 * median(widths) if widths else 0.0
    return 100.0 * half if share else half


def answers(folder: Path) -> Extract:
    """Return the columns of a result's summary that answer its study's question."""
    study, rows = study_of(folder), read_table(inside(folder, "summary.csv"))
    return of_rows(study, rows, answering(study, rows))


def answering(study: str, rows: Sequence[Row]) -> list[str]:
    """Return the columns of a summary that answer a study's question; see `main_columns`."""
    try:
        with as_data():
            printed = load("experiments", study).printed
    except WideberthError:  # its plug-in is not there
        printed = ()
    return main_columns(rows, printed)


def _table_with(folder: Path, wanted: Sequence[str]) -> tuple[str, list[Row], list[str]]:
    """Return the first table that has all columns, by name or heading; its name, and theirs."""
    known: list[str] = []
    for name in ("summary.csv", "table.csv", "times.csv"):
        path = inside(folder, name)
        rows = read_table(path) if path.is_file() else []
        columns = [column_named(text, rows[0] if rows else ()) for text in wanted]
        if rows and all(columns):
            return name, rows, columns
        known += columns_of(rows)
    for column in wanted:
        if not column_named(column, known):
            near = nearest(column, known) or ";"
            raise WideberthError(
                f"unknown column {short(column)}{near} `wideberth show {folder} --columns all` "
                "prints all of the summary"
            )
    raise WideberthError(f"no table of {folder} has all of {', '.join(wanted)}; name fewer")


def _pivoted(name: str, rows: Sequence[Row], pivot: Sequence[str], share: bool) -> Extract:
    lines, across, measure = pivot
    cells: dict[tuple[Any, Any], list[float]] = {}
    for row in rows:
        value = nan if row[measure] is None else row[measure]
        if isinstance(value, str):
            raise WideberthError(
                f"the column {measure!r} holds text; the measure of a pivot is a number"
            )
        cells.setdefault((_label(row[lines]), _label(row[across])), []).append(float(value))
    heads = _apart({label: with_unit(across, label) for _, label in cells}, across, [lines])
    names = _apart({line: format_cell(line) for line, _ in cells}, "", [])
    alike = len({format_cell(line) for line in names}) < len(names)
    found = [
        {
            lines: name if alike else line,
            **{head: _mean(cells.get((line, label), ())) for label, head in heads.items()},
        }
        for line, name in names.items()
    ]
    most = max(map(len, cells.values()), default=0)
    note = f"each cell is the mean of up to {most} lines of {name}" if most > 1 else ""
    held = frozenset(heads.values()) if share else frozenset[str]()
    return Extract(found, headed(measure, share), note, held)


def _label(value: Any) -> Any:
    """Return a cell that equals itself: all numbers that are not known are one label."""
    return nan if value != value else value


def _apart(texts: Mapping[Any, str], column: str, taken: Sequence[str]) -> dict[Any, str]:
    """Return label -> text, all different: with all digits, and numbered, if some are alike."""
    if len({*texts.values(), *taken}) < len(texts) + len(taken):
        texts = {label: with_unit(column, label, "") for label in texts}
    apart: dict[Any, str] = {}
    for label, text in texts.items():
        name, count = text, 1
        while name in (*apart.values(), *taken):
            count += 1
            name = f"{text} ({count})"
        apart[label] = name
    return apart


def _mean(values: Sequence[float]) -> float:
    return fsum(values) / len(values) if values else nan


def markdown_text(chosen: Extract) -> str:
    """Return an extract as a Markdown table with units; the measure of a pivot stands above."""
    above = f"{plain(chosen.measure)}\n\n" if chosen.measure else ""
    return above + markdown_table([_titled(row, chosen) for row in chosen.rows])


def html_text(chosen: Extract) -> str:
    """Return an extract as a plain HTML table with units."""
    rows = [_titled(row, chosen) for row in chosen.rows]
    lines = [[format_cell(value) for value in row.values()] for row in rows]
    body = "".join(_html_line("td", cells) for cells in lines)
    return f"<table>{_html_line('th', columns_of(rows))}{body}</table>"


def _html_line(kind: str, cells: Sequence[str]) -> str:
    return f"<tr>{''.join(f'<{kind}>{escape(cell)}</{kind}>' for cell in cells)}</tr>"


def latex_text(chosen: Extract) -> str:
    """Return an extract as a LaTeX tabular with units; it needs the package booktabs.

    The numbers of a column have the same digits after the point, see `aligned`; what is unknown
    is a dash.
    """
    rows = [_titled(row, chosen) for row in chosen.rows]
    names = columns_of(rows)
    sides = "".join("l" if has_words(rows, name) else "r" for name in names)
    errors = [chosen.errors.get(name) for name in columns_of(chosen.rows)]
    columns = [
        _with_minus([row.get(name) for row in rows], error)
        for name, error in zip(names, errors, strict=True)
    ]
    above = f" & \\multicolumn{{{len(names) - 1}}}{{c}}{{{_latex(chosen.measure)}}} \\\\"
    return "\n".join([
        f"\\begin{{tabular}}{{{sides}}}",
        r"\toprule",
        *([above] if chosen.measure else []),
        _latex_line(names),
        r"\midrule",
        *(_latex_line(line) for line in zip(*columns, strict=True)),
        r"\bottomrule",
        r"\end{tabular}",
    ])  # fmt: skip


def _with_minus(values: Sequence[Any], error: float | None) -> list[str]:
    """Return the cells of a column as `aligned` does, their numbers with a minus sign."""
    return [
        cell if isinstance(value, str) else cell.replace("-", MINUS)
        for value, cell in zip(values, aligned(values, error), strict=True)
    ]


def _latex_line(cells: Sequence[str]) -> str:
    line = " & ".join(map(_latex, cells)).lstrip()
    option = line.startswith(("[", "*"))  # as which LaTeX reads these behind a line's end
    return f"{'{}' * option}{line} \\\\"


_DIGITS, _LEAST, _MORE, _OF_ERROR = 4, 2, 2, 2
"""Digits of the largest number of a column, of the smallest one, how many that may add, and digits
of an error that is known."""
_ENDLESS = "\u221e"


def aligned(values: Sequence[Any], error: float | None = None) -> list[str]:
    """Return the cells of a column as text; its numbers have the same digits after the point.

    The largest number has four digits, or fewer where none needs them, or where the error has
    two. A number that would be 0 is stated as smaller than the last digit; an unknown one is a
    dash.

    Parameters
    ----------
    values : cells.
    error : by how much the numbers are uncertain, in their own unit; None where it is not known.

    Examples
    --------
    >>> aligned([12.3456, 0.5, float("nan"), None])
    ['12.35', '0.50', '–', '']
    >>> aligned([1.0, 0.03125, 2e-9])
    ['1.00000', '0.03125', '<0.00001']
    >>> aligned([3, 12]), aligned(["a", True])
    (['3', '12'], ['a', 'True'])
    >>> aligned([97.3333, 8.125], error=3.2), aligned([97.3333, 8.125], error=0.4)
    (['97.3', '8.1'], ['97.33', '8.12'])
    """
    numbers = [abs(value) for value in values if _finite(value)]
    decimals = _decimals([number for number in numbers if number])
    if error:
        decimals = min(decimals, max(_OF_ERROR - 1 - floor(log10(error)), 0))
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
    if not isinstance(value, int | float) or isinstance(value, bool) or value != value:
        return format_cell(value)
    if isinf(value):
        return f"{'-' * (value < 0)}{_ENDLESS}"
    last = 10.0**-decimals
    if 0.0 < value < 0.5 * last:
        return f"<{last:.{decimals}f}"
    return f"{round(value, decimals) + 0.0:.{decimals}f}"  # of -0.0 this is 0.0


_SPECIAL = {
    **{sign: f"\\{sign}" for sign in "&%$#_{}"},
    "\\": r"\textbackslash{}", "~": r"\textasciitilde{}", "^": r"\textasciicircum{}",
    "<": "$<$", ">": "$>$", UNKNOWN: "--", _ENDLESS: r"$\infty$", MINUS: "$-$",
}  # fmt: skip
"""Character -> how LaTeX writes it."""


def _latex(text: str) -> str:
    r"""Return text as LaTeX writes it, in one line.

    Examples
    --------
    >>> print(_latex("asked 95 % of box_1"), _latex("<0.001"))
    asked 95 \% of box\_1 $<$0.001
    """
    text = "".join(sign if sign.isprintable() else " " for sign in text)
    return "".join(_SPECIAL.get(sign, sign) for sign in text)


def _titled(row: Row, chosen: Extract) -> Row:
    """Return a line under headers for reading; the labels across a pivot stay what they are."""
    return {
        headed(name, name in chosen.shares) if i == 0 or not chosen.measure else name: value
        for i, (name, value) in enumerate(in_per_cent(row, chosen.shares).items())
    }

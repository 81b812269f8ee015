"""Tables of results as text: in a terminal that they fit, and as Markdown."""

import re
from collections.abc import Collection, Iterable, Sequence
from itertools import takewhile
from pathlib import Path
from typing import Any

from .csv_tables import Row
from .line_width import width

WIDEST = 36
"""Characters of a column; longer text is wrapped."""
NARROWEST = 16
"""Characters of a column below which text is not wrapped further."""
EDGES = 3
"""Characters beside each column: two blanks and a line."""
PIPED = 200
"""Characters of a line in a file or a pipe."""
MOST = 8
"""Columns of a summary that are printed unless more are asked for."""
LISTED = 8
"""Files of one folder that are named; more are counted."""


UNITS = {
    "m": "m", "m2": "m²", "s": "s", "ms": "ms", "mps": "m/s", "radps": "rad/s", "deg": "°",
}  # fmt: skip
"""Units by the endings of columns that state them."""


def headed(column: str, share: bool = False) -> str:
    """Return the name of a column for reading, its unit in brackets; of shares it is per cent.

    Examples
    --------
    >>> [headed(name) for name in ("clearance_min_m", "median ms", "time_ratio", "speed_mps")]
    ['clearance min (m)', 'median (ms)', 'time ratio', 'speed (m/s)']
    >>> headed("goals_in_time", share=True)
    'goals in time (%)'
    """
    *words, last = column.replace("_", " ").split(" ")
    if share:
        return f"{' '.join([*words, last])} (%)"
    if words and last in UNITS:
        return f"{' '.join(words)} ({UNITS[last]})"
    return " ".join([*words, last])


def column_named(text: str, columns: Iterable[str]) -> str:
    """Return the column that a name means, or a printed heading; "" for none.

    Examples
    --------
    >>> column_named("time mean (s)", ["success", "time_mean_s"])
    'time_mean_s'
    """
    columns, words = list(columns), " ".join(text.split())
    headings = (name for name in columns if words in (headed(name), headed(name, share=True)))
    return text if text in columns else next(headings, "")


def with_unit(column: str, value: Any, form: str = ".4g") -> str:
    """Return a value as a heading, with the unit that the name of its column states.

    Parameters
    ----------
    form : of a float, as after the colon in an f-string.

    Examples
    --------
    >>> with_unit("delay_s", -0.5), with_unit("region", "box_1")
    ('−0.5 s', 'box_1')
    """
    if not isinstance(value, int | float):
        return format_cell(value)
    unit = UNITS.get(column.rpartition("_")[2], "")
    from ...draw.style import MINUS  # imports NumPy, which completion does not wait for

    return f"{format_cell(value, form).replace('-', MINUS)} {unit}".rstrip()


UNKNOWN = "\u2013"
"""Stands for a number that is not known."""


def format_cell(value: Any, form: str = ".4g") -> str:
    """Return a cell as text: a float with four digits, a dash for NaN, None empty."""
    if isinstance(value, float):
        return UNKNOWN if value != value else format(value + 0.0, form)  # of -0.0 this is 0.0
    return "" if value is None else str(value)


def per_cent(value: Any) -> Any:
    """Return a share in per cent; what is no number as it is.

    Examples
    --------
    >>> [per_cent(value) for value in (0.25, 1, True, "none", None)]
    [25.0, 100.0, True, 'none', None]
    """
    known = isinstance(value, int | float) and not isinstance(value, bool)
    return 100.0 * value if known else value


def in_per_cent(row: Row, shares: Collection[str]) -> Row:
    """Return a line with those columns in per cent."""
    return {name: per_cent(value) if name in shares else value for name, value in row.items()}


def main_columns(rows: Sequence[Row], printed: Sequence[str]) -> list[str]:
    """Return the columns that a table has in a terminal.

    Behind those that name a line `MOST` are left, if there are so many: without those that hold
    one value in all lines, then without the ones before the last.

    Parameters
    ----------
    rows : of the summary; all columns of a single line, where none are printed.
    printed : see `Experiment.printed`; those that hold nothing are left out.
    """
    every = columns_of(rows)
    if not printed and len(rows) < 2:
        return every
    names = _naming(rows)
    rest = [name for name in printed or every if name not in names]
    held = [name for name in rest if any(row.get(name) not in ("", None) for row in rows)]
    if len(held) > MOST:
        held = [name for name in held if len({repr(row.get(name)) for row in rows}) > 1] or held
    return [*names, *(held if len(held) <= MOST else (*held[: MOST - 1], held[-1]))]


def print_table(rows: Sequence[Row], shares: Collection[str] = ()) -> None:
    """Print a table, on its side where many quantities stand against few rows.

    What is too wide for the terminal is folded into several tables below each other, each
    with the columns that name the lines; text is wrapped between words. In a file or a pipe
    there are 200 characters, or as many as COLUMNS says.

    Parameters
    ----------
    rows : lines.
    shares : columns that hold shares, which are printed in per cent.
    """
    from rich.console import Console
    from rich.table import Table

    upright = not sideways(rows)
    lines = [
        [headed(name) if upright else name, *(_printed(row[name], name in shares) for row in rows)]
        for name in (rows[0] if rows else ())
    ]
    columns = lines if upright else [list(line) for line in zip(*lines, strict=True)]
    names = min(max(len(_naming(rows)), 1), 2) if upright else 1
    console = Console(width=width() or PIPED, markup=False)  # reasons may hold brackets
    widest = WIDEST if upright else _share(columns, console.width)
    for block in _fold(columns, names, console.width, widest):
        table = Table()
        for column in block:
            table.add_column(column[0], max_width=_needed(column, widest))
        for line in zip(*(column[1:] for column in block), strict=True):
            table.add_row(*line)
        console.print(table)


def _printed(value: Any, share: bool) -> str:
    """Return a cell as text, of a share with its unit; a dash where there is nothing."""
    if value in (None, ""):
        return UNKNOWN
    found = per_cent(value) if share else value
    return format_cell(found) + (" %" if found is not value and found == found else "")


def sideways(rows: Sequence[Row]) -> bool:
    """Whether a table reads better with a line per quantity: many of them, in few rows."""
    return 0 < len(rows) <= 4 and len(rows[0]) > 8


def _naming(rows: Sequence[Row]) -> list[str]:
    """Return the first columns that hold text: they name the lines."""
    return [
        *takewhile(
            lambda name: all(isinstance(row.get(name), str) for row in rows), columns_of(rows)
        )
    ]


def _needed(column: Sequence[str], widest: int) -> int:
    """Return the characters of a column whose text is wrapped at ``widest``, but in no word."""
    longest = max(len(word) for cell in column for word in [*cell.split(), ""])
    return max(longest, min(max(map(len, column)), widest))


def _share(columns: Sequence[Sequence[str]], width: int) -> int:
    """Return where text is wrapped so that all columns but the first fit, if they can."""
    first, rest = columns[0], columns[1:]
    room = width - 1 - _needed(first, WIDEST) - EDGES
    return min(WIDEST, max(room // max(len(rest), 1) - EDGES, NARROWEST))


def _fold(columns: list[list[str]], names: int, width: int, widest: int) -> list[list[list[str]]]:
    """Share columns out to tables of at most this width; each begins with the naming ones."""

    def needed(column: list[str]) -> int:
        return _needed(column, widest) + EDGES

    first, rest = columns[:names], columns[names:]
    room = width - 1 - sum(map(needed, first))
    blocks: list[list[list[str]]] = [[]]
    used = 0
    for column in rest:
        if blocks[-1] and used + needed(column) > room:
            blocks.append([])
            used = 0
        blocks[-1].append(column)
        used += needed(column)
    return [[*first, *block] for block in blocks]


def list_files(folder: Path, files: Sequence[Path]) -> list[str]:
    """Name the files of a result; of a folder with many their number."""
    by_folder: dict[Path, list[Path]] = {}
    for path in files:
        inside = path.relative_to(folder)
        top = folder / inside.parts[0] if len(inside.parts) > 1 else folder
        by_folder.setdefault(top, []).append(path)
    lines: list[str] = []
    for top, some in by_folder.items():
        many = top != folder and len(some) > LISTED and top.name == "files"
        lines += [f"{top}: {len(some)} files"] if many else [str(path) for path in some]
    return lines


def markdown_table(rows: Sequence[Row]) -> str:
    r"""Return rows as a Markdown table; words stand left, numbers right.

    Examples
    --------
    >>> print(markdown_table([{"planner": "a|b", "share": 0.123456}]))
    | planner | share |
    | :-- | --: |
    | a\|b | 0.1235 |
    """
    columns = columns_of(rows)
    marks = [":--" if has_words(rows, name) else "--:" for name in columns]
    lines = [[plain(name) for name in columns], marks]
    lines += [[plain(format_cell(row.get(name))) for name in columns] for row in rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def columns_of(rows: Sequence[Row]) -> list[str]:
    """Return the names of all columns, in the order in which they first appear."""
    return list(dict.fromkeys(name for row in rows for name in row))


def has_words(rows: Sequence[Row], name: str) -> bool:
    """Whether a column holds words, which stand left."""
    return any(isinstance(row.get(name), str) for row in rows)


def plain(text: str) -> str:
    r"""Return text that means nothing to Markdown or HTML but itself, in one line.

    Examples
    --------
    >>> plain("<b>a_b*</b> `x` [y]")
    '&lt;b&gt;a_b\\*&lt;/b&gt; \\`x\\` \\[y\\]'
    >>> plain("_a_b_ costs $5 ~ $6")
    '\\_a_b\\_ costs \\$5 \\~ \\$6'
    """
    for sign, written in (("\\", "\\\\"), ("&", "&amp;"), ("<", "&lt;"), (">", "&gt;")):
        text = text.replace(sign, written)
    text = re.sub(r"[|*`\[\]$~]|(?<!\w)_+|_+(?!\w)", _escaped, text)  # not underscores in a word
    return " ".join(text.split())


def _escaped(signs: re.Match[str]) -> str:
    return "".join(f"\\{sign}" for sign in signs[0])

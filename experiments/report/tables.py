"""Tables of a report: on their side where that reads better, with what each column means."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby, takewhile
from typing import Any

from ...draw.style import MINUS, number
from ..engine.base import Row
from ..engine.column_descriptions import ColumnDescription
from ..engine.text_tables import (
    WIDEST,
    columns_of,
    format_cell,
    has_words,
    headed,
    naming,
    per_cent,
    sideways,
)
from .page import rendered

FLAGS = {
    "collision": "contact",
    "collisions": "contact",
    "deadlock": "stuck",
    "deadlocks": "stuck",
    "below_reference": "gave way",
    "driven_below": "gave way",
    "fallback_plans": "not optimal",
    "fallbacks": "not optimal",
    "entered": "entered",
    "deadline_misses": "late",
    "errors": "stopped",
    "above_tail": "too small",
}
"""Column -> the word beside a cell of it that is neither 0 nor empty."""
_OTHER = "Other"
_MANY = 9  # columns from which on those with one value throughout become a sentence


def flagged(name: str, value: Any) -> str:
    """Return the word that warns of a cell's value; empty where there is nothing to warn of."""
    wrong = value not in (None, "", 0) and value == value  # NaN is not known
    return FLAGS[name] if name in FLAGS and wrong else ""


def html_table(
    rows: Sequence[Row], caption: str, descriptions: Mapping[str, ColumnDescription] | None = None
) -> str:
    """Return rows as a table.

    Many quantities of few lines stand on their side, each with its meaning. Otherwise columns
    sort at a click and stand in their groups; of a wide table those with the same value in every
    line are said in a sentence, and what the columns mean follows, folded.

    Parameters
    ----------
    rows : lines.
    caption : plain text.
    descriptions : of the columns, where known.
    """
    descriptions = descriptions or {}
    first = leading(rows, descriptions)
    upright = not sideways(rows)
    every = [_column(name, rows, descriptions, upright) for name in _grouped(rows, descriptions)]
    names, rest = every[: len(first)], every[len(first) :]
    same = _constant(rows, [column.name for column in rest])
    columns = [column for column in rest if column.name not in same]
    groups = [(name, len(list(some))) for name, some in groupby(one.group for one in columns)]
    known = {name for name, _ in groups} - {_OTHER}
    return rendered(
        "table.html",
        caption=caption,
        sideways=not upright,
        names=names,
        columns=columns,
        groups=groups if len(known) > 1 else [],
        explained=any(column.meaning for column in (*names, *columns)),
        lines=[{one.name: _Cell(one, row.get(one.name)) for one in every} for row in rows],
        same=[_said(column, rows[0]) for column in rest if column.name in same],
    )


@dataclass(frozen=True)
class _Column:
    """A column as the page shows it.

    Attributes
    ----------
    name, heading, title : as in the table, for reading, and with the unit of shares.
    meaning, group : as of `ColumnDescription`; empty where no page defines the column.
    share : whether it holds shares, which are shown in per cent.
    words : whether it holds text. decimals : digits after the point that its numbers have at most.
    """

    name: str
    heading: str
    title: str
    meaning: str
    group: str
    share: bool
    words: bool
    decimals: int


def _column(
    name: str, rows: Sequence[Row], descriptions: Mapping[str, ColumnDescription], upright: bool
) -> _Column:
    """Return a column; below one that is upright, words stand left and points below each other."""
    known = descriptions.get(name)
    share = known is not None and known.share
    values = [in_unit(row.get(name), known) for row in rows] if upright else []
    digits = [len(_fraction(shown(value))) for value in values if isinstance(value, float)]
    return _Column(
        name, headed(name), titled(name, known), known.text if known else "",
        known.group if known else _OTHER, share, upright and has_words(rows, name),
        max(digits, default=0),
    )  # fmt: skip


@dataclass(frozen=True)
class _Cell:
    """A value below a column; a number is carried with all its digits, for the sorting."""

    column: _Column
    value: Any

    @property
    def text(self) -> str:
        return shown(per_cent(self.value) if self.column.share else self.value)

    @property
    def number(self) -> float | None:
        return float(self.value) if isinstance(self.value, int | float) else None

    @property
    def flag(self) -> str:
        return flagged(self.column.name, self.value)

    @property
    def kinds(self) -> str:
        long = isinstance(self.value, str) and len(self.text) > WIDEST
        held = {"words": self.column.words, "long": long, "flagged": bool(self.flag)}
        return " ".join(name for name, there in held.items() if there)

    @property
    def blanks(self) -> str:
        """Blanks behind a number that bring its point below those of the others."""
        missing = self.column.decimals - len(_fraction(self.text))
        if self.number is None or not self.column.decimals or not self.text[-1:].isdigit():
            return ""
        if "e" in self.text:
            return ""
        return ("" if "." in self.text else "\u2008") + "\u2007" * missing  # point and digits

    @property
    def plain(self) -> str:
        return format_cell(self.value)


def _said(column: _Column, row: Row) -> str:
    """Say which value a column holds in every line."""
    cell = _Cell(column, row.get(column.name))
    return f"{column.title} {cell.text or 'none'}{f' ({cell.flag})' if cell.flag else ''}"


def leading(rows: Sequence[Row], descriptions: Mapping[str, ColumnDescription]) -> list[str]:
    """Return the first columns, which name a line: words whose meaning the config states."""
    columns = columns_of(rows)
    if not descriptions:
        return columns[: naming(rows)]
    found = list(
        takewhile(
            lambda name: (
                name not in descriptions and all(isinstance(r.get(name), str) for r in rows)
            ),
            columns,
        )
    )
    return found or columns[:1]


def _grouped(rows: Sequence[Row], descriptions: Mapping[str, ColumnDescription]) -> list[str]:
    """Return all columns, those of one group beside each other, after those that name a line."""
    first = leading(rows, descriptions)
    rest = [name for name in columns_of(rows) if name not in first]
    groups = {name: descriptions[name].group if name in descriptions else _OTHER for name in rest}
    order = [*dict.fromkeys(group for group in groups.values() if group != _OTHER), _OTHER]
    return [*first, *sorted(rest, key=lambda name: order.index(groups[name]))]


def titled(name: str, meaning: ColumnDescription | None) -> str:
    """Return the name of a column for reading, with its unit."""
    return headed(name, meaning is not None and meaning.share)


def in_unit(value: Any, meaning: ColumnDescription | None) -> Any:
    """Return a value in the unit that the name of its column states: a share in per cent."""
    return per_cent(value) if meaning is not None and meaning.share else value


def shown(value: Any) -> str:
    """Return a cell as text: of a number four digits at least, and no exponent below 1e7.

    Examples
    --------
    >>> [shown(value) for value in (0.123456, 10261.7, float("nan"), None, "a", True)]
    ['0.1235', '10262', '–', '', 'a', 'yes']
    """
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float) and 1e4 <= abs(value) < 1e7:
        return number(value, ".0f")
    text = format_cell(value)
    if isinstance(value, int | float):
        return text.replace("-", MINUS)
    return text


def _fraction(text: str) -> str:
    """Return the digits after the point; none of a number with an exponent."""
    return "" if "e" in text else text.partition(".")[2]


def _constant(rows: Sequence[Row], columns: Sequence[str]) -> list[str]:
    """Return those of many columns that hold one value in every line.

    Of a table on its side, where there is room, only those that hold nothing.
    """
    if len(columns) < _MANY or len(rows) < 2:
        return []
    held = {name: {repr(row.get(name)) for row in rows} for name in columns}
    if sideways(rows):
        return [name for name, values in held.items() if values <= {repr(""), repr(None)}]
    return [name for name, values in held.items() if len(values) == 1]

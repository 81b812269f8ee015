"""What a column means: the tables of docs/results.md and docs/metrics.md, which the wheel holds.

These pages are the one source; `wideberth show column` prints their sentences.
"""

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from ...framework.plugins.registry import names
from ...framework.values.errors import WideberthError, nearest, short
from .places import page_address
from .text_tables import UNKNOWN, column_named

PAGES = Path(__file__).resolve().parents[2] / "docs"
"""Folder of the pages."""


_SHARE = re.compile(
    r"((surface|centre): )?((least|largest|mean|median|true) )*"
    r"(shares?|contents?|(collision )?probability|risk)\b"
)
"""How the meaning of a column of shares begins."""
_BOUND = re.compile(r"(_single)?_(low|high)$")
"""End of the name of a column that bounds the one before it."""


@dataclass(frozen=True)
class _Table:
    group: str
    studies: frozenset[str]  # empty: of every study
    columns: dict[str, str]


def column_texts(study: str) -> dict[str, str]:
    """Return column -> what it means in the tables of a study, by its registered name.

    The last definition counts: a page defines the columns of the table first, then those of the
    summary, which may condense a column of the same name.
    """
    common = [table for table in _tables() if not table.studies]
    own = [table for table in _tables() if study in table.studies]
    return {name: text for table in (*common, *own) for name, text in table.columns.items()}


def shares(study: str, columns: Sequence[str]) -> frozenset[str]:
    """Return those columns of a study's tables that hold shares, by what the pages say of them.

    Bounds of an interval are shares where the quantity is one.
    """
    texts = column_texts(study)
    return frozenset(
        name
        for name in columns
        if name in texts and _SHARE.match(texts.get(_BOUND.sub("", name), texts[name]))
    )


def column_meanings(column: str) -> list[str]:
    """Return what a column means: a line for each definition, with the studies that it is of.

    Parameters
    ----------
    column : its name, or its heading in a printed table.

    Raises
    ------
    WideberthError : no page defines a column of this name.
    """
    studies: dict[str, set[str]] = {}
    column = (
        column_named(column, (name for table in _tables() for name in table.columns)) or column
    )
    for table in _tables():
        if column in table.columns:
            studies.setdefault(table.columns[column], set()).update(table.studies)
    if not studies:
        near = nearest(column, defined_columns())
        raise WideberthError(
            f"no page defines a column {short(column)}{near or ';'} {page_address('results')} and "
            f"{page_address('metrics')} define them"
        )
    return [
        " ".join([column, *([f"({', '.join(sorted(of))})"] if of else [])])
        + f": {text}{'; printed in per cent' * bool(_SHARE.match(text))}"
        for text, of in studies.items()
    ]


def dash_meaning(meanings: Sequence[str]) -> str:
    """Return when a printed table has a dash below a column with these meanings."""
    if any("NaN" in line for line in meanings):
        return f"A dash ({UNKNOWN}) in a printed table is NaN."
    return (
        f"A dash ({UNKNOWN}) in a printed table: the line has no episode, pair, plan or step that "
        "counts for this column, or it was not measured."
    )


def defined_columns() -> list[str]:
    """Return the names of all columns that a page defines, sorted."""
    found = {name for table in _tables() for name in table.columns}
    return sorted(name for name in found if not name.startswith("_"))  # an ending, as in `_low`


@cache
def _tables() -> tuple[_Table, ...]:
    """Return every table of the pages whose first column is headed "Column"."""
    registered = frozenset(names("experiments"))
    return tuple(
        table
        for name in ("results.md", "metrics.md")
        for table in _read((PAGES / name).read_text(encoding="utf-8"), registered)
    )


def _read(text: str, registered: frozenset[str]) -> Iterator[_Table]:
    """Yield the tables of a page.

    A table belongs to the studies that the text before it names, since the last heading or
    table; else to those that the page names above its first heading.
    """
    group, named = "", set[str]()
    page: set[str] | None = None
    for block in text.split("\n\n"):
        lines = block.strip().splitlines()
        if lines and lines[0].startswith("#"):
            if lines[0].startswith("## "):
                page = named if page is None else page
            group, named = lines[0].lstrip("# "), set()
            lines = lines[1:]
        if lines and lines[0].startswith("| Column |"):
            columns = dict(entry for line in lines[2:] for entry in _entries(line))
            yield _Table(group, frozenset(named or page or ()), columns)
            named = set()
        else:
            named |= {word for word in re.findall(r"`(\w+)`", block) if word in registered}


def _entries(line: str) -> Iterator[tuple[str, str]]:
    """Yield name and meaning for each column that a line of a table defines."""
    first, *rest = (cell.strip() for cell in line.strip().strip("|").split(" | "))
    said = [re.sub(r"\[(.*?)\]\(.*?\)", r"\1", cell).replace("`", "") for cell in rest]
    for name in re.findall(r"`(\w+)`", first):
        yield name, ": ".join(said)

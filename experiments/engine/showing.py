"""How results are shown in a terminal: tables that fit, files that can be counted."""

import sysconfig
import traceback
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from ...framework.values.errors import WideberthError
from .base import Row

WIDEST = 36
"""Characters of a column; longer text is wrapped."""
LISTED = 8
"""Files of one folder that are named; more are counted."""


def shown(value: Any) -> str:
    """Return a cell as a reader wants it: four digits, and nothing for None."""
    if isinstance(value, float):
        return f"{value:.4g}"
    return "" if value is None else str(value)


def fault(error: BaseException) -> str:
    """Say what an exception says; of anything but our own also its type and where it arose."""
    if isinstance(error, WideberthError):
        return str(error)
    frames = traceback.extract_tb(error.__traceback__)
    own = [frame for frame in frames if not _of_a_library(Path(frame.filename))]
    place = "".join(f" ({frame.filename}, line {frame.lineno})" for frame in (own or frames)[-1:])
    text = f": {error}" if str(error) else ""
    return f"{type(error).__name__}{text}{place}"


@contextmanager
def told(head: str = "") -> Iterator[None]:
    """Turn whatever a plug-in raises, or an exit, into one message that begins with ``head``.

    Raises
    ------
    WideberthError : the block has raised anything but a KeyboardInterrupt.
    """
    try:
        yield
    except (Exception, SystemExit) as error:
        raise WideberthError(f"{head}{fault(error)}") from error


def _of_a_library(file: Path) -> bool:
    """Whether a file is of an installed library or of Python itself, not somebody's own."""
    return "site-packages" in file.parts or file.is_relative_to(sysconfig.get_path("stdlib"))


def print_table(rows: Sequence[Row]) -> None:
    """Print a table, on its side where many quantities stand against few rows.

    What is too wide for the terminal is folded into several tables below each other, each
    with the columns that name the lines. In a file or a pipe there are 200 characters.
    """
    from rich.console import Console
    from rich.table import Table

    lines = [[name, *(shown(row[name]) for row in rows)] for name in (rows[0] if rows else ())]
    upright = len(rows) > 4 or len(lines) <= 8
    columns = lines if upright else [list(line) for line in zip(*lines, strict=True)]
    names = _naming(rows) if upright else 1
    console = Console(markup=False)  # notes and reasons may hold brackets
    if not console.is_terminal:
        console = Console(width=max(console.width, 200), markup=False)
    for block in _fold(columns, names, console.width):
        table = Table()
        for column in block:
            table.add_column(column[0].replace("_", " ") if upright else column[0])
        for line in zip(*(column[1:] for column in block), strict=True):
            table.add_row(*line)
        console.print(table)


def _naming(rows: Sequence[Row]) -> int:
    """Count the first columns that hold text: they name the lines."""
    count = 0
    for name in rows[0] if rows else ():
        if not all(isinstance(row[name], str) for row in rows):
            break
        count += 1
    return min(max(count, 1), 2)


def _fold(columns: list[list[str]], names: int, width: int) -> list[list[list[str]]]:
    """Share columns out to tables of at most this width; each begins with the naming ones."""

    def needed(column: list[str]) -> int:
        return min(max(map(len, column)), WIDEST) + 3  # two blanks and a line

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

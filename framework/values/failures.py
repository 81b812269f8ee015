"""Exceptions of plug-ins in words: what was raised, and in which line of whose file."""

import sysconfig
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from pathlib import Path
from typing import TypeAlias

from .errors import WideberthError

Take: TypeAlias = Callable[[str, str], object]
"""What is called with the kind of a failure, its type and place, and with all its words."""

_PACKAGE = __name__.partition(".")[0]
_taken: ContextVar[Take | None] = ContextVar("taken", default=None)


def in_words(error: BaseException) -> str:
    """Return the type of an exception and its message; unless it is our own, where it arose.

    The place is the last line outside of wideberth, other libraries aside; where there is none,
    the last line of a library, or of all.

    Examples
    --------
    >>> in_words(WideberthError("no path is set"))
    'WideberthError: no path is set'
    """
    text = f": {error}" if str(error) else ""
    return f"{type(error).__name__}{text}{_place(error)}"


def caught(error: Exception) -> str:
    """Return an exception `in_words`; where it is not our own, report it, see `reporting`."""
    words, take = in_words(error), _taken.get()
    if take is not None and not isinstance(error, WideberthError):
        take(f"{type(error).__name__}{_place(error)}", words)
    return words


@contextmanager
def reporting(take: Take) -> Iterator[None]:
    """Have what plug-ins raise within the block reported, while the robot drives on."""
    token = _taken.set(take)
    try:
        yield
    finally:
        _taken.reset(token)


def _place(error: BaseException) -> str:
    """Return " (FILE, line N)"; "" of our own exceptions, and of one that was not raised."""
    if isinstance(error, WideberthError):
        return ""
    frames = [
        (frame.f_globals.get("__name__", ""), frame.f_code.co_filename, line)
        for frame, line in traceback.walk_tb(error.__traceback__)
    ]
    outside = [one for one in frames if one[0].partition(".")[0] != _PACKAGE]
    user = [one for one in outside if not _of_a_library(Path(one[1]))]
    return "".join(f" ({file}, line {line})" for _, file, line in (user or outside or frames)[-1:])


def _of_a_library(file: Path) -> bool:
    """Return whether a file belongs to an installed library or to Python itself."""
    return "site-packages" in file.parts or file.is_relative_to(sysconfig.get_path("stdlib"))

"""Exceptions of plug-ins as messages for the user."""

import sysconfig
import traceback
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from ...framework.values.errors import WideberthError


def describe_error(error: BaseException) -> str:
    """Return an exception's message; unless it is our own, with its type and where it arose."""
    if isinstance(error, WideberthError):
        return str(error)
    frames = traceback.extract_tb(error.__traceback__)
    own = [frame for frame in frames if not _of_a_library(Path(frame.filename))]
    place = "".join(f" ({frame.filename}, line {frame.lineno})" for frame in (own or frames)[-1:])
    text = f": {error}" if str(error) else ""
    return f"{type(error).__name__}{text}{place}"


@contextmanager
def as_user_error(head: str = "") -> Iterator[None]:
    """Re-raise any exception of the block, or an exit, as a `WideberthError`.

    Parameters
    ----------
    head : begins the message.

    Raises
    ------
    WideberthError : the block has raised anything but a KeyboardInterrupt.
    """
    try:
        yield
    except (Exception, SystemExit) as error:
        raise WideberthError(f"{head}{describe_error(error)}") from error


def _of_a_library(file: Path) -> bool:
    """Return whether a file belongs to an installed library or to Python itself."""
    return "site-packages" in file.parts or file.is_relative_to(sysconfig.get_path("stdlib"))

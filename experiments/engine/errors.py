"""Exceptions of plug-ins as messages for the user."""

from collections.abc import Iterator
from contextlib import contextmanager

from ...framework.values.errors import WideberthError, place_of


def describe_error(error: BaseException) -> str:
    """Return an exception's message; unless it is our own, with its type and where it arose."""
    if isinstance(error, WideberthError):
        return str(error)
    text = f": {error}" if str(error) else ""
    return f"{type(error).__name__}{text}{place_of(error)}"


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

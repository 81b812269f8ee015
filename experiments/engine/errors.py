"""Exceptions of plug-ins as messages for the user."""

import os
from collections.abc import Iterator
from contextlib import chdir, contextmanager

from ...framework.values.errors import WideberthError
from ...framework.values.failures import in_words


def describe_error(error: BaseException) -> str:
    """Return an exception's message; unless it is our own, with its type and where it arose."""
    return str(error) if isinstance(error, WideberthError) else in_words(error)


@contextmanager
def as_user_error(head: str = "") -> Iterator[None]:
    """Re-raise any exception of the block, or an exit, as a `WideberthError`.

    The working folder is that from before the block again, whatever plug-ins in it have done.

    Parameters
    ----------
    head : begins the message.

    Raises
    ------
    WideberthError : the block has raised anything but a KeyboardInterrupt.
    """
    try:
        with chdir(os.curdir):
            yield
    except (Exception, SystemExit) as error:
        raise WideberthError(f"{head}{describe_error(error)}") from error

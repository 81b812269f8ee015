"""Libraries that come with an extra, imported when they are needed."""

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from importlib import import_module
from importlib.util import find_spec
from typing import Any

from ..values.errors import MissingLibraryError, WideberthError, together
from ..values.errors import missing as missing

_LACKING: ContextVar[list[MissingLibraryError] | None] = ContextVar("lacking", default=None)
"""What `check_extra` has found missing within the outermost `gathered`; None outside of one."""


def from_extra(module: str, extra: str, need: str, otherwise: str = "") -> Any:
    """Return a module of a library that an extra of this package installs.

    Parameters
    ----------
    module : name of the module.
    extra : name of the extra.
    need : who needs what, as "messages of ROS 2 need rosbags"; the error begins with it.
    otherwise : what can be done without the library; the error ends with it.

    Raises
    ------
    WideberthError : it is not installed.
    """
    try:
        return import_module(module)
    except ImportError as error:
        raise missing(extra, need, error, otherwise) from error


def check_extra(module: str, extra: str, need: str, otherwise: str = "") -> None:
    """Refuse what needs a library that is not installed; nothing is imported.

    For constructors, so that the error comes before any work. Arguments and error are those of
    `from_extra`; within `gathered` the error comes at its end.
    """
    library = module.partition(".")[0]
    try:
        if find_spec(library) is not None:
            return
        reason = ImportError(f"No module named {library!r}")
    except ImportError as error:
        reason = error
    lack, lacking = missing(extra, need, reason, otherwise), _LACKING.get()
    if lacking is None:
        raise lack from reason
    lacking.append(lack)


@contextmanager
def gathered() -> Iterator[None]:
    """Go on where `check_extra` finds a library missing, and name all of them at the end.

    Within another one it does nothing.

    Raises
    ------
    WideberthError : a library is missing; any other error of the block may come of that, and
        is not named.
    """
    if _LACKING.get() is not None:
        yield
        return
    lacking: list[MissingLibraryError] = []
    token = _LACKING.set(lacking)
    try:
        yield
    except WideberthError as error:
        if lacking:
            raise together([*lacking, *_missing_in(error)]) from error
        raise
    finally:
        _LACKING.reset(token)
    if lacking:
        raise together(lacking)


def _missing_in(error: BaseException | None) -> Iterator[MissingLibraryError]:
    """Yield the errors of missing libraries among those that led to this one."""
    while error is not None:
        if isinstance(error, MissingLibraryError):
            yield error
        error = error.__cause__

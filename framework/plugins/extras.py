"""Libraries that come with an extra, imported when they are needed."""

from importlib import import_module
from typing import Any

from ..values.errors import WideberthError


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


def missing(extra: str, need: str, error: Exception, otherwise: str = "") -> WideberthError:
    """Return the error for a library that cannot be imported; see `from_extra`."""
    words = f"{need}, which cannot be imported ({error}): {installation(extra)}"
    return WideberthError(f"{words}; {otherwise}" if otherwise else words)


def installation(extra: str) -> str:
    """Say how the libraries of an extra are installed.

    Examples
    --------
    >>> installation("sim")
    "pip install 'wideberth[sim]'"
    """
    return f"pip install 'wideberth[{extra}]'"

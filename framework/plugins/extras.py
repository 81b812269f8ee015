"""Libraries that come with an extra, imported when they are needed."""

from importlib import import_module
from importlib.util import find_spec
from typing import Any

from ..values.errors import missing


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
    `from_extra`.
    """
    library = module.partition(".")[0]
    try:
        if find_spec(library) is not None:
            return
        reason = ImportError(f"No module named {library!r}")
    except ImportError as error:
        reason = error
    raise missing(extra, need, reason, otherwise) from reason

"""Libraries that come with an extra, imported when they are needed."""

from importlib import import_module
from typing import Any

from ..values.errors import WideberthError


def from_extra(module: str, extra: str, need: str) -> Any:
    """Return a module of a library that an extra of this package installs.

    Parameters
    ----------
    module : name of the module.
    extra : name of the extra.
    need : who needs what, as "messages of ROS 2 need rosbags"; the error begins with it.

    Raises
    ------
    WideberthError : it is not installed.
    """
    try:
        return import_module(module)
    except ImportError as error:
        raise WideberthError(
            f"{need}, which is not installed: pip install 'wideberth[{extra}]'"
        ) from error

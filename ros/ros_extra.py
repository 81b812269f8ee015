"""Libraries of the extra ``bags``, imported when they are needed."""

from typing import Any

from ..framework.plugins.extras import from_extra


def needed(module: str) -> Any:
    """Return a module of a library that comes with the extra ``bags``.

    Raises
    ------
    WideberthError : it is not installed.
    """
    return from_extra(module, "bags", f"messages of ROS 2 need {module.partition('.')[0]}")

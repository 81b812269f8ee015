"""Libraries of the extra ``ros``, imported when they are needed."""

from typing import Any

from wideberth.framework.plugins.extras import from_extra


def needed(module: str) -> Any:
    """Return a module of a library that comes with the extra ``ros``.

    Raises
    ------
    WideberthError : it is not installed.
    """
    return from_extra(module, "ros", f"messages of ROS 2 need {module.partition('.')[0]}")

"""Libraries of the extra ``ros``, imported when they are needed."""

from importlib import import_module
from typing import Any

from ..framework.values.errors import WideberthError


def needed(module: str) -> Any:
    """Return a module of a library that comes with the extra ``ros``.

    Raises
    ------
    WideberthError : it is not installed.
    """
    try:
        return import_module(module)
    except ImportError as error:
        raise WideberthError(
            f"messages of ROS 2 need {module.partition('.')[0]}, which is not installed: "
            "pip install 'wideberth[ros]'"
        ) from error

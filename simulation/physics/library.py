"""The library MuJoCo, imported when it is needed."""

from functools import cache
from importlib import import_module
from typing import Any

from ...framework.values.errors import WideberthError


@cache
def mujoco() -> Any:
    """Return the module `mujoco`.

    Raises
    ------
    WideberthError : it is not installed.
    """
    try:
        return import_module("mujoco")
    except ImportError as error:
        raise WideberthError(
            "the physics simulation needs MuJoCo, which is not installed: "
            "pip install 'wideberth[physics]'"
        ) from error

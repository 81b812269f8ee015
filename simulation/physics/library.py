"""The library MuJoCo, imported when it is needed."""

from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from typing import Any

from ...framework.plugins.extras import from_extra


@cache
def mujoco() -> Any:
    """Return the module `mujoco`.

    Raises
    ------
    WideberthError : it is not installed.
    """
    return from_extra("mujoco", "physics", "the physics simulation needs MuJoCo")


@contextmanager
def collected_warnings() -> Iterator[list[str]]:
    """Collect what MuJoCo warns of, which it otherwise prints and writes into MUJOCO_LOG.TXT."""
    library = mujoco()
    before, found = library.get_mju_user_warning(), list[str]()
    library.set_mju_user_warning(found.append)
    try:
        yield found
    finally:
        library.set_mju_user_warning(before)

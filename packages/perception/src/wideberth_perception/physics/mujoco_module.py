"""The library MuJoCo, imported when it is needed."""

from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from typing import Any

from wideberth.framework.plugins.extras import check_extra, from_extra

_NEED = "the physics simulation needs MuJoCo"


@cache
def mujoco() -> Any:
    """Return the module `mujoco`.

    Raises
    ------
    WideberthError : it is not installed.
    """
    return from_extra("mujoco", "perception", _NEED)


def check_mujoco() -> None:
    """Refuse what needs MuJoCo where it is not installed; for constructors."""
    check_extra("mujoco", "perception", _NEED)


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

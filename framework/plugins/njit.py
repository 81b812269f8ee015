"""Numba, imported where a loop is first needed: its import takes a second."""

import logging
import os
from collections.abc import Callable, Sequence
from functools import cache
from pathlib import Path
from typing import Any

from .code_cache import check_private

LOG = logging.getLogger("wideberth.compiling")
_UNANNOUNCED: set[str] = set()
"""Modules whose compilation was not logged yet."""


def cached_njit(
    functions: Sequence[Callable[..., Any]], inner: Sequence[Callable[..., Any]] = ()
) -> tuple[Callable[..., Any], ...]:
    """Compile plain functions with Numba: once per machine, then from its cache.

    They are compiled at their first call, which a warning of `LOG` announces. Where no cache
    folder can be written, or others may write to it, they are compiled for this process alone:
    Numba unpickles what it finds there. A division by zero gives infinity or NaN, as in NumPy.

    Parameters
    ----------
    functions : those that are called from Python.
    inner : those that they call; they stay plain functions, too.

    Returns
    -------
    compiled : one for each of ``functions``.

    Examples
    --------
    >>> def twice(x: float) -> float:
    ...     return 2.0 * x
    >>> cached_njit([twice])[0](4.0)
    8.0
    """
    # else Numba takes the place of its cache from a file of the working folder
    os.environ.setdefault("NUMBA_CACHE_DIR", "")
    _announce_compilation()
    for function in inner:
        _register_inner(function)
    _UNANNOUNCED.update(function.__module__ for function in functions)
    return tuple(_compiled(function) for function in functions)


@cache  # several kernels may share one
def _register_inner(function: Callable[..., Any]) -> None:
    from numba.extending import register_jitable

    register_jitable(error_model="numpy")(function)


def _compiled(function: Callable[..., Any]) -> Callable[..., Any]:
    import numba

    try:
        compiled: Any = numba.njit(cache=True, error_model="numpy")(function)
        place = Path(compiled.stats.cache_path)
        if place.parent != Path(function.__code__.co_filename).parent and place.exists():
            check_private(place.parent, place, *place.iterdir())
    except (OSError, RuntimeError):  # no folder that can be written, or one of others
        compiled = numba.njit(error_model="numpy")(function)
    return compiled  # type: ignore[no-any-return]


@cache
def _announce_compilation() -> None:
    """Log when Numba begins to compile the functions of a module: it takes seconds."""
    from numba.core import event

    class Announcement(event.Listener):
        def on_start(self, event: Any) -> None:
            module = event.data["dispatcher"].py_func.__module__
            if module in _UNANNOUNCED:
                _UNANNOUNCED.remove(module)
                LOG.warning("compiling %s for its first use, some seconds ...", module)

        def on_end(self, event: Any) -> None: ...

    event.register("numba:compile", Announcement())  # type: ignore[no-untyped-call]

"""Numba, imported where a loop is first needed and not before."""

import os
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from ..plugins.extras import check_extra, from_extra
from .cache import check_private

_KNOWN: set[Callable[..., Any]] = set()
"""Functions that Numba knows as inner ones."""


def cached_njit(
    functions: Sequence[Callable[..., Any]], inner: Sequence[Callable[..., Any]] = ()
) -> tuple[Callable[..., Any], ...]:
    """Compile plain functions with Numba: once per machine, then from its cache.

    Where nothing can be cached they are compiled for this process alone, as where others may write
    to the cache: Numba unpickles what it finds there. A division by zero gives infinity or NaN, as
    in NumPy.

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
    numba = from_extra("numba", "fast", "compiled loops need Numba")
    from numba.extending import register_jitable

    for function in inner:
        if function not in _KNOWN:  # several kernels may share one
            _KNOWN.add(function)
            register_jitable(error_model="numpy")(function)

    def made(function: Callable[..., Any]) -> Callable[..., Any]:
        try:
            compiled = numba.njit(cache=True, error_model="numpy")(function)
            place = Path(compiled.stats.cache_path)
            if place.parent != Path(function.__code__.co_filename).parent and place.exists():
                check_private(place.parent, place, *place.iterdir())
        except (OSError, RuntimeError):  # no folder that can be written, or one of others
            compiled = numba.njit(error_model="numpy")(function)
        return compiled  # type: ignore[no-any-return]

    return tuple(made(function) for function in functions)


def check_numba(user: str) -> None:
    """Refuse what needs Numba where it is not installed; for constructors.

    Parameters
    ----------
    user : who needs it, as "navfn".

    Raises
    ------
    WideberthError : names the extra.
    """
    check_extra("numba", "fast", f"{user} needs Numba")

"""Plain functions of numbers and arrays, compiled by Numba when they are first needed."""

from collections.abc import Callable
from typing import Any


def kernel(
    function: Callable[..., Any], *inner: Callable[..., Any], error_model: str = "python"
) -> Callable[..., Any]:
    """Return a function as Numba compiles it: once per machine, then from its cache.

    Where nothing can be cached it is compiled for this process alone.

    Parameters
    ----------
    function : to be compiled at its first call.
    inner : functions that it calls, in whatever file.
    error_model : "python" raises for a division by zero; "numpy" goes on with inf or NaN.
    """
    import numba
    from numba.extending import register_jitable

    for one in inner:
        register_jitable(one)
    tool: Any = numba
    try:
        return tool.njit(cache=True, error_model=error_model)(function)  # type: ignore[no-any-return]
    except RuntimeError:  # no folder that can be written
        return tool.njit(error_model=error_model)(function)  # type: ignore[no-any-return]

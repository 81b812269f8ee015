"""CasADi functions with CasADi's own rounding, compiled or interpreted, called on arrays.

Sums stay in their order and no product is fused with a sum, so that every number is the one that
CasADi's virtual machine gives, to the byte; a constant power alone may be rounded otherwise.
"""

import ctypes
from collections.abc import Mapping
from typing import Any

import numpy as np

from ..values.arrays import Array
from ..values.errors import WideberthError
from .operations import exactly
from .records import Records
from .transpile import kernel_source, module_source

MOST_OPERATIONS = 2000
"""Of one function: a larger one takes seconds to compile."""

_KERNEL: Any = ctypes.CFUNCTYPE(
    None, ctypes.c_void_p, *[ctypes.c_int64] * 2, *[ctypes.c_void_p, ctypes.c_int64] * 3
)


class Exact:
    """Compiled functions of two vectors, evaluated for many columns in one call.

    Parameters
    ----------
    functions : by name, each of (v, p) with one result, see `kernel_source`.

    Raises
    ------
    WideberthError : one is too large, of another form, or cannot be compiled here.
    """

    def __init__(self, functions: Mapping[str, Any]) -> None:
        for name, one in functions.items():
            if one.n_instructions() > MOST_OPERATIONS:
                raise WideberthError(
                    f"{name} has {one.n_instructions()} operations; up to {MOST_OPERATIONS} are "
                    "compiled"
                )
        self._functions: Mapping[str, Any] = functions

        def source() -> str:
            return exactly(
                module_source(kernel_source(one, name) for name, one in functions.items())
            )

        self._records = Records.of("checks", functions, source, {})
        self._calls: dict[str, tuple[Any, int, int]] = {
            name: (_KERNEL(self._records.code(name)), self._records.place(name), one.nnz_out(0))
            for name, one in functions.items()
        }

    def __reduce__(self) -> tuple[type["Exact"], tuple[Mapping[str, Any]]]:
        """Leave the machine code behind."""
        return Exact, (self._functions,)

    def __call__(self, name: str, v: Array, p: Array) -> Array:
        """Evaluate at columns: v (rows, S, C) and p (rows, C), the same for all S -> (out, S, C).

        Both are contiguous.
        """
        call, record, rows = self._calls[name]
        _, times, count = v.shape
        found = np.empty((rows, times, count))
        places = (_address(v), v.strides[0], _address(p), 8 * count)
        out, row = _address(found), found.strides[0]
        for k in range(times):
            call(record, k * count, count, *places, out + 8 * k * count, row)
        return found


def _address(array: Array) -> int:
    """Where an array's numbers stand; `ndarray.ctypes` takes three times as long."""
    place: int = array.__array_interface__["data"][0]
    return place

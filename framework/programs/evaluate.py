"""CasADi functions of two vectors, evaluated at many columns in one call.

Numbers are those of CasADi's virtual machine. On Linux they are the same to the bit. Elsewhere the
mathematical functions of the C library may round otherwise than those that CasADi was linked with.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np

from ..values.arrays import Array, address
from ..values.errors import WideberthError
from .program import Program

try:
    from . import _evaluator
except ImportError:  # it was not built
    _evaluator = None  # type: ignore[assignment]


class ColumnFunctions:
    """CasADi functions of (v, p) with one result, by name.

    The C evaluator runs them as programs. CasADi itself evaluates all of them where that was not
    built, and a function that has an operation which programs do not have.

    Parameters
    ----------
    functions : by name, see `listing_of`.
    """

    def __init__(self, functions: Mapping[str, Any]) -> None:
        self._functions: Mapping[str, Any] = functions
        self._programs: dict[str, Program | None] = {
            name: _program(function) for name, function in functions.items()
        }

    def __reduce__(self) -> tuple[type["ColumnFunctions"], tuple[Mapping[str, Any]]]:
        """Leave the programs behind: the evaluator of another process may be another one."""
        return ColumnFunctions, (self._functions,)

    def __call__(self, name: str, v: Array, p: Array) -> Array:
        """Evaluate at columns: v (rows, S, C) and p (rows, C), the same for all S -> (out, S, C).

        Both are contiguous.
        """
        program = self._programs[name]
        if program is None or _evaluator is None:
            return _by_casadi(self._functions[name], v, p)
        _, times, count = v.shape
        out = np.empty((program.results, times, count))
        inputs = (address(v), v.strides[0], address(p), 8 * count)
        first, row = address(out), out.strides[0]
        for k in range(times):
            _evaluator.evaluate(
                program.address, k * count, count, *inputs, first + 8 * k * count, row
            )
        return out


def _program(function: Any) -> Program | None:
    """Write the program of a function; None where it cannot be run."""
    if _evaluator is None:
        return None
    try:
        return Program.of(function)
    except WideberthError:
        return None


def _by_casadi(function: Any, v: Array, p: Array) -> Array:
    _, times, count = v.shape
    columns = times * count
    if not columns:
        return np.empty((function.nnz_out(0), times, count))
    repeated = np.tile(p, times) if p.size else np.zeros((len(p), columns))
    result = function.map(columns)(v.reshape(len(v), columns), repeated)
    return np.array(result.nonzeros()).reshape(columns, -1).T.reshape(-1, times, count)

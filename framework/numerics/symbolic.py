"""CasADi with its NumPy behaviour fixed: the one place that imports it for the package.

Robots and regions are written with NumPy functions (``np.cos``), which also accept CasADi
expressions. CasADi 3.8 warns about that once and offers to choose; mode -1 keeps the
behaviour of 3.7 (a symbolic argument gives a symbolic result) without the warning.
"""

from collections.abc import Sequence
from typing import Any, cast

import casadi as ca
import numpy as np

from ..values.arrays import Array

if hasattr(ca.GlobalOptions, "setNumpyMode"):
    ca.GlobalOptions.setNumpyMode(-1)

__all__ = ["Mapped", "ca", "evaluated"]


class Mapped:
    """A mapped function, to be evaluated on arrays again and again.

    By way of a buffer, which reads and writes arrays where they are: turning them into CasADi's
    matrices and back takes three times as long as evaluating the residuals of a plan. The arrays
    stay, since handing their addresses over takes longer than copying what is in them. One call
    uses them at a time; a second one meanwhile gets others.

    Parameters
    ----------
    function : of columns, as `casadi.Function.map` makes it.
    """

    def __init__(self, function: Any) -> None:
        self._function: Any = function
        outputs = range(function.n_out())
        self._dense: bool = all(function.nnz_out(i) == function.numel_out(i) for i in outputs)
        self._free: list[tuple[Any, list[Array], list[Array]]] = []

    def __reduce__(self) -> tuple[type["Mapped"], tuple[Any]]:
        """Leave the buffers behind."""
        return Mapped, (self._function,)

    def __call__(self, columns: Sequence[Array | float]) -> list[Array]:
        """Evaluate: (N, n) arrays, a row per column, or a number for all, to (N, rows) ones."""
        try:
            made = self._free.pop()
        except IndexError:
            made = self._made()
        buffer, given, results = made
        for array, values in zip(given, columns, strict=True):
            array[...] = values
        if self._dense:
            buffer._eval()
            found = [array.copy() for array in results]
        else:  # zeros are not stored
            matrices = self._function.call([array.T for array in given])
            found = [np.asarray(matrix.full()).T for matrix in matrices]
        self._free.append(made)
        return found

    def _made(self) -> tuple[Any, list[Array], list[Array]]:
        function = self._function
        given = [
            np.zeros((function.size2_in(i), function.size1_in(i))) for i in range(function.n_in())
        ]
        results = [
            np.zeros((function.size2_out(i), function.size1_out(i)))
            for i in range(function.n_out())
        ]
        buffer, _ = function.buffer()
        for arrays, bind in ((given, buffer.set_arg), (results, buffer.set_res)):
            for i, array in enumerate(arrays):
                if array.size:
                    bind(i, memoryview(cast(Any, array)))
        return buffer, given, results


def evaluated(function: Any, columns: Sequence[Array]) -> list[Array]:
    """Evaluate a mapped function once, see `Mapped`."""
    return Mapped(function)(columns)

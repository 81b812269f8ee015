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

__all__ = ["ca", "evaluated"]


def evaluated(function: Any, columns: Sequence[Array]) -> list[Array]:
    """Evaluate a mapped function: (N, n) arrays, a row per column, to (columns, rows) ones.

    By way of a buffer, which reads and writes the arrays where they are: turning them into
    CasADi's matrices and back takes three times as long as evaluating the residuals of a plan.
    """
    outputs = range(function.n_out())
    if any(function.nnz_out(i) < function.numel_out(i) for i in outputs):  # no zeros are stored
        found = function.call([np.ascontiguousarray(values.T) for values in columns])
        return [np.asarray(values.full()).T for values in found]
    buffer, _ = function.buffer()
    given = [np.ascontiguousarray(values, dtype=np.float64) for values in columns]
    results = [np.empty((function.size2_out(i), function.size1_out(i))) for i in outputs]
    for values, bind in ((given, buffer.set_arg), (results, buffer.set_res)):
        for i, array in enumerate(values):
            if array.size:
                bind(i, memoryview(cast(Any, array)))
    buffer._eval()
    return results

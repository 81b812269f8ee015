"""One thread per process: for the same rounding anywhere, and so that workers do not contend."""

import os
import sys

from ...framework.values.errors import WideberthError

ROUNDING = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
"""Variables that NumPy's BLAS reads when it is loaded; they change the rounding of sums."""

WORKER = (
    *ROUNDING, "BLIS_NUM_THREADS", "VECLIB_MAXIMUM_THREADS", "NUMBA_NUM_THREADS", "NPROC",
)  # fmt: skip
"""Those that hold a worker to one thread; NPROC is what JAX's compiler goes by on a CPU."""


def pin() -> None:
    """Hold this process to one thread.

    Raises
    ------
    WideberthError : NumPy is loaded already, with other settings.
    """
    general = os.environ.get("OMP_NUM_THREADS", "not set")  # holds where the others are not set
    for name in ROUNDING:
        found = os.environ.get(name, general)
        if "numpy" in sys.modules and found != "1":
            raise WideberthError(
                f"{name} is {found} there and NumPy is loaded already, but the threads of BLAS "
                "change the rounding: set it to 1 before the worker is started"
            )
    os.environ.update(dict.fromkeys(WORKER, "1"))

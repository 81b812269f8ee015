"""CasADi with its NumPy behaviour fixed: the one place that imports it for the package.

Robots and regions are written with NumPy functions (``np.cos``), which also accept CasADi
expressions. CasADi 3.8 warns about that once and offers to choose; mode -1 keeps the
behaviour of 3.7 (a symbolic argument gives a symbolic result) without the warning.
"""

import casadi as ca

if hasattr(ca.GlobalOptions, "setNumpyMode"):
    ca.GlobalOptions.setNumpyMode(-1)

__all__ = ["ca"]

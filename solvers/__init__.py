"""Solvers, one file each, behind one interface."""

from ..framework.plugins.lazy import lazy

BUILT_IN = {
    "ipopt": "wideberth.solvers.ipopt:Ipopt",
    "fatrop": "wideberth.solvers.fatrop:Fatrop",
    "riccati": "wideberth.solvers.riccati.solver:Riccati",
}

__getattr__, __dir__, __all__ = lazy(
    __name__, [*BUILT_IN.values(), "wideberth.solvers.casadi_program"]
)

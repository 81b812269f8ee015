"""Solvers, one file each, behind one interface."""

from ...plugins.lazy import lazy

BUILT_IN = {
    "ipopt": "wideberth.framework.mpc.solvers.ipopt:Ipopt",
    "fatrop": "wideberth.framework.mpc.solvers.fatrop:Fatrop",
    "batch": "wideberth.framework.mpc.solvers.batch.solver:Batch",
    "riccati": "wideberth.framework.mpc.solvers.riccati.solver:Riccati",
    "riccati_live": "wideberth.framework.mpc.solvers.riccati.live:RiccatiLive",
}

__getattr__, __dir__, __all__ = lazy(__name__, BUILT_IN.values())

"""Solvers, one file each, behind one interface."""

BUILT_IN = {
    "ipopt": "wideberth.framework.mpc.solvers.ipopt:Ipopt",
    "fatrop": "wideberth.framework.mpc.solvers.fatrop:Fatrop",
    "batch": "wideberth.framework.mpc.solvers.batch.solver:Batch",
    "riccati": "wideberth.framework.mpc.solvers.riccati.solver:Riccati",
}

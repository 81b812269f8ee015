"""Solvers of others that take part, and why the others do not."""

from importlib.util import find_spec

import acados_program
import alpaqa_program
from sqp_program import SETTINGS, Sqp

from wideberth.framework.mpc.solver import Solver

STOPPABLE = "do-mpc"
"""The peer that takes a time limit."""


def peers(tolerance: float) -> dict[str, Solver]:
    """Return the peers that are installed here; their problems are compiled when first solved."""
    found: dict[str, Solver] = {}
    lacking = missing()
    if "do-mpc" not in lacking:
        from do_mpc_program import DoMpcProgram

        found["do-mpc"] = DoMpcProgram(tolerance)
    if "acados" not in lacking:
        found["acados"] = acados_program.AcadosProgram(tolerance)
    if "alpaqa" not in lacking:
        found["alpaqa"] = alpaqa_program.AlpaqaProgram(tolerance)
    return found | {f"sqpmethod, {qp}": Sqp(qp, tolerance) for qp in SETTINGS}


def missing() -> dict[str, str]:
    """Return why each peer that is left out is left out, by name."""
    do_mpc = "" if find_spec("do_mpc") else "not installed (dependency group `bench`)"
    found = {
        "do-mpc": do_mpc, "acados": acados_program.missing(), "alpaqa": alpaqa_program.missing()
    }  # fmt: skip
    return {name: why for name, why in found.items() if why}

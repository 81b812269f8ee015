"""An exported solver, and what it asks of its caller: bytes of memory and of stack."""

from dataclasses import dataclass

from ....framework.jit.shipped import PROCESSORS, fitting
from ....framework.values.arrays import Array
from ....framework.values.errors import WideberthError
from ...riccati import _protocol as protocol
from ...riccati.solver import Riccati
from .measured import Needs
from .native import Native

GLUE_STACK = 4096
"""Bytes of stack for `wideberth_solver.c` itself and for functions of the C library."""


@dataclass(frozen=True, eq=False)
class ExportedSolver:
    """What is exported: code, settings, and what a solve takes.

    Attributes
    ----------
    native : the code.
    settings : of the solver.
    needs : memory and stack of the core.
    speed : m/s, the planner's along its path.
    aims : level that the planner aims at, for each step, of each kind of slots; None without.
    more : whether a planner in C calls it, which gives multipliers and plans from other starts.
    """

    native: Native
    settings: Riccati
    needs: Needs
    speed: float
    aims: tuple[Array | None, ...]
    more: bool = False


def memory(solver: ExportedSolver) -> int:
    """Bytes that the caller has to give: tables, arrays of the core, and room to align them."""
    return work(solver) + solver.needs.memory + 16


def work(solver: ExportedSolver) -> int:
    """Bytes of the tables that `wideberth_solver.c` hands to the core, a multiple of 16."""
    problem, kinds = solver.native.subject.problem, solver.native.kernels.kinds
    small = len(protocol.Kernels._fields) + sum(map(len, kinds)) + 2
    numbers = len(protocol.Settings._fields) + len(protocol.Numbers._fields)
    states = (problem.horizon + 1) * problem.states
    return -(-8 * (table_words(solver) + small + numbers + states) // 16) * 16


def table_words(solver: ExportedSolver) -> int:
    """Words of the core's table."""
    return protocol.WORDS * sum(map(len, protocol.layout(len(solver.native.kernels.kinds))))


def stack(solver: ExportedSolver) -> int:
    """Bytes of stack: as measured here, and twice that for another family of processors."""
    try:
        here = PROCESSORS[fitting()].machine
    except WideberthError:
        here = ""
    factor = 1 if here == solver.native.machine.family else 2
    return factor * solver.needs.stack + GLUE_STACK

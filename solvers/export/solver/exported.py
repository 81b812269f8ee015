"""An exported solver: its functions, and what a solve asks of its caller."""

import ctypes
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from hashlib import sha256
from typing import Any

from .... import __version__
from ....framework.mpc.slots.base import GaussianKind
from ....framework.numerics.symbolic import ca
from ....framework.programs import listing_of
from ....framework.values.arrays import Array
from ....framework.values.errors import WideberthError
from ...c_text import c_source
from ...riccati.kernels import Kernels, build, slot_name
from ...riccati.problem import core_problem
from ...riccati.solver import Riccati
from ...riccati.workspace import (
    KindTable,
    ProblemTable,
    ResultTable,
    SettingsTable,
    SlotsTable,
    StartTable,
    Workspace,
    width_of,
)
from ..subject import Subject

PREFIX = "wideberth_"
"""Of the names of all functions in C."""
_STACK, _STACK_PER_OPERATION = 12288, 32
"""Bytes of stack: of the core, and of each operation of a stage function. Compilers keep most of
the values in registers."""


@dataclass(frozen=True, eq=False)
class ExportedSolver:
    """A problem with the solver's settings, as they are exported.

    Attributes
    ----------
    subject : the problem and what its numbers are called.
    settings : of the solver.
    margin : m, added around the robot's bodies.
    speed : m/s, the planner's along its path.
    aims : level that the planner aims at, for each step, of each kind of slots; None without.
    further : functions that the planner calls beside the solver, by name, see `listing_of`.
    """

    subject: Subject
    settings: Riccati
    margin: float
    speed: float
    aims: tuple[Array | None, ...]
    further: Mapping[str, Any] = field(default_factory=dict)

    @cached_property
    def kernels(self) -> Kernels:
        """The stage functions that the core calls, with their sizes."""
        return build(self.subject.problem)

    @cached_property
    def functions(self) -> Mapping[str, Any]:
        """All functions in C by name, see `listing_of`; kinds of slots without slots have none."""
        slots = self.subject.problem.slots
        unused = {
            name
            for k, kind in enumerate(slots)
            if not kind.count
            for name in (slot_name(k), f"{slot_name(k)}_values")
        }
        called = {k: one for k, one in self.kernels.functions.items() if k not in unused}
        return {**called, **_around(self.subject, self.margin), **self.further}

    @cached_property
    def text(self) -> str:
        """The functions as C."""
        return c_source({PREFIX + name: one for name, one in self.functions.items()})

    @property
    def build(self) -> int:
        """Number of 64 bits that no other export has."""
        parts = (__version__, self.text, self.subject.problem.key, self.margin, self.aims)
        return int.from_bytes(sha256(repr(parts).encode()).digest()[:8], "big")

    @property
    def filled(self) -> tuple[bool, ...]:
        """Of which kinds the parameters of a slot are computed in C."""
        return tuple(f"set{k}" in self.functions for k in range(len(self.subject.problem.slots)))

    def rows(self, name: str) -> int:
        """Count the results of a function; 0 where there is no such function."""
        return int(self.functions[name].numel_out(0)) if name in self.functions else 0

    @cached_property
    def table(self) -> ProblemTable:
        """Sizes of the problem as the core takes them, without the functions."""
        return self._workspace.problem

    @cached_property
    def kinds(self) -> tuple[KindTable, ...]:
        """Sizes of the kinds of slots."""
        return tuple(self._workspace.kinds)

    @cached_property
    def _workspace(self) -> Workspace:
        prepared = core_problem(self.subject.problem, compiled=False)
        table = ProblemTable.from_buffer_copy(prepared.table)
        table.work = 0  # straight-line functions need no memory
        slots = self.subject.problem.slots
        kinds = [
            table if one.count else KindTable()
            for table, one in zip(prepared.kinds, slots, strict=True)
        ]
        return Workspace(table, kinds, self.subject.parameters)

    @property
    def memory(self) -> int:
        """Bytes that a solve works in on 64-bit processors; on others fewer are needed."""
        problem = self.subject.problem
        tables = (SettingsTable, StartTable, ResultTable, *[SlotsTable] * len(problem.slots))
        numbers = (problem.horizon + 1) * problem.states + problem.horizon * problem.head_width
        numbers += len(self._workspace.memory) + 1  # to align it
        return sum(map(ctypes.sizeof, tables)) + 8 * numbers

    @property
    def stack(self) -> int:
        """Bytes of stack that a solve needs at most."""
        most = max(len(listing_of(one).operations) for one in self.functions.values())
        return _STACK + _STACK_PER_OPERATION * most

    @property
    def width(self) -> int:
        """Multipliers of one step, all but those of slots."""
        return width_of(self.table)


def _around(subject: Subject, margin: float) -> dict[str, Any]:
    """Return the functions that code around the core calls.

    ``dynamics`` (x, u) -> next x; ``place`` x -> position; ``final`` x_N -> limits >= 0;
    ``motion`` and, for kind k of the slots, ``check`` followed by k, as
    `Problem.constraint_values` has them; ``set`` followed by k: (mean, covariance, radius) ->
    parameters, where a closed form is known. What has no result is left out.
    """
    problem, robot = subject.problem, subject.robot
    x, u = ca.SX.sym("x", problem.states), ca.SX.sym("u", problem.inputs)
    place = robot.pose(tuple(ca.vertsplit(x))).position
    functions = {
        "dynamics": _column(problem.dynamics(x, u), x, u),
        "place": _column(ca.vertcat(*place), x),
        "final": _column(problem.terminal_constraints(x), x),
    }
    for k, (kind, slots) in enumerate(zip(subject.kinds, problem.slots, strict=True)):
        if slots.count and isinstance(kind, GaussianKind):
            functions |= _set(f"set{k}", subject, kind, margin)
    checks = {
        name.replace("slot", "check"): one for name, one in problem.constraint_functions.items()
    }
    return {name: one for name, one in {**functions, **checks}.items() if one.numel_out(0)}


def _set(name: str, subject: Subject, kind: GaussianKind, margin: float) -> dict[str, Any]:
    """Parameters of a slot as a function of (mean, covariance, radius), if there is a form."""
    try:
        function = kind.parameters_of_one(subject.robot, margin)
    except WideberthError:  # the caller fills them
        return {}
    given = [ca.SX.sym(f"g{i}", *function.size_in(i)) for i in range(function.n_in())]
    return {name: _column(function(*given), *given)}


def _column(result: Any, *given: Any) -> Any:
    v, none = ca.vertcat(*map(ca.vec, given)), ca.SX.sym("none", 0)
    return ca.Function("kernel", [v, none], [ca.densify(result)], {"cse": True})

"""A problem as the C core takes it: its stage functions, sizes and bounds."""

from collections import OrderedDict
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from ...framework.mpc.ocp.problem import Parameters, Problem, Slots
from ...framework.programs import Program
from ...framework.values.arrays import Array, address
from ...framework.values.errors import WideberthError
from ..c_text import c_source
from .compile_once import compile_once
from .kernels import Kernels, build, slot_name
from .workspace import KernelTable, KindTable, ProblemTable, Workspace, shape_of

try:
    from . import _core
except ImportError:  # it was not built
    _core = None  # type: ignore[assignment]

_MOST_SIZES = 16
"""Sizes of instances whose arrays are kept at once, of one problem."""


@dataclass(frozen=True, eq=False)
class CoreProblem:
    """Stage functions of a problem with its sizes; any horizon, any number of slots.

    Attributes
    ----------
    table : the problem as the core takes it, without the horizon and the kinds of slots.
    kinds : of slots, without how many there are.
    kept : what the tables point to.
    """

    table: ProblemTable
    kinds: tuple[KindTable, ...]
    kept: tuple[Any, ...]
    _free: dict[tuple[Any, ...], list[Workspace]] = field(default_factory=dict)

    @contextmanager
    def workspace(self, parameters: Parameters) -> Iterator[Workspace]:
        """Lend arrays for one solve, those of an earlier one where they are free."""
        free = self._free.setdefault(shape_of(parameters), [])
        try:
            space = free.pop()
        except IndexError:
            space = Workspace(self.table, self.kinds, parameters)
        try:
            yield space
        finally:
            free.append(space)
            if len(self._free) > _MOST_SIZES:
                self._free.clear()


_PROBLEMS: OrderedDict[str, CoreProblem | WideberthError] = OrderedDict()
_BY_IDENTITY: dict[bool, WeakKeyDictionary[Problem, CoreProblem | WideberthError]] = {
    False: WeakKeyDictionary(),
    True: WeakKeyDictionary(),
}
_MOST_PROBLEMS = 64


def core_problem(problem: Problem, compiled: bool) -> CoreProblem:
    """Prepare a problem for the core, or take it from this process's cache.

    Parameters
    ----------
    problem : to be solved.
    compiled : whether the system's C compiler compiles its stage functions.

    Raises
    ------
    WideberthError : the core was not built, or a stage function has no program.
    """
    problems = _BY_IDENTITY[compiled]
    if problem not in problems:
        key = repr((compiled, problem.stage_key, problem.state_bounds, problem.input_bounds))
        if key not in _PROBLEMS:
            try:
                _PROBLEMS[key] = _prepared(problem, compiled)
            except WideberthError as error:  # it would fail the same way at every solve
                _PROBLEMS[key] = error
        if len(_PROBLEMS) > _MOST_PROBLEMS:
            _PROBLEMS.popitem(last=False)
        problems[problem] = _PROBLEMS[key]
    prepared = problems[problem]
    if isinstance(prepared, WideberthError):
        raise prepared
    return prepared


def _prepared(problem: Problem, compiled: bool) -> CoreProblem:
    """Differentiate a problem and fill in its tables."""
    if _core is None:
        raise WideberthError(
            "the extension module of riccati was not built: install a C compiler, then wideberth"
        )
    kernels = build(problem)
    tables, kept = _tables(kernels.functions, None if compiled else _core.PROGRAM)
    lower, upper = _bounds(problem)
    table = ProblemTable(
        **{name: tables[name] for name in ("drive", "node", "node_values", "level")},
        n=problem.states,
        m=problem.inputs,
        shared=int(problem.shared),
        input_rows=kernels.input_rows,
        node_rows=kernels.node_rows,
        final_rows=kernels.final_rows,
        head=problem.head_width,
        work=max((_core.work(one.program) for one in tables.values() if one.program), default=0),
        lower=address(lower),
        upper=address(upper),
    )
    kinds = []
    for k, slots in enumerate(problem.slots):
        kind, arrays = _kind(kernels, k, slots, tables)
        kinds.append(kind)
        kept += arrays
    return CoreProblem(table, tuple(kinds), (*kept, lower, upper))


def _bounds(problem: Problem) -> tuple[Array, Array]:
    state, control = problem.state_bounds, problem.input_bounds
    return np.array(state.lower + control.lower, np.float64), np.array(
        state.upper + control.upper, np.float64
    )


def _tables(
    functions: Mapping[str, Any], evaluator: int | None
) -> tuple[dict[str, KernelTable], list[Any]]:
    """Stage functions as the core takes them, and what has to be kept for that.

    They are programs for the evaluator at this address; None: compiled C.
    """
    if evaluator is None:
        places = compile_once(c_source(functions), list(functions))
        return {name: KernelTable(places[name], None) for name in functions}, []
    programs = {name: Program.of(one, fused=True) for name, one in functions.items()}
    tables = {name: KernelTable(evaluator, one.address) for name, one in programs.items()}
    return tables, list(programs.values())


def _kind(
    kernels: Kernels, place: int, slots: Slots, tables: Mapping[str, KernelTable]
) -> tuple[KindTable, Sequence[NDArray[Any]]]:
    """One kind of slots, and the arrays that its table points to."""
    shape, own, name = kernels.slots[place], slots.auxiliary, slot_name(place)
    arrays = (
        np.array(shape.depends, dtype=np.int64),
        np.array(own.lower, dtype=np.float64),
        np.array(own.upper, dtype=np.float64),
    )
    depends, lower, upper = map(address, arrays)
    kind = KindTable(
        derivatives=tables[name],
        values=tables[f"{name}_values"],
        levelled=int(slots.levelled),
        entries=len(shape.depends),
        inequalities=shape.inequalities,
        equalities=shape.equalities,
        own=len(own),
        depends=depends,
        lower=lower,
        upper=upper,
        regularisation=own.regularisation,
    )
    return kind, arrays

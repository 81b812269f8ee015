"""Compile the solver: one core for all problems, and kernels for each.

The kernels know nothing of the horizon and the number of slots, the core nothing of a robot or a
region: it takes the kernels by their addresses. Compiling the core takes about a minute, once
per machine; the kernels of a new pair of robot and region take seconds. Both are kept by
`wideberth.framework.jit.store`.
"""

import sys
from collections import OrderedDict
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from functools import cache, cached_property
from hashlib import sha256
from itertools import chain
from pathlib import Path
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from ....jit.columns import KERNEL, address
from ....jit.store import load
from ....jit.transpile import NUMBA_IMPORTS, numba_source, recursion_source
from ....numerics.symbolic import ca
from ....region import Auxiliary
from ....values.arrays import Array
from ....values.errors import WideberthError
from ...ocp.problem import Problem, Slots
from . import protocol
from .kernels import Kernels, Slot, SlotShape, build, carried, eliminate, expand, slot_name, sweep
from .protocol import SlotKernels

LEAST_KINDS = 2
"""Kinds of slots for which the core is compiled at least; as many as a planner has anyway."""

MOST_OPERATIONS = 10_000
"""Size of a kernel that is still compiled; the compiler needs a second for a thousand."""

_CORE_FILES = ("core.py", "protocol.py", "../interior_point.py")
"""Files that the compiled core consists of: a change of any of them compiles it anew."""

_OPTIONS = (
    'error_model="numpy", nogil=True, fastmath={"contract", "reassoc", "nsz", "arcp"}, cache=True'
)
_VECTOR, _MATRIX, _CUBE, _PLACES = "f8[::1]", "f8[:, ::1]", "f8[:, :, ::1]", "i8[::1]"

_TYPES: dict[str, Any] = {
    "head": protocol.Head(_MATRIX, _MATRIX, _VECTOR, _MATRIX),
    "start": protocol.Start(_VECTOR, _MATRIX, _MATRIX),
    "found": protocol.Found(_MATRIX, _MATRIX, _VECTOR, _VECTOR),
}  # fmt: skip
"""Arrays of the core by group, with their types; those of the slots come before ``found``."""
_SLOT_TYPES = protocol.SlotArguments(
    kernels=_PLACES, depends=_PLACES, rows=_PLACES, limits=_MATRIX, regularisation=_VECTOR,
    numbers=_CUBE, levels=_MATRIX, active=_VECTOR, drawn=_CUBE, begun=_CUBE, found=_CUBE,
)  # fmt: skip

_PLAIN = {"kernels": _PLACES, "sizes": _PLACES, "limits": _MATRIX, "settings": _VECTOR}


def _source(digest: str, kinds: int) -> str:
    """Write the module that compiles the core for flat arguments, for some kinds of slots."""
    slots = [f"slots{k}" for k in range(kinds)]
    typed = {"head": _TYPES["head"], "start": _TYPES["start"]}
    typed |= {**dict.fromkeys(slots, _SLOT_TYPES), "found": _TYPES["found"]}
    groups, types, given = {}, list(_PLAIN.values()), list(_PLAIN)
    for group, kinds_of in typed.items():
        names = [f"{group}_{field}" for field in kinds_of._fields]
        groups[group] = f"{type(kinds_of).__name__}({', '.join(names)})"
        types += kinds_of
        given += names
    return f"""# {digest}
from numba import njit

from wideberth.framework.mpc.solvers.riccati import core
from wideberth.framework.mpc.solvers.riccati.protocol import Found, Head, SlotArguments, Start

iterate = core.solve


@njit("void({", ".join([*types, _VECTOR])})", {_OPTIONS})
def solve({", ".join([*given, "stop"])}):
    iterate(
        {", ".join(_PLAIN)}, {groups["head"]}, {groups["start"]},
        ({", ".join(groups[kind] for kind in slots)}), {groups["found"]}, stop,
    )
"""


def announce(line: str) -> None:
    """Say on standard error that something takes its time."""
    print(line, file=sys.stderr, flush=True)


def core(kinds: int) -> Callable[..., None]:
    """Return the compiled iteration, the same for all problems with so many kinds of slots.

    Raises
    ------
    WideberthError : it cannot be compiled here; that is tried once per process.
    """
    found = _core(kinds)
    if isinstance(found, WideberthError):
        raise found
    return found


@cache
def _core(kinds: int) -> Callable[..., None] | WideberthError:
    text = "".join(
        (Path(__file__).parent / name).read_text(encoding="utf-8") for name in _CORE_FILES
    )
    try:
        source = _source(sha256(text.encode()).hexdigest(), kinds)
        solve: Callable[..., None] = load("solver", source, announce).solve
    except WideberthError as error:
        return error
    return solve


@dataclass(frozen=True, eq=False)
class CompiledSlots:
    """One kind of slots as the core takes it, see `protocol.SlotArguments`.

    Attributes
    ----------
    kernels : addresses, by the names of `protocol.SlotKernels`.
    depends : entries of x. rows : inequalities, equalities, whether slots have a level.
    limits : (2, A) of the own variables. regularisation : (1,).
    """

    kernels: NDArray[np.int64]
    depends: NDArray[np.int64]
    rows: NDArray[np.int64]
    limits: Array
    regularisation: Array

    @classmethod
    def of(cls, kernels: NDArray[np.int64], shape: SlotShape, slots: Slots) -> "CompiledSlots":
        """Gather the arrays from a problem's slots and the shape of their kernels."""
        own = slots.auxiliary
        return cls(
            kernels,
            np.array(shape.depends, dtype=np.int64),
            np.array([shape.inequalities, shape.equalities, int(slots.levelled)]),
            np.array([own.lower, own.upper], dtype=np.float64),
            np.array([own.regularisation]),
        )

    @cached_property
    def arguments(self) -> tuple[Any, ...]:
        """The first arguments of the core, those that do not change from solve to solve."""
        return self.kernels, self.depends, self.rows, self.limits, self.regularisation


@dataclass(frozen=True, eq=False)
class CompiledProblem:
    """Compiled kernels of a problem.

    Attributes
    ----------
    module : holds the kernels as long as their addresses are in use.
    kernels, sizes : by the names of `protocol.Kernels` and `protocol.Sizes`.
    limits : (2, n + m), bounds of states and inputs.
    kinds : of the slots; empty ones behind those of the problem.
    """

    module: Any
    kernels: NDArray[np.int64]
    sizes: NDArray[np.int64]
    limits: Array
    kinds: tuple[CompiledSlots, ...]


_PROBLEMS: OrderedDict[str, CompiledProblem | WideberthError] = OrderedDict()
_KNOWN: WeakKeyDictionary[Problem, CompiledProblem | WideberthError] = WeakKeyDictionary()
_MOST_PROBLEMS = 64


def compiled_problem(problem: Problem) -> CompiledProblem:
    """Compile the kernels of a problem, or take them from this process's cache.

    Raises
    ------
    WideberthError : they cannot be compiled here, or are too large.
    """
    if problem not in _KNOWN:
        key = repr((problem.stage_key, problem.state_bounds, problem.input_bounds))
        if key not in _PROBLEMS:
            try:
                _PROBLEMS[key] = _compile(problem)
            except WideberthError as error:  # it would fail the same way at every solve
                _PROBLEMS[key] = error
        if len(_PROBLEMS) > _MOST_PROBLEMS:
            _PROBLEMS.popitem(last=False)
        _KNOWN[problem] = _PROBLEMS[key]
    found = _KNOWN[problem]
    if isinstance(found, WideberthError):
        raise found
    return found


def _slot_kernels(place: int) -> SlotKernels:
    """Names of the kernels of one kind of slots."""
    name = slot_name(place)
    return SlotKernels(name, f"{name}_values", f"{name}_eliminate", f"{name}_expand")


def _functions(problem: Problem, made: Kernels) -> dict[str, Any]:
    """Return the stage functions with derivatives, and those that solve the Newton step."""
    found = {**made.functions}
    found["sweep"] = sweep(problem.states, problem.inputs, made.functions["drive"])
    for k, (slots, shape) in enumerate(zip(problem.slots, made.slots, strict=True)):
        outer = len(shape.depends) + int(problem.shared)
        own = slots.auxiliary
        slot = Slot(outer, own.lower, own.upper, shape.inequalities, shape.equalities)
        names = _slot_kernels(k)
        found[names.eliminate], found[names.expand] = eliminate(slot), expand(slot)
    return found


def _compile(problem: Problem) -> CompiledProblem:
    problem = _filled_up(problem)
    made = build(problem)
    functions = _functions(problem, made)
    longest = max(one.n_instructions() for one in functions.values())
    if longest > MOST_OPERATIONS:
        raise WideberthError(
            f"a kernel of this problem has {longest} operations; up to {MOST_OPERATIONS} are "
            "compiled"
        )
    kinds = [_slot_kernels(k) for k in range(len(problem.slots))]
    text = ["from numba import njit", NUMBA_IMPORTS]
    stages = [name for name in protocol.Kernels._fields if name != "sweep"]
    names = [*stages, *chain.from_iterable(kinds)]
    sources = [numba_source(functions[name], name) for name in names]
    sources.append(recursion_source(functions["sweep"], "sweep", carried(problem.states)))
    for source in sources:
        text += ["", f'@njit("{KERNEL}", {_OPTIONS})', source]
    module = load("kernels", "\n".join(text), announce)

    def addresses(names: Iterable[str]) -> NDArray[np.int64]:
        return np.array([address(getattr(module, name)) for name in names])

    state, control = problem.state_bounds, problem.input_bounds
    sizes = protocol.Sizes(
        problem.states, problem.inputs, problem.shared, made.input_rows, made.node_rows,
        made.final_rows,
    )  # fmt: skip
    return CompiledProblem(
        module,
        addresses(protocol.Kernels._fields),
        np.array(sizes, dtype=np.int64),
        np.array([state.lower + control.lower, state.upper + control.upper], dtype=np.float64),
        tuple(
            CompiledSlots.of(addresses(names), shape, slots)
            for names, shape, slots in zip(kinds, made.slots, problem.slots, strict=True)
        ),
    )


def _filled_up(problem: Problem) -> Problem:
    """Add empty kinds of slots up to `LEAST_KINDS`, so that few cores are compiled."""
    x, s = ca.SX.sym("x", problem.states), ca.SX.sym("s", int(problem.shared))
    none = [ca.SX(0, 1), ca.SX(0, 1)]
    constraint = ca.Function("constraint", [x, ca.SX(0, 1), s, ca.SX.sym("numbers")], none)
    empty = Slots("empty", 0, 0, False, Auxiliary(), constraint)
    return replace(problem, slots=(*problem.slots, *[empty] * (LEAST_KINDS - len(problem.slots))))

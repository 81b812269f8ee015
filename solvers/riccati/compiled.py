"""Compile the solver: one core for all problems, and kernels for each.

The kernels know nothing of the horizon and the number of slots, the core nothing of a robot or a
region: it takes the kernels by their records. The core is shipped as object code, see
`objects`; where that does not fit, Numba compiles it in another process, which takes a minute or
two, once per machine. The kernels of a new pair of robot and region are compiled by LLVM in less
than a second; without LLVM they are interpreted. What is compiled is kept by
`wideberth.framework.jit.store`.
"""

import ctypes
import sys
from collections import OrderedDict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import cache, cached_property
from itertools import chain
from threading import Lock, Thread
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from ...framework.jit.records import Records
from ...framework.jit.store import load
from ...framework.jit.transpile import kernel_source, module_source, recursion_source
from ...framework.mpc.ocp.problem import Parameters, Problem, Slots
from ...framework.numerics.symbolic import ca
from ...framework.region import Auxiliary
from ...framework.values.arrays import Array
from ...framework.values.errors import WideberthError
from . import _protocol as protocol
from . import emit, objects
from ._protocol import SlotKernels
from .kernels import Kernels, Slot, SlotShape, build, carried, eliminate, expand, slot_name, sweep
from .workspace import Entry, Workspace, shape_of

LEAST_KINDS = objects.KINDS
"""Kinds of slots that every problem is filled up to with empty ones."""

MOST_OPERATIONS = 10_000
"""Size of a kernel that is still compiled; the compiler needs a second for a thousand."""


USUAL = {"solver": 100.0, "kernels": 1.0}
"""s that compiling takes on two cores of a laptop, until this machine has measured its own."""


def announce(line: str) -> None:
    """Say on standard error that something takes its time."""
    print(line, file=sys.stderr, flush=True)


def core(kinds: int) -> Entry:
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
def _core(kinds: int) -> Entry | WideberthError:
    try:
        place = _shipped_or_compiled(kinds)
    except WideberthError as error:
        return error
    return ctypes.CFUNCTYPE(ctypes.c_int, *[ctypes.c_void_p] * 3)(place)


_COMING: dict[int, Thread] = {}
_GUARD = Lock()
_LOADING = 0.2
"""s that are waited for a core that has only to be loaded."""


def core_is_coming(kinds: int) -> bool:
    """Whether the core is still compiled in the background, which the first call begins.

    Once it is False, `core` returns or raises at once.
    """
    with _GUARD:
        if kinds not in _COMING:
            _COMING[kinds] = Thread(target=_core, args=(kinds,), daemon=True)
            _COMING[kinds].start()
            _COMING[kinds].join(_LOADING)
        return _COMING[kinds].is_alive()


def _shipped_or_compiled(kinds: int) -> int:
    """Address of the core."""
    try:
        return objects.library(kinds)[objects.ENTRY]
    except WideberthError as error:
        why = str(error)
    source = f"{objects.SHIPPED.sources()}, {kinds} kinds, by {emit.compiler()}"
    found = load(
        "solver",
        source,
        [objects.ENTRY],
        lambda line: announce(f"{line} [{why}]"),
        USUAL["solver"],
        lambda: emit.compile_in_subprocess(kinds),
    )
    return found[objects.ENTRY]


@dataclass(frozen=True, eq=False)
class CompiledSlots:
    """One kind of slots as the core takes it, see `_protocol.SlotArguments`.

    Attributes
    ----------
    kernels : places of records, by the names of `_protocol.SlotKernels`.
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
    kernels, sizes : by the names of `protocol.Kernels` and `protocol.Sizes`.
    records : of all kernels.
    limits : (2, n + m), bounds of states and inputs.
    kinds : of the slots; empty ones behind those of the problem.
    """

    kernels: NDArray[np.int64]
    sizes: NDArray[np.int64]
    limits: Array
    kinds: tuple[CompiledSlots, ...]
    records: Records
    _free: dict[tuple[Any, ...], list[Workspace]] = field(default_factory=dict)

    @contextmanager
    def workspace(self, parameters: Parameters) -> Iterator[Workspace]:
        """Lend arrays for one solve, those of an earlier one where they are free."""
        free = self._free.setdefault(shape_of(parameters), [])
        try:
            space = free.pop()
        except IndexError:
            plain = self.kernels, self.sizes, self.limits
            space = Workspace(plain, [kind.arguments for kind in self.kinds], parameters)
        try:
            yield space
        finally:
            free.append(space)
            if len(self._free) > _MOST_SIZES:
                self._free.clear()


_MOST_SIZES = 16
"""Sizes of instances whose arrays are kept at once, of one problem."""

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


@dataclass(frozen=True, eq=False)
class KernelSet:
    """The kernels of a problem, as CasADi functions.

    Attributes
    ----------
    problem : filled up with empty kinds of slots, see `LEAST_KINDS`.
    made : sizes of the kernels.
    functions : by their names: first `protocol.Kernels`, then `SlotKernels` of each kind.
    kinds : names of the kernels of each kind of slots.
    """

    problem: Problem
    made: Kernels
    functions: Mapping[str, Any]
    kinds: tuple[SlotKernels, ...]

    @classmethod
    def of(cls, problem: Problem) -> "KernelSet":
        """Differentiate a problem.

        Raises
        ------
        WideberthError : a kernel that is too large.
        """
        problem = _filled_up(problem)
        made = build(problem)
        kinds = tuple(_slot_kernels(k) for k in range(len(problem.slots)))
        known = _functions(problem, made)
        _refuse_large(problem, known, kinds)
        names = [*protocol.Kernels._fields, *chain.from_iterable(kinds)]
        return cls(problem, made, {name: known[name] for name in names}, kinds)

    def sizes(self) -> tuple[int, ...]:
        """Sizes that the core is given, in the order of `Sizes`."""
        problem, made = self.problem, self.made
        return protocol.Sizes(
            problem.states, problem.inputs, problem.shared, made.input_rows, made.node_rows,
            made.final_rows,
        )  # fmt: skip

    def limits(self) -> Array:
        """Bounds of states and inputs, (2, n + m)."""
        state, control = self.problem.state_bounds, self.problem.input_bounds
        return np.array([state.lower + control.lower, state.upper + control.upper], np.float64)


def sources(functions: Mapping[str, Any], handed: int, prefix: str = "") -> list[str]:
    """LLVM functions of kernels; the one called ``sweep`` hands numbers from stage to stage."""
    return [
        recursion_source(one, prefix + name, handed)
        if name == "sweep"
        else kernel_source(one, prefix + name)
        for name, one in functions.items()
    ]


def _compile(problem: Problem) -> CompiledProblem:
    made = KernelSet.of(problem)
    found = _ready(made.functions, carried(problem.states))

    def places(names: Iterable[str]) -> NDArray[np.int64]:
        return np.array([found.place(name) for name in names])

    return CompiledProblem(
        places(protocol.Kernels._fields),
        np.array(made.sizes(), dtype=np.int64),
        made.limits(),
        tuple(
            CompiledSlots.of(places(names), shape, slots)
            for names, shape, slots in zip(
                made.kinds, made.made.slots, made.problem.slots, strict=True
            )
        ),
        found,
    )


def _refuse_large(
    problem: Problem, functions: Mapping[str, Any], kinds: Sequence[SlotKernels]
) -> None:
    """Refuse a problem whose largest function has more than `MOST_OPERATIONS`.

    Raises
    ------
    WideberthError : it has; the message says of what it is.
    """
    sizes = {name: one.n_instructions() for name, one in functions.items()}
    largest = max(sizes, key=lambda name: sizes[name])
    if sizes[largest] > MOST_OPERATIONS:
        pairs = zip(problem.slots, kinds, strict=True)
        owners = {name: f"each {slots.name}'s constraint" for slots, own in pairs for name in own}
        owner = owners.get(largest, "the robot's motion, or the cost,")
        raise WideberthError(
            f"{owner} has {sizes[largest]} operations with its derivatives; up to "
            f"{MOST_OPERATIONS} are compiled"
        )


def _ready(functions: Mapping[str, Any], handed: int) -> Records:
    """Make kernels that can be called."""

    def source() -> str:
        return module_source(sources(functions, handed))

    carried_by = {"sweep": handed}
    return Records.of("kernels", functions, source, carried_by, announce, USUAL["kernels"])


def _filled_up(problem: Problem) -> Problem:
    """Add empty kinds of slots up to `LEAST_KINDS`, so that few cores are compiled."""
    x, s = ca.SX.sym("x", problem.states), ca.SX.sym("s", int(problem.shared))
    none = [ca.SX(0, 1), ca.SX(0, 1)]
    constraint = ca.Function("constraint", [x, ca.SX(0, 1), s, ca.SX.sym("numbers")], none)
    empty = Slots("empty", 0, 0, False, Auxiliary(), constraint)
    return replace(problem, slots=(*problem.slots, *[empty] * (LEAST_KINDS - len(problem.slots))))

"""The structured solver's compiled code: one core for all problems, and kernels for each.

The kernels know nothing of the horizon and the number of slots, the core nothing of a robot or a
region: it takes the kernels by their addresses. Compiling the core takes about a minute, once
per machine; the kernels of a new pair of robot and region take seconds. Both are kept by
`wideberth.framework.jit.store`.
"""

import sys
from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache, cached_property
from hashlib import sha256
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
from .elimination import Slot, eliminate, expand
from .kernels import Kernels, SlotShape, build, slot_name
from .sweep import carried, sweep

NAMES = (
    "drive", "node", "node_values", "level",
    "slot0", "slot0_values", "slot0_eliminate", "slot0_expand",
    "slot1", "slot1_values", "slot1_eliminate", "slot1_expand", "sweep",
)  # fmt: skip
"""Kernels in the order of their addresses, see `point`."""

KINDS = 2
"""Kinds of slots that the core takes."""

MOST_OPERATIONS = 10_000
"""Size of a kernel that is still compiled; the compiler needs a second for a thousand."""

_OPTIONS = (
    'error_model="numpy", nogil=True, fastmath={"contract", "reassoc", "nsz", "arcp"}, cache=True'
)
_KIND = (
    "i8[::1], i8[::1], f8[:, ::1], f8[::1], f8[:, :, ::1], f8[:, ::1], f8[::1], f8[:, :, ::1], "
    "f8[:, :, ::1]"
)
_SIGNATURE = (
    "void(i8[::1], i8[::1], f8[:, ::1], f8[::1], "
    "f8[::1], f8[:, ::1], f8[:, ::1], f8[::1], f8[:, ::1], f8[:, ::1], f8[:, ::1], "
    f"{_KIND}, {_KIND}, "
    "f8[:, ::1], f8[:, ::1], f8[::1], f8[:, :, ::1], f8[:, :, ::1], f8[::1], f8[::1])"
)
_CORE = f'''# DIGEST
from numba import njit

from wideberth.framework.mpc.solvers.riccati.core import solve as core


@njit("{_SIGNATURE}", {_OPTIONS})
def solve(
    kernels, sizes, limits, settings,
    initial, reference, direction, speed, curve, states, inputs,
    a, b, c, d, e, f, g, h, i, j, k, l, m, n, o, p, q, r,
    found_states, found_inputs, slack, own, still, numbers, stop,
):
    core(
        kernels, sizes, limits, settings, (reference, direction, speed, curve),
        (initial, states, inputs),
        ((a, b, c, d, e, f, g, h, i), (j, k, l, m, n, o, p, q, r)),
        (found_states, found_inputs, slack, own, still, numbers), stop,
    )
'''


def announce(line: str) -> None:
    """Say on standard error that something takes its time."""
    print(line, file=sys.stderr, flush=True)


def core() -> Callable[..., None]:
    """Return the compiled iteration, the same for all problems.

    Raises
    ------
    WideberthError : it cannot be compiled here; that is tried once per process.
    """
    found = _core()
    if isinstance(found, WideberthError):
        raise found
    return found


@cache
def _core() -> Callable[..., None] | WideberthError:
    here = Path(__file__).parent
    text = "".join(path.read_text(encoding="utf-8") for path in sorted(here.glob("*.py")))
    try:
        source = _CORE.replace("DIGEST", sha256(text.encode()).hexdigest())
        solve: Callable[..., None] = load("solver", source, announce).solve
    except WideberthError as error:
        return error
    return solve


@dataclass(frozen=True, eq=False)
class Kind:
    """What the core wants to know of one kind of slots.

    Attributes
    ----------
    depends : entries of x. rows : inequalities, equalities, whether slots have a level.
    limits : (2, A) of the own variables. regularisation : (1,).
    """

    depends: NDArray[np.int64]
    rows: NDArray[np.int64]
    limits: Array
    regularisation: Array

    @classmethod
    def of(cls, shape: SlotShape, slots: Slots) -> "Kind":
        """Gather it from a problem's slots and the shape of their kernel."""
        own = slots.auxiliary
        return cls(
            np.array(shape.depends, dtype=np.int64),
            np.array([shape.inequalities, shape.equalities, int(slots.levelled)]),
            np.array([own.lower, own.upper], dtype=np.float64),
            np.array([own.regularisation]),
        )

    @cached_property
    def about(self) -> tuple[Any, ...]:
        """All of it, as arguments of the core."""
        return self.depends, self.rows, self.limits, self.regularisation


@dataclass(frozen=True, eq=False)
class Program:
    """Compiled kernels of a problem.

    Attributes
    ----------
    module : holds the kernels as long as their addresses are in use.
    addresses : in the order of `NAMES`.
    sizes : n, m, whether a level is shared, rows of input, node and final constraints.
    limits : (2, n + m), bounds of states and inputs.
    kinds : of the slots; empty ones behind those of the problem.
    """

    module: Any
    addresses: NDArray[np.int64]
    sizes: NDArray[np.int64]
    limits: Array
    kinds: tuple[Kind, ...]


_PROGRAMS: OrderedDict[str, Program | WideberthError] = OrderedDict()
_KNOWN: WeakKeyDictionary[Problem, Program | WideberthError] = WeakKeyDictionary()
_MOST_PROGRAMS = 64


def program(problem: Problem) -> Program:
    """Compile the kernels of a problem, or take them from this process's cache.

    Raises
    ------
    WideberthError : they cannot be compiled here, or are too large.
    """
    if problem in _KNOWN:
        return _sound(_KNOWN[problem])
    key = repr((problem.stage_key, problem.state_bounds, problem.input_bounds))
    if key not in _PROGRAMS:
        try:
            _PROGRAMS[key] = _made(problem)
        except WideberthError as error:  # it would fail the same way at every solve
            _PROGRAMS[key] = error
    if len(_PROGRAMS) > _MOST_PROGRAMS:
        _PROGRAMS.popitem(last=False)
    _KNOWN[problem] = _PROGRAMS[key]
    return _sound(_PROGRAMS[key])


def _sound(found: Program | WideberthError) -> Program:
    if isinstance(found, WideberthError):
        raise found
    return found


def _newton(problem: Problem, made: Kernels) -> dict[str, Any]:
    """Functions that solve the Newton step, from the derivatives that ``made`` gives."""
    found = {"sweep": sweep(problem.states, problem.inputs, made.functions["drive"])}
    for k, (slots, shape) in enumerate(zip(problem.slots, made.slots, strict=True)):
        name = slot_name(k)
        outer = len(shape.depends) + int(problem.shared)
        own = slots.auxiliary
        slot = Slot(outer, own.lower, own.upper, shape.inequalities, shape.equalities)
        found[f"{name}_eliminate"], found[f"{name}_expand"] = eliminate(slot), expand(slot)
    return found


def _made(problem: Problem) -> Program:
    """Compile the kernels of a problem."""
    problem = _filled_up(problem)
    made = build(problem)
    functions = {**made.functions, **_newton(problem, made)}
    longest = max(one.n_instructions() for one in functions.values())
    if longest > MOST_OPERATIONS:
        raise WideberthError(
            f"a kernel of this problem has {longest} operations; up to {MOST_OPERATIONS} are "
            "compiled"
        )
    text = ["from numba import njit", NUMBA_IMPORTS]
    for name in NAMES:
        source = numba_source(functions[name], name)
        if name == "sweep":
            source = recursion_source(functions[name], name, carried(problem.states))
        text += ["", f'@njit("{KERNEL}", {_OPTIONS})', source]
    module = load("kernels", "\n".join(text), announce)
    state, control = problem.state_bounds, problem.input_bounds
    return Program(
        module,
        np.array([address(getattr(module, name)) for name in NAMES]),
        np.array(
            [
                problem.states,
                problem.inputs,
                problem.shared,
                made.input_rows,
                made.node_rows,
                made.final_rows,
            ]
        ),
        np.array([state.lower + control.lower, state.upper + control.upper], dtype=np.float64),
        tuple(Kind.of(*pair) for pair in zip(made.slots, problem.slots, strict=True)),
    )


def _filled_up(problem: Problem) -> Problem:
    """Add empty kinds of slots until there are as many as the core takes."""
    x, s = ca.SX.sym("x", problem.states), ca.SX.sym("s", int(problem.shared))
    none = [ca.SX(0, 1), ca.SX(0, 1)]
    constraint = ca.Function("constraint", [x, ca.SX(0, 1), s, ca.SX.sym("numbers")], none)
    empty = Slots("empty", 0, 0, False, Auxiliary(), constraint)
    return replace(problem, slots=(*problem.slots, *[empty] * (KINDS - len(problem.slots))))

"""The tables of an exported solver, which tell `wideberth_solver.c` of one problem."""

from collections.abc import Sequence
from itertools import chain
from typing import Any

import numpy as np

from ....framework.mpc.ocp.problem import Slots
from ....framework.values.arrays import Array
from ...riccati import _protocol as protocol
from ...riccati.compiled import CompiledSlots
from ...riccati.interior_point import BARRIER_TEST, WARM_DISTANCE
from ...riccati.workspace import MOST_PLANS
from ..layout import number
from ..rendering import rendered
from .native import PREFIX
from .needs import ExportedSolver, table_words

_NOTHING = "work->nothing"


def tables(solver: ExportedSolver) -> str:
    """Return the text of wideberth_tables.h."""
    native = solver.native
    return rendered(
        "solver/wideberth_tables.h",
        kernels=[PREFIX + name for name in (*native.kernels.functions, *native.around)],
        constants=_constants(solver),
        fixed=_fixed(solver),
        limits=native.kernels.limits(),
        kinds=_kinds(solver),
        own=[_kind(solver, k, one) for k, one in enumerate(native.subject.problem.slots)],
        words=table_words(solver),
        settings=len(protocol.Settings._fields),
        numbers=len(protocol.Numbers._fields),
        rows=rows(solver),
    )


def _constants(solver: ExportedSolver) -> dict[str, Any]:
    needs = " && ".join(f'has("{one}")' for one in solver.native.machine.needs) or "1"
    return {
        "NEEDS(has)": f"({needs})",
        "SETTING_GUESS": protocol.SETTING.guess,
        **(_more_constants() if solver.more else {}),
        **{f"NUMBER_{name.upper()}": k for name, k in protocol.NUMBER._asdict().items()},
        "PLAIN_KERNELS": len(protocol.Kernels._fields),
        "SLOT_KERNELS": sum(map(len, solver.native.kernels.kinds)),
        "MOTION_ROWS": _results(solver, "motion"),
        "FINAL_ROWS": _results(solver, "final"),
        "ANY_SLOTS": int(any(one.count for one in solver.native.subject.problem.slots)),
        "MOST_GIVEN": _most(solver, 0),
        "MOST_NUMBERS": _most(solver, 1),
        "MOST_ROWS": _most(solver, 2),
    }


def _more_constants() -> dict[str, Any]:
    """Name the settings that a planner changes, and state those of a warm start."""
    names = ("warm", "push", "test", "plans", "best", "within", "iterations")
    return {
        **{f"SETTING_{name.upper()}": getattr(protocol.SETTING, name) for name in names},
        "WARM_PUSH": number(WARM_DISTANCE),
        "WARM_TEST": number(BARRIER_TEST),
    }


def _fixed(solver: ExportedSolver) -> list[str]:
    """Arrays that do not change, but for those of the slots."""
    made, subject = solver.native.kernels, solver.native.subject
    settings = solver.settings.settings_for(subject.problem, subject.guess)
    slots = list(chain.from_iterable(made.kinds))
    return [
        _array("wideberth_kernel *const PLAIN_KERNELS", _kernels(protocol.Kernels._fields)),
        _array("wideberth_kernel *const SLOT_KERNELS", _kernels(slots)),
        _array("const int64_t SIZES", list(map(int, made.sizes()))),
        _array("const double SETTINGS", list(map(number, settings))),
    ]


def _kinds(solver: ExportedSolver) -> list[str]:
    """Arrays of the slots that do not change."""
    slots = solver.native.subject.problem.slots
    return [
        *(line for k in range(len(solver.native.kernels.kinds)) for line in _core_kind(solver, k)),
        *(line for k, one in enumerate(slots) for line in _own(solver, k, one)),
    ]


def rows(solver: ExportedSolver) -> list[tuple[Any, ...]]:
    """Arrays that the core takes: where each begins in C, and its lengths.

    In the order of `_protocol.layout`; a field that is not known here is an error, so that a core
    with another table is noticed.
    """
    kinds = len(solver.native.kernels.kinds)
    known = _plain(solver)
    begin, found = _trajectories(solver)
    slots = [_of_slots(solver, k) for k in range(kinds)]
    arrays = [known, known, {**known, **begin}, *slots, found, known]
    groups = protocol.layout(kinds)
    named = [
        some[field] for group, some in zip(groups, arrays, strict=True) for field in group._fields
    ]
    return [(*one, *[0] * (4 - len(one))) for one in named]


def _plain(solver: ExportedSolver) -> dict[str, tuple[Any, ...]]:
    """Arrays of the problem, and of its path."""
    problem = solver.native.subject.problem
    steps, size = problem.horizon, problem.dimension
    return {
        "kernels": ("work->kernels", len(protocol.Kernels._fields)),
        "sizes": ("SIZES", len(protocol.Sizes._fields)),
        "limits": ("LIMITS", 2, problem.states + problem.inputs),
        "settings": ("work->settings", len(protocol.Settings._fields)),
        "reference": ("problem->reference", steps, size),
        "direction": ("problem->direction", steps, size),
        "speed": ("problem->speed", steps),
        "curve": ("problem->curve" if problem.curve else _NOTHING, steps, problem.curve),
        "initial": ("problem->initial", problem.states),
        "flag": ("(problem->stop ? problem->stop : work->nothing)", 1),
    }


def _trajectories(solver: ExportedSolver) -> tuple[dict[str, tuple[Any, ...]], ...]:
    """Arrays of the guess, and of the result; a planner alone gives and wants multipliers."""
    problem = solver.native.subject.problem
    width = problem.horizon, width_of_steps(solver)
    states = problem.horizon + 1, problem.states
    inputs = problem.horizon, problem.inputs
    begin: dict[str, tuple[Any, ...]] = {
        "states": ("work->states", *states),
        "inputs": ("problem->start_inputs", *inputs),
        "multipliers": ("more->steps_before", *width) if solver.more else (_NOTHING, 0, 0),
        "plans": ("more->plans", MOST_PLANS, *states) if solver.more else (_NOTHING, 0, 0, 0),
    }
    return begin, {
        "states": ("result->states", *states),
        "inputs": ("result->inputs", *inputs),
        "slack": ("result->slack", problem.horizon),
        "numbers": ("work->numbers", len(protocol.Numbers._fields)),
        "multipliers": ("more->steps_after", *width) if solver.more else (_NOTHING, 0, 0),
    }


def width_of_steps(solver: ExportedSolver) -> int:
    """Multipliers of one step, all but those of slots."""
    return protocol.width_of(solver.native.kernels.sizes())


def width_of_slots(solver: ExportedSolver, k: int) -> int:
    """Multipliers of one slot and step of a kind."""
    shape = solver.native.kernels.made.slots[k]
    own = len(solver.native.kernels.problem.slots[k].auxiliary)
    return shape.inequalities + shape.equalities + 2 * own


def _of_slots(solver: ExportedSolver, k: int) -> dict[str, tuple[Any, ...]]:
    """Arrays of one kind of slots."""
    made = solver.native.kernels
    one, steps = made.problem.slots[k], made.problem.horizon
    own, first = len(one.auxiliary), sum(map(len, made.kinds[:k]))
    some = f"problem->{one.name}s" if one.count else ""

    def at(name: str, *shape: int) -> tuple[Any, ...]:
        return (f"{some}.{name}" if np.prod(shape) else _NOTHING, *shape)

    where = f"result->{one.name}_auxiliaries" if one.count * own else _NOTHING
    begun = at("auxiliaries", steps, one.count, own)
    before: tuple[Any, ...] = (_NOTHING, 0, 0, 0)
    after = before
    if solver.more and one.count:
        wide = steps, one.count, width_of_slots(solver, k)
        before = (f"more->{one.name}s_before", *wide)
        after = (f"more->{one.name}s_after", *wide)
        if own:
            begun = (f"more->{one.name}s_begun", steps, one.count, own)
    levels = (steps, one.count) if one.levelled else (0, 0)
    return {
        "kernels": (f"work->slot_kernels + {first}", len(made.kinds[k])),
        "depends": (f"DEPENDS_{k}", len(made.made.slots[k].depends)),
        "rows": (f"ROWS_{k}", 3),
        "limits": (f"OWN_LIMITS_{k}", 2, own),
        "regularisation": (f"REGULARISATION_{k}", 1),
        "numbers": at("parameters", steps, one.count, one.width),
        "levels": at("level", *levels),
        "active": at("active", one.count),
        "drawn": at("auxiliaries", steps, one.count, own),
        "begun": begun,
        "found": (where, steps, one.count, own),
        "before": before,
        "after": after,
    }


def _core_kind(solver: ExportedSolver, k: int) -> list[str]:
    """Arrays of a kind of slots that do not change."""
    made = solver.native.kernels
    none = np.zeros(0, dtype=np.int64)
    fixed = CompiledSlots.of(none, made.made.slots[k], made.problem.slots[k])
    limits = list(map(number, fixed.limits.ravel()))
    return [
        _array(f"const int64_t DEPENDS_{k}", fixed.depends.tolist()),
        _array(f"const int64_t ROWS_{k}", fixed.rows.tolist()),
        _array(f"const double OWN_LIMITS_{k}", limits),
        _array(f"const double REGULARISATION_{k}", list(map(number, fixed.regularisation))),
    ]


def _own(solver: ExportedSolver, k: int, one: Slots) -> list[str]:
    """Levels that are aimed at, and where own variables start."""
    aim = solver.aims[k]
    return [
        _array(f"const double AIM_{k}", _numbers(aim)),
        _array(f"const double BEGIN_{k}", _numbers(np.array(one.auxiliary.start))),
    ]


def _numbers(values: Array | None) -> list[str]:
    return [] if values is None else [number(value) for value in values.tolist()]


def _kind(solver: ExportedSolver, k: int, one: Slots) -> str:
    """Return the initialiser of a `struct kind`."""
    own, around = len(one.auxiliary), solver.native.around
    places = {
        "parameters": True, "level": one.levelled, "active": True, "auxiliaries": own > 0,
    }  # fmt: skip
    offsets = [
        f"offsetof(wideberth_problem, {one.name}s.{name})" if one.count and there else "NOWHERE"
        for name, there in places.items()
    ]
    found = f"offsetof(wideberth_result, {one.name}_auxiliaries)" if one.count * own else "NOWHERE"
    begun = "NOWHERE"
    if solver.more and one.count * own:
        begun = f"offsetof(wideberth_more, {one.name}s_begun)"
    kernels = [PREFIX + name if name in around else "NULL" for name in (f"rows{k}", f"set{k}")]
    shape = solver.native.kernels.made.slots[k]
    numbers = [one.count, one.width, own, shape.inequalities, shape.equalities]
    return _joined([*numbers, *offsets, found, begun, f"AIM_{k}", f"BEGIN_{k}", *kernels])


def _results(solver: ExportedSolver, name: str) -> int:
    around = solver.native.around
    return int(around[name].numel_out(0)) if name in around else 0


def _most(solver: ExportedSolver, place: int) -> int:
    """Most variables, numbers or rows that the constraint of a slot has."""
    some = [one for name, one in solver.native.around.items() if name.startswith("rows")]
    counts = [one.numel_out(0) if place == 2 else one.numel_in(place) for one in some]
    return max([1, *map(int, counts)])


def _kernels(names: Sequence[str]) -> list[str]:
    return [PREFIX + name for name in names]


def _array(name: str, values: Sequence[Any]) -> str:
    """Definition of an array; C has none without an element, so it gets a 0."""
    return f"static {name}[] = {{{_joined(values) or '0'}}};"


def _joined(values: Any) -> str:
    return ", ".join(map(str, values))

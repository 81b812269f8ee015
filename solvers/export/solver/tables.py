"""The problem of an exported solver in C: stage functions, sizes and bounds."""

from collections.abc import Iterable
from typing import Any

from ....framework.mpc.ocp.problem import Slots
from ...riccati.kernels import slot_name
from ..layout import number
from ..rendering import rendered
from .exported import PREFIX, ExportedSolver

_FUNCTIONS = ("drive", "node", "node_values", "level")
_SIZES = ("n", "m", "steps", "shared", "input_rows", "node_rows", "final_rows", "head", "kinds")
_SLOT_SIZES = (
    "slots", "parameters", "levelled", "entries", "inequalities", "equalities", "own",
)  # fmt: skip


def problem_header(solver: ExportedSolver) -> str:
    """Return the text of problem.h."""
    checks = [
        one for name, one in solver.functions.items() if name.startswith(("check", "motion"))
    ]  # that of the motion, so that arrays are long enough where there are no slots
    rows = [
        ("MOTION_ROWS", solver.rows("motion"), "constraints of a step"),
        ("FINAL_ROWS", solver.rows("final"), "further ones of x_N"),
        ("MOST_VARIABLES", max(one.numel_in(0) for one in checks), "of a slot and its state"),
        ("MOST_NUMBERS", max(1, *(one.numel_in(1) for one in checks)), "of a slot"),
        ("MOST_ROWS", max(one.numel_out(0) for one in checks), "constraints of a slot"),
    ]
    return rendered(
        "solver/problem.h",
        source=solver.subject.source.replace("*/", ""),
        head=solver.subject.problem.head_width,
        rows=rows,
        kernels=[PREFIX + name for name in solver.functions],
    )


def problem_source(solver: ExportedSolver) -> str:
    """Return the text of problem.c."""
    problem = solver.subject.problem
    state, control = problem.state_bounds, problem.input_bounds
    arrays = [
        _doubles("LOWER", (*state.lower, *control.lower)),
        _doubles("UPPER", (*state.upper, *control.upper)),
    ]
    for k, slots in enumerate(problem.slots):
        arrays += _arrays(solver, k, slots)
    settings = solver.settings.settings_for(problem, solver.subject.guess)
    return rendered(
        "solver/problem.c",
        source=solver.subject.source.replace("*/", ""),
        build=solver.build,
        functions=solver.text,
        arrays=arrays,
        kinds=[_kind(solver, k, slots) for k, slots in enumerate(problem.slots)],
        core=[
            *((name, _kernel(name)) for name in _FUNCTIONS),
            *((name, getattr(solver.table, name)) for name in _SIZES),
            ("lower", "LOWER"),
            ("upper", "UPPER"),
        ],
        settings=[(name, number(getattr(settings, name))) for name, *_ in settings._fields_],
    )


def _kind(solver: ExportedSolver, k: int, slots: Slots) -> dict[str, Any]:
    """One kind of slots: how the core, the code around it and the structures have it."""
    table, name = solver.kinds[k], slot_name(k)
    core: list[tuple[str, Any]] = []
    places: list[tuple[str, str]] = []
    if slots.count:
        core = [
            ("derivatives", _kernel(name)),
            ("values", _kernel(f"{name}_values")),
            *((size, getattr(table, size)) for size in _SLOT_SIZES),
            ("depends", f"DEPENDS_{k}"),
            ("lower", f"LOWER_{k}"),
            ("upper", f"UPPER_{k}"),
            ("regularisation", number(table.regularisation)),
        ]
        places = _places(slots)
    check, fill = (
        PREFIX + one if one in solver.functions else "NULL" for one in (f"check{k}", f"set{k}")
    )
    return {
        "core": core or [("slots", 0)],
        "place": k,
        "places": places,
        "check": check,
        "set": fill,
    }


def _places(slots: Slots) -> list[tuple[str, str]]:
    """Where the numbers of a kind stand, field by field of wb_slots."""
    numbers = f"problem->{slots.name}s"
    places = [
        ("parameters", f"{numbers}.parameters[0][0]"),
        ("active", f"{numbers}.active"),
    ]
    if slots.levelled:
        places.append(("level", f"{numbers}.level[0]"))
    if len(slots.auxiliary):
        places += [(name, f"{numbers}.auxiliaries[0][0]") for name in ("drawn", "begun")]
        found = f"result->{slots.name}_auxiliaries[0][0]"
        places.append(("found", f"result ? (double *){found} : NULL"))
    return places


def _arrays(solver: ExportedSolver, k: int, slots: Slots) -> list[tuple[str, list[str]]]:
    """Arrays of a kind of slots."""
    aim, own = solver.aims[k], slots.auxiliary
    arrays = [_doubles(f"AIM_{k}", () if aim is None else aim.tolist())]
    arrays.append(_doubles(f"BEGIN_{k}", own.start))
    if slots.count:
        depends = solver.kernels.slots[k].depends
        arrays.append((f"int64_t DEPENDS_{k}", [str(one) for one in depends]))
        arrays += [_doubles(f"LOWER_{k}", own.lower), _doubles(f"UPPER_{k}", own.upper)]
    return arrays


def _doubles(name: str, values: Iterable[float]) -> tuple[str, list[str]]:
    return f"double {name}", [number(value) for value in values]


def _kernel(name: str) -> str:
    return f"{{{PREFIX}{name}, NULL}}"

"""The header of an exported solver: sizes, limits, the problem and the result as C structures."""

from ....framework.mpc.slots.base import WIDE
from ....framework.values.arrays import FARTHEST
from ..layout import Define
from ..rendering import rendered
from .exported import ExportedSolver


def header(solver: ExportedSolver) -> str:
    """Return the text of wideberth_solver.h."""
    problem = solver.subject.problem
    return rendered(
        "solver/wideberth_solver.h",
        source=solver.subject.source.replace("*/", ""),
        sizes=_sizes(solver),
        entries=solver.subject.entries,
        needs=_needs(solver),
        numbers=_numbers(solver),
        slots=[one for one in problem.slots if one.count],
        curve=problem.curve,
        margin=f"{solver.margin:g}",
    )


def _sizes(solver: ExportedSolver) -> list[Define]:
    problem = solver.subject.problem
    found: list[Define] = [
        ("HORIZON", problem.horizon, "N, steps"),
        ("DIMENSION", problem.dimension, "D, of the world"),
        ("STATES", problem.states, "n"),
        ("INPUTS", problem.inputs, "m"),
        ("HEADING", -1 if problem.heading is None else problem.heading,
         "which state is the heading, which may be shifted by full turns; -1: none"),
        ("SHARED_LEVEL", int(problem.shared), "1: one level for all slots is a variable"),
        ("CURVE", problem.curve, "numbers of the path that the cost has for a step"),
        ("KINDS", len(problem.slots), "kinds of things to keep clear of"),
    ]  # fmt: skip
    for k, one in enumerate(problem.slots):
        name = one.name.upper()
        found += [
            (f"KIND_{name}", k, "its number"),
            (f"{name}S", one.count, "slots"),
        ]
        if one.count:
            found += [
                (f"{name}_PARAMETERS", one.width, "of the region, of each slot and step"),
                (f"{name}_AUXILIARIES", len(one.auxiliary), "own variables of a slot and step"),
                (f"{name}_FILLED", int(solver.filled[k]),
                 "1: wideberth_set computes them; 0: the caller, see README.md"),
            ]  # fmt: skip
    return found


def _needs(solver: ExportedSolver) -> list[Define]:
    return [
        ("MEMORY", solver.memory, "what wideberth_solve is given"),
        ("STACK", solver.stack, "enough for wideberth_solve compiled by GCC"),
        ("ITERATIONS", solver.settings.iterations, "limit of iterations"),
        ("BUILD", f"UINT64_C({solver.build})", "the same in all files of one export"),
    ]


def _numbers(solver: ExportedSolver) -> list[tuple[str, float, str]]:
    problem = solver.subject.problem
    found = [
        ("DT", problem.dt, "s per step"),
        ("SPEED", solver.speed, "m/s along the path"),
        ("TOLERANCE", solver.settings.tolerance, "of the optimality conditions, scaled"),
        ("START_LEVEL", _start_level(solver), "of a shared level, first guess"),
        ("FARTHEST", FARTHEST, "largest number that is taken"),
        ("WIDEST", WIDE, "m, largest standard deviation and radius"),
    ]
    if problem.penalty is not None:
        found.append(("PENALTY", problem.penalty, "price of one unit of slack"))
    return found


def _start_level(solver: ExportedSolver) -> float:
    level = solver.subject.guess.level
    return float(level) if solver.subject.problem.shared else 0.0

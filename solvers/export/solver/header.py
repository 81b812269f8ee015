"""The header of an exported solver: sizes, limits, the problem and the result as C structures."""

from ....framework.mpc.slots.base import WIDE
from ....framework.values.arrays import FARTHEST
from ..header import entries
from ..layout import Define
from ..rendering import rendered
from .needs import ExportedSolver, memory, stack, work

ERRORS = (
    ("NO_ERROR", "nothing is wrong; how a solve ended, its status says"),
    ("NULL", "an argument is NULL"),
    ("OTHER_BUILD", "header, archive and wideberth_solver.c are of different exports"),
    ("OTHER_PROCESSOR", "the processor lacks instructions that the code was made with"),
    ("LITTLE_MEMORY", "fewer bytes than WIDEBERTH_MEMORY"),
    ("NO_SLOT", "no such kind, or no such slot of it"),
    ("NOT_FINITE", "a number is not finite, or too large"),
    ("NOT_A_COVARIANCE", "a matrix that no Gaussian has"),
    ("NO_CLOSED_FORM", "the caller has to fill in the parameters of this kind"),
    ("BAD_PATH", "a path without two different points"),
)
STATUSES = (
    ("SOLVED", "the plan is a local optimum"),
    ("LIMIT", "the limit of iterations was reached"),
    ("INFEASIBLE", "no plan keeps every region; this one enters them least"),
    ("FAILED", "the numbers did not lead to a plan"),
    ("STOPPED", "*stop was set"),
)


def header(solver: ExportedSolver) -> str:
    """Return the text of wideberth_solver.h."""
    native = solver.native
    problem = native.subject.problem
    return rendered(
        "solver/wideberth_solver.h",
        source=native.subject.source.replace("*/", ""),
        machine=native.machine.name,
        conditions=f"defined(__{native.machine.family}__) && defined(__linux__)",
        sizes=_sizes(solver),
        entries=entries(native.subject),
        needs=_needs(solver),
        numbers=_numbers(solver),
        errors=ERRORS,
        statuses=STATUSES,
        slots=[one for one in problem.slots if one.count],
        curve=problem.curve,
        margin=f"{native.margin:g}",
        more=solver.more,
    )


def _sizes(solver: ExportedSolver) -> list[Define]:
    problem = solver.native.subject.problem
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
                (f"{name}_FILLED", int(solver.native.filled[k]),
                 "1: wideberth_set computes them; 0: the caller, see README.md"),
            ]  # fmt: skip
    return found


def _needs(solver: ExportedSolver) -> list[Define]:
    native = solver.native
    return [
        ("MEMORY", memory(solver), "what wideberth_solve is given"),
        ("STACK", stack(solver), "at most, of wideberth_solve with all that it calls"),
        ("WORK", work(solver), "of MEMORY, tables"),
        ("ITERATIONS", solver.settings.iterations, "limit of iterations"),
        ("BUILD", f"UINT64_C({native.build})", "the same in all files of one export"),
    ]


def _numbers(solver: ExportedSolver) -> list[tuple[str, float, str]]:
    problem = solver.native.subject.problem
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
    level = solver.native.subject.guess.level
    return float(level) if solver.native.subject.problem.shared else 0.0

"""The header of an exported solver: sizes, limits, the problem and the result as C structures."""

from textwrap import wrap

from ....framework.mpc.ocp.problem import Slots
from ....framework.mpc.slots.base import WIDE
from ....framework.values.arrays import FARTHEST
from ..header import entries
from ..layout import Define, number
from .native import Native
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

_HEAD = """\
/* {source}: the planner's solver as object code for {machine}.
 *
 *   cc -O2 loop.c wideberth_solver.c libwideberth.a -lm
 *
 * Each period: wideberth_begin, initial, wideberth_follow, wideberth_set for every obstacle,
 * wideberth_start, wideberth_solve; result.inputs[0] drives the robot. All functions may be called
 * from several threads at once, each with memory, problem and result of its own. None allocates,
 * and none keeps a state between calls (a pointer of the thread's own leads a running solve to
 * its memory). SI units and radians.
 *
 * Of what the planner does in Python around its solver, this is here: the reference along a path,
 * parameters of slots from mean and covariance, the shifted last plan as the start, and how far a
 * plan breaks its constraints. Left to the caller are forecasts, the robot's own uncertainty (add
 * its covariance to every obstacle's), which obstacles get a slot, further starts, and what to do
 * where no plan was found. Made by wideberth; edit the config, not this file.
 */
#ifndef WIDEBERTH_SOLVER_H
#define WIDEBERTH_SOLVER_H

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {{
#endif

#if {conditions}
#define WIDEBERTH_FOR_THIS_PROCESSOR 1
#endif
"""

_FUNCTIONS = """
/* All of these return an error, WIDEBERTH_NO_ERROR if all is well; see wideberth_error_text. */

/* Make a problem empty: no slot in use, levels and own variables those of the planner. */
#define wideberth_begin(problem) \\
    wideberth_begin_as((problem), sizeof(wideberth_problem), WIDEBERTH_BUILD)
int wideberth_begin_as(wideberth_problem *problem, size_t size, uint64_t build);

/* Lay reference, direction and speed along a path, from its point nearest to `initial`, at `speed`
 * m/s; the reference stops at the end. `*arc` in m is how far the robot has come: negative before
 * the first call, then what the last call left in it. */
int wideberth_follow(wideberth_problem *problem, const double (*points)[WIDEBERTH_DIMENSION],
    int count, double speed, double *arc);

/* Put a thing with Gaussian place into a slot, for the steps 1..N: mean in m, covariance in m^2
 * row by row, radius in m of the thing alone; the robot's radius and the planner's margin of
 * {margin:g} m are added. `kind` is one of WIDEBERTH_KIND_... */
int wideberth_set(wideberth_problem *problem, int kind, int slot,
    const double (*mean)[WIDEBERTH_DIMENSION],
    const double (*covariance)[WIDEBERTH_DIMENSION * WIDEBERTH_DIMENSION], double radius);

/* Put a slot out of use. */
int wideberth_clear(wideberth_problem *problem, int kind, int slot);

/* Start from the last plan, seen `share` steps (period / WIDEBERTH_DT) later and driven from
 * `initial`; from zero inputs where `last` is NULL. */
int wideberth_start(wideberth_problem *problem, const wideberth_result *last, double share);

/* Solve. The `size` bytes at `memory` (WIDEBERTH_MEMORY, any alignment) are used until it returns.
 * May be called inside a signal handler that interrupted it, with other memory. */
int wideberth_solve(
    const wideberth_problem *problem, void *memory, size_t size, wideberth_result *result);

/* Largest violation of dynamics, limits and regions by a plan, each in its own unit. */
double wideberth_violation(const wideberth_problem *problem, const wideberth_result *plan);

/* The planner's robot after one step of WIDEBERTH_DT; `next` may be `state`. */
void wideberth_step(const double *state, const double *input, double *next);

/* Words; also for numbers that are no error or status. */
const char *wideberth_error_text(int error);
const char *wideberth_status_text(int status);

#ifdef __cplusplus
}
#endif

#endif
"""


def header(solver: ExportedSolver) -> str:
    """Return the text of wideberth_solver.h."""
    native = solver.native
    machine = native.machine
    known = f"defined(__{machine.family}__) && defined(__linux__)"
    parts = [
        _HEAD.format(
            source=native.subject.source.replace("*/", ""), machine=machine.name, conditions=known
        ),
        "/* Sizes. */",
        *(_define(name, str(value), text) for name, value, text in _sizes(solver)),
        "\n/* What each entry is. */",
        *(_define(name, str(value), text) for name, value, text in entries(native.subject)),
        "\n/* What a solve takes, in bytes; limits. */",
        *(_define(name, str(value), text) for name, value, text in _needs(solver)),
        "\n/* Numbers of the planner. */",
        *(_define(name, number(value), text) for name, value, text in _numbers(solver)),
        _listed("error", ERRORS),
        _listed("status", STATUSES),
        *(_slots(one) for one in native.subject.problem.slots if one.count),
        _problem(native),
        _result(native),
    ]
    return "\n".join(parts) + "\n" + _FUNCTIONS.replace("{margin:g}", f"{native.margin:g}")


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


def _slots(one: Slots) -> str:
    """Structure of the numbers of one kind of slots."""
    upper = f"WIDEBERTH_{one.name.upper()}"
    each = f"[WIDEBERTH_HORIZON][{upper}S]"
    lines = [
        f"    double parameters{each}[{upper}_PARAMETERS]; /* of step i + 1, see wideberth_set */"
    ]
    if one.levelled:
        lines.append(
            f"    double level{each}; /* larger keeps farther away; not read if shared */"
        )
    lines.append(f"    double active[{upper}S]; /* 1 where the slot is used, else 0 */")
    if len(one.auxiliary):
        lines.append(f"    double auxiliaries{each}[{upper}_AUXILIARIES]; /* their start */")
    body = "\n".join(lines)
    return f"\ntypedef struct {{\n{body}\n}} wideberth_{one.name}s;"


def _problem(native: Native) -> str:
    problem = native.subject.problem
    curve = [
        "    double curve[WIDEBERTH_HORIZON][WIDEBERTH_CURVE]; /* the caller's, see README.md */"
    ]
    lines = [
        "    uint64_t build; /* set by wideberth_begin, as is all that is not given */",
        "    const volatile double *stop; /* a solve ends early once *stop is above 0; or NULL */",
        "    double initial[WIDEBERTH_STATES]; /* x_0 */",
        "    double reference[WIDEBERTH_HORIZON][WIDEBERTH_DIMENSION]; /* m, at steps 1..N */",
        "    double direction[WIDEBERTH_HORIZON][WIDEBERTH_DIMENSION]; /* unit tangents */",
        "    double speed[WIDEBERTH_HORIZON]; /* m/s */",
        *(curve if problem.curve else []),
        "    double start_states[WIDEBERTH_HORIZON + 1][WIDEBERTH_STATES]; /* first guess */",
        "    double start_inputs[WIDEBERTH_HORIZON][WIDEBERTH_INPUTS];",
        "    double start_level; /* of a shared level; else not read */",
        *(f"    wideberth_{one.name}s {one.name}s;" for one in problem.slots if one.count),
    ]
    return "\ntypedef struct {\n" + "\n".join(lines) + "\n} wideberth_problem;"


def _result(native: Native) -> str:
    lines = [
        "    double states[WIDEBERTH_HORIZON + 1][WIDEBERTH_STATES];",
        "    double inputs[WIDEBERTH_HORIZON][WIDEBERTH_INPUTS]; /* the first one drives */",
        "    double slack[WIDEBERTH_HORIZON]; /* of the regions, 0 where they are kept */",
        *(
            f"    double {one.name}_auxiliaries[WIDEBERTH_HORIZON][WIDEBERTH_{one.name.upper()}S]"
            f"[WIDEBERTH_{one.name.upper()}_AUXILIARIES];"
            for one in native.subject.problem.slots
            if one.count and len(one.auxiliary)
        ),
        "    double cost, level, error; /* the price of slack included; shared level; residual */",
        "    int iterations, status; /* WIDEBERTH_SOLVED, ... */",
    ]
    return "\ntypedef struct {\n" + "\n".join(lines) + "\n} wideberth_result;"


def _listed(name: str, values: tuple[tuple[str, str], ...]) -> str:
    rows = [f"    WIDEBERTH_{one}, /* {text} */" for one, text in values]
    count = "WIDEBERTH_STATUSES" if name == "status" else "WIDEBERTH_ERRORS"
    return "\nenum wideberth_" + name + " {\n" + "\n".join([*rows, f"    {count}"]) + "\n};"


def _define(name: str, value: str, text: str) -> str:
    shown = f"({value})" if value.startswith("-") else value
    lines = wrap(f"#define WIDEBERTH_{name} {shown} /* {text} */", 99)
    return "\n".join([lines[0], *(f"    {line}" for line in lines[1:])])

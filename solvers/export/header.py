"""The C header and the file behind it: declarations, sizes, bounds, sparsity."""

from textwrap import wrap

from .layout import Define, c_array, identifiers, number
from .routines import Routine
from .subject import Subject

_HEAD = """\
/* {source}: the planner's optimisation problem as C.
 *
 *   minimise    sum_{{i=0..N-1}} input_cost(x_i, u_i, stage_{{i+1}})
 *             + sum_{{i=1..N}}   state_cost(x_i, stage_i) + WIDEBERTH_PENALTY * slack_i
 *                              + regularisation * |auxiliaries_i - their guesses|^2
 *             + level_cost(level, target)
 *   subject to  x_{{i+1}} = dynamics(x_i, u_i),  input_constraints(x_i, u_i) >= 0,  i = 0..N-1
 *               state_constraints(x_i) >= 0,                                   i = 1..N
 *               inequalities of every slot at x_i + slack_i >= 0,  equalities == 0,  i = 1..N
 *               terminal_constraints(x_N) >= 0,  and the bounds below
 *
 * SI units and radians. Every argument is a vector of doubles, also where it has one entry;
 * NULL stands for one without entries. Matrices are dense and stand column by column. No
 * function keeps a state, allocates or fails. Made by wideberth; edit the config, not this file.
 */
#ifndef WIDEBERTH_H
#define WIDEBERTH_H

#include <math.h> /* INFINITY */

#ifdef __cplusplus
extern "C" {{
#endif
"""

_TAIL = """
#ifdef __cplusplus
}
#endif

#endif
"""

_TOP = """\
/* Tables, and functions that call the generated ones. */
#include "wideberth.h"

#include <stddef.h>
"""

_SLOTS = """
/* Begin of slot k among the numbers of a stage, and of stage i = 1..N among the parameters. */
{slots}
#define WIDEBERTH_PARAMETER_STAGE(i) \\
    (WIDEBERTH_PARAMETER_STAGES + ((i) - 1) * WIDEBERTH_STAGE_SIZE)
"""


def header(subject: Subject) -> str:
    """Return the text of wideberth.h."""
    parts = [_HEAD.format(source=subject.source.replace("*/", "")), "/* Sizes and places. */"]
    parts += [_define(name, value, text) for name, value, text in constants(subject)]
    begins = "\n".join(_begin(one.name.upper()) for one in subject.problem.slots)
    parts += [_SLOTS.replace("{slots}", begins), "/* Numbers. */"]
    parts += [_define(name, number(value), text) for name, value, text in _numbers(subject)]
    bounds = [*_stage_bounds(subject), *_flat_bounds(subject)]
    parts.append("\n/* Bounds of states and inputs, of auxiliaries per slot, and of the NLP. */")
    parts += [f"extern const double wideberth_{name}[];" for name, _ in bounds]
    parts.append(
        "\n/* Where the pieces of stage i = 0..N begin among variables and rows; -1: nowhere. */"
    )
    tables = subject.layout.tables()
    parts += [f"extern const int wideberth_{name}[]; /* {text} */" for name, _, text in tables]
    parts.append("\n/* Nonzeros: column k holds those from columns[k] to columns[k + 1] - 1. */")
    parts += [f"extern const int wideberth_{name}[];" for name, _ in _sparsity(subject)]
    parts.append("\n/* Functions of one stage. */")
    parts += [_declaration(routine) for routine in subject.stage]
    parts.append(
        "\n/* The whole problem as one NLP (wideberth_nlp.c), f over g within its bounds. */"
    )
    parts += [_declaration(routine) for routine in subject.flat]
    return "\n".join(parts) + "\n" + _TAIL


def stage_source(subject: Subject) -> str:
    """Return the text of wideberth.c: bounds, and the functions in front of CasADi's."""
    parts = [_TOP, *(c_array("double", f"wideberth_{k}", v) for k, v in _stage_bounds(subject))]
    return "\n".join([*parts, *map(_definition, subject.stage)])


def flat_source(subject: Subject) -> str:
    """Return the text of wideberth_nlp.c: the same of the whole problem, and its layout."""
    parts = [_TOP, *(c_array("double", f"wideberth_{k}", v) for k, v in _flat_bounds(subject))]
    parts += [c_array("int", f"wideberth_{k}", v) for k, v, _ in subject.layout.tables()]
    parts += [c_array("int", f"wideberth_{k}", v) for k, v in _sparsity(subject)]
    return "\n".join([*parts, *map(_definition, subject.flat)])


def constants(subject: Subject) -> list[Define]:
    """Return all whole numbers of the header: sizes, then what each entry is."""
    found = subject.layout.constants() + entries(subject)
    size = subject.problem.dimension
    found += [
        ("HEAD_REFERENCE", 0, "where the reference position stands in a stage, D entries, m"),
        ("HEAD_DIRECTION", size, "where the path's unit tangent stands, D entries"),
        ("HEAD_SPEED", 2 * size, "where the reference speed stands, m/s"),
        ("HEAD_CURVE", 2 * size + 1, "where the cost's numbers of the path begin, if any"),
    ]
    nonzeros = {routine.name: routine.size for routine in subject.flat}
    for name in ("jacobian", "hessian"):
        found.append((f"{name.upper()}_NONZEROS", nonzeros[f"nlp_{name}"], "of the NLP"))
    return found


def entries(subject: Subject) -> list[Define]:
    """Return what each entry of states and inputs is, with its unit."""
    kinds = (
        ("STATE", subject.robot.states, subject.problem.states),
        ("INPUT", subject.robot.inputs, subject.problem.inputs),
    )
    found: list[Define] = []
    for kind, quantities, count in kinds:
        names = [quantity.name for quantity in quantities][:count]
        units = [quantity.unit for quantity in quantities][:count]
        further = count - len(names)  # what the problem adds to the robot's own
        names += [f"extra {i}" for i in range(further)]
        units += ["-"] * further
        for i, (one, unit) in enumerate(zip(identifiers(names), units, strict=True)):
            found.append((f"{kind}_{one}", i, unit))
    return found


def _numbers(subject: Subject) -> list[Define]:
    problem = subject.problem
    return [
        ("DT", problem.dt, "s per step"),
        ("MINIMUM_LEVEL", problem.minimum, "lower bound of a shared level"),
        ("PENALTY", problem.penalty if problem.slacks and problem.penalty else 0.0,
         "price of one unit of slack"),
        *((f"{one.name.upper()}_REGULARISATION", one.auxiliary.regularisation,
           "likewise" if k else "price of leaving the guess of the auxiliaries")
          for k, one in enumerate(problem.slots)),
    ]  # fmt: skip


def _begin(name: str) -> str:
    """Macro of where slot k of a kind begins among the numbers of a stage."""
    each = f"(k) * WIDEBERTH_{name}_SIZE"
    return f"#define WIDEBERTH_STAGE_{name}(k) (WIDEBERTH_STAGE_{name}S + {each})"


def _stage_bounds(subject: Subject) -> list[tuple[str, list[float]]]:
    problem = subject.problem
    pairs = {
        "state": problem.state_bounds,
        "input": problem.input_bounds,
        **{f"{one.name}_auxiliary": one.auxiliary for one in problem.slots},
    }
    return [
        (f"{name}_{side}", list(getattr(pair, side)))
        for name, pair in pairs.items()
        for side in ("lower", "upper")
    ]


def _flat_bounds(subject: Subject) -> list[tuple[str, list[float]]]:
    form = subject.layout.form
    found = [("nlp_lower", form.lower), ("nlp_upper", form.upper)]
    return [*found, ("nlp_row_lower", form.row_lower), ("nlp_row_upper", form.row_upper)]


def _sparsity(subject: Subject) -> list[tuple[str, list[int]]]:
    found = []
    for routine in subject.flat:
        if routine.name in ("nlp_jacobian", "nlp_hessian"):
            pattern = routine.function.sparsity_out(0)
            found.append((f"{routine.name}_columns", list(pattern.colind())))
            found.append((f"{routine.name}_row_indices", list(pattern.row())))
    return found


def _define(name: str, value: object, text: str) -> str:
    shown = f"({value})" if str(value).startswith("-") else str(value)
    return f"#define WIDEBERTH_{name} {shown} /* {text} */"


def _signature(routine: Routine) -> str:
    given = ", ".join(f"const double *{name}" for name in routine.arguments)
    return f"void wideberth_{routine.name}({given}, double *{routine.result})"


def _declaration(routine: Routine) -> str:
    text = f"/* {routine.result}[{routine.size}]: {routine.text}. */"
    lines = wrap(text, 99, subsequent_indent=" * ", break_on_hyphens=False)
    call = wrap(f"{_signature(routine)};", 99, subsequent_indent="    ")
    return "\n".join([*lines, *call])


def _definition(routine: Routine) -> str:
    """Write the function that hands its arguments to the generated one.

    What CasADi makes of scalar operations keeps all work in local variables: no work array.
    """
    inner, function = f"wideberth_casadi_{routine.name}", routine.function
    lines = [
        f"int {inner}(const double **, double **, long long int *, double *, int);",
        f"{_signature(routine)}",
        "{",
        f"    const double *given[{function.sz_arg()}];",
        f"    double *found[{function.sz_res()}];",
    ]
    lines += [f"    given[{i}] = {name};" for i, name in enumerate(routine.arguments)]
    lines += [
        f"    found[0] = {routine.result};",
        f"    {inner}(given, found, NULL, NULL, 0);",
        "}\n",
    ]
    return "\n".join(lines)

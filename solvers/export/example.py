"""The C example: every function against the values that Python finds, and how they add up."""

from .layout import auxiliary_table, c_array
from .routines import Routine
from .subject import Subject

_PLACES = {
    "state": "variables + wideberth_nlp_states[1]",
    "input": "variables + wideberth_nlp_inputs[0]",
    "head": "STAGE(1)",
    "level": "LEVEL",
    "target": "parameters + WIDEBERTH_PARAMETER_TARGET",
    "weights": "multipliers",
    "weight": "&one",
}
"""Where the example finds the arguments of the functions of one stage."""

_TOP = """\
/* Evaluates every function for one recorded instance and compares with Python's values.
 * total_cost and all_rows show how the functions of one stage make up the whole problem. */
#include "wideberth.h"

#include <math.h>
#include <stdio.h>

#include "example_data.h"

#define STAGE(i) (parameters + WIDEBERTH_PARAMETER_STAGE(i))
#define STATE(i) ((i) ? variables + wideberth_nlp_states[i] : parameters)
#define LEVEL variables /* the first variable where the level is shared; else not read */

static double deviation(const double *found, const double *expected, int count)
{
    double worst = 0.0;
    int k;
    for (k = 0; k < count; k++) {
        const double size = fabs(expected[k]) > 1.0 ? fabs(expected[k]) : 1.0;
        const double off = fabs(found[k] - expected[k]) / size;
        if (!(off <= worst)) worst = off; /* also what is not a number */
    }
    return worst;
}

static int check(const char *name, const double *found, const double *expected, int count)
{
    const double worst = deviation(found, expected, count);
    const int good = worst <= 1e-9;
    printf("%-32s %6d values  %.1e  %s\\n", name, count, worst, good ? "ok" : "WRONG");
    return !good;
}

#if {lifted}
static double distance(const double *first, const double *second, int count)
{
    double sum = 0.0;
    int k;
    for (k = 0; k < count; k++) sum += (first[k] - second[k]) * (first[k] - second[k]);
    return sum;
}
#endif

static double total_cost(void)
{
    double total, part;
    int i;
    wideberth_level_cost(LEVEL, parameters + WIDEBERTH_PARAMETER_TARGET, &total);
    for (i = 1; i <= WIDEBERTH_HORIZON; i++) {
        wideberth_input_cost(
            STATE(i - 1), variables + wideberth_nlp_inputs[i - 1], STAGE(i), &part);
        total += part;
        wideberth_state_cost(STATE(i), STAGE(i), &part);
        total += part;
#if WIDEBERTH_SLACKS > 0
        total += WIDEBERTH_PENALTY * variables[wideberth_nlp_slacks[i]];
#endif
"""

_REGULARISATION = """\
#if WIDEBERTH_{upper}_AUXILIARIES * WIDEBERTH_{upper}S > 0
        {{
            int k;
            for (k = 0; k < WIDEBERTH_{upper}S; k++)
                total += WIDEBERTH_{upper}_REGULARISATION
                    * distance(variables + {where}[i] + k * WIDEBERTH_{upper}_AUXILIARIES,
                          STAGE(i) + WIDEBERTH_STAGE_{upper}(k) + WIDEBERTH_{upper}_GUESS,
                          WIDEBERTH_{upper}_AUXILIARIES);
        }}
#endif
"""

_ROWS = """\
    }
    return total;
}

static void all_rows(double *rows)
{
    int i, k;
    for (i = 0; i <= WIDEBERTH_HORIZON; i++) {
        double *next = rows + wideberth_nlp_first_row[i];
        if (i < WIDEBERTH_HORIZON) {
            const double *input = variables + wideberth_nlp_inputs[i];
            wideberth_dynamics(STATE(i), input, next);
            for (k = 0; k < WIDEBERTH_STATES; k++) next[k] = STATE(i + 1)[k] - next[k];
            next += WIDEBERTH_STATES;
            wideberth_input_constraints(STATE(i), input, next);
            next += WIDEBERTH_INPUT_CONSTRAINTS;
        }
        if (i == 0) continue;
        wideberth_state_constraints(STATE(i), next);
        next += WIDEBERTH_STATE_CONSTRAINTS;
        if (i == WIDEBERTH_HORIZON) {
            wideberth_terminal_constraints(STATE(i), next);
            next += WIDEBERTH_TERMINAL_CONSTRAINTS;
        }
        slots(i, next);
    }
}
"""

_SLOTS_HEAD = """
/* First the inequalities of all slots, {kinds}, then the equalities. */
static void slots(int i, double *next)
{
    double found[SLOT_ROWS];
    double *tied = next + {inequalities};
    int k, j;
"""

_SLOT = """\
#if WIDEBERTH_{upper}S > 0
    for (k = 0; k < WIDEBERTH_{upper}S; k++) {{
        wideberth_{lower}(STATE(i), AUXILIARY({where}[i], k, WIDEBERTH_{upper}_AUXILIARIES), LEVEL,
            STAGE(i) + WIDEBERTH_STAGE_{upper}(k), found);
        for (j = 0; j < WIDEBERTH_{upper}_INEQUALITIES; j++) *next++ = found[j] + SLACK(i);
        for (j = 0; j < WIDEBERTH_{upper}_EQUALITIES; j++)
            *tied++ = found[WIDEBERTH_{upper}_INEQUALITIES + j];
    }}
#endif
"""

_SLOTS_TAIL = """\
    (void)i, (void)k, (void)j, (void)next, (void)tied, (void)found;
}
"""

_MACROS = """
#define SLOT_ROWS ({rows} + 1)
#define AUXILIARY(first, k, each) ((each) ? variables + (first) + (k) * (each) : NULL)
#if WIDEBERTH_SLACKS > 0
#define SLACK(i) variables[wideberth_nlp_slacks[i]]
#else
#define SLACK(i) 0.0
#endif
"""


def example(subject: Subject) -> str:
    """Return the text of example.c."""
    kinds = [
        {"upper": name.upper(), "lower": name, "where": where}
        for name, (where, _) in _slot_places(subject).items()
    ]
    texts = _texts(subject)
    cost, rows = _TOP.replace("{lifted}", texts["lifted"]), _ROWS
    cost += "".join(_REGULARISATION.format(**kind) for kind in kinds)
    head, macros = _SLOTS_HEAD, _MACROS.replace("{rows}", texts["rows"])
    for name in ("kinds", "inequalities"):
        head = head.replace(f"{{{name}}}", texts[name])
    states = head + "".join(_SLOT.format(**kind) for kind in kinds) + _SLOTS_TAIL
    end = rows.index("static void all_rows")
    checks = [_check(subject, routine) for routine in [*subject.stage, *subject.flat]]
    main = [
        "\nint main(void)\n{",
        f"    static double found[{_largest(subject)}];",
        "    const double one = 1.0;",
        "    int wrong = 0;",
        *checks,
        "    found[0] = total_cost();",
        '    wrong += check("total cost", found, expected_nlp_cost, 1);',
        "    all_rows(found);",
        '    wrong += check("all rows", found, expected_nlp_constraints, WIDEBERTH_ROWS);',
        '    if (wrong) printf("%d results differ\\n", wrong);',
        '    else printf("all results agree\\n");',
        "    return wrong != 0;\n}\n",
    ]
    return cost + rows[:end] + macros.lstrip() + states + "\n" + rows[end:] + "\n".join(main)


def data(subject: Subject) -> str:
    """Return the text of example_data.h: the instance, and what Python finds."""
    arrays = {
        "variables": subject.variables,
        "parameters": subject.numbers,
        "multipliers": subject.multipliers,
        **{f"expected_{one.name}": subject.values(one) for one in [*subject.stage, *subject.flat]},
    }
    text = "".join(f"static {c_array('double', name, values)}" for name, values in arrays.items())
    return f"/* One instance, and the values that Python finds for it. */\n{text}"


def _largest(subject: Subject) -> int:
    return max(1, *(one.size for one in [*subject.stage, *subject.flat]))


def _slot_places(subject: Subject) -> dict[str, tuple[str, str]]:
    """Where the auxiliaries and the numbers of a kind of slots begin, by its name."""
    return {
        one.name: (
            f"wideberth_nlp_{auxiliary_table(k, one)}",
            f"WIDEBERTH_STAGE_{one.name.upper()}(0)",
        )
        for k, one in enumerate(subject.problem.slots)
    }


def _texts(subject: Subject) -> dict[str, str]:
    """Pieces of C that list all kinds of slots."""
    names = [f"WIDEBERTH_{one.name.upper()}" for one in subject.problem.slots]
    rows = [f"{name}_INEQUALITIES + {name}_EQUALITIES" for name in names]
    return {
        "kinds": " before ".join(f"{one.name}s" for one in subject.problem.slots),
        "lifted": " \\\n    || ".join(f"{name}_AUXILIARIES * {name}S > 0" for name in names)
        or "0",
        "inequalities": "\n        + ".join(f"{name}S * {name}_INEQUALITIES" for name in names)
        or "0",
        "rows": " \\\n    + ".join(rows) or "0",
    }


def _check(subject: Subject, routine: Routine) -> str:
    slots, kind = _slot_places(subject), routine.slots
    places = {**_PLACES, **{name: name for name in ("variables", "parameters", "multipliers")}}
    if kind:
        where, numbers = slots[kind]
        each = f"WIDEBERTH_{kind.upper()}_AUXILIARIES"
        places |= {"auxiliary": f"AUXILIARY({where}[1], 0, {each})"}
        places |= {"numbers": f"STAGE(1) + {numbers}"}
    given = ", ".join(places[name] for name in routine.arguments)
    return (
        f"    wideberth_{routine.name}({given}, found);\n"
        f'    wrong += check("{routine.name}", found, expected_{routine.name}, {routine.size});'
    )

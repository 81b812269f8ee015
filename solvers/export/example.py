"""The C example: every function against the values that Python finds, and how they add up."""

from typing import Any

from .layout import auxiliary_table, c_array
from .rendering import rendered
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


def example(subject: Subject) -> str:
    """Return the text of example.c."""
    routines = [*subject.stage, *subject.flat]
    checks = [
        {"name": one.name, "size": one.size, "given": ", ".join(_places(subject, one))}
        for one in routines
    ]
    slots = [
        {"upper": one.name.upper(), "name": one.name, "where": where}
        for one, where in zip(subject.problem.slots, _auxiliaries(subject), strict=True)
    ]
    largest = max(1, *(one.size for one in routines))
    return rendered(
        "problem/example.c", slots=slots, checks=checks, largest=largest, **_texts(subject)
    )


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


def _auxiliaries(subject: Subject) -> list[str]:
    """Tables that say where the auxiliaries of each kind of slots begin."""
    slots = subject.problem.slots
    return [f"wideberth_nlp_{auxiliary_table(k, one)}" for k, one in enumerate(slots)]


def _texts(subject: Subject) -> dict[str, Any]:
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


def _places(subject: Subject, routine: Routine) -> list[str]:
    """Where the example finds the arguments of a function."""
    places = {**_PLACES, **{name: name for name in ("variables", "parameters", "multipliers")}}
    for one, where in zip(subject.problem.slots, _auxiliaries(subject), strict=True):
        if one.name == routine.slots:
            upper = f"WIDEBERTH_{one.name.upper()}"
            places["auxiliary"] = f"AUXILIARY({where}[1], 0, {upper}_AUXILIARIES)"
            places["numbers"] = f"STAGE(1) + WIDEBERTH_STAGE_{one.name.upper()}(0)"
    return [places[name] for name in routine.arguments]

"""The C header and the file behind it: declarations, sizes, bounds, sparsity."""

from typing import Any

from .layout import Define
from .rendering import rendered
from .subject import Subject


def header(subject: Subject) -> str:
    """Return the text of wideberth.h."""
    return rendered(
        "problem/wideberth.h",
        source=subject.source.replace("*/", ""),
        constants=constants(subject),
        slots=[one.name.upper() for one in subject.problem.slots],
        numbers=_numbers(subject),
        bounds=[*_stage_bounds(subject), *_flat_bounds(subject)],
        tables=subject.layout.tables(),
        sparsity=_sparsity(subject),
        stage=subject.stage,
        flat=subject.flat,
    )


def stage_source(subject: Subject) -> str:
    """Return the text of wideberth.c: bounds, and the functions in front of CasADi's."""
    arrays = [("double", *one) for one in _stage_bounds(subject)]
    return rendered("problem/functions.c", arrays=arrays, routines=subject.stage)


def flat_source(subject: Subject) -> str:
    """Return the text of wideberth_nlp.c: the same of the whole problem, and its layout."""
    arrays: list[tuple[Any, ...]] = [("double", *one) for one in _flat_bounds(subject)]
    arrays += [("int", name, values) for name, values, _ in subject.layout.tables()]
    arrays += [("int", *one) for one in _sparsity(subject)]
    return rendered("problem/functions.c", arrays=arrays, routines=subject.flat)


def constants(subject: Subject) -> list[Define]:
    """Return all whole numbers of the header: sizes, then what each entry is."""
    found = subject.layout.constants() + subject.entries
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

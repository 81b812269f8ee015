"""The READMEs of exports."""

from collections.abc import Iterable
from typing import Any

from .rendering import rendered
from .routines import STAGE
from .subject import Subject


def readme(subject: Subject) -> str:
    """Return the text of README.md: what each function is, in calling order."""
    problem = subject.problem
    functions = [*subject.stage, *subject.flat]
    owners = [("those" if k else "the numbers", one) for k, one in enumerate(problem.slots)]
    return rendered(
        "problem/README.md",
        source=subject.source,
        problem=problem,
        stack=max(one.function.sz_w() for one in functions),
        states=_names(subject.robot.states),
        inputs=_names(subject.robot.inputs),
        rooms=_listed(f"{one.count} {one.name}s" for one in problem.slots),
        kinds=[f"{one.name}s" for one in problem.slots],
        levelled=_listed(f"{one.name}s" for one in problem.slots if one.levelled),
        stage=[one for one in subject.stage if one.name in (*STAGE, one.slots)],
        flat=subject.flat,
        numbers=", ".join(f"{what} of the {one.name} slots" for what, one in owners),
        cost=type(subject.cost).__name__,
        regions="\n\n".join(regions(subject)),
    )


def _names(quantities: Any) -> str:
    return ", ".join(f"{one.name} ({one.unit})" for one in quantities)


def _listed(words: Iterable[str]) -> str:
    """Join words by commas and a last "and"."""
    *first, last = [*words] or [""]
    return " and ".join(part for part in (", ".join(first), last) if part)


def regions(subject: Subject) -> list[str]:
    """Describe how the parameters of the slots are computed, in the words of each kind."""
    pairs = zip(subject.kinds, subject.problem.slots, strict=True)
    return [
        f"The slot of each {one.name} has {one.width} parameters. "
        f"{kind.explanation(subject.problem.dimension)}"
        for kind, one in pairs
        if one.count
    ]

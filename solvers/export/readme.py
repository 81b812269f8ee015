"""The README of an export: what each function is, in the order in which they are called."""

from textwrap import fill
from typing import Any

from ...framework.mpc.ocp.problem import Problem, Slots
from .routines import STAGE, Routine
from .subject import Subject

_TEXT = """\
# {source}, as C

The optimisation problem of the planner `{source}`, for a controller of your own. `make` compiles
the example and compares every function with the values that Python found.

| File | Content |
| --- | --- |
| `wideberth.h` | what you include; sizes and places |
| `wideberth.c`, `stage_functions.c` | functions of one stage, the latter made by CasADi |
| `wideberth_nlp.c`, `nlp_functions.c` | the whole problem as one NLP; not needed by the former |
| `example.c`, `example_data.h` | every function for one instance, with the values expected |
| `manifest.json` | the planner's config, versions, sizes |

C99, no library but libm. All functions are re-entrant: no state, no allocation, work on the stack
({stack} doubles in the largest). `wideberth.h` may be included from C++.

## The problem

N = {horizon} steps of {dt:g} s; states {states}; inputs {inputs}. {slots}

{level}

{soft}

## Functions of one stage, in calling order

For a solver that works stage by stage (Riccati, SQP). Besides each `NAME` there are
`NAME_jacobian` and `NAME_hessian`; both are dense, column by column, by the arguments that the
header names. The Hessian takes one weight per row (of a cost: one weight).

{stage}

The slack of stage i is added to every inequality of every slot at that stage. The cost of slacks
and auxiliaries is plain: see `total_cost` in `example.c`, and `all_rows` there for the order of
the rows.

## The whole problem

{flat}

Variables stand stage by stage: {shared}u_0, then x_i, u_i, {lifted},
slack for i = 1..N (no u_N); the tables `wideberth_nlp_*` say where. Jacobian and Hessian are
compressed by columns; the sign of the multipliers is that of `weight * f + multipliers' g`.

## Parameters

x_0 ({states_count}), then the level that a shared one is drawn to (1), then for i = 1..N the
stage: a head of {head} (reference position, unit tangent of the path, reference speed{curve}),
{numbers}. A slot holds

1. the parameters of its region, see below;
2. its level ({levelled} alone; not read where the level is shared);
3. 1 where it is used, else 0 (an empty slot must still hold finite parameters, as of a unit disc);
4. the guess that its auxiliaries are drawn to.

Before a solve shift x_0's heading by full turns until the guess's is within pi of it.

{regions}

## Solving

Nothing here solves: bring a solver. CasADi generates code of whole solvers too: of its own
`sqpmethod` with `qrqp` all of it; of IPOPT and fatrop calls that need their headers and libraries
on the target. Such code is not part of this export.
"""


def readme(subject: Subject) -> str:
    """Return the text of README.md."""
    problem = subject.problem
    soft = "Regions are hard: there is no slack."
    if problem.slacks:
        soft = f"Regions are soft: one slack per stage, at the price {problem.penalty:g}."
    text = _TEXT.format(
        source=subject.source,
        stack=max(routine.function.sz_w() for routine in [*subject.stage, *subject.flat]),
        horizon=problem.horizon,
        dt=problem.dt,
        states=_names(subject.robot.states),
        inputs=_names(subject.robot.inputs),
        slots=f"Room for {_listed([f'{one.count} {one.name}s' for one in problem.slots])}.",
        level=_level(subject),
        soft=soft,
        stage=_table([one for one in subject.stage if one.name in (*STAGE, one.slots)]),
        flat=_table(subject.flat),
        shared="the shared level, " if problem.shared else "",
        states_count=problem.states,
        head=problem.head_width,
        curve=_curve(subject),
        lifted=f"auxiliaries of {', of '.join(f'{one.name}s' for one in problem.slots)}",
        numbers=", ".join(f"{what} of the {one.name} slots" for what, one in _own(problem)),
        levelled=_listed([f"{one.name}s" for one in problem.slots if one.levelled]),
        regions="\n\n".join(regions(subject)),
    )
    return "\n\n".join(filled(block) for block in text.split("\n\n")).rstrip() + "\n"


def filled(block: str) -> str:
    """Wrap a paragraph; tables, headings, lists and quotes stay as they are."""
    plain = block[:1] not in ("|", "#", ">", "1", "")
    return fill(block, 99, break_long_words=False, break_on_hyphens=False) if plain else block


def _curve(subject: Subject) -> str:
    """Say what the cost adds to the head."""
    count = subject.problem.head_width - 2 * subject.problem.dimension - 1
    kind = type(subject.cost)
    return f", {count} numbers of the path as `{kind.__name__}.lay` makes them" if count else ""


def _level(subject: Subject) -> str:
    problem = subject.problem
    named = [f"{one.name}s" for one in problem.slots if one.levelled]
    if not problem.shared:
        return f"Each slot of {_listed(named)} has its level among its numbers: larger is safer."
    return (
        f"One level is a decision variable for all slots of {_listed(named)} and all stages, "
        f"at least "
        f"{problem.minimum:g}; `level_cost` draws it to the target. Larger is safer."
    )


def _names(quantities: Any) -> str:
    return ", ".join(f"{one.name} ({one.unit})" for one in quantities)


def _table(routines: list[Routine]) -> str:
    lines = ["| Function | What it is |", "| --- | --- |"]
    for one in routines:
        arguments = ", ".join(one.arguments)
        lines.append(f"| `wideberth_{one.name}({arguments}, {one.result})` | {one.text} |")
    return "\n".join(lines)


def _own(problem: Problem) -> list[tuple[str, Slots]]:
    """Every kind of slots with the words that begin what is said of its numbers."""
    return [("those" if k else "the numbers", one) for k, one in enumerate(problem.slots)]


def _listed(words: list[str]) -> str:
    """Join words by commas and a last "and"."""
    first = ", ".join(words[:-1])
    return " and ".join(part for part in (first, *words[-1:]) if part)


def regions(subject: Subject) -> list[str]:
    """Describe how the parameters of the slots are computed, in the words of each kind."""
    pairs = zip(subject.kinds, subject.problem.slots, strict=True)
    return [
        f"The slot of each {one.name} has {one.width} parameters. "
        f"{kind.explanation(subject.problem.dimension)}"
        for kind, one in pairs
        if one.count
    ]

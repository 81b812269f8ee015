"""The README of an exported solver."""

from ..readme import filled, regions
from .needs import ExportedSolver, memory, stack

_TEXT = """\
# {source}: the solver for {machine}

`{source}` as object code: what the solver `riccati` computes in Python, without Python. One linker
line, one call per period.

```sh
cc -O2 loop.c wideberth_solver.c libwideberth.a -lm
```

| File | Content |
| --- | --- |
| `wideberth_solver.h` | what you include: sizes, limits, structures, functions, errors |
| `libwideberth.a` | object code: the solver's core, and this problem's derivatives |
| `wideberth_solver.c`, `wideberth_tables.h` | fill in what the core reads; C99, compiled by you |
| `loop.c`, `loop.cpp` | close the loop among obstacles, for robots in the plane |
| `manifest.json` | the planner's config, versions, target |

A solve takes {memory} bytes, which you give to it, {stack} bytes of stack at most, and at most
{iterations} iterations. It allocates nothing and keeps nothing; from several threads call it with
memory, problem and result of each. All files belong together: of another export they are refused
with an error code, on a processor that lacks instructions likewise.

The object code needs 64-bit Linux with glibc, of which it calls {called}. Two exports have the
same names, so one program holds one of them; put others into a shared library each.

## What the caller does

Forecasts; the robot's own covariance, added to every obstacle's; the choice of obstacles where
there are more than slots; further starts where the last plan leads to no plan; what to do where
none is found. `wideberth_violation` says how far a plan breaks its constraints.

Levels stand in the problem after `wideberth_begin` as the planner aims at them with all slots in
use.{curve}

{regions}
"""
_CURVE = (
    " The cost has {count} numbers of the path for each step, `curve`, which `{kind}.lay` makes "
    "in Python; `wideberth_follow` leaves them alone."
)


def readme(solver: ExportedSolver) -> str:
    """Return the text of README.md."""
    native = solver.native
    subject, problem = native.subject, native.subject.problem
    curve = _CURVE.format(count=problem.curve, kind=type(subject.cost).__name__)
    text = _TEXT.format(
        source=subject.source,
        machine=native.machine.name,
        memory=memory(solver),
        stack=stack(solver),
        called=", ".join(f"`{name}`" for name in native.called),
        iterations=solver.settings.iterations,
        curve=curve if problem.curve else "",
        regions="\n\n".join(regions(subject)),
    )
    return "\n\n".join(filled(block) for block in text.split("\n\n")).rstrip() + "\n"

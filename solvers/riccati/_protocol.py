"""Named places in the arrays that Python hands to the compiled core.

A call from Python into compiled code costs time for every argument, so that numbers travel in
arrays. Each array has a named tuple for its entries: filled by name on the Python side, read by
name in `core`, where ``settings[SETTING.tolerance]`` compiles to a constant index.

The core itself has one argument, a table: of each array, in the order of `layout`, the address
and the lengths of up to three dimensions, so `WORDS` numbers per array.
"""

from collections import namedtuple
from typing import Any

Plain = namedtuple("Plain", "kernels sizes limits settings")
"""Addresses in the order of `Kernels`; numbers by the names of `Sizes`; bounds of x and u,
(2, w); numbers by the names of `Settings`."""

Kernels = namedtuple("Kernels", "drive node node_values level sweep")
"""Kernels that do not belong to a kind of slots, see `kernels.Kernels`."""

SlotKernels = namedtuple("SlotKernels", "derivatives values eliminate expand")
"""Kernels of one kind of slots: derivatives, values alone, both parts of its Newton step."""

Sizes = namedtuple("Sizes", "n m shared input_rows node_rows final_rows")
"""States, inputs, whether the problem has a shared level; rows of the constraints on (x_i, u_i),
on every x_i, and on x_N beside those."""

Settings = namedtuple(
    "Settings",
    "iterations tolerance barrier test push penalty most_penalty gradient minimum guess warm "
    "plans best within",
)
"""Limits of iterations and errors; first barrier; below how many barriers errors have to be before
it is lowered; distance of the start from its bounds; price of slack, first and highest; largest
gradient after scaling; the level's minimum and guess; 1 where multipliers are given, else 0; how
many plans are known from other starts, the cost of the best, and the distance within which a start
leads to the same plan."""

Numbers = namedtuple("Numbers", "status iterations cost level error penalty")
"""Results of a solve beside its arrays."""

Outcomes = namedtuple("Outcomes", "solved limit infeasible failed stopped same dearer")
"""How a solve may end; the last two where it is given up since it leads to a plan that is known,
or to one that is dearer than the best."""

Head = namedtuple("Head", "reference direction speed curve")
"""Parameters of the stage costs, see `ocp.problem.Parameters`."""

Start = namedtuple("Start", "initial states inputs multipliers plans")
"""x_0, guessed states (N + 1, n), guessed inputs (N, m), multipliers (N, `width_of` them), states
of plans from other starts (.., N + 1, n)."""

SlotArguments = namedtuple(
    "SlotArguments",
    "kernels depends rows limits regularisation numbers levels active drawn begun found before "
    "after",
)
"""One kind of slots: addresses in the order of `SlotKernels`; entries of x that matter; (rows of
h, rows of e, whether slots have a level); limits of the own variables (2, A); their
regularisation (1,); parameters (N, K, P); levels (N, K); active (K,); what the regularisation
draws to, the start and the result, each (N, K, A); multipliers of h and e, and of the lower and
upper limits of the own variables, (N, K, H + E + 2 A): those given, NaN where a slot is new, and
those found; either has no steps where they are not given or not wanted."""

Found = namedtuple("Found", "states inputs slack numbers multipliers")
"""Arrays for the results; the multipliers have no steps where they are not wanted."""

Stop = namedtuple("Stop", "flag")
"""One number; another thread sets it to end the solve."""

KERNEL = Kernels(*range(len(Kernels._fields)))
SIZE = Sizes(*range(len(Sizes._fields)))
SETTING = Settings(*range(len(Settings._fields)))
NUMBER = Numbers(*range(len(Numbers._fields)))
OUTCOME = Outcomes(*range(len(Outcomes._fields)))

WORDS = 4
_PLACES, _VECTOR, _MATRIX, _CUBE = ("i8", 1), ("f8", 1), ("f8", 2), ("f8", 3)
_PLAIN = Plain(kernels=_PLACES, sizes=_PLACES, limits=_MATRIX, settings=_VECTOR)
_SLOTS = SlotArguments(
    kernels=_PLACES, depends=_PLACES, rows=_PLACES, limits=_MATRIX, regularisation=_VECTOR,
    numbers=_CUBE, levels=_MATRIX, active=_VECTOR, drawn=_CUBE, begun=_CUBE, found=_CUBE,
    before=_CUBE, after=_CUBE,
)  # fmt: skip


def width_of(sizes: Any) -> int:
    """Multipliers of one step, all but those of slots.

    Of the lower bounds of (x_{i+1}, u_i), then of the upper ones; of the dynamics; of the
    constraints on (x_i, u_i), and on x_{i+1}; of the slack; of the level's minimum, which all
    steps repeat. They belong to the cost as it is stated, before scaling.
    """
    wide = sizes[SIZE.n] + sizes[SIZE.m]
    rows = sizes[SIZE.input_rows] + sizes[SIZE.node_rows] + sizes[SIZE.final_rows]
    return int(2 * wide + sizes[SIZE.n] + rows + 2)


def layout(kinds: int) -> tuple[Any, ...]:
    """Return the groups of arrays as the core takes them: of each array type and dimensions."""
    head = Head(_MATRIX, _MATRIX, _VECTOR, _MATRIX)
    start = Start(_VECTOR, _MATRIX, _MATRIX, _MATRIX, _CUBE)
    found = Found(_MATRIX, _MATRIX, _VECTOR, _VECTOR, _MATRIX)
    return _PLAIN, head, start, *[_SLOTS] * kinds, found, Stop(_VECTOR)

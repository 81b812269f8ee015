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
    "iterations tolerance barrier push penalty most_penalty gradient minimum guess",
)
"""Limits of iterations and errors; first barrier; distance of the start from its bounds; price of
slack, first and highest; largest gradient after scaling; the level's minimum and guess."""

Numbers = namedtuple("Numbers", "status iterations cost level error penalty")
"""Results of a solve beside its arrays."""

Outcomes = namedtuple("Outcomes", "solved limit infeasible failed stopped")
"""How a solve may end."""

Head = namedtuple("Head", "reference direction speed curve")
"""Parameters of the stage costs, see `ocp.problem.Parameters`."""

Start = namedtuple("Start", "initial states inputs")
"""x_0, guessed states (N + 1, n), guessed inputs (N, m)."""

SlotArguments = namedtuple(
    "SlotArguments",
    "kernels depends rows limits regularisation numbers levels active drawn begun found",
)
"""One kind of slots: addresses in the order of `SlotKernels`; entries of x that matter; (rows of
h, rows of e, whether slots have a level); limits of the own variables (2, A); their
regularisation (1,); parameters (N, K, P); levels (N, K); active (K,); what the regularisation
draws to, the start and the result, each (N, K, A)."""

Found = namedtuple("Found", "states inputs slack numbers")
"""Arrays for the results."""

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
)  # fmt: skip


def layout(kinds: int) -> tuple[Any, ...]:
    """Return the groups of arrays as the core takes them: of each array type and dimensions."""
    head, start = Head(_MATRIX, _MATRIX, _VECTOR, _MATRIX), Start(_VECTOR, _MATRIX, _MATRIX)
    found = Found(_MATRIX, _MATRIX, _VECTOR, _VECTOR)
    return _PLAIN, head, start, *[_SLOTS] * kinds, found, Stop(_VECTOR)

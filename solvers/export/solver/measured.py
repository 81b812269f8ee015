"""How much memory and stack a solve takes: the core itself is run, and what it took is counted.

Its arrays depend on the sizes of a problem alone, and so does its stack. The solve that is
measured has every slot in use.
"""

import ctypes
from dataclasses import dataclass, replace
from threading import Lock

import numpy as np

from ....framework.jit.machine import host, loaded, object_code
from ....framework.mpc.ocp.problem import Parameters, Problem, SlotNumbers
from ....framework.mpc.ocp.transcription import Guess
from ....framework.values.errors import WideberthError
from ...riccati import emit, objects
from ...riccati.compiled import compiled_problem
from ...riccati.solver import Riccati, with_auxiliaries
from ..rendering import rendered

_ALIGN = 16
_STACK = 2**19
_ROOM = 2**28
_PAINT = 165

_NAMES = ("begin", "taken", "take", "give", "measure")
_GUARD = Lock()


@dataclass(frozen=True)
class Needs:
    """What one solve takes.

    Attributes
    ----------
    memory : bytes of the core's arrays, each at a multiple of 16.
    stack : bytes that the core and what it calls were seen to use on this processor.
    """

    memory: int
    stack: int


def needs(problem: Problem, parameters: Parameters, guess: Guess, solver: Riccati) -> Needs:
    """Solve an instance with every slot in use, and count.

    Raises
    ------
    WideberthError : the core cannot be run here.
    """
    full = replace(parameters, slots=tuple(map(_full, parameters.slots)))
    made = compiled_problem(problem)
    kinds = len(made.kinds)
    try:
        code = objects.shipped(kinds)
    except WideberthError:
        code = emit.compiled(kinds, host())
    sizes = {"align": _ALIGN, "room": _ROOM, "stack": _STACK, "paint": _PAINT}
    source = rendered("solver/counting.ll", **sizes)
    place = loaded(object_code(source, host(), optimise=False), _NAMES)
    counted = {"wideberth_take": place["take"], "wideberth_give": place["give"]}
    core = loaded(code, [objects.ENTRY], counted)
    word = ctypes.c_int64
    begin = ctypes.CFUNCTYPE(None, word)(place["begin"])
    taken = ctypes.CFUNCTYPE(word)(place["taken"])
    measure = ctypes.CFUNCTYPE(word, *[ctypes.c_void_p] * 4)(place["measure"])
    used: list[int] = []

    def run(*arguments: int) -> int:
        used.append(measure(core[objects.ENTRY], *arguments))
        return 0

    room = np.empty(_ROOM + _ALIGN, dtype=np.uint8)
    with _GUARD, made.workspace(full) as space:
        begin(-(-room.ctypes.data // _ALIGN) * _ALIGN)
        space.fill(full)
        space.begin(solver.settings_for(problem, guess), with_auxiliaries(full, guess))
        space.run(run)
        memory = int(taken())
    if used[0] < 0:
        raise WideberthError(f"a solve of this problem takes more than {_ROOM} bytes")
    return Needs(memory, used[0])


def _full(numbers: SlotNumbers) -> SlotNumbers:
    """Put every slot to use."""
    return replace(numbers, active=np.ones_like(numbers.active))

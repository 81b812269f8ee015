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

_ALIGN = 16
_STACK = 2**19
_ROOM = 2**28
_PAINT = 165

_SOURCE = f"""
@next = internal global i64 0
@first = internal global i64 0

define void @begin(i64 %place) {{
  store i64 %place, ptr @first
  store i64 %place, ptr @next
  ret void
}}

define i64 @taken() {{
  %first = load i64, ptr @first
  %next = load i64, ptr @next
  %count = sub i64 %next, %first
  ret i64 %count
}}

define ptr @take(i64 %size) {{
  %place = load i64, ptr @next
  %more = add i64 %size, {_ALIGN - 1}
  %whole = and i64 %more, -{_ALIGN}
  %behind = add i64 %place, %whole
  %first = load i64, ptr @first
  %all = sub i64 %behind, %first
  %fits = icmp ule i64 %all, {_ROOM}
  br i1 %fits, label %some, label %none
some:
  store i64 %behind, ptr @next
  %found = inttoptr i64 %place to ptr
  ret ptr %found
none:
  ret ptr null
}}

define void @give(ptr %place) {{
  ret void
}}

define void @paint() noinline optnone "no-stack-arg-probe" {{
entry:
  %room = alloca [{_STACK} x i8], align 16
  br label %next
next:
  %k = phi i64 [ 0, %entry ], [ %more, %next ]
  %at = getelementptr i8, ptr %room, i64 %k
  store volatile i8 {_PAINT}, ptr %at
  %more = add i64 %k, 1
  %last = icmp eq i64 %more, {_STACK}
  br i1 %last, label %done, label %next
done:
  ret void
}}

define i64 @scan() noinline optnone "no-stack-arg-probe" {{
entry:
  %room = alloca [{_STACK} x i8], align 16
  br label %next
next:
  %k = phi i64 [ 0, %entry ], [ %more, %same ]
  %at = getelementptr i8, ptr %room, i64 %k
  %found = load volatile i8, ptr %at
  %painted = icmp eq i8 %found, {_PAINT}
  br i1 %painted, label %same, label %done
same:
  %more = add i64 %k, 1
  %last = icmp eq i64 %more, {_STACK}
  br i1 %last, label %done, label %next
done:
  %touched = phi i64 [ %k, %next ], [ %more, %same ]
  %used = sub i64 {_STACK}, %touched
  ret i64 %used
}}

define i64 @measure(ptr %core, ptr %result, ptr %problem, ptr %table) noinline optnone {{
  call void @paint()
  %status = call i32 %core(ptr %result, ptr %problem, ptr %table)
  %used = call i64 @scan()
  %none = icmp eq i32 %status, 1
  %found = select i1 %none, i64 -1, i64 %used
  ret i64 %found
}}
"""
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
    place = loaded(object_code(_SOURCE, host(), optimise=False), _NAMES)
    core = loaded(code, [objects.ENTRY], {"malloc": place["take"], "free": place["give"]})
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

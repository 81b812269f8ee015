"""CasADi functions without a compiler: programs, and the machine code that runs them.

A program is a row of numbers: what is read, which operations follow, what is given. The shipped
code `RUN` walks through it and does every operation for eight columns at once, so that to decide
what comes next costs little beside doing it. A solve takes one and a half times as long as with
compiled kernels, and the first one needs no second of compiling before.

Each operation stands alone, so that every number is the one that CasADi's virtual machine gives.

``python -m wideberth.framework.jit.interpreter`` makes the shipped code anew.
"""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .columns import SIGNATURE
from .machine import compiler, object_code
from .operations import OPERATIONS, exactly, instructions
from .shipped import PROCESSORS, ShippedCode, library_name, linked
from .transpile import Listing, declarations, listing_of

RUN = "wideberth_interpret"
"""Name of the code; a kernel as `columns` calls it, whose record is a program."""

_HERE = Path(__file__).parent
SHIPPED = ShippedCode(
    _HERE / "objects",
    tuple(_HERE / name for name in ("columns.py", "interpreter.py", "operations.py")),
)

_HEAD = ("run", "backwards", "registers", "constants", "reads", "operations", "results")
"""First words of a program: address of the code, 1 where it goes from the last column to the first
and else 0, number of registers, and lengths of the lists that follow.

Constants fill the first registers. A read is a pair of words, which array (v, p, or the next
column of the result) and which row; reads fill the next registers. An operation is four halves of
words: its place among `OPERATIONS`, the register that it sets, and those of its operands. A
result is a register for each row."""
_V, _P, _NEXT = range(3)
_LANES = 8


def program(function: Any, carried: int | None = None) -> NDArray[np.int64]:
    """Write the program of a CasADi function of two columns.

    Parameters
    ----------
    function : as for `transpile.kernel_source`.
    carried : as for `transpile.recursion_source`; None for a function of each column alone.

    Raises
    ------
    WideberthError : no code is shipped for this processor, the function has another form, or an
        operation has no translation.
    """
    return np.concatenate([[_address()], _words(listing_of(function), carried)])


@cache
def _address() -> int:
    return SHIPPED.loaded([RUN])[RUN]


def _words(listing: Listing, carried: int | None) -> NDArray[np.int64]:
    """Return a program without its first word."""
    names = {*listing.results, *(one for _, taken in listing.operations.values() for one in taken)}
    constants = sorted(one for one in names if one[0] not in "vpx")
    places = {name: k for k, name in enumerate([*constants, *listing.reads])}
    steps = _allocated(listing, places)
    reads = [_source(array, row, carried or 0) for array, row in listing.reads.values()]
    results = [places[name] for name in listing.results]
    registers = 1 + max(places.values(), default=0)
    head = [int(carried is not None), registers, len(constants), len(reads), len(steps)]
    numbers = np.array([float(one) for one in constants]).view(np.int64)
    operations = np.array(steps, dtype=np.int32).reshape(-1).view(np.int64)
    pieces = [[*head, len(results)], numbers, np.reshape(reads, -1), operations, results]
    return np.concatenate([np.asarray(piece, dtype=np.int64) for piece in pieces])


def _source(array: str, row: int, carried: int) -> tuple[int, int]:
    """Where a read comes from."""
    if array == "p":
        return _P, row
    return (_NEXT, row) if row < carried else (_V, row - carried)


def _allocated(listing: Listing, places: dict[str, int]) -> list[tuple[int, int, int, int]]:
    """Give each operation a register, one that nothing reads any more where there is one."""
    last = {name: k for k, (_, taken) in enumerate(listing.operations.values()) for name in taken}
    kept, free, count, steps = set(listing.results), [], len(places), []
    fixed = set(places)
    for k, (name, (operation, taken)) in enumerate(listing.operations.items()):
        operands = [places[one] for one in taken]
        for one in set(taken) - kept - fixed:
            if last[one] == k:
                free.append(places[one])
        if free:
            places[name] = free.pop()
        else:
            places[name], count = count, count + 1
        steps.append((OPERATIONS.index(operation), places[name], operands[0], operands[-1]))
    return steps


def source() -> str:
    """Write the LLVM module of the code that runs programs."""
    text = "\n".join([*_entry(), *_columns(1), *_columns(_LANES)])
    return exactly("\n".join([*declarations(text), "", text, ""]))


_WORK = "ptr %program, i64 %first, i64 %step, i64 %times, ptr noalias %work, "


def _entry() -> Iterator[str]:
    """`RUN`: columns one after the other from the last one, or eight at once and then the rest."""
    given = SIGNATURE.replace("ptr %self", "ptr %program")
    passed = SIGNATURE.replace("ptr %self, ", "")
    yield f"define void @{RUN}({given}) {{"
    yield from _head_words()
    yield f"""%size = mul i64 %registers, {_LANES}
%work = alloca double, i64 %size, align 64
%back = icmp ne i64 %backwards, 0
br i1 %back, label %backward, label %forward
backward:
%last = sub i64 %count, 1
call void @columns1(ptr %program, i64 %last, i64 -1, i64 %count, ptr %work, {passed})
ret void
forward:
%blocks = sdiv i64 %count, {_LANES}
%done = mul i64 %blocks, {_LANES}
%rest = sub i64 %count, %done
call void @columns{_LANES}(ptr %program, i64 0, i64 {_LANES}, i64 %blocks, ptr %work, {passed})
call void @columns1(ptr %program, i64 %done, i64 1, i64 %rest, ptr %work, {passed})
ret void
}}"""


def _head_words() -> Iterator[str]:
    """Read the first words of a program, each under its name in `_HEAD`."""
    for k, name in enumerate(_HEAD):
        yield f"%{name}.at = getelementptr i64, ptr %program, i64 {k}"
        yield f"%{name} = load i64, ptr %{name}.at"


@dataclass(frozen=True)
class _Loop:
    """A loop over ``%NAME`` = 0 .. count - 1 around some lines.

    Attributes
    ----------
    name : of the number.
    count : how often.
    body : lines inside.
    """

    name: str
    count: str
    body: Iterable[str]

    def lines(self) -> Iterator[str]:
        """Write it; ``%NAME.now`` is memory of the function."""
        name = self.name
        yield f"store i64 0, ptr %{name}.now"
        yield f"br label %{name}.head"
        yield f"{name}.head:"
        yield f"%{name} = load i64, ptr %{name}.now"
        yield f"%{name}.more = icmp slt i64 %{name}, {self.count}"
        yield f"br i1 %{name}.more, label %{name}.body, label %{name}.end"
        yield f"{name}.body:"
        yield from self.body
        yield f"%{name}.next = add i64 %{name}, 1"
        yield f"store i64 %{name}.next, ptr %{name}.now"
        yield f"br label %{name}.head"
        yield f"{name}.end:"


def _columns(lanes: int) -> Iterator[str]:
    """Write the function that runs a program for some columns at a time."""
    given = SIGNATURE.replace("ptr %self, ", "").replace("ptr %out", "ptr noalias %out")
    yield f"define internal void @columns{lanes}({_WORK}{given}) {{"
    for loop in ("constant", "turn", "read", "operation", "result"):
        yield f"%{loop}.now = alloca i64"
    yield from _head_words()
    yield f"""%constants.begin = getelementptr i64, ptr %program, i64 {len(_HEAD)}
%reads.begin = getelementptr i64, ptr %constants.begin, i64 %constants
%reads.words = mul i64 %reads, 2
%operations.begin = getelementptr i64, ptr %reads.begin, i64 %reads.words
%operations.words = mul i64 %operations, 2
%results.begin = getelementptr i64, ptr %operations.begin, i64 %operations.words"""
    yield from _Loop("constant", "%constants", _constant(lanes)).lines()
    turn = [
        "%moved = mul i64 %turn, %step",
        "%column = add i64 %first, %moved",
        "%from = add i64 %column, %offset",
        "%behind = add i64 %column, 1",
        *_Loop("read", "%reads", _read(lanes)).lines(),
        *_Loop("operation", "%operations", _operation(lanes)).lines(),
        *_Loop("result", "%results", _result(lanes)).lines(),
    ]
    yield from _Loop("turn", "%times", turn).lines()
    yield "ret void"
    yield "}"


def _register(name: str, index: str, lanes: int) -> list[str]:
    """Define ``%NAME.line``, where a register begins."""
    return [
        f"%{name}.skip = mul i64 {index}, {lanes}",
        f"%{name}.line = getelementptr double, ptr %work, i64 %{name}.skip",
    ]


def _kind(lanes: int) -> str:
    """Type of a register."""
    return "double" if lanes == 1 else f"<{lanes} x double>"


def _constant(lanes: int) -> list[str]:
    lines = [
        "%constant.at = getelementptr double, ptr %constants.begin, i64 %constant",
        "%constant.value = load double, ptr %constant.at",
        *_register("constant", "%constant", lanes),
    ]
    for lane in range(lanes):
        lines += [
            f"%constant.to{lane} = getelementptr double, ptr %constant.line, i64 {lane}",
            f"store double %constant.value, ptr %constant.to{lane}",
        ]
    return lines


def _read(lanes: int) -> list[str]:
    return [
        "%read.twice = mul i64 %read, 2",
        "%read.kind.at = getelementptr i64, ptr %reads.begin, i64 %read.twice",
        "%read.kind = load i64, ptr %read.kind.at",
        "%read.index.at = getelementptr i64, ptr %read.kind.at, i64 1",
        "%read.index = load i64, ptr %read.index.at",
        f"%read.is.v = icmp eq i64 %read.kind, {_V}",
        f"%read.is.p = icmp eq i64 %read.kind, {_P}",
        "%read.other = select i1 %read.is.p, ptr %p, ptr %out",
        "%read.base = select i1 %read.is.v, ptr %v, ptr %read.other",
        "%read.other.wide = select i1 %read.is.p, i64 %p.row, i64 %out.row",
        "%read.wide = select i1 %read.is.v, i64 %v.row, i64 %read.other.wide",
        "%read.other.column = select i1 %read.is.p, i64 %column, i64 %behind",
        "%read.column = select i1 %read.is.v, i64 %from, i64 %read.other.column",
        "%read.bytes = mul i64 %read.index, %read.wide",
        "%read.begin = getelementptr i8, ptr %read.base, i64 %read.bytes",
        "%read.row = getelementptr double, ptr %read.begin, i64 %read.column",
        "%read.place = add i64 %constants, %read",
        *_register("read", "%read.place", lanes),
        f"%read.value = load {_kind(lanes)}, ptr %read.row, align 8",
        f"store {_kind(lanes)} %read.value, ptr %read.line, align 8",
    ]


def _result(lanes: int) -> list[str]:
    return [
        "%result.at = getelementptr i64, ptr %results.begin, i64 %result",
        "%result.place = load i64, ptr %result.at",
        *_register("result", "%result.place", lanes),
        "%result.bytes = mul i64 %result, %out.row",
        "%result.begin = getelementptr i8, ptr %out, i64 %result.bytes",
        "%result.row = getelementptr double, ptr %result.begin, i64 %column",
        f"%result.value = load {_kind(lanes)}, ptr %result.line, align 8",
        f"store {_kind(lanes)} %result.value, ptr %result.row, align 8",
    ]


def _operation(lanes: int) -> Iterator[str]:
    """Do one operation: a branch for each kind."""
    yield "%halves = mul i64 %operation, 4"
    for k, name in enumerate(("kind", "x", "a", "b")):
        yield f"%{name}.place = add i64 %halves, {k}"
        yield f"%{name}.at = getelementptr i32, ptr %operations.begin, i64 %{name}.place"
        yield f"%{name}.half = load i32, ptr %{name}.at"
        if name != "kind":
            yield f"%{name}.index = zext i32 %{name}.half to i64"
            yield from _register(name, f"%{name}.index", lanes)
    cases = " ".join(f"i32 {k}, label %case{k}" for k in range(len(OPERATIONS)))
    yield f"switch i32 %kind.half, label %done [ {cases} ]"
    for k, operation in enumerate(OPERATIONS):
        yield f"case{k}:"
        yield from _case(k, operation, lanes)
        yield "br label %done"
    yield "done:"


def _case(k: int, operation: int, lanes: int) -> Iterator[str]:
    """One operation: all lanes are read, then done, then written, so that vectors can do them."""
    names = [f"{k}.{lane}" for lane in range(lanes)]
    for lane, name in enumerate(names):
        for operand, register in (("v", "a"), ("p", "b")):
            yield f"%{operand}.{name}.at = getelementptr double, ptr %{register}.line, i64 {lane}"
            yield f"%{operand}.{name} = load double, ptr %{operand}.{name}.at"
    for name in names:
        yield from instructions(operation, f"x.{name}", [f"v.{name}", f"p.{name}"])
    for lane, name in enumerate(names):
        yield f"%x.{name}.to = getelementptr double, ptr %x.line, i64 {lane}"
        yield f"store double %x.{name}, ptr %x.{name}.to"


def emitted() -> Mapping[str, bytes]:
    """Compile the code for each processor, as shared libraries by their file names.

    Raises
    ------
    WideberthError : llvmlite or the linker is missing.
    """
    return {
        library_name(name): linked([object_code(source(), one.target, straight=True)])
        for name, one in PROCESSORS.items()
    }


if __name__ == "__main__":
    SHIPPED.write(emitted(), compiler())

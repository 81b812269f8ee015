"""Programs: lists of operations as numbers, which evaluator.h runs."""

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from ..values.arrays import address
from .listing import Listing, is_name, listing_of
from .operations import OPERATIONS

MAGIC = 0x7762303100000001
"""First word of a program; evaluator.h describes the layout."""
_WORDS_OF_STEP = 6


@dataclass(frozen=True)
class _Step:
    """One operation: its name, the names that it sets, and the names that it works on."""

    name: str
    sets: tuple[str, ...]
    operands: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class Program:
    """A function of two columns as a program.

    Attributes
    ----------
    words : what evaluator.h runs.
    results : rows of the result.
    """

    words: NDArray[np.int64]
    results: int

    @classmethod
    def of(cls, function: Any, fused: bool = False) -> Self:
        """Write the program of a CasADi function.

        Parameters
        ----------
        function : see `listing_of`.
        fused : whether operations are joined: a product with a sum, a sine with the cosine of the
            same number, and so on. Results may then differ from CasADi's by rounding.

        Raises
        ------
        WideberthError : a function of another form, or with an operation that programs lack.
        """
        listing = listing_of(function)
        steps = _plain(listing)
        if fused:
            steps = _with_sincos(_joined(steps, listing.results))
        return cls(_words(listing, steps), len(listing.results))

    @property
    def address(self) -> int:
        """Address of the words, which stay in memory as long as this object."""
        return address(self.words)

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), (self.words, self.results)


def _plain(listing: Listing) -> list[_Step]:
    return [
        _Step(operation.name, (name,), operands)
        for name, (operation, operands) in listing.operations.items()
    ]


_FUSED: Mapping[tuple[str, int, str], str] = {
    ("ADD", 0, "MUL"): "MULADD", ("ADD", 1, "MUL"): "MULADD",
    ("SUB", 0, "MUL"): "MULSUB", ("SUB", 1, "MUL"): "NEGMULADD",
    ("MULADD", 2, "MUL"): "MULADDMUL", ("MULSUB", 2, "MUL"): "NEGMULADDMUL",
    ("ADD", 0, "ADD"): "ADDADD", ("ADD", 1, "ADD"): "ADDADD",
    ("MUL", 0, "MUL"): "MULMUL", ("MUL", 1, "MUL"): "MULMUL",
    ("MUL", 0, "TWICE"): "MULTWICE", ("MUL", 1, "TWICE"): "MULTWICE",
    ("MUL", 0, "ADD"): "ADDMUL", ("MUL", 1, "ADD"): "ADDMUL",
    ("MUL", 0, "SUB"): "SUBMUL", ("MUL", 1, "SUB"): "SUBMUL",
    ("DIV", 0, "MUL"): "MULDIV", ("MUL", 0, "DIV"): "DIVMUL", ("MUL", 1, "DIV"): "DIVMUL",
}  # fmt: skip
"""(Operation, one of its operands, operation that gives that operand) -> the two as one operation.
Its operands are those of the inner operation, then the others of the outer one."""


def _joined(steps: list[_Step], results: Iterable[str]) -> list[_Step]:
    """Join operations whose result is used once with the operation that uses it."""
    steps = [
        _Step("MUL", step.sets, step.operands * 2) if step.name == "SQ" else step for step in steps
    ]
    uses = Counter(results)
    for step in steps:
        uses.update(step.operands)
    by_result: dict[str, _Step] = {}
    for step in steps:
        place = 0
        while place < len(step.operands):
            operand = step.operands[place]
            inner = by_result.get(operand)
            name = _FUSED.get((step.name, place, inner.name)) if inner else None
            if inner and name and uses[operand] == 1:
                del by_result[operand]
                others = step.operands[:place] + step.operands[place + 1 :]
                step, place = _Step(name, step.sets, inner.operands + others), -1
            place += 1
        by_result[step.sets[0]] = step
    return list(by_result.values())


def _with_sincos(steps: list[_Step]) -> list[_Step]:
    """Join each sine and cosine of the same number, in the place of the first of them."""
    results = {(step.name, step.operands): step.sets[0] for step in steps}
    joined = []
    for step in steps:
        sine, cosine = (results.get((name, step.operands)) for name in ("SIN", "COS"))
        if step.name not in ("SIN", "COS") or sine is None or cosine is None:
            joined.append(step)
        elif _Step("SINCOS", (sine, cosine), step.operands) not in joined:
            joined.append(_Step("SINCOS", (sine, cosine), step.operands))
    return joined


def _words(listing: Listing, steps: list[_Step]) -> NDArray[np.int64]:
    names = {*listing.results, *(name for step in steps for name in step.operands)}
    constants = sorted(name for name in names if not is_name(name))
    fixed = {name: k for k, name in enumerate([*constants, *listing.reads])}
    places, registers = _allocated(listing, steps, fixed)

    def numbers(names: Iterable[str]) -> Iterator[int]:
        return (registers - 1 - k if k < 0 else k for k in (places[name] for name in names))

    table = np.zeros((len(steps), _WORDS_OF_STEP), dtype=np.int32)
    for row, step in zip(table, steps, strict=True):
        first, *second = numbers(step.sets)
        operands = [*numbers(step.operands), *second]
        operands += [operands[0]] * (4 - len(operands))
        row[:] = [OPERATIONS[step.name].code, first, *operands]
    arrays = {"v": 0, "p": 1}
    reads = [(arrays[array], row) for array, row in listing.reads.values()]
    lengths = [len(constants), len(reads), len(steps), registers, len(listing.results)]
    pieces = [
        np.array([MAGIC, *listing.rows, *lengths]),
        np.array([float(name) for name in constants], dtype=np.float64).view(np.int64),
        np.array(reads, dtype=np.int64).reshape(-1),
        table.reshape(-1).view(np.int64),
        # an operation writes the first row that it is; the evaluator copies the other ones
        np.array([*numbers(listing.results)], dtype=np.int64),
    ]
    return np.concatenate(pieces).astype(np.int64)


def _allocated(
    listing: Listing, steps: list[_Step], fixed: dict[str, int]
) -> tuple[dict[str, int], int]:
    """Give each name a register, and return how many there are; -1 - k is row k of the result.

    A register that nothing reads any more is taken again, so that they stay in the cache.
    """
    places = dict(fixed)
    for k, name in enumerate(listing.results):
        if name not in fixed:
            places.setdefault(name, -1 - k)
    last = {name: k for k, step in enumerate(steps) for name in step.operands}
    count, free = len(fixed), list[int]()
    for k, step in enumerate(steps):
        for name in set(step.operands):
            if last[name] == k and name not in fixed and places[name] >= 0:
                free.append(places[name])
        for name in step.sets:
            if name not in places:
                if not free:
                    free, count = [count], count + 1
                places[name] = free.pop()
    return places, count

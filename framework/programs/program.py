"""Programs: lists of operations as numbers, which evaluator.h runs."""

from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from .listing import Listing, is_name, listing_of
from .operations import BY_NAME, SINCOS

MAGIC = 0x7762303100000001
"""First word of a program; evaluator.h describes the layout."""
_WORDS_OF_STEP = 6


@dataclass(frozen=True)
class _Step:
    """One operation: its code, the names that it sets, and the names that it works on."""

    code: int
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
        fused : whether a product and a sum become one operation, and a sine and a cosine of the
            same number. Such numbers may differ from CasADi's by rounding.

        Raises
        ------
        WideberthError : a function of another form, or with an operation that programs lack.
        """
        listing = listing_of(function)
        steps = _plain(listing)
        if fused:
            steps = _with_sincos(_with_products(steps, listing.results))
        return cls(_words(listing, steps), len(listing.results))

    @property
    def address(self) -> int:
        """Address of the words, which stay in memory as long as this object."""
        address: int = self.words.__array_interface__["data"][0]
        return address

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), (self.words, self.results)


def _plain(listing: Listing) -> list[_Step]:
    return [
        _Step(operation.code, (name,), operands)
        for name, (operation, operands) in listing.operations.items()
    ]


def _with_products(steps: list[_Step], results: Iterable[str]) -> list[_Step]:
    """Join each product that is used once, by a sum, with that sum."""
    uses = Counter(results)
    for step in steps:
        uses.update(step.operands)
    multiply, square = BY_NAME["MUL"].code, BY_NAME["SQ"].code
    products = {
        step.sets[0]: (step.operands * 2)[:2]
        for step in steps
        if step.code in (multiply, square) and uses[step.sets[0]] == 1
    }
    joined: set[str] = set()
    fused = []
    for step in steps:
        for name, left, right in (("ADD", 0, 1), ("ADD", 1, 0), ("SUB", 0, 1), ("SUB", 1, 0)):
            if step.code == BY_NAME[name].code and step.operands[left] in products:
                joined.add(step.operands[left])
                word = "MULADD" if name == "ADD" else "NEGMULADD" if left else "MULSUB"
                operands = (*products[step.operands[left]], step.operands[right])
                step = _Step(BY_NAME[word].code, step.sets, operands)
        fused.append(step)
    return [step for step in fused if step.sets[0] not in joined]


def _with_sincos(steps: list[_Step]) -> list[_Step]:
    """Join each sine and cosine of the same number, in the place of the first of them."""
    sine, cosine = BY_NAME["SIN"].code, BY_NAME["COS"].code
    of = {(step.code, step.operands): step.sets[0] for step in steps}
    joined = []
    done: set[str] = set()
    for step in steps:
        sets = tuple(of.get((code, step.operands), "") for code in (sine, cosine))
        if step.code not in (sine, cosine) or not all(sets):
            joined.append(step)
        elif sets[0] not in done:
            done.add(sets[0])
            joined.append(_Step(SINCOS.code, sets, step.operands))
    return joined


def _words(listing: Listing, steps: list[_Step]) -> NDArray[np.int64]:
    names = {*listing.results, *(name for step in steps for name in step.operands)}
    constants = sorted(name for name in names if not is_name(name))
    fixed = {name: k for k, name in enumerate([*constants, *listing.reads])}
    places, registers = _allocated(listing, steps, fixed)
    # an operation writes the first row that it is; the evaluator copies the other ones
    results = [registers - 1 - k if k < 0 else k for k in (places[n] for n in listing.results)]

    def numbers(names: Iterable[str]) -> Iterator[int]:
        return (registers - 1 - k if k < 0 else k for k in (places[name] for name in names))

    table = np.zeros((len(steps), _WORDS_OF_STEP), dtype=np.int32)
    for row, step in zip(table, steps, strict=True):
        sets, operands = [*numbers(step.sets)], [*numbers(step.operands)]
        operands += [operands[0]] * (3 - len(operands))
        row[:] = [step.code, sets[0], *operands, sets[-1]]
    arrays = {"v": 0, "p": 1}
    reads = [(arrays[array], row) for array, row in listing.reads.values()]
    lengths = [len(constants), len(reads), len(steps), registers, len(listing.results)]
    pieces = [
        np.array([MAGIC, *listing.rows, *lengths]),
        np.array([float(name) for name in constants], dtype=np.float64).view(np.int64),
        np.array(reads, dtype=np.int64).reshape(-1),
        table.reshape(-1).view(np.int64),
        np.array(results, dtype=np.int64),
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

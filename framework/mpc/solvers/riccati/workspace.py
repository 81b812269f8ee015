"""The arrays of one solve, at addresses that do not change.

To take the address of an array costs more than to copy it, as long as it is small. So the core
works on arrays of its own, made once for each size of problem: a solve copies its numbers into
them, hands the core their table, and copies the results out of them.
"""

from collections.abc import Callable, Iterable, Sequence
from typing import Any

import numpy as np

from ....values.arrays import Array
from ...ocp.problem import Parameters, SlotNumbers
from ...ocp.transcription import Guess
from ._protocol import (
    SIZE,
    WORDS,
    Found,
    Head,
    Numbers,
    Plain,
    Settings,
    SlotArguments,
    Start,
    Stop,
)

Entry = Callable[[int, int, int], int]
"""The compiled core; it takes places for a result and an exception, not used, and its table."""


def shape_of(parameters: Parameters) -> tuple[Any, ...]:
    """Sizes on which the arrays of a compiled problem depend."""
    slots = [(one.parameters.shape, one.level is None) for one in parameters.slots]
    return parameters.reference.shape, parameters.curve.shape, *slots


class Workspace:
    """Arrays of one size, with their table; for one solve at a time.

    Parameters
    ----------
    plain : arrays of a compiled problem, all but the settings.
    kinds : the first arrays of each kind of slots, those that do not change either.
    parameters : of an instance; their numbers are not used.

    Attributes
    ----------
    groups : arrays as `_protocol.layout` names them.
    found : results of a solve.
    own : of the slots' own variables, of each kind of the problem.
    """

    def __init__(
        self,
        plain: Sequence[Any],
        kinds: Sequence[Sequence[Any]],
        parameters: Parameters,
    ) -> None:
        steps, slots = len(parameters.speed), len(parameters.slots)
        first = Plain._make([*plain, np.zeros(len(Settings._fields))])
        n, m = int(first.sizes[SIZE.n]), int(first.sizes[SIZE.m])
        head = Head(*map(_like, _head(parameters)))
        start = Start(np.zeros(n), np.zeros((steps + 1, n)), np.zeros((steps, m)))
        self.found: Any = Found(
            np.zeros((steps + 1, n)), np.zeros((steps, m)), np.zeros(steps),
            np.zeros(len(Numbers._fields)),
        )  # fmt: skip
        given = [*parameters.slots, *[SlotNumbers.none(steps)] * (len(kinds) - slots)]
        made = [
            SlotArguments(*kind, *_of_slots(one)) for kind, one in zip(kinds, given, strict=True)
        ]
        self._stop = Stop(np.zeros(1))
        self.groups: tuple[Any, ...] = (first, head, start, *made, self.found, self._stop)
        self.own: Sequence[Array] = [kind.found for kind in made[:slots]]
        self._filled: list[Array] = [first.settings, *head, *start]
        for kind, one in zip(made, parameters.slots, strict=False):
            self._filled += [kind.numbers, kind.active, kind.drawn, kind.begun, kind.found]
            self._filled += [] if one.level is None else [kind.levels]
        self._table = np.array([word for one in self._arrays() for word in _row(one)])
        self._scratch = np.zeros(2, dtype=np.int64)
        place = self._scratch.ctypes.data
        self._arguments = place, place + 8, self._table.ctypes.data

    def _arrays(self) -> Iterable[Any]:
        return (array for group in self.groups for array in group)

    def fill(self, settings: Array, parameters: Parameters, guess: Guess) -> None:
        """Copy the numbers of an instance; the results of empty slots are those of the guess."""
        values = [settings, *_head(parameters), parameters.initial, guess.states, guess.inputs]
        for one, begun in zip(parameters.slots, guess.auxiliaries, strict=True):
            values += [one.parameters, one.active, one.auxiliaries, begun, begun]
            if one.level is not None:
                values.append(one.level)
        for array, value in zip(self._filled, values, strict=True):
            array[...] = value

    def run(self, entry: Entry, stop: Array | None = None) -> None:
        """Solve what the arrays hold; ``stop`` is a number that another thread may set.

        Raises
        ------
        MemoryError : there is not enough for the core's own arrays.
        """
        self._table[-WORDS] = (self._stop.flag if stop is None else stop).ctypes.data
        if entry(*self._arguments) == 1:  # a status of Numba's: an exception was raised
            raise MemoryError("there is not enough memory for a solve by riccati")


def _head(parameters: Parameters) -> tuple[Array, Array, Array, Array]:
    return parameters.reference, parameters.direction, parameters.speed, parameters.curve


def _of_slots(given: SlotNumbers) -> tuple[Array, ...]:
    """Arrays for the numbers of one kind of slots."""
    level = np.zeros((0, 0)) if given.level is None else _like(given.level)
    own = given.auxiliaries
    return _like(given.parameters), level, _like(given.active), _like(own), _like(own), _like(own)


def _like(array: Array) -> Array:
    return np.zeros(array.shape)


def _row(array: Array) -> list[int]:
    """Words of the table that describe an array."""
    return [array.ctypes.data, *array.shape, *[0] * (WORDS - 1 - array.ndim)]

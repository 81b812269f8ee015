"""The arrays of one solve, at addresses that do not change.

To take the address of an array costs more than to copy it, as long as it is small. So the core
works on arrays of its own, made once for each size of problem: a solve copies its numbers into
them, hands the core their table, and copies the results out of them.
"""

import ctypes
from collections.abc import Callable, Iterable, Sequence
from functools import cache
from math import isfinite
from pathlib import Path
from typing import Any

import numpy as np

from ...framework.jit.machine import host, loaded, object_code
from ...framework.mpc.ocp.problem import Parameters, SlotNumbers
from ...framework.mpc.ocp.transcription import Guess, Multipliers
from ...framework.values.arrays import Array
from ...framework.values.errors import WideberthError
from . import objects
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
    width_of,
)

MOST_PLANS = 8
"""Plans from other starts that a solve is compared with."""

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
    after : multipliers of the slots, of each kind; NaN in empty ones.
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
        of_steps = steps, width_of(first.sizes)
        start = Start(
            np.zeros(n), np.zeros((steps + 1, n)), np.zeros((steps, m)), np.zeros(of_steps),
            np.zeros((MOST_PLANS, steps + 1, n)),
        )  # fmt: skip
        self.found: Any = Found(
            np.zeros((steps + 1, n)), np.zeros((steps, m)), np.zeros(steps),
            np.zeros(len(Numbers._fields)), np.zeros(of_steps),
        )  # fmt: skip
        given = [*parameters.slots, *[SlotNumbers.none(steps)] * (len(kinds) - slots)]
        made = [
            SlotArguments(*kind, *_of_slots(one, kind[2]))
            for kind, one in zip(kinds, given, strict=True)
        ]
        self._stop = Stop(np.zeros(1))
        self.groups: tuple[Any, ...] = (first, head, start, *made, self.found, self._stop)
        self.own: Sequence[Array] = [kind.found for kind in made[:slots]]
        self.after: Sequence[Array] = [kind.after for kind in made[:slots]]
        self._before = [start.multipliers, *(kind.before for kind in made[:slots])]
        self._shapes = [one.shape for one in self._before]
        self._loose = any(
            one.auxiliaries.size and np.isinf(kind[3]).any()
            for kind, one in zip(kinds, given, strict=True)
        )
        self._plans: Array = start.plans
        self._given: list[Array] = [*head, start.initial]
        self._guessed: list[Array] = [first.settings, start.states, start.inputs]
        for kind, one in zip(made, parameters.slots, strict=False):
            self._given += [kind.numbers, kind.active, kind.drawn]
            self._given += [] if one.level is None else [kind.levels]
            self._guessed += [kind.begun, kind.found]
        self._table = np.array([word for one in self._arrays() for word in _row(one)])
        self._flag = int(self._table[-WORDS])
        self._scratch = np.zeros(2, dtype=np.int64)
        place = self._scratch.ctypes.data
        self._arguments = place, place + 8, self._table.ctypes.data

    def _arrays(self) -> Iterable[Any]:
        return (array for group in self.groups for array in group)

    @property
    def ended(self) -> Any:
        """How the last solve ended, `_protocol.Numbers`."""
        return Numbers(*self.found.numbers.tolist())

    def fill(self, parameters: Parameters) -> None:
        """Copy the numbers of an instance."""
        values = [*_head(parameters), parameters.initial]
        for one in parameters.slots:
            values += [one.parameters, one.active, one.auxiliaries]
            if one.level is not None:
                values.append(one.level)
        for array, value in zip(self._given, values, strict=True):
            array[...] = value

    def begin(self, settings: Array, guess: Guess) -> None:
        """Copy a guess; the results of empty slots are those of the guess."""
        values = [settings, guess.states, guess.inputs]
        for begun in guess.auxiliaries:
            values += [begun, begun]
        for array, value in zip(self._guessed, values, strict=True):
            array[...] = value

    def note(self, plan: Guess, count: int) -> int:
        """Copy a plan that is known from another start behind ``count`` others, if it fits.

        Returns how many there are now.
        """
        if count == MOST_PLANS:
            return count
        self._plans[count] = plan.states
        return count + 1

    def take(self, multipliers: Multipliers) -> bool:
        """Copy multipliers, if they are numbers and of a problem of this size; say whether.

        None are taken where own variables of slots in use have no bounds, as the angle of
        `SeparatingLine`: from its multipliers a solve needs twice the iterations in the mean.
        """
        given = multipliers.steps, *multipliers.slots
        if self._loose or [one.shape for one in given] != self._shapes:
            return False
        if not isfinite(multipliers.steps.sum()):
            return False
        for array, value in zip(self._before, given, strict=True):
            array[...] = value
        return True

    def run(self, entry: Entry, stop: Array | None = None) -> None:
        """Solve what the arrays hold; ``stop`` is a number that another thread may set.

        Raises
        ------
        MemoryError : there is not enough for the core's own arrays.
        """
        self._table[-WORDS] = self._flag if stop is None else stop.ctypes.data
        _check(entry(*self._arguments))

    @property
    def table(self) -> int:
        """Address of the arrays' table, for a solve that nothing stops."""
        self._table[-WORDS] = self._flag
        return self._arguments[-1]


def run_all(entry: Any, spaces: Sequence[Workspace]) -> None:
    """Solve what several workspaces hold, one after the other, in one call out of Python.

    Between the solves the thread does not wait for Python's lock, so that threads do not hold up
    each other.

    Raises
    ------
    MemoryError : there is not enough for the core's own arrays.
    """
    tables, scratch = np.array([space.table for space in spaces]), np.zeros(2, dtype=np.int64)
    _check(_row_of_calls()(entry, scratch.ctypes.data, tables.ctypes.data, len(tables)))


def _check(status: int) -> None:
    if status == 1:  # of Numba's: an exception was raised
        raise MemoryError("there is not enough memory for a solve by riccati")


@cache
def _row_of_calls() -> Any:
    """Return native code that calls an entry for a row of tables, until a status is not 0."""
    try:
        place = objects.library(objects.KINDS)[objects.ROW]
    except WideberthError:
        source = Path(__file__).with_name("row_of_calls.ll").read_text(encoding="utf-8")
        place = loaded(object_code(source, host()), [objects.ROW])[objects.ROW]
    words = [ctypes.c_void_p] * 3
    return ctypes.CFUNCTYPE(ctypes.c_int, *words, ctypes.c_int64)(place)


def _head(parameters: Parameters) -> tuple[Array, Array, Array, Array]:
    return parameters.reference, parameters.direction, parameters.speed, parameters.curve


def _of_slots(given: SlotNumbers, rows: Any) -> tuple[Array, ...]:
    """Arrays for the numbers of one kind of slots; ``rows`` as in `_protocol.SlotArguments`."""
    level = np.zeros((0, 0)) if given.level is None else _like(given.level)
    own = given.auxiliaries
    known = np.full((*own.shape[:2], int(rows[0] + rows[1]) + 2 * own.shape[2]), np.nan)
    plain = _like(given.parameters), level, _like(given.active), _like(own), _like(own), _like(own)
    return *plain, known, known.copy()


def _like(array: Array) -> Array:
    return np.zeros(array.shape)


def _row(array: Array) -> list[int]:
    """Words of the table that describe an array."""
    return [array.ctypes.data, *array.shape, *[0] * (WORDS - 1 - array.ndim)]

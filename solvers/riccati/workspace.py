"""The arrays of one solve, at addresses that do not change.

To take the address of an array costs more than to copy it, as long as it is small. So the core
works on arrays of its own, made once for each size of problem: a solve copies its numbers into
them, hands the core their addresses, and copies the results out of them.

The structures have the names and the order of those in ``core/riccati.h``.
"""

import ctypes
from collections.abc import Sequence
from math import isfinite
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...framework.mpc.ocp.problem import Parameters, SlotNumbers
from ...framework.mpc.ocp.transcription import Guess, Multipliers
from ...framework.values.arrays import Array, address

MOST_PLANS = 8
"""Plans from other starts that a solve is compared with."""

_WORD, _NUMBER, _PLACE = ctypes.c_int64, ctypes.c_double, ctypes.c_void_p


def _fields(kind: Any, names: str) -> list[tuple[str, Any]]:
    return [(name, kind) for name in names.split()]


class KernelTable(ctypes.Structure):
    """A stage function: its address, and that of its program."""

    _fields_ = _fields(_PLACE, "run program")


class KindTable(ctypes.Structure):
    """One kind of slots."""

    _fields_ = [
        *_fields(KernelTable, "derivatives values"),
        *_fields(_WORD, "slots parameters levelled entries inequalities equalities own"),
        *_fields(_PLACE, "depends lower upper"),
        ("regularisation", _NUMBER),
    ]


class ProblemTable(ctypes.Structure):
    """Functions and sizes of a problem."""

    _fields_ = [
        *_fields(KernelTable, "drive node node_values level"),
        *_fields(_WORD, "n m steps shared input_rows node_rows final_rows head work kinds"),
        *_fields(_PLACE, "lower upper kind"),
    ]


class SettingsTable(ctypes.Structure):
    """Settings of a solve."""

    _fields_ = _fields(
        _NUMBER,
        "iterations tolerance barrier test push penalty most_penalty gradient minimum guess warm "
        "plans best within",
    )

    def copy(self) -> "SettingsTable":
        """Return a copy."""
        return SettingsTable.from_buffer_copy(self)


class SlotsTable(ctypes.Structure):
    """Numbers of the slots of one kind."""

    _fields_ = _fields(_PLACE, "parameters level active drawn begun before found after")


class StartTable(ctypes.Structure):
    """Numbers, guess and multipliers from which a solve starts."""

    _fields_ = _fields(_PLACE, "head initial states inputs multipliers plans slots")


class ResultTable(ctypes.Structure):
    """Results of a solve."""

    _fields_ = [
        *_fields(_PLACE, "states inputs slack multipliers"),
        *_fields(_WORD, "status iterations"),
        *_fields(_NUMBER, "cost level error penalty"),
    ]


class TaskTable(ctypes.Structure):
    """The arguments of a solve."""

    _fields_ = _fields(_PLACE, "problem settings start result stop memory")


def shape_of(parameters: Parameters) -> tuple[Any, ...]:
    """Sizes on which the arrays of a problem depend."""
    slots = [(one.parameters.shape, one.level is None) for one in parameters.slots]
    return parameters.reference.shape, parameters.curve.shape, *slots


def width_of(problem: ProblemTable) -> int:
    """Multipliers of one step, all but those of slots, see ``wb_start``."""
    rows = problem.input_rows + problem.node_rows + problem.final_rows
    return int(2 * (problem.n + problem.m) + problem.n + rows + 2)


class _SlotArrays:
    """Arrays for the numbers of one kind of slots."""

    def __init__(self, kind: KindTable, given: SlotNumbers) -> None:
        multipliers = kind.inequalities + kind.equalities + 2 * kind.own
        self.numbers, self.active = _like(given.parameters), _like(given.active)
        self.level = np.zeros((0, 0)) if given.level is None else _like(given.level)
        own = given.auxiliaries
        self.drawn, self.begun, self.found = _like(own), _like(own), _like(own)
        self.before = np.full((*own.shape[:2], multipliers), np.nan)
        self.after = self.before.copy()
        arrays = (
            self.numbers, self.level, self.active, self.drawn, self.begun, self.before,
            self.found, self.after,
        )  # fmt: skip
        self.table = SlotsTable(*map(address, arrays))


class Workspace:
    """Arrays of one size, with their tables; for one solve at a time.

    Parameters
    ----------
    problem, kinds : as the core takes them, without the horizon and how many slots there are.
    parameters : of an instance; their numbers are not used.

    Attributes
    ----------
    states, inputs, slack, multipliers : results of a solve.
    ended : how the last solve ended.
    own : of the slots' own variables, of each kind.
    after : multipliers of the slots, of each kind; NaN in empty ones.
    problem, kinds : as the core takes them.
    memory : in which a solve works.
    """

    def __init__(
        self, problem: ProblemTable, kinds: Sequence[KindTable], parameters: Parameters
    ) -> None:
        from . import _core

        steps, n, m = len(parameters.speed), problem.n, problem.m
        width = width_of(problem)
        slots = [_SlotArrays(kind, one) for kind, one in zip(kinds, parameters.slots, strict=True)]
        self._head = np.zeros((steps, problem.head))
        self._initial = np.zeros(n)
        self._states, self._inputs = np.zeros((steps + 1, n)), np.zeros((steps, m))
        self._multipliers = np.zeros((steps, width))
        self._plans = np.zeros((MOST_PLANS, steps + 1, n))
        self.states: Array = np.zeros((steps + 1, n))
        self.inputs: Array = np.zeros((steps, m))
        self.slack: Array = np.zeros(steps)
        self.multipliers: Array = np.zeros((steps, width))
        self.own: Sequence[Array] = [one.found for one in slots]
        self.after: Sequence[Array] = [one.after for one in slots]
        self._slots = slots
        self._before = [self._multipliers, *(one.before for one in slots)]
        self._shapes = [one.shape for one in self._before]
        self._loose = any(
            kind.own and one.drawn.size and _has_loose(kind)
            for kind, one in zip(kinds, slots, strict=True)
        )
        self._fill_tables(problem, kinds, parameters)
        self.memory: Array = np.empty(_core.size(ctypes.addressof(self.problem)))
        self._task.memory = address(self.memory)
        self._solve = _core.solve

    def _fill_tables(
        self, problem: ProblemTable, kinds: Sequence[KindTable], parameters: Parameters
    ) -> None:
        count = len(kinds)
        self.kinds: ctypes.Array[KindTable] = (KindTable * count)(*kinds)
        for kind, one in zip(self.kinds, parameters.slots, strict=True):
            _, kind.slots, kind.parameters = one.parameters.shape
        self.problem: ProblemTable = ProblemTable.from_buffer_copy(problem)
        self.problem.steps, self.problem.kinds = len(parameters.speed), count
        self.problem.kind = ctypes.addressof(self.kinds)
        self._tables = (SlotsTable * count)(*(one.table for one in self._slots))
        start = (
            self._head, self._initial, self._states, self._inputs, self._multipliers, self._plans,
        )  # fmt: skip
        self._start = StartTable(*map(address, start), ctypes.addressof(self._tables))
        results = self.states, self.inputs, self.slack, self.multipliers
        self.ended: ResultTable = ResultTable(*map(address, results))
        self._settings = SettingsTable()
        tables = self.problem, self._settings, self._start, self.ended
        self._task = TaskTable(*map(ctypes.addressof, tables))
        self._row = np.array([ctypes.addressof(self._task)], dtype=np.int64)
        self._place = address(self._row)

    def fill(self, parameters: Parameters) -> None:
        """Copy the numbers of an instance."""
        self._head[...] = parameters.heads()
        self._initial[...] = parameters.initial
        for slots, one in zip(self._slots, parameters.slots, strict=True):
            slots.numbers[...], slots.active[...] = one.parameters, one.active
            slots.drawn[...] = one.auxiliaries
            if one.level is not None:
                slots.level[...] = one.level

    def begin(self, settings: SettingsTable, guess: Guess) -> None:
        """Copy a guess; the results of empty slots are those of the guess."""
        self._settings = settings
        self._task.settings = ctypes.addressof(settings)
        self._states[...], self._inputs[...] = guess.states, guess.inputs
        for slots, begun in zip(self._slots, guess.auxiliaries, strict=False):
            slots.begun[...] = slots.found[...] = begun

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

    def run(self, stop: NDArray[np.int64] | None = None) -> None:
        """Solve what the arrays hold; ``stop`` is a number that another thread may set to 1."""
        self._task.stop = None if stop is None else address(stop)
        self._solve(self._place, 1)

    @property
    def task(self) -> int:
        """Address of what a solve takes that nothing stops."""
        self._task.stop = None
        return int(self._row[0])


def run_all(spaces: Sequence[Workspace]) -> None:
    """Solve what several workspaces hold, one after the other, in one call out of Python.

    Between the solves the thread does not wait for Python's lock, so that threads do not hold up
    each other.
    """
    from . import _core

    tasks = np.array([space.task for space in spaces], dtype=np.int64)
    _core.solve(address(tasks), len(tasks))


def _has_loose(kind: KindTable) -> bool:
    """Whether an own variable lacks a bound."""
    limits = (ctypes.c_double * kind.own).from_address
    return not np.isfinite([*limits(kind.lower), *limits(kind.upper)]).all()


def _like(array: Array) -> Array:
    return np.zeros(array.shape)

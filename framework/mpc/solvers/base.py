"""The Solver interface, and what the solvers behind `casadi.nlpsol` share."""

from abc import ABC, abstractmethod
from collections import OrderedDict
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from time import perf_counter
from typing import Any, cast

import numpy as np

from ...arrays import Array
from ...plan import Status
from ...symbolic import ca
from ..problem import Parameters, Problem
from ..transcription import Guess, Transcription


@dataclass(frozen=True, eq=False)
class Solution:
    """What a solver returns for one starting point.

    Attributes
    ----------
    point : the last iterate, whatever the status.
    status : how the solver ended.
    message : the solver's own word for it.
    cost : objective at the point.
    iterations : of the solver.
    seconds : wall time of this solve, parameter packing included.
    """

    point: Guess
    status: Status
    message: str
    cost: float
    iterations: int
    seconds: float


class Solver(ABC):
    """Solves a problem from several starting points.

    A solver never raises for what a problem holds: failure is the status of the solution. It
    takes every guess through `unwrapped` first.
    The same problem, parameters and guesses give the same solution unless a deadline cuts
    it short.
    """

    @abstractmethod
    def solve(
        self,
        problem: Problem,
        parameters: Parameters,
        guesses: Sequence[Guess],
        deadline: float | None = None,
    ) -> list[Solution]:
        """Solve from each guess; ``deadline`` in s caps each single solve."""


def unwrapped(problem: Problem, parameters: Parameters, guess: Guess) -> Guess:
    """Turn a guess by whole turns, so that its first heading is nearest that of x_0.

    A heading that is off by 2 pi is the same heading, and no solver finds its way back from
    there. Every solver passes its guesses through this door.
    """
    where = problem.heading
    if where is None:
        return guess
    turns = (guess.states[0, where] - parameters.initial[where]) / (2.0 * np.pi)
    turns = np.round(turns * (1.0 - 1e-9))  # half a turn off stays as it is
    if turns == 0.0 or not np.isfinite(turns):
        return guess
    states = guess.states.copy()
    states[:, where] -= 2.0 * np.pi * turns
    return replace(guess, states=states)


class Compiled:
    """A transcribed problem with the CasADi solver made for it.

    A solver keeps its memory from call to call. fatrop's is spoilt by a solve that fails: a
    later one, which a fresh solver does in 77 iterations, then never returned. So a call
    goes through a buffer, which has a memory of its own, and after a solve that did not
    succeed the next one gets another buffer. Results therefore do not depend on what was
    solved before.

    Parameters
    ----------
    form : the transcribed problem.
    make : makes the CasADi function.
    """

    def __init__(self, form: Transcription, make: Callable[[], Any]) -> None:
        self.form, self._make = form, make
        self._function, self._buffer = make(), None
        self._spoilt: list[Any] = []

    def __call__(
        self, parameters: Parameters, guess: Guess
    ) -> tuple[Array, float, dict[str, Any]]:
        """Solve from a guess: variables, cost and the solver's statistics."""
        form = self.form
        variables, rows = len(form.lower), len(form.row_lower)
        given = [
            form.pack(guess),
            form.parameters(parameters),
            *(form.lower, form.upper, form.row_lower, form.row_upper),
            *(np.zeros(variables), np.zeros(rows)),  # multipliers
        ]
        kept = [np.ascontiguousarray(values, dtype=np.float64) for values in given]
        flat, cost = np.full(variables, np.nan), np.full(1, np.nan)
        buffer = self._free()
        for i, values in enumerate(kept):
            buffer.set_arg(i, memoryview(cast(Any, values)))
        for i, values in enumerate((flat, cost)):
            buffer.set_res(i, memoryview(cast(Any, values)))
        buffer._eval()
        stats = buffer.stats()
        if not stats["success"]:
            self._spoilt.append(buffer)  # kept: its memory would be handed out again
            self._buffer = None
        return flat, float(cost[0]), stats

    def _free(self) -> Any:
        """Return a buffer whose memory is sound; with too many spoilt ones all are made anew."""
        if len(self._spoilt) > _MOST_SPOILT:
            self._spoilt, self._function = [], self._make()
        if self._buffer is None:
            self._buffer, _ = self._function.buffer()
        return self._buffer


_MOST_SPOILT = 8
"""Each holds some MiB; making the solver anew takes tenths of a second."""

_CACHE: OrderedDict[tuple[str, str, str], Compiled] = OrderedDict()
_CACHE_SIZE = 64


def compiled(
    name: str,
    problem: Problem,
    options: dict[str, Any],
    *,
    staged: bool,
    matrix: bool = False,
) -> Compiled:
    """Make the `casadi.nlpsol` of a problem, or take it from this process's cache.

    The cache is keyed by the hash of the expressions, never of a config alone.
    """
    key = (problem.key, name, repr((sorted(options.items()), staged, matrix)))
    if key in _CACHE:
        _CACHE.move_to_end(key)
        return _CACHE[key]
    form = Transcription(problem, staged=staged, symbol=ca.MX if matrix else ca.SX)
    quiet = {"print_time": False, "error_on_fail": False, "show_eval_warnings": False}
    settings = {**quiet, "calc_lam_p": False, **options}
    if name == "fatrop":
        settings |= _structure(form)
    program = form.nlp()
    _CACHE[key] = Compiled(form, lambda: ca.nlpsol("solver", name, program, settings))
    if len(_CACHE) > _CACHE_SIZE:
        _CACHE.popitem(last=False)
    return _CACHE[key]


def _structure(form: Transcription) -> dict[str, Any]:
    """Stage sizes as fatrop wants them; its rows leave out the gaps of the dynamics."""
    states = [size[0] for size in form.sizes]
    rows = [size[2] for size in form.sizes]
    for i in range(len(rows) - 1):
        rows[i] -= states[i + 1]
    return {
        "structure_detection": "manual",
        "N": len(states) - 1,
        "nx": states,
        "nu": [size[1] for size in form.sizes],
        "ng": rows,
    }


def run(
    program: Compiled,
    parameters: Parameters,
    guess: Guess,
    status: Callable[[dict[str, Any]], tuple[Status, str]],
) -> Solution:
    """Solve from one guess and read the result."""
    begin = perf_counter()
    form = program.form
    guess = unwrapped(form.problem, parameters, guess)
    flat, cost, stats = program(parameters, guess)
    seconds = perf_counter() - begin
    outcome, message = status(stats)
    if not (np.isfinite(flat).all() and np.isfinite(cost)):
        flat, outcome, message = form.pack(guess), Status.FAILED, "not a number"
    point = form.unpack(flat, parameters)
    return Solution(point, outcome, message, cost, int(stats.get("iter_count", 0)), seconds)

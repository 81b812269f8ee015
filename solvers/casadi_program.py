"""Programs of `casadi.nlpsol`, compiled once for each problem: what ipopt and fatrop share."""

from collections import OrderedDict
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from threading import Lock
from time import perf_counter
from typing import Any, cast

import numpy as np

from ..framework.mpc.ocp.problem import Parameters, Problem
from ..framework.mpc.ocp.transcription import Guess, Transcription
from ..framework.mpc.solver import Solution, unwrapped
from ..framework.numerics.symbolic import ca
from ..framework.values.arrays import Array
from ..framework.values.plan import Status


class Compiled:
    """A transcribed problem with the CasADi solver made for it.

    A solver keeps its memory from call to call. fatrop's is spoilt by a solve that fails: a
    later one, which a fresh solver does in 77 iterations, then never returned. So a call
    goes through a buffer, which has a memory of its own, and after a solve that did not
    succeed the next one gets another buffer. Results therefore do not depend on what was
    solved before.

    One thread uses it at a time, see `compiled`.

    Parameters
    ----------
    form : the transcribed problem.
    make : makes the CasADi function.
    stop : ends a solve at a time, where the function was made with it.
    """

    def __init__(
        self, form: Transcription, make: Callable[[], Any], stop: "StopCallback | None" = None
    ) -> None:
        self.form: Transcription = form
        self.stop: StopCallback | None = stop
        self._make = make
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


class StopCallback(ca.Callback):
    """Stops an iterative solver of CasADi after the iteration in which a time has passed.

    CasADi calls it with every iterate; it reads the clock and changes nothing.

    Parameters
    ----------
    program : the symbols and expressions of the NLP.

    Attributes
    ----------
    until : s, reading of ``perf_counter`` after which the solver stops.
    """

    def __init__(self, program: dict[str, Any]) -> None:
        ca.Callback.__init__(self)
        self.until: float = np.inf
        x, g, p = (program[name].numel() for name in ("x", "g", "p"))
        self._sizes = {"x": x, "f": 1, "g": g, "lam_x": x, "lam_g": g, "lam_p": p}
        self.construct("stop")

    def get_n_in(self) -> int:
        """Count the inputs: those of a solver's result."""
        return int(ca.nlpsol_n_out())

    def get_n_out(self) -> int:
        """Count the outputs."""
        return 1

    def get_sparsity_in(self, i: int) -> Any:
        """Return the shape of an input."""
        return ca.Sparsity.dense(self._sizes[ca.nlpsol_out(i)], 1)

    def eval(self, _: Sequence[Any]) -> list[float]:
        """Return 1 where the time has passed."""
        return [float(perf_counter() > self.until)]


_CACHE: OrderedDict[tuple[str, str, str], list[Compiled]] = OrderedDict()
"""The programs of a problem that no thread uses at present."""
_CACHE_SIZE = 64
_LOCK = Lock()


@contextmanager
def compiled(
    name: str,
    problem: Problem,
    options: dict[str, Any],
    *,
    staged: bool,
    matrix: bool = False,
    stoppable: bool = False,
) -> Iterator[Compiled]:
    """Make the `casadi.nlpsol` of a problem, or take it from this process's cache.

    The cache is keyed by the hash of the expressions, never of a config alone. ``options`` are
    those that stay the same from call to call; what changes, such as the time left, reaches a
    program through its ``stop``. A program that is in use is not in the cache: a solve that was
    left behind keeps its own, and the next one gets another.
    """
    key = (problem.key, name, repr((sorted(options.items()), staged, matrix, stoppable)))
    with _LOCK:
        unused = _CACHE.setdefault(key, [])
        _CACHE.move_to_end(key)
        if len(_CACHE) > _CACHE_SIZE:
            _CACHE.popitem(last=False)
        program = unused.pop() if unused else None
    if program is None:
        program = _made(name, problem, options, staged, matrix, stoppable)
    yield program  # one whose solve raises is not used again
    unused.append(program)


def _made(
    name: str,
    problem: Problem,
    options: dict[str, Any],
    staged: bool,
    matrix: bool,
    stoppable: bool,
) -> Compiled:
    form = Transcription(problem, staged=staged, symbol=ca.MX if matrix else ca.SX)
    quiet = {"print_time": False, "error_on_fail": False, "show_eval_warnings": False}
    settings = {**quiet, "calc_lam_p": False, **options}
    if name == "fatrop":
        settings |= _structure(form)
    program = form.nlp()
    stop = StopCallback(program) if stoppable else None
    if stop is not None:
        settings["iteration_callback"] = stop
    return Compiled(form, lambda: ca.nlpsol("solver", name, program, settings), stop)


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
    if not all(np.isfinite(one).all() for one in (form.pack(guess), form.parameters(parameters))):
        # fatrop does not come back from a guess or a region of NaN
        words, spent = "the guess or the parameters are not finite", perf_counter() - begin
        return Solution(guess, Status.FAILED, words, float("nan"), 0, spent)
    flat, cost, stats = program(parameters, guess)
    seconds = perf_counter() - begin
    outcome, message = status(stats)
    if not (np.isfinite(flat).all() and np.isfinite(cost)):
        flat, outcome, message = form.pack(guess), Status.FAILED, "not a number"
    point = form.unpack(flat, parameters)
    return Solution(point, outcome, message, cost, int(stats.get("iter_count", 0)), seconds)

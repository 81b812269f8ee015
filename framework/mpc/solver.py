"""The Solver interface, and what the solvers behind `casadi.nlpsol` share."""

from abc import ABC, abstractmethod
from collections import OrderedDict
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import lru_cache
from operator import attrgetter
from threading import Lock
from time import perf_counter
from typing import Any, NamedTuple, TypeAlias, cast

import numpy as np

from ..numerics.symbolic import ca
from ..values.arrays import Array
from ..values.errors import WideberthError
from ..values.plan import Status
from .ocp.problem import Parameters, Problem
from .ocp.transcription import Guess, Transcription


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
    stand_in : which other solver answered, and why; empty where the solver itself did.
    """

    point: Guess
    status: Status
    message: str
    cost: float
    iterations: int
    seconds: float
    stand_in: str = ""


class Solver(ABC):
    """Solves a problem from several starting points.

    A solver never raises for the numbers of an instance: failure is the status of the solution.
    Arrays of another problem are refused, see `refuse_misfits`, and every guess is taken through
    `unwrapped` first. The same problem, parameters and guesses give the same solution unless a
    deadline cuts it short. `wideberth.framework.testing.check_solver` states the laws.

    The planner calls a solver in a thread of its own, and leaves it behind where it does not
    return (see `wideberth.framework.mpc.planner.watchdog`): another call may begin while one still
    runs, so
    that calls must not share memory. Native code has to release Python's lock, as CasADi and
    Numba's ``nogil`` do; a thread that keeps it stops the whole process.
    """

    @abstractmethod
    def solve(
        self,
        problem: Problem,
        parameters: Parameters,
        guesses: Sequence[Guess],
        deadline: float | None = None,
    ) -> list[Solution]:
        """Solve from each guess; ``deadline``, s by the clock, caps each single solve.

        A solution that took longer has `Status.DEADLINE`, however the solver ended.
        """


class SizelessSolver(Solver):
    """A solver that compiles nothing for another number of obstacles.

    A planner makes its problems of every size before the first decision, not when it meets them.
    """


class ManySolver(Solver):
    """A solver that solves many instances of one problem together, see `solve_many`."""

    @abstractmethod
    def solve_many(
        self,
        problem: Problem,
        parameters: Sequence[Parameters],
        guesses: Sequence[Guess],
        workers: int | None = None,
    ) -> list[Solution]:
        """Solve each instance from its guess; ``workers`` cores, by default all.

        Raises
        ------
        WideberthError : as many parameters as guesses are needed.
        """


class CheapestSolver(Solver):
    """A solver that gives up starts that lead to no cheaper plan, see `solve_cheapest`."""

    @abstractmethod
    def solve_cheapest(
        self,
        problem: Problem,
        parameters: Parameters,
        guesses: Sequence[Guess],
        known: Sequence[Solution],
        within: float,
        deadline: float | None = None,
    ) -> list[Solution]:
        """Solve from each guess in turn, but for those that lead to no cheaper plan.

        Unlike with `solve`, a solution depends on those before it, ``known`` ones included. One
        that is given up has `Status.GIVEN_UP`; its message says why, its point is no plan. No
        start is given up for being dearer than a plan that `enters` regions, but it may be for
        taking far longer.

        Parameters
        ----------
        known : solutions from other starts; those that did not converge do not count.
        within : a start leads to a known plan where it comes so near in all that regions see, m
            (rad for headings).
        deadline : s by the clock, caps each single solve.
        """


def solve_cheapest(
    solver: Solver,
    problem: Problem,
    parameters: Parameters,
    guesses: Sequence[Guess],
    known: Sequence[Solution],
    within: float,
    deadline: float | None = None,
) -> list[Solution]:
    """Solve from each guess with any solver; only a `CheapestSolver` gives some of them up.

    See there for the parameters.
    """
    if isinstance(solver, CheapestSolver):
        return solver.solve_cheapest(problem, parameters, guesses, known, within, deadline)
    return solver.solve(problem, parameters, guesses, deadline)


ENTERED = 1e-4
"""Slack beyond which a plan enters soft regions, and fails the planner's re-check."""


def enters(solution: Solution) -> bool:
    """Whether a plan enters soft regions and pays for it: cheap or not, it is no plan to keep."""
    return bool(solution.point.slack.max(initial=0.0) > ENTERED)


NO_FORCE = 1e-3
"""Where no region presses, all of them relaxed by 1 save less than this share of 1 + |cost|."""


def pressed(solution: Solution) -> bool:
    """Whether regions press on a plan, so that another start may lead to a cheaper one.

    Where none does, the plan is optimal without any region, and that problem is the tracking
    problem, which has one optimum. Without multipliers the answer is True.
    """
    known = solution.point.multipliers
    if solution.status is not Status.SOLVED or known is None:
        return True
    force = sum(float(np.abs(one[one == one]).sum()) for one in known.slots)  # NaN where empty
    return not force <= NO_FORCE * (1.0 + abs(solution.cost))


def solve_many(
    solver: Solver,
    problem: Problem,
    parameters: Sequence[Parameters],
    guesses: Sequence[Guess],
    workers: int | None = None,
) -> list[Solution]:
    """Solve many instances of one problem with any solver, each from its guess.

    A `ManySolver` takes them together, any other one after the other.

    Raises
    ------
    WideberthError : as many parameters as guesses are needed.
    """
    if isinstance(solver, ManySolver):
        return solver.solve_many(problem, parameters, guesses, workers)
    refuse_unequal(parameters, guesses)
    pairs = zip(parameters, guesses, strict=True)
    return [solver.solve(problem, one, [guess])[0] for one, guess in pairs]


def refuse_unequal(parameters: Sequence[Parameters], guesses: Sequence[Guess]) -> None:
    """Refuse more or fewer guesses than instances."""
    if len(parameters) != len(guesses):
        raise WideberthError(
            f"got {len(parameters)} parameters and {len(guesses)} guesses; wanted one of each per "
            "instance: repeat the parameters for several starts"
        )


def refuse_misfits(problem: Problem, parameters: Parameters, guesses: Sequence[Guess]) -> None:
    """Refuse arrays that do not fit the problem; every solver does so first.

    A guess without auxiliaries fits, see `Guess.bare`.

    Raises
    ------
    WideberthError : names the array, its shape and the shape wanted.
    """
    wanted = _shapes(problem)
    if len(parameters.slots) != len(wanted.slots):
        raise WideberthError(
            f"parameters hold {len(parameters.slots)} kinds of slots; wanted {len(wanted.slots)}, "
            "those of the problem"
        )
    if _NUMBERS(parameters) != wanted.numbers:
        _refuse_misfit("parameters", parameters, _NUMBER_NAMES, wanted.numbers)
    if parameters.curve.size != wanted.curve[0] * wanted.curve[1]:
        _refuse_misfit("parameters", parameters, ("curve",), (wanted.curve,))
    for shapes, own in zip(wanted.slots, parameters.slots, strict=True):
        if _SLOTS(own) != shapes:
            _refuse_misfit("parameters.slots", own, _SLOT_NAMES, shapes)
        if own.level is not None and own.level.shape != own.parameters.shape[:2]:
            _refuse_misfit("parameters.slots", own, ("level",), (own.parameters.shape[:2],))
    for guess in guesses:
        if _GUESS(guess) != wanted.guess:
            _refuse_misfit("guess", guess, _GUESS_NAMES, wanted.guess)


_Shape: TypeAlias = tuple[int, ...]


def _refuse_misfit(
    name: str, owner: object, fields: Sequence[str], shapes: Sequence[_Shape]
) -> None:
    for field, wanted in zip(fields, shapes, strict=True):
        values = getattr(owner, field)
        if values.shape != wanted and (values.size or 0 not in wanted):
            raise WideberthError(
                f"{name}.{field} is {values.shape}; wanted {wanted}: fill it for the same problem"
            )


def _shapes_in(names: Sequence[str]) -> Callable[[object], tuple[_Shape, ...]]:
    """Return a function that reads the shapes of several arrays at once: every solve does so."""
    return attrgetter(*(f"{name}.shape" for name in names))


_NUMBER_NAMES = ("initial", "reference", "direction", "speed")
_SLOT_NAMES = ("parameters", "active", "auxiliaries")
_GUESS_NAMES = ("states", "inputs")
_NUMBERS, _SLOTS, _GUESS = map(_shapes_in, (_NUMBER_NAMES, _SLOT_NAMES, _GUESS_NAMES))


class _Shapes(NamedTuple):
    """Shapes of the arrays of parameters, of the slots of each kind, and of a guess."""

    numbers: tuple[_Shape, ...]
    curve: _Shape
    slots: tuple[tuple[_Shape, ...], ...]
    guess: tuple[_Shape, ...]


@lru_cache(maxsize=8)
def _shapes(problem: Problem) -> _Shapes:
    """Return the shapes that a problem wants, in the order of the names above."""
    steps, size = problem.horizon, problem.dimension
    return _Shapes(
        ((problem.states,), (steps, size), (steps, size), (steps,)),
        (steps, problem.curve),
        tuple(
            ((steps, own.count, own.width), (own.count,), (steps, own.count, len(own.auxiliary)))
            for own in problem.slots
        ),
        ((steps + 1, problem.states), (steps, problem.inputs)),
    )


def on_time(solution: Solution, taken: float, deadline: float | None) -> Solution:
    """Return a solution as it is, or with `Status.DEADLINE` where the deadline has passed.

    Parameters
    ----------
    solution : just found.
    taken : s by the clock that its solve took, compilation included.
    deadline : s, or None.
    """
    if deadline is None or taken <= deadline or solution.status is Status.DEADLINE:
        return solution
    message = f"{solution.message}, after {taken:.3g} s, later than the deadline {deadline:.3g} s"
    return replace(solution, status=Status.DEADLINE, message=message)


def unwrapped(problem: Problem, parameters: Parameters, guess: Guess) -> Guess:
    """Turn a guess by whole turns, so that its first heading is nearest that of x_0.

    A heading that is off by 2 pi is the same heading, and no solver finds its way back from
    there. Every solver takes its guesses through this function.
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

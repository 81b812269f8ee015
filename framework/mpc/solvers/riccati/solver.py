"""Our own solver: a structured interior point, compiled without a compiler."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from os import cpu_count
from threading import Timer
from time import perf_counter
from typing import TYPE_CHECKING, final

import numpy as np

from ....values.arrays import Array, positive, whole
from ....values.errors import WideberthError
from ....values.plan import Status
from ...ocp.problem import Parameters, Problem, SlotNumbers
from ...ocp.transcription import Guess
from ..base import Solution, Solver, on_time, unwrapped
from ..fatrop import Fatrop

if TYPE_CHECKING:
    from .compiled import Program

_STATUS = (Status.SOLVED, Status.LIMIT, Status.INFEASIBLE, Status.FAILED, Status.DEADLINE)


@final
@dataclass(frozen=True)
class Riccati(Solver):
    """Primal-dual interior point whose Newton steps are a Riccati recursion over the horizon.

    Exact Hessians, regularised where the reduced one is not positive definite; a filter line
    search; regions soft by an exact penalty and, with all that belongs to one obstacle and step,
    eliminated by hand. It knows a problem by its stage functions alone: derivatives come from
    CasADi, and all of it is compiled by Numba, so an iteration never enters Python.

    Hard regions are held by a penalty as well, which is raised until they are kept: where
    nothing keeps them, the plan with the smallest violation comes back as ``infeasible``.

    The first solve on a machine compiles for about a minute, later processes load the result.
    Where that is not possible (no Numba, or a region with too large an expression), `Fatrop`
    solves, and the message says so.

    Parameters
    ----------
    iterations : limit.
    tolerance : of the optimality conditions, scaled as by IPOPT.
    start_barrier : first barrier parameter mu.
    start_distance : of the start from its bounds, relative.
    start_penalty, most_penalty : price of one unit of slack on hard regions, first and highest.
    gradient : largest entry of the cost's gradient after scaling.
    """

    iterations: int = 200
    tolerance: float = 1e-6
    start_barrier: float = 0.1
    start_distance: float = 0.1
    start_penalty: float = 1e4
    most_penalty: float = 1e7
    gradient: float = 10.0

    def __post_init__(self) -> None:
        whole("riccati.iterations", self.iterations)
        for name in ("tolerance", "start_barrier", "start_distance", "start_penalty", "gradient"):
            positive(f"riccati.{name}", getattr(self, name))
        if not self.most_penalty >= self.start_penalty:
            raise WideberthError(
                f"riccati.most_penalty is {self.most_penalty}; wanted at least start_penalty, "
                f"{self.start_penalty}"
            )

    def solve(
        self,
        problem: Problem,
        parameters: Parameters,
        guesses: Sequence[Guess],
        deadline: float | None = None,
    ) -> list[Solution]:
        """Solve from each guess."""
        begin = perf_counter()
        try:
            made, run = _compiled(problem)
        except WideberthError as error:
            why = f"by fatrop, since {error}"
            others = Fatrop().solve(problem, parameters, guesses, deadline)
            return [replace(one, message=f"{one.message} ({why})") for one in others]
        solutions = []
        for guess in guesses:
            found = self._one(problem, parameters, guess, deadline, made, run, begin)
            solutions.append(on_time(found, perf_counter() - begin, deadline))
            begin = perf_counter()
        return solutions

    def solve_many(
        self,
        problem: Problem,
        parameters: Sequence[Parameters],
        guesses: Sequence[Guess],
        workers: int | None = None,
    ) -> list[Solution]:
        """Solve many instances of one problem, each from its guess, on several cores.

        The compiled solver holds no lock of Python's while it works, so threads suffice. Results
        do not depend on their number, which is that of the cores by default.
        """
        from concurrent.futures import ThreadPoolExecutor

        if len(parameters) != len(guesses):
            raise WideberthError(
                f"{len(parameters)} instances and {len(guesses)} guesses; wanted one for each"
            )
        if parameters:
            self.solve(problem, parameters[0], [])  # compiles, once and not in every thread
        pairs = list(zip(parameters, guesses, strict=True))

        def part(some: Sequence[tuple[Parameters, Guess]]) -> list[Solution]:
            return [self.solve(problem, one, [guess])[0] for one, guess in some]

        share = max(1, -(-len(pairs) // (8 * (workers or cpu_count() or 1))))
        pieces = [pairs[i : i + share] for i in range(0, len(pairs), share)]
        with ThreadPoolExecutor(workers or cpu_count()) as pool:
            return [solution for some in pool.map(part, pieces) for solution in some]

    def _one(
        self,
        problem: Problem,
        parameters: Parameters,
        guess: Guess,
        deadline: float | None,
        made: "Program",
        run: Callable[..., None],
        begin: float,
    ) -> Solution:
        """Call the compiled core and read its result."""
        guess = _suited(parameters, _turned(problem, parameters, guess))
        found, numbers = _room(problem, guess, len(made.kinds)), np.zeros(7)
        stop = numbers[6:]
        arguments = (
            *(made.addresses, made.sizes, made.limits, self._settings(problem, guess)),
            *_arrays(
                parameters.initial, parameters.reference, parameters.direction,
                parameters.speed, parameters.curve, guess.states, guess.inputs,
            ),
            *_slots(made, parameters, guess),
            *(*found, numbers, stop),
        )  # fmt: skip
        if deadline is None:
            run(*arguments)
        else:
            _until(begin + deadline, stop, run, arguments)
        states, inputs, slack, *own = found
        kind, iterations, cost, level, error = numbers[:5].tolist()
        status = _STATUS[int(kind)]
        if problem.penalty is not None:
            cost += problem.penalty * float(slack.sum())
            if status is Status.INFEASIBLE:
                status = Status.SOLVED  # its slack is paid for
        level = level if problem.shared else float("nan")
        point = Guess(states, inputs, tuple(own[: len(problem.slots)]), level, slack)
        words = _words(status, iterations, error)
        return Solution(point, status, words, cost, int(iterations), perf_counter() - begin)

    def _settings(self, problem: Problem, guess: Guess) -> Array:
        """Numbers of the core, in its order."""
        price, highest = self.start_penalty, self.most_penalty
        if problem.penalty is not None:
            price = highest = problem.penalty
        level = (problem.minimum, guess.level) if problem.shared else (-np.inf, 0.0)
        barrier = (self.iterations, self.tolerance, self.start_barrier, self.start_distance)
        return np.array([*barrier, price, highest, self.gradient, *level])


@lru_cache(maxsize=8)
def _compiled(problem: Problem) -> "tuple[Program, Callable[..., None]]":
    """Return what a problem is compiled to; the latest ones without a look into `program`."""
    from .compiled import core, program

    return program(problem), core()


def _room(problem: Problem, guess: Guess, kinds: int) -> tuple[Array, ...]:
    """Arrays for the result; empty slots keep the auxiliaries of the guess."""
    horizon = problem.horizon
    states, inputs = np.empty((horizon + 1, problem.states)), np.empty((horizon, problem.inputs))
    own = [one.copy() for one in guess.auxiliaries]
    own += [np.zeros((horizon, 0, 0))] * (kinds - len(own))
    return states, inputs, np.empty(horizon), *own


def _turned(problem: Problem, parameters: Parameters, guess: Guess) -> Guess:
    """Send a guess through the door of all solvers, but for the one that is let through there."""
    where = problem.heading
    if where is None or abs(guess.states[0, where] - parameters.initial[where]) <= np.pi:
        return guess
    return unwrapped(problem, parameters, guess)


def _suited(parameters: Parameters, guess: Guess) -> Guess:
    """Give a bare guess the auxiliaries that the regularisation pulls to."""
    wanted = tuple(one.auxiliaries for one in parameters.slots)
    own = guess.auxiliaries or wanted
    pairs = zip(own, wanted, strict=True)
    return replace(
        guess,
        auxiliaries=tuple(one if one.shape == other.shape else other for one, other in pairs),
    )


_NONE = np.zeros((0, 0))
"""Levels of slots that have none."""


def _slots(made: "Program", parameters: Parameters, guess: Guess) -> list[object]:
    """Return the arguments of the core about every kind of slots."""
    none = SlotNumbers.none(len(parameters.speed))
    arguments: list[object] = []
    for k, kind in enumerate(made.kinds):
        there = k < len(parameters.slots)
        own = parameters.slots[k] if there else none
        start = guess.auxiliaries[k] if there else none.auxiliaries
        level = _NONE if own.level is None else own.level
        arguments += kind.about
        arguments += _arrays(own.parameters, level, own.active, own.auxiliaries, start)
    return arguments


def _arrays(*values: Array) -> list[Array]:
    """Return the arrays as the core takes them; most are so already."""
    return [
        value
        if value.flags.carray and value.dtype == np.float64
        else np.array(value, dtype=np.float64, order="C")
        for value in values
    ]


def _until(
    end: float, stop: Array, run: Callable[..., None], arguments: tuple[object, ...]
) -> None:
    """Run, and ask the core to stop at a time; another thread sets the flag that it looks at."""
    timer = Timer(max(end - perf_counter(), 0.0), stop.fill, (1.0,))
    timer.daemon = True
    timer.start()
    try:
        run(*arguments)
    finally:
        timer.cancel()


def _words(status: Status, iterations: float, error: float) -> str:
    """Say how it ended."""
    if status is Status.INFEASIBLE:
        return "no plan keeps every region; this one enters them least, as far as was found"
    return f"{status} after {iterations:.0f} iterations, error {error:.1e}"

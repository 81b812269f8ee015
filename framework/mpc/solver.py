"""The Solver interface, and what every solver keeps to."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from operator import attrgetter
from typing import NamedTuple, TypeAlias

import numpy as np

from ..values.errors import WideberthError
from ..values.plan import TOLERANCE, Status
from .ocp.problem import Parameters, Problem
from .ocp.transcription import Guess


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

    The planner calls a solver in a thread of its own, unless it is a `BoundedSolver`, and leaves
    it behind where it does not return (see `wideberth.framework.mpc.planner.watchdog`): another
    call may begin while one still runs, so that calls must not share memory. Native code has to
    release Python's lock, as CasADi and Numba's ``nogil`` do; a thread that keeps it stops the
    whole process.
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


class BoundedSolver(Solver):
    """A solver that may say of a problem that every solve of it ends by itself.

    No thread is needed for what cannot run on: to hand a call over may take longer than the call.
    """

    @abstractmethod
    def always_ends(self, problem: Problem) -> bool:
        """Whether solves of a problem that was solved before take a bounded number of operations.

        Nothing is compiled or started in them, and no foreign solver is called.
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


def enters(solution: Solution) -> bool:
    """Whether a plan enters soft regions and pays for it: cheap or not, it is no plan to keep.

    Slack beyond `TOLERANCE` fails the planner's re-check.
    """
    return bool(solution.point.slack.max(initial=0.0) > TOLERANCE)


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
    force = sum(float(np.abs(one[~np.isnan(one)]).sum()) for one in known.slots)  # empty: NaN
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

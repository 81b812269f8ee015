"""The solver ``riccati``: an interior point along the horizon, in C."""

from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from functools import lru_cache
from os import cpu_count
from threading import Timer
from time import perf_counter
from typing import final

import numpy as np

from ...framework.mpc.ocp.problem import Parameters, Problem
from ...framework.mpc.ocp.transcription import Guess, Multipliers
from ...framework.mpc.solver import (
    BoundedSolver,
    CheapestSolver,
    ManySolver,
    SizelessSolver,
    Solution,
    enters,
    on_time,
    refuse_misfits,
    refuse_unequal,
    unwrapped,
)
from ...framework.values.arrays import positive, whole
from ...framework.values.errors import WideberthError
from ...framework.values.plan import Status
from ..fatrop import Fatrop
from .interior_point import (
    BARRIER_TEST,
    ITERATIONS,
    LARGEST_GRADIENT,
    LONG,
    LONG_BARRIER,
    LONG_PENALTY,
    LONG_TEST,
    MOST_PENALTY,
    START_BARRIER,
    START_DISTANCE,
    START_PENALTY,
    TOLERANCE,
    WARM_DISTANCE,
)
from .problem import CoreProblem, core_problem
from .workspace import ResultTable, SettingsTable, Workspace, run_all

_STATUS = (
    Status.SOLVED,
    Status.LIMIT,
    Status.INFEASIBLE,
    Status.FAILED,
    Status.DEADLINE,
    Status.GIVEN_UP,
    Status.GIVEN_UP,
)
"""Status of a solution for each ``wb_status`` of the core."""
_NAMES = {status: str(status) for status in _STATUS}
_WHY = {5: "it leads to the same plan as another", 6: "it leads to a dearer plan than another"}
"""Why the core gave a start up, by its ``wb_status``."""
PATIENT_ITERATIONS, PATIENT_PER_STEP, PATIENT_SHARE = 40.0, 1.5, 2.0
"""Where a plan is known, a further start is given up after the largest of so many iterations, so
many per step, and so many times those of the quickest solve. In a crowd where no plan keeps all
regions ``along`` wanders about for 100 iterations in the mean: of 360 such decisions two chose
another command by more than 0.001 m/s, none by 0.05, in 168 iterations instead of 288."""
_AT_ONCE = 32
"""Instances of `Riccati.solve_many` that a thread solves in one call out of Python, at most."""


@final
@dataclass(frozen=True)
class Riccati(ManySolver, SizelessSolver, CheapestSolver, BoundedSolver):
    """Primal-dual interior point whose Newton steps are a Riccati recursion over the horizon.

    Exact Hessians, regularised where the reduced one is not positive definite; a filter line
    search; regions soft by an exact penalty and, with all that belongs to one obstacle and step,
    eliminated by hand. It knows a problem by its stage functions alone: derivatives come from
    CasADi, and an iteration never enters Python.

    Hard regions are held by a penalty as well, which is raised until they are kept: where
    nothing keeps them, the plan with the smallest violation comes back as ``infeasible``.

    The solver is an extension module in C. Where that was not built, `Fatrop` solves, and
    `Solution.stand_in` says so.

    Parameters
    ----------
    iterations : limit.
    tolerance : of the optimality conditions, scaled as by IPOPT.
    compile : whether the system's C compiler compiles the stage functions of a problem, once per
        machine. Solves then take about three quarters of the time.
    """

    iterations: int = ITERATIONS
    tolerance: float = TOLERANCE
    compile: bool = False

    def __post_init__(self) -> None:
        whole("riccati.iterations", self.iterations)
        positive("riccati.tolerance", self.tolerance)

    def always_ends(self, problem: Problem) -> bool:
        """Whether the core solves the problem: its iterations are limited."""
        try:
            self._prepared(problem)
        except WideberthError:  # fatrop does
            return False
        return True

    def solve(
        self,
        problem: Problem,
        parameters: Parameters,
        guesses: Sequence[Guess],
        deadline: float | None = None,
    ) -> list[Solution]:
        """Solve from each guess."""
        return self._each(problem, parameters, guesses, deadline, None, 0.0)

    def solve_cheapest(
        self,
        problem: Problem,
        parameters: Parameters,
        guesses: Sequence[Guess],
        known: Sequence[Solution],
        within: float,
        deadline: float | None = None,
    ) -> list[Solution]:
        """Solve from each guess, but for those that lead to no cheaper plan.

        See ``hopeless`` in core/riccati.c and `_OtherPlans.most` for when a solve is given up.
        """
        return self._each(problem, parameters, guesses, deadline, known, within)

    def _each(
        self,
        problem: Problem,
        parameters: Parameters,
        guesses: Sequence[Guess],
        deadline: float | None,
        known: Sequence[Solution] | None,
        within: float,
    ) -> list[Solution]:
        """Solve from each guess; give some up unless ``known`` is None."""
        begin = perf_counter()
        refuse_misfits(problem, parameters, [*guesses, *(one.point for one in known or ())])
        try:
            prepared = self._prepared(problem)
        except WideberthError as error:
            return by_fatrop(problem, parameters, guesses, deadline, str(error))
        solutions: list[Solution] = []
        with prepared.workspace(parameters) as space:
            space.fill(parameters)
            others = None if known is None else _OtherPlans(space, within)
            for one in known or ():
                if others is not None and one.status is Status.SOLVED:
                    others.add(one)
            for guess in guesses:
                (found,) = self._solved(
                    problem, [space], [parameters], [guess], begin, deadline, others
                )
                found = on_time(found, perf_counter() - begin, deadline)
                solutions.append(found)
                if others is not None and found.status is Status.SOLVED:
                    others.add(found)
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

        The compiled solver holds no lock of Python's while it works, so threads suffice; each
        solves several instances in one call out of Python. Results do not depend on the number of
        threads, which is that of the cores by default. ``seconds`` of a solution is its share of
        the time of such a call.
        """
        from concurrent.futures import ThreadPoolExecutor

        refuse_unequal(parameters, guesses)
        try:
            prepared = self._prepared(problem)
        except WideberthError as error:
            why = str(error)
            pairs = zip(parameters, guesses, strict=True)
            return [by_fatrop(problem, one, [guess], None, why)[0] for one, guess in pairs]

        def part(some: slice) -> list[Solution]:
            begin = perf_counter()
            for one, guess in zip(parameters[some], guesses[some], strict=True):
                refuse_misfits(problem, one, [guess])
            with ExitStack() as lent:
                spaces = [lent.enter_context(prepared.workspace(one)) for one in parameters[some]]
                for space, one in zip(spaces, parameters[some], strict=True):
                    space.fill(one)
                return self._solved(problem, spaces, parameters[some], guesses[some], begin)

        count = len(guesses)
        threads = min(workers or cpu_count() or 1, max(count, 1))
        share = min(max(1, -(-count // (8 * threads))), _AT_ONCE)
        pieces = [slice(i, i + share) for i in range(0, count, share)]
        if threads == 1:
            return [solution for some in map(part, pieces) for solution in some]
        with ThreadPoolExecutor(threads) as pool:
            return [solution for some in pool.map(part, pieces) for solution in some]

    def _solved(
        self,
        problem: Problem,
        spaces: Sequence[Workspace],
        parameters: Sequence[Parameters],
        guesses: Sequence[Guess],
        begin: float,
        deadline: float | None = None,
        others: "_OtherPlans | None" = None,
    ) -> list[Solution]:
        """Solve filled instances one after the other, in one call of the core, and read results.

        From multipliers that lead nowhere the guess alone is taken. A deadline, or other plans,
        are for a single instance.
        """
        full = [
            with_auxiliaries(one, _with_wrapped_heading(problem, one, guess))
            for one, guess in zip(parameters, guesses, strict=True)
        ]
        warm = [
            self._begin(problem, space, guess, others)
            for space, guess in zip(spaces, full, strict=True)
        ]
        _run(spaces, begin, deadline)
        spent, found = (perf_counter() - begin) / len(spaces), []
        for begun, space, guess in zip(warm, spaces, full, strict=True):
            since, before = perf_counter() - spent, 0
            if begun and _failed(problem, space.ended):
                before = space.ended.iterations
                self._begin(problem, space, replace(guess, multipliers=None), others)
                _run([space], since, deadline)
            cut = None if others is None else others.most
            found.append(self._result(problem, space, guess, before, since, cut))
        return found

    def _begin(
        self,
        problem: Problem,
        space: Workspace,
        guess: Guess,
        others: "_OtherPlans | None" = None,
    ) -> bool:
        """Fill in a guess; return whether the core starts from multipliers."""
        multipliers = guess.multipliers
        warm = multipliers is not None and space.take(multipliers)
        settings = self.settings_for(problem, guess, warm=warm)
        if others is not None:
            others.write(settings)
        space.begin(settings, guess)
        return warm

    def _result(
        self,
        problem: Problem,
        space: Workspace,
        guess: Guess,
        before: int,
        begin: float,
        cut: float | None = None,
    ) -> Solution:
        """Read what the core found, after so many iterations of an earlier try.

        Where ``cut`` is below the limit of iterations, a solve that reached it is given up. What
        is given up keeps its guess.
        """
        ended, known = space.ended, None
        status, cost = _status_of(problem, ended), ended.cost
        if status is Status.LIMIT and cut is not None and cut < self.iterations:
            status = Status.GIVEN_UP
        if status is Status.GIVEN_UP:
            words, spent = _words(status, ended), perf_counter() - begin
            return Solution(guess, status, words, cost, before + ended.iterations, spent)
        states, inputs, slack = space.states.copy(), space.inputs.copy(), space.slack.copy()
        own = tuple(array.copy() for array in space.own)
        if problem.penalty is not None:
            cost += problem.penalty * float(slack.sum())
        if _STATUS[ended.status] is Status.SOLVED:
            known = Multipliers(
                space.multipliers.copy(), tuple(array.copy() for array in space.after)
            )
        level = ended.level if problem.shared else float("nan")
        words, spent = _words(status, ended), perf_counter() - begin
        point = Guess(states, inputs, own, level, slack, known)
        return Solution(point, status, words, cost, before + ended.iterations, spent)

    def _prepared(self, problem: Problem) -> CoreProblem:
        return core_problem(problem, self.compile)

    def settings_for(self, problem: Problem, guess: Guess, *, warm: bool = False) -> SettingsTable:
        """Collect the settings of the core.

        ``warm`` says whether multipliers are given.
        """
        settings = _settings_of(self, problem).copy()
        if problem.shared:
            settings.guess = guess.level
        if warm:
            settings.warm, settings.push = 1.0, WARM_DISTANCE
            settings.test = BARRIER_TEST  # the start is near, whatever the horizon
        return settings


class _OtherPlans:
    """Plans from other starts, with which solves in a workspace are compared.

    Parameters
    ----------
    space : the arrays of these solves.
    within : how near to a plan another start leads to the same one.
    """

    def __init__(self, space: Workspace, within: float) -> None:
        self._space, self._within = space, within
        self._count, self._best, self._fewest = 0, np.inf, np.inf

    def add(self, solution: Solution) -> None:
        """Take note of a plan; those beyond the first `MOST_PLANS` are no longer compared with.

        Who enters regions makes no other start too dear.
        """
        self._count = self._space.note(solution.point, self._count)
        self._fewest = min(self._fewest, float(solution.iterations))
        if not enters(solution):
            self._best = min(self._best, solution.cost)

    @property
    def most(self) -> float:
        """Iterations after which a start is given up; infinite where no plan is known."""
        steps = len(self._space.inputs)
        patient = max(PATIENT_ITERATIONS, PATIENT_PER_STEP * steps)
        return max(patient, PATIENT_SHARE * self._fewest)

    def write(self, settings: SettingsTable) -> None:
        """Write the plans that are known into the settings of the next solve."""
        settings.plans, settings.best = self._count, self._best
        settings.within = self._within
        settings.iterations = min(settings.iterations, np.floor(self.most))


def by_fatrop(
    problem: Problem,
    parameters: Parameters,
    guesses: Sequence[Guess],
    deadline: float | None,
    why: str,
) -> list[Solution]:
    """Solve by `Fatrop`; every solution says so, and why."""
    found = Fatrop().solve(problem, parameters, guesses, deadline)
    return [replace(one, stand_in=f"fatrop, since {why}") for one in found]


@lru_cache(maxsize=8)
def _settings_of(solver: Riccati, problem: Problem) -> SettingsTable:
    """Return the settings of the core for a problem, whatever the guess."""
    price = highest = problem.penalty
    long = problem.horizon >= LONG
    if price is None or highest is None:
        price, highest = LONG_PENALTY if long else START_PENALTY, MOST_PENALTY
    return SettingsTable(
        iterations=solver.iterations,
        tolerance=solver.tolerance,
        barrier=LONG_BARRIER if long else START_BARRIER,
        test=LONG_TEST if long else BARRIER_TEST,
        push=START_DISTANCE,
        penalty=price,
        most_penalty=highest,
        gradient=LARGEST_GRADIENT,
        minimum=problem.minimum if problem.shared else -np.inf,
        guess=0.0,
        warm=0.0,
        plans=0.0,
        best=np.inf,
        within=0.0,
    )


def _failed(problem: Problem, ended: ResultTable) -> bool:
    """Whether a solve from multipliers led nowhere, so that the guess alone is tried."""
    fine = Status.SOLVED, Status.DEADLINE, Status.GIVEN_UP
    return _status_of(problem, ended) not in fine


def _status_of(problem: Problem, ended: ResultTable) -> Status:
    """How the core ended; where regions are soft, slack that is left is paid for."""
    status = _STATUS[ended.status]
    paid = problem.penalty is not None and status is Status.INFEASIBLE
    return Status.SOLVED if paid else status


def _with_wrapped_heading(problem: Problem, parameters: Parameters, guess: Guess) -> Guess:
    """Wrap the initial heading unless it is within pi of that of x_0."""
    where = problem.heading
    if where is None or abs(guess.states[0, where] - parameters.initial[where]) <= np.pi:
        return guess
    return unwrapped(problem, parameters, guess)


def with_auxiliaries(parameters: Parameters, guess: Guess) -> Guess:
    """Add the auxiliaries that the regularisation draws to where the guess has none."""
    drawn = [one.auxiliaries for one in parameters.slots]
    if [one.shape for one in guess.auxiliaries] == [one.shape for one in drawn]:
        return guess
    pairs = zip(guess.auxiliaries or drawn, drawn, strict=True)
    found = [one if one.shape == other.shape else other for one, other in pairs]
    own = tuple(found)
    return Guess(guess.states, guess.inputs, own, guess.level, guess.slack, guess.multipliers)


def _run(spaces: Sequence[Workspace], begin: float, deadline: float | None) -> None:
    """Call the core on what the arrays hold; a deadline is for a single workspace."""
    if deadline is not None:
        _until(begin + deadline, spaces[0])
    elif len(spaces) == 1:
        spaces[0].run()
    else:
        run_all(spaces)


def _until(end: float, space: Workspace) -> None:
    """Run, and ask the core to stop at a time; another thread sets the flag that it looks at."""
    stop = np.zeros(1, dtype=np.int64)  # of this call alone: the other thread may be late
    timer = Timer(max(end - perf_counter(), 0.0), stop.fill, (1,))
    timer.daemon = True
    timer.start()
    try:
        space.run(stop)
    finally:
        timer.cancel()


def _words(status: Status, ended: ResultTable) -> str:
    """How the solve ended, in words."""
    if status is Status.INFEASIBLE:
        return "no plan keeps every region; this one enters them least, as far as was found"
    words = f"{_NAMES[status]} after {ended.iterations} iterations"
    if status is Status.GIVEN_UP:
        return f"{words}: {_WHY.get(ended.status, 'it takes far longer than another')}"
    return f"{words}, error {ended.error:.1e}"

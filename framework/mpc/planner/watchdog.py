"""Calls of a solver within the time of a decision, in threads that can be left behind.

A solver is native code: nothing in Python can end it. So it is called in a thread of its own, and
where it does not return in time the caller goes on without it. The thread left behind runs on
until its call returns, or to the end of the process, which does not wait for it.

Threads are kept for the next call: handing a call over takes some tens of microseconds, and on a
virtual machine several hundred. A `BoundedSolver` needs no thread for a problem that it has
solved before, where there is no deadline. A call sees the caller's context variables (NumPy's
error state is one). On Linux it has the caller's right to the processor, a real-time priority too,
until it is left behind: then it is ordinary. Threads that it starts itself are ordinary.
"""

import os
from collections.abc import Callable, Sequence
from contextvars import copy_context
from dataclasses import dataclass
from functools import partial
from threading import TIMEOUT_MAX, Lock, Thread
from time import perf_counter
from typing import Any, TypeVar

import numpy as np

from ..ocp.transcription import Guess
from ..solver import BoundedSolver, Solution, Solver, on_time, solve_cheapest
from .instance import Instance

RESERVE = 0.1
"""Share of the deadline that is kept for checking the results and for falling back. A solver that
runs on is waited for during the first half of it."""

PATIENCE = 60.0
"""s that a solve may take where there is no deadline. A solver that has not returned by then is
left behind, and the plan comes from the next rung. Far more than solvers need: it changes nothing
but what would hold the loop."""

COMPILING = 10.0
"""The first use of a problem, which builds or compiles it, may take so many times `PATIENCE`."""

SAME = 2.0 / 3.0
"""Radii of the robot within which a further start leads to a plan that is known already. On the
other side of something a plan is farther away than the robot is wide."""

MOST_LEFT = 3
"""Threads left behind, in the whole process, with which another call is still begun: each that
calculates takes a core."""

T = TypeVar("T")


@dataclass(frozen=True)
class Budget:
    """Time of one call of the planner.

    Attributes
    ----------
    deadline : s, or None for no limit.
    begin : clock reading when the call came.
    """

    deadline: float | None
    begin: float

    @classmethod
    def start(cls, deadline: float | None) -> "Budget":
        """Begin to count."""
        return cls(deadline, perf_counter())

    def spent(self) -> float:
        """Return how long the call has taken, s."""
        return perf_counter() - self.begin

    def left(self) -> float:
        """Return what is left for solving, s; infinite without a deadline."""
        if self.deadline is None:
            return np.inf
        return (1.0 - RESERVE) * self.deadline - self.spent()

    def wait(self) -> float:
        """Return how much longer a solver is waited for, s; infinite without a deadline."""
        return self.left() + (0.0 if self.deadline is None else 0.5 * RESERVE * self.deadline)


class WatchedSolver:
    """Calls a planner's solver in a thread that is left behind where it does not return.

    Parameters
    ----------
    solver : the plug-in.
    """

    def __init__(self, solver: Solver) -> None:
        self._solver = solver
        self._name = type(solver).__name__
        self._used: set[str] = set()
        self._bounded: set[str] = set()

    @property
    def name(self) -> str:
        """What reasons call the solver."""
        return self._name

    def solve(
        self, instance: Instance, guesses: Sequence[Guess], budget: Budget
    ) -> list[Solution]:
        """Solve from each guess.

        With a deadline all of it, compilation included, may take what the budget has left.
        Without one `PATIENCE` counts, and more of it at the first use of a problem; later uses of
        a problem whose solves always end are calls like any other.

        Raises
        ------
        SolverTimeout, SolverRefused : there is no solution, see `watchdog.watched`.
        """
        call = partial(self._solver.solve, instance.problem, instance.asked, guesses)
        return self._watched(instance, call, len(guesses), budget)

    def solve_cheapest(
        self,
        instance: Instance,
        guesses: Sequence[Guess],
        known: Sequence[Solution],
        budget: Budget,
    ) -> list[Solution]:
        """Do the same, but give up what leads to no cheaper plan, see `solver.solve_cheapest`."""
        call = partial(
            solve_cheapest, self._solver, instance.problem, instance.asked, guesses, known,
            SAME * instance.robot.radius,
        )  # fmt: skip
        return self._watched(instance, call, len(guesses), budget)

    def _watched(
        self,
        instance: Instance,
        call: Callable[[float | None], list[Solution]],
        count: int,
        budget: Budget,
    ) -> list[Solution]:
        """Call with what is left of the time for each of ``count`` solves."""
        if budget.deadline is None:
            key = instance.problem.key
            if key in self._bounded:
                return call(None)
            patience = PATIENCE * (1.0 if key in self._used else COMPILING)
            self._used.add(key)
            solutions, solver = watched(partial(call, None), patience * count), self._solver
            if isinstance(solver, BoundedSolver) and solver.always_ends(instance.problem):
                self._bounded.add(key)
            return solutions
        begin, left = budget.spent(), max(budget.left(), 1e-3)
        found = watched(partial(call, left), max(budget.wait(), left))
        return [on_time(one, budget.spent() - begin, left) for one in found]


class SolverTimeout(Exception):
    """A call did not return in time."""


class SolverRefused(Exception):
    """Too many threads were left behind; the call was not begun."""


def left_behind() -> int:
    """Count the threads of this process that were left behind and still run."""
    return _left


def watched(call: Callable[[], T], limit: float) -> T:
    """Return what a call returns, or raise what it raises.

    Parameters
    ----------
    call : runs in another thread.
    limit : s by the clock; more than a thread can wait for, some centuries, counts as that.

    Raises
    ------
    SolverTimeout : it has not returned after ``limit``; it still runs.
    SolverRefused : `MOST_LEFT` earlier calls still run.
    """
    if _left >= MOST_LEFT:
        raise SolverRefused(
            f"is not asked: {_left} calls that did not return in time still run, and no other is "
            "begun until one ends"
        )
    with _LOCK:
        worker = _IDLE.pop() if _IDLE else None
    if worker is None:
        worker = _Worker()
    job = _Job(call)
    worker.begin(job)
    try:
        job.done.acquire(timeout=min(max(limit, 0.0), TIMEOUT_MAX))
    finally:  # also where the wait itself is interrupted
        over = _over(job, worker)
    if not over:
        raise SolverTimeout(f"did not return within {limit:.3g} s")
    if job.error is not None:
        raise job.error
    result: T = job.result
    return result


_LOCK = Lock()
_IDLE: "list[_Worker]" = []
_left = 0


class _Job:
    """A call, and what came of it."""

    def __init__(self, call: Callable[[], Any]) -> None:
        self.call, self.context = call, copy_context()
        self.result: Any = None
        self.error: BaseException | None = None
        self.over = self.left = False
        self.done = Lock()
        self.done.acquire()


class _Worker:
    """A thread that makes one call after the other."""

    def __init__(self) -> None:
        self._go = Lock()
        self._go.acquire()
        self._job: _Job | None = None
        self._thread = Thread(target=self._run, name="wideberth-watched", daemon=True)
        self._thread.start()

    def begin(self, job: _Job) -> None:
        """Make a call."""
        self._job = job
        self._go.release()

    def _run(self) -> None:
        global _left
        while True:
            self._go.acquire()
            job, self._job = self._job, None
            assert job is not None
            try:
                job.result = job.context.run(job.call)
            except BaseException as error:  # raised again where it was asked for
                job.error = error
            with _LOCK:
                job.over = True
                if job.left:
                    _left -= 1
                    _IDLE.append(self)
            job.done.release()
            del job  # while it waits it holds on to nothing


def _over(job: _Job, worker: _Worker) -> bool:
    """Whether a call has returned; otherwise its thread counts as left behind."""
    global _left
    with _LOCK:
        if job.over:
            _IDLE.append(worker)
        else:
            job.left = True
            _left += 1
        return job.over


def _forked() -> None:
    """Begin anew in a child process: no thread but the one that forked lives on there."""
    global _LOCK, _left
    _LOCK, _left = Lock(), 0
    _IDLE.clear()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_forked)

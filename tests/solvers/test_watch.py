"""A call that does not return is left behind, and what comes after it is not harmed."""

import ctypes
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextvars import ContextVar
from dataclasses import dataclass, field
from threading import Event, get_ident
from time import sleep
from typing import Any

import numpy as np
import pytest

from wideberth.framework.mpc.ocp.problem import Parameters, Problem
from wideberth.framework.mpc.ocp.transcription import Guess
from wideberth.framework.mpc.planner import watchdog as watch
from wideberth.framework.mpc.planner.cycle import PlannerState, Services, step
from wideberth.framework.mpc.planner.settings import changed
from wideberth.framework.mpc.planner.watchdog import (
    SolverRefused,
    SolverTimeout,
    left_behind,
    watched,
)
from wideberth.framework.mpc.solver import BoundedSolver, Solution, Solver
from wideberth.framework.values.motion import Observation
from wideberth.framework.values.plan import Plan, Rung, Status
from wideberth.solvers.casadi_program import Compiled, compiled
from wideberth.solvers.fatrop import Fatrop
from wideberth.tests.helpers.planning import STRAIGHT, at, planner


@pytest.fixture
def end() -> Iterator[Event]:
    """Let those who wait for it go on at the end of a test."""
    made = Event()
    yield made
    made.set()
    while left_behind():
        sleep(0.001)


def leave(end: Event) -> None:
    with pytest.raises(SolverTimeout, match="did not return"):
        watched(end.wait, 0.01)


def raising() -> None:
    raise KeyError("own")


def test_a_call_returns_what_it_returns_and_raises_what_it_raises() -> None:
    assert watched(lambda: 7, 60.0) == 7
    with pytest.raises(KeyError, match="own"):
        watched(raising, 60.0)
    assert left_behind() == 0


@pytest.mark.parametrize("limit", [1e11, 1e300, np.inf])
def test_a_limit_of_any_length_is_waited_for(limit: float) -> None:
    assert watched(lambda: 7, limit) == 7
    assert left_behind() == 0


def test_one_thread_serves_all_calls() -> None:
    idents = {watched(get_ident, 60.0) for _ in range(50)}
    assert len(idents) == 1 and get_ident() not in idents


def test_calls_see_the_callers_context() -> None:
    own: ContextVar[int] = ContextVar("own", default=0)
    own.set(3)
    assert watched(own.get, 60.0) == 3
    with np.errstate(divide="raise"):
        assert watched(np.geterr, 60.0)["divide"] == "raise"


def test_a_call_within_a_call() -> None:
    assert watched(lambda: watched(lambda: 5, 60.0), 60.0) == 5


def test_who_does_not_return_is_left_behind_and_counted(end: Event) -> None:
    leave(end)
    assert left_behind() == 1
    assert watched(lambda: 1, 60.0) == 1
    end.set()
    while left_behind():
        sleep(0.001)
    assert watched(lambda: 2, 60.0) == 2


def test_no_more_than_a_few_are_left_behind(end: Event) -> None:
    for _ in range(watch.MOST_LEFT):
        leave(end)
    with pytest.raises(SolverRefused, match=f"{watch.MOST_LEFT} calls"):
        watched(lambda: 1, 60.0)


# solvers


@dataclass(frozen=True)
class Asleep(Solver):
    """Solves until it is put to sleep, and then never returns."""

    end: Event
    native: bool = False
    asleep: list[int] = field(default_factory=list)

    def solve(
        self,
        problem: Problem,
        parameters: Parameters,
        guesses: Sequence[Guess],
        deadline: float | None = None,
    ) -> list[Solution]:
        while self.asleep and not self.end.is_set():
            if self.native:
                ctypes.CDLL(None).usleep(50_000)  # without Python's lock
            else:
                self.end.wait()
        return Fatrop().solve(problem, parameters, guesses, deadline)


class Cycle:
    """Planning cycles of one planner whose settings may change from call to call."""

    def __init__(self, **settings: Any) -> None:
        self.settings = planner(**settings)
        self.services = Services.of(self.settings)
        self.state = PlannerState.initial(self.settings, STRAIGHT)

    def plan(self, seen: Observation, **changes: Any) -> Plan:
        settings = changed(self.settings, **changes)
        self.state, decision = step(settings, self.state, seen, self.services)
        return decision.plan


@pytest.mark.parametrize("native", [False, True], ids=["python", "native"])
@pytest.mark.parametrize("limit", ["deadline", "patience"])
def test_a_solver_that_never_returns_does_not_hold_the_loop(
    native: bool, limit: str, end: Event, monkeypatch: pytest.MonkeyPatch
) -> None:
    solver = Asleep(end, native)
    long, short = ({"deadline": 60.0}, {"deadline": 0.3}) if limit == "deadline" else ({}, {})
    monkeypatch.setattr(watch, "PATIENCE", 3.0)
    made = Cycle(solver=solver, starts=(), **long)
    made.plan(at(0.0, 0.0))
    solver.asleep.append(1)
    plan = made.plan(at(0.5, 0.25), **short)
    assert (plan.rung, plan.status) == (Rung.SHIFTED, Status.DEADLINE)
    assert "Asleep did not return within" in plan.reason
    assert plan.violation <= 1e-4
    assert left_behind() == 1
    solver.asleep.clear()
    assert made.plan(at(1.0, 0.5), **long).rung is Rung.OPTIMAL


def test_with_too_many_left_behind_the_planner_drives_on_lower_rungs(end: Event) -> None:
    solver = Asleep(end)
    made = Cycle(solver=solver, starts=(), deadline=60.0)
    made.plan(at(0.0, 0.0))
    solver.asleep.append(1)
    for k in range(1, watch.MOST_LEFT + 2):
        plan = made.plan(at(0.5 * k, 0.25 * k), deadline=0.3)
    assert left_behind() == watch.MOST_LEFT
    assert plan.rung is Rung.SHIFTED
    assert "no other is begun until one ends" in plan.reason
    end.set()
    while left_behind():
        sleep(0.001)
    assert made.plan(at(3.0, 1.5)).rung is Rung.OPTIMAL


def test_who_is_left_behind_at_another_start_is_named(
    end: Event, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The first start is solved; the plan is taken, and says what it was not held against."""
    solver = Second(end)
    monkeypatch.setattr(watch, "PATIENCE", 3.0)
    made = planner(solver=solver, starts=("wait",))
    solver.asleep.append(1)
    made.command(at(0.0, 0.0))
    assert made.plan is not None
    assert made.plan.rung is Rung.OPTIMAL
    assert "from another start Second did not return" in made.plan.reason


@dataclass(frozen=True)
class Threads(BoundedSolver):
    """Notes the threads that it is called in."""

    ends: bool
    found: list[int] = field(default_factory=list)

    def always_ends(self, problem: Problem) -> bool:
        return self.ends

    def solve(
        self,
        problem: Problem,
        parameters: Parameters,
        guesses: Sequence[Guess],
        deadline: float | None = None,
    ) -> list[Solution]:
        self.found.append(get_ident())
        return Fatrop().solve(problem, parameters, guesses, deadline)


@pytest.mark.parametrize("ends", [True, False])
def test_a_solver_that_always_ends_needs_no_thread_once_it_has_solved(ends: bool) -> None:
    solver = Threads(ends)
    made = Cycle(solver=solver, starts=())
    solver.found.clear()
    for k in range(3):
        made.plan(at(0.5 * k, 0.25 * k))
    assert [one == get_ident() for one in solver.found] == [False, ends, ends]
    made.plan(at(1.5, 0.75), deadline=60.0)
    assert solver.found[3] != get_ident()


@dataclass(frozen=True)
class Second(Solver):
    """Solves once, and does not return from the second call."""

    end: Event
    asleep: list[int] = field(default_factory=list)

    def solve(
        self,
        problem: Problem,
        parameters: Parameters,
        guesses: Sequence[Guess],
        deadline: float | None = None,
    ) -> list[Solution]:
        if self.asleep:
            self.asleep.append(1)
            if len(self.asleep) == 3:
                self.end.wait()
        return Fatrop().solve(problem, parameters, guesses, deadline)


def test_a_program_in_use_is_not_shared(end: Event) -> None:
    """The thread left behind keeps its own; the next solve gets another."""
    made = planner()
    made.command(at(0.0, 0.0))
    problem = made.explain().problem()
    taken: list[Compiled] = []

    def hold() -> None:
        with compiled("fatrop", problem, {}, staged=True) as program:
            taken.append(program)
            end.wait()

    with pytest.raises(SolverTimeout):
        watched(hold, 0.5)
    with compiled("fatrop", problem, {}, staged=True) as second:
        assert second is not taken[0]
    with compiled("fatrop", problem, {}, staged=True) as third:
        assert third is second  # the returned one is used again


EXIT = """
import ctypes
from wideberth.framework.mpc.planner.watchdog import SolverTimeout, watched
for call in (lambda: ctypes.CDLL(None).sleep(1000), __import__("threading").Event().wait):
    try:
        watched(call, 0.1)
    except SolverTimeout as error:
        print(error)
"""


def test_a_process_ends_although_threads_were_left_behind() -> None:
    found = subprocess.run(
        [sys.executable, "-c", EXIT], capture_output=True, text=True, timeout=120, check=False
    )
    assert found.returncode == 0, found.stderr
    assert found.stdout.count("did not return") == 2 and not found.stderr


FORKED = """
import os
from threading import Event
from wideberth.framework.mpc.planner.watchdog import SolverTimeout, left_behind, watched

watched(int, 60.0)
try:
    watched(Event().wait, 0.01)
except SolverTimeout:
    assert left_behind() == 1
child = os.fork()
if not child:
    os._exit(0 if left_behind() == 0 and watched(lambda: 4, 30.0) == 4 else 1)
assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 0
os._exit(0)
"""


@pytest.mark.skipif(not hasattr(watch.os, "fork"), reason="no fork here")
def test_a_forked_process_begins_anew() -> None:
    """In a process of its own: libraries that other tests load warn of a fork among threads."""
    done = subprocess.run([sys.executable, "-c", FORKED], capture_output=True, timeout=120)
    assert done.returncode == 0, done.stderr.decode()

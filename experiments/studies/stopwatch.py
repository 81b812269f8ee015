"""A planner that reports how much processor time its solver took."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from time import process_time
from typing import final

from ...framework import Command, Controller, Observation, Path, Plan
from ...framework.controller import fresh
from ...framework.mpc.ocp.problem import Parameters, Problem
from ...framework.mpc.ocp.transcription import Guess
from ...framework.mpc.planner.planner import Planner
from ...framework.mpc.solver import CheapestSolver, Solution, Solver, solve_cheapest
from .variants import planner_of


class WatchedController(Controller):
    """Does what another controller does; what is noted of it is up to `command`."""

    watched: Controller

    @final
    def reset(self) -> None:
        """As the controller; what was noted stays."""
        self.watched.reset()

    @final
    def set_path(self, path: Path) -> None:
        """As the controller, which compiles and warms up here."""
        self.watched.set_path(path)

    @final
    def remember(self, observation: Observation) -> None:
        """As the controller."""
        self.watched.remember(observation)

    @final
    @property
    def last_plan(self) -> Plan | None:
        """The controller's."""
        return self.watched.last_plan


@final
@dataclass(eq=False)
class Stopwatch(WatchedController):
    """Does what a fresh copy of the planner does, and notes the seconds of each solve.

    An episode keeps the time of a whole call alone (forecast, reference and re-check
    included), beside which what a region adds to the solve would seem smaller than it is.
    Seconds are processor time of this process, not of the clock on the wall: what else the
    machine does in between is not a solver's.

    Parameters
    ----------
    planner : copied, so that every robot has its own.
    seconds : one entry is appended per plan that a solver had a part in; robots may share it.
    """

    planner: Planner
    seconds: list[float]

    def __post_init__(self) -> None:
        planner = planner_of(fresh(self.planner))
        self._laps: list[float] = []
        self.planner = replace(planner, solver=_Timed(planner.solver, self._laps))
        self.watched: Controller = self.planner
        self.period: float = planner.period

    def command(self, observation: Observation) -> Command:
        """As the planner."""
        self._laps.clear()
        command = self.planner.command(observation)
        if self._laps:
            self.seconds.append(sum(self._laps))
        return command


@final
@dataclass(frozen=True)
class _Timed(CheapestSolver):
    """Another solver, whose calls are timed; it gives starts up where that one does."""

    solver: Solver
    laps: list[float]

    def solve(
        self,
        problem: Problem,
        parameters: Parameters,
        guesses: Sequence[Guess],
        deadline: float | None = None,
    ) -> list[Solution]:
        """As the other solver."""
        return self._timed(partial(self.solver.solve, problem, parameters, guesses, deadline))

    def solve_cheapest(
        self,
        problem: Problem,
        parameters: Parameters,
        guesses: Sequence[Guess],
        known: Sequence[Solution],
        within: float,
        deadline: float | None = None,
    ) -> list[Solution]:
        """As the other solver."""
        given = self.solver, problem, parameters, guesses, known, within, deadline
        return self._timed(partial(solve_cheapest, *given))

    def _timed(self, solve: Callable[[], list[Solution]]) -> list[Solution]:
        begin = process_time()
        found = solve()
        self.laps.append(process_time() - begin)
        return found

"""A solved problem on record: in words, and as something to solve again."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ...framework.mpc.ocp.problem import Parameters, Problem
from ...framework.mpc.ocp.transcription import Guess
from ...framework.mpc.planner.cycle import ProblemCache, Solved
from ...framework.mpc.planner.settings import PlannerSettings
from ...framework.mpc.planner.verify import violation
from ...framework.mpc.planner.watchdog import SAME
from ...framework.mpc.slots.base import SlotSizes, farthest
from ...framework.mpc.slots.gaussian_discs import GaussianDiscs
from ...framework.mpc.solver import Solution, Solver, solve_cheapest
from ...framework.plugins.config import build, describe
from ...framework.plugins.registry import as_data
from ...framework.predictor import Predictor
from ...framework.region import Convex
from ...framework.values.errors import WideberthError
from ...framework.values.forecast import Forecast, Scene
from ...framework.values.plan import TOLERANCE, Status
from ...framework.values.tracks import Tracks
from ..slots.between_steps import ENTERED, entered_between

_ROWS = 8
"""Violations that are listed."""


@dataclass(frozen=True)
class PlanSummary:
    """The numbers and words of a plan, as in its `Plan`.

    Attributes
    ----------
    stamp : s, time of the plan's first state.
    status, rung, reason, iterations, seconds, violation, cost : of the plan. Seconds are those of
        the whole call.
    given_way : how the plan gave way, in words; empty where it did not.
    """

    stamp: float
    status: str
    rung: str
    reason: str
    iterations: int
    seconds: float
    violation: float
    cost: float
    given_way: str = ""


@dataclass(frozen=True, eq=False)
class SolveRecord:
    """One problem with its numbers, its starting points, and the plan that came of it.

    Attributes
    ----------
    planner : config of the planner, see `config.describe`; of its predictor the type alone.
    rooms : what the problem has room for, of each kind.
    key : hash of the problem's expressions.
    names : of its slots, kind by kind; "?" where empty.
    parameters : of the instance, as the solver was given them.
    guesses : what was solved from.
    point : the plan taken, auxiliaries and level included.
    verdict : what the planner said of it.
    ends : how the solve from each starting point ended, in words; empty in older records.
    """

    planner: dict[str, Any]
    rooms: tuple[SlotSizes, ...]
    key: str
    names: tuple[str, ...]
    parameters: Parameters
    guesses: tuple[Guess, ...]
    point: Guess
    verdict: PlanSummary
    ends: tuple[str, ...] = ()

    @classmethod
    def of(cls, settings: PlannerSettings, solved: Solved) -> "SolveRecord":
        """Write down what a planner of these settings solved."""
        config = {"type": "mpc", **describe(settings), "record": None}
        config["predictor"] = _name(config["predictor"])
        plan, instance = solved.plan, solved.instance
        verdict = PlanSummary(
            stamp=plan.stamp,
            status=str(plan.status),
            rung=str(plan.rung),
            reason=plan.reason,
            iterations=plan.iterations,
            seconds=solved.seconds,
            violation=plan.violation,
            cost=plan.cost,
            given_way="" if plan.given_way is None else str(plan.given_way),
        )
        return cls(
            config,
            tuple(one.room for one in instance.around.chosen),
            instance.problem.key,
            instance.names,
            instance.asked,
            solved.guesses,
            solved.point,
            verdict,
            solved.ends,
        )

    def problem(self) -> Problem:
        """Assemble the problem again.

        Raises
        ------
        WideberthError : a plug-in that is not known here, or one that makes another problem now.
        """
        problem = ProblemCache(self._planner()).of(self.rooms)
        if problem.key != self.key:
            raise WideberthError(
                "the problem assembled from the recorded settings is another one than was solved: "
                "package or plug-ins have changed since; use the version that wrote the file"
            )
        return problem

    def again(self, solver: Solver | str | None = None) -> list[Solution]:
        """Solve from each recorded starting point; give up again where one was given up.

        Parameters
        ----------
        solver : another one, or its name; the recorded one by default.
        """
        settings = self._planner()
        own: Solver = settings.solver if solver is None else build("solvers", solver)
        given = own, self.problem(), self.parameters
        if not any(end.startswith(Status.GIVEN_UP) for end in self.ends):
            return own.solve(*given[1:], self.guesses)
        first = own.solve(*given[1:], self.guesses[:1])
        within = SAME * settings.robot.radius
        return first + solve_cheapest(*given, self.guesses[1:], first, within)

    def __repr__(self) -> str:
        """Say which plan it is and how it came about; `text` says why."""
        found, starts = self.verdict, len(self.guesses)
        words = f"plan at {found.stamp:g} s: {found.rung}, solver: {found.status}"
        counts = f"{starts} start{'s' * (starts != 1)}, {found.iterations} iterations"
        return f"SolveRecord({words}; {counts}; text() says why)"

    def text(self) -> str:
        """Say what happened: rung, reason, sizes, and what the plan taken breaks."""
        found, config = self.verdict, self.planner
        plugs = ", ".join(_name(config[key]) for key in ("robot", "region", "level", "solver"))
        first = (found.rung, found.given_way, f"solver: {found.status}")
        lines = [
            f"plan at {found.stamp:g} s: {'; '.join(filter(None, first))}",
            f"why: {found.reason or 'nothing went wrong'}",
            f"{len(self.guesses)} starts, {found.iterations} iterations, "
            f"{1e3 * found.seconds:.1f} ms for the call; cost {found.cost:.6g}, "
            f"largest violation {found.violation:.3g}",
            *(
                f"start {number} was {end}"
                for number, end in enumerate(self.ends, start=1)
                if end.startswith(Status.GIVEN_UP)
            ),
        ]
        sizes = f"{plugs}; N = {len(self.point.inputs)}"
        try:
            slots = zip(self.problem().slots, self.parameters.slots, strict=True)
        except WideberthError as error:
            return "\n".join([*lines, sizes, f"the problem cannot be assembled: {error}"])
        counts = ", ".join(
            f"{int(own.active.sum())} {one.name}s in {one.count} slots" for one, own in slots
        )
        return "\n".join([*lines, f"{sizes}, {counts}", *self._broken(), *self._between()])

    def _broken(self) -> list[str]:
        """Table of what the plan taken breaks, worst first."""
        found = violation(self.problem(), self.parameters, self.point)
        rows = [
            (float(entered.max()), f"region of {name!r}", int(entered.argmax()) + 1)
            for name, entered in zip(self.names, found.regions.T, strict=True)
        ]
        motion = int(found.motion.argmax())
        rows.append((float(found.motion[motion]), "motion limits", motion + 1))
        broken = sorted((row for row in rows if row[0] > TOLERANCE), reverse=True)
        if not broken:
            level = ", at the level to which it gave way" if self.verdict.given_way else ""
            return [f"the plan taken keeps every constraint of the problem{level}"]
        table = [f"  {what} by {amount:.3g} at step {step}" for amount, what, step in broken]
        return ["the plan taken breaks, each at its worst step:", *table[:_ROWS]]

    def _between(self) -> list[str]:
        """Say which region the plan taken enters most between two steps, if it does."""
        settings, numbers, point = self._planner(), self.parameters.slots[0], self.point
        kind, robot = settings.kinds[0], settings.robot
        if not (isinstance(kind, GaussianDiscs) and isinstance(kind.region, Convex)):
            return []
        if numbers.level is None or robot.dimension != 2 or farthest(kind.bodies(robot)) > 0.0:
            return []
        held = numbers.level if np.isnan(point.level) else np.full_like(numbers.level, point.level)
        places = robot.pose(tuple(point.states[:, : len(robot.states)].T)).points()
        depth = entered_between(kind.region, places, numbers.parameters, held) * numbers.active
        if depth.max(initial=0.0) <= ENTERED:
            return []
        step, slot = divmod(int(depth.argmax()), depth.shape[1])
        name = self.names[slot]
        return [
            f"between its steps it enters the region of {name!r} by {depth.max():.2g} m, on the "
            f"way to step {step + 2}"
        ]

    def _planner(self) -> PlannerSettings:
        unknown = f"{NotKept.__module__}:{NotKept.__qualname__}"
        config = {**self.planner, "predictor": unknown}
        config.pop("record", None)
        with as_data():
            made = build("controllers", config)
        if not isinstance(made, PlannerSettings):
            raise WideberthError(
                f"the recorded planner is {_name(config)!r}; wanted the settings of an mpc planner"
            )
        return made


def compared(solve: SolveRecord, solutions: Sequence[Solution]) -> list[str]:
    """One line per starting point: how solving again ended."""
    problem = solve.problem()
    lines = []
    for number, one in enumerate(solutions, start=1):
        worst = violation(problem, solve.parameters, one.point).worst
        lines.append(
            f"  start {number}: {one.status} ({one.message}), cost {one.cost:.6g}, largest "
            f"violation {worst:.3g}, {one.iterations} iterations, {1e3 * one.seconds:.1f} ms"
        )
    return lines


@dataclass(frozen=True)
class NotKept(Predictor):
    """Stands for the predictor of a recorded solve: the problem holds what it forecast."""

    def predict(self, tracks: Tracks, steps: int, scene: Scene | None = None) -> Forecast:
        """Refuse."""
        raise WideberthError("a recorded solve keeps the forecast, not the predictor")


def _name(config: Any) -> str:
    return str(config["type"]) if isinstance(config, dict) else str(config)

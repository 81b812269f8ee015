"""What one call of the planner solved and what came of it, in words and as something to repeat."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from ...plugins.config import build, describe
from ...predictor import Predictor
from ...values.errors import WideberthError
from ...values.plan import Plan
from ...values.tracks import Tracks
from ..fallback.instance_check import TOLERANCE, InstanceCheck
from ..fallback.verify import violation
from ..ocp.problem import Parameters, Problem
from ..ocp.transcription import Guess
from ..planner.problem_cache import ProblemCache
from ..slots.base import Room
from ..solvers.base import Solution, Solver

if TYPE_CHECKING:
    from ...values.forecast import Forecast, Scene
    from ..planner.planner import Planner

_ROWS = 8
"""Violations that are listed."""


@dataclass(frozen=True)
class Verdict:
    """What the planner made of a solve, as in its `Plan`.

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
class Solve:
    """One problem with its numbers, its starting points, and the plan that came of it.

    Attributes
    ----------
    planner : config of the planner, see `config.describe`; of its predictor the type alone.
    rooms : what the problem has room for, of each kind.
    key : hash of the problem's expressions.
    names : of its slots, kind by kind; "?" where empty.
    parameters : of the instance.
    guesses : what was solved from.
    point : the plan taken, auxiliaries and level included.
    verdict : what the planner said of it.
    """

    planner: dict[str, Any]
    rooms: tuple[Room, ...]
    key: str
    names: tuple[str, ...]
    parameters: Parameters
    guesses: tuple[Guess, ...]
    point: Guess
    verdict: Verdict

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
        """Solve from each recorded starting point.

        Parameters
        ----------
        solver : another one, or its name; the recorded one by default.
        """
        own: Solver = self._planner().solver if solver is None else build("solvers", solver)
        return own.solve(self.problem(), self.parameters, self.guesses)

    def text(self) -> str:
        """Say what happened: rung, reason, sizes, and what the plan taken breaks."""
        found, config = self.verdict, self.planner
        slots = zip(self.problem().slots, self.parameters.slots, strict=True)
        counts = ", ".join(
            f"{int(own.active.sum())} {one.name}s in {one.count} slots" for one, own in slots
        )
        plugs = ", ".join(_name(config[key]) for key in ("robot", "region", "level", "solver"))
        first = (found.rung, found.given_way, f"solver: {found.status}")
        lines = [
            f"plan at {found.stamp:g} s: {'; '.join(filter(None, first))}",
            f"why: {found.reason or 'nothing went wrong'}",
            f"{len(self.guesses)} starts, {found.iterations} iterations, "
            f"{1e3 * found.seconds:.1f} ms for the call; cost {found.cost:.6g}, "
            f"largest violation {found.violation:.3g}",
            f"{plugs}; N = {len(self.point.inputs)}, {counts}",
        ]
        return "\n".join([*lines, *self._broken()])

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

    def _planner(self) -> "Planner":
        unknown = f"{NotKept.__module__}:{NotKept.__qualname__}"
        config = {**self.planner, "predictor": unknown}
        config.pop("record", None)
        made: Planner = build("controllers", config)
        return made


@dataclass(frozen=True, eq=False)
class Decision:
    """What a planner has at hand after a call; `solve` makes something to keep of it.

    Attributes
    ----------
    check, rooms : what was solved. guesses : from where.
    point : the plan taken, as the problem states it. plan : as the planner hands it out.
    seconds : of the call.
    """

    check: InstanceCheck
    rooms: tuple[Room, ...]
    guesses: tuple[Guess, ...]
    point: Guess
    plan: Plan
    seconds: float

    def solve(self, planner: "Planner") -> Solve:
        """Write down what the planner solved."""
        config = describe(replace(planner, record=None))
        config["predictor"] = _name(config["predictor"])
        plan = self.plan
        verdict = Verdict(
            stamp=plan.stamp,
            status=str(plan.status),
            rung=str(plan.rung),
            reason=plan.reason,
            iterations=plan.iterations,
            seconds=self.seconds,
            violation=plan.violation,
            cost=plan.cost,
            given_way="" if plan.given_way is None else str(plan.given_way),
        )
        check = self.check
        return Solve(
            config,
            self.rooms,
            check.problem.key,
            check.names,
            check.parameters,
            self.guesses,
            self.point,
            verdict,
        )


def compared(solve: Solve, solutions: Sequence[Solution]) -> list[str]:
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

    def predict(self, tracks: Tracks, steps: int, scene: "Scene | None" = None) -> "Forecast":
        """Refuse."""
        raise WideberthError("a recorded solve keeps the forecast, not the predictor")


def _name(config: Any) -> str:
    return str(config["type"]) if isinstance(config, dict) else str(config)

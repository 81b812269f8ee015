"""Answer of the planner to an instance: several starts, a deadline and the fallback ladder."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from time import perf_counter
from typing import final

import numpy as np

from wideberth.framework.mpc.levels.relaxed import Relaxed
from wideberth.framework.mpc.ocp.problem import Parameters, Problem
from wideberth.framework.mpc.ocp.transcription import Guess
from wideberth.framework.mpc.planner.instance import Instance
from wideberth.framework.mpc.planner.multistart import MultiStart
from wideberth.framework.mpc.planner.rollout import follow
from wideberth.framework.mpc.planner.rungs import RUNGS, LadderInput, choose, rungs_of
from wideberth.framework.mpc.planner.starts import at_target
from wideberth.framework.mpc.planner.watchdog import Budget, WatchedSolver
from wideberth.framework.mpc.slots.base import ActiveObstacles, SlotAssignment
from wideberth.framework.mpc.slots.gaussian_discs import GaussianDiscs, KnownDiscs, ObstacleSet
from wideberth.framework.mpc.solver import Solution, Solver
from wideberth.framework.plugins.config import build
from wideberth.framework.values.plan import Rung, Status


@final
@dataclass(frozen=True)
class PlannerAnswer(Solver):
    """Solves as the planner does, and returns the plan that it would take.

    The guess's inputs are its last plan, which it drives from the present state: of the guess
    itself nothing else is used. The plan counts as solved on the ladder's first rung alone.

    Parameters
    ----------
    solver : of the planner.
    """

    solver: Solver

    def solve(
        self,
        problem: Problem,
        parameters: Parameters,
        guesses: Sequence[Guess],
        deadline: float | None = None,
    ) -> list[Solution]:
        """Plan from each guess, for the paper's robot and region."""
        return [self._plan(problem, parameters, guess, deadline) for guess in guesses]

    def _plan(
        self, problem: Problem, parameters: Parameters, guess: Guess, deadline: float | None
    ) -> Solution:
        budget = Budget.start(deadline)
        robot = build("robots", "unicycle")
        discs = GaussianDiscs(build("regions", "mahalanobis_ellipse"))
        level, inputs = Relaxed(weight=1.0, minimum=0.0), guess.inputs
        obstacles, numbers = _obstacles(parameters, robot.radius), parameters.slots[0]
        known = KnownDiscs(discs, obstacles, 0.0)
        chosen = SlotAssignment((len(obstacles),), obstacles.ids, (), numbers, known)
        around = ActiveObstacles(robot, (discs,), (chosen,))
        instance = Instance(problem, parameters, around, level, inputs)
        states = follow(robot, parameters.initial, inputs, problem.dt)
        first = at_target(instance, states, inputs)
        instance = replace(instance, parameters=first.pull(parameters))
        outcome = MultiStart(WatchedSolver(self.solver), "auto", budget).run(
            instance, first, False
        )
        plan, point = choose(rungs_of(list(RUNGS)), LadderInput(instance, outcome), 0.0)
        status = Status.SOLVED if plan.rung is Rung.OPTIMAL else Status.FAILED
        spent = perf_counter() - budget.begin
        return Solution(point, status, plan.reason, plan.cost, plan.iterations, spent)


def _obstacles(parameters: Parameters, radius: float) -> ObstacleSet:
    """Read the discs out of the parameters of their ellipses: mean first, margin last."""
    numbers = parameters.slots[0].parameters
    mean, margin = numbers[..., :2], numbers[0, :, -1]
    names = tuple(f"{i}" for i in range(numbers.shape[1]))
    covariance = np.zeros((*mean.shape, 2))
    return ObstacleSet(mean, covariance, np.maximum(margin - radius, 0.0), names)

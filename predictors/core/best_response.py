"""Rounds of best responses: each agent plans against the last plans of all others."""

from dataclasses import dataclass

import numpy as np

from ...framework.mpc.planner.best_response import BestResponsePlanner, Player
from ...framework.values.arrays import Array
from ...framework.values.forecast import Forecast
from .social_rollout import RobotCourse


@dataclass(frozen=True, eq=False)
class PlayedGame:
    """Result of the game, per agent.

    Attributes
    ----------
    bent : (A, N, 2), m, how much the others change each agent's way.
    unsettled : (A, N, 2), m, half of what the last round would still have changed.
    failures : index of the agent -> why no plan was found for it.
    """

    bent: Array
    unsettled: Array
    failures: dict[int, str]


@dataclass(frozen=True, eq=False)
class Table:
    """Agents of the game; the robot is agent 0, agent i is the obstacle in row ``rows[i - 1]``.

    Attributes
    ----------
    responder : plans for each of them.
    agents : (A,).
    rows : (A - 1,), where the obstacles stand in ``straight``.
    straight : forecast of all obstacles alone.
    grid : (N,), s, its steps.
    """

    responder: BestResponsePlanner
    agents: tuple[Player, ...]
    rows: tuple[int, ...]
    straight: Forecast
    grid: Array

    def play(self, iterations: int) -> PlayedGame:
        """Compute all best responses to the last round at once, and move half the way to them.

        An agent for which no plan is found keeps its way, and is still seen by the others;
        nothing bends the forecast of one that found none in the last round, nor any without the
        robot's plan there.
        """
        count, steps = len(self.agents), len(self.grid)
        bent, step = np.zeros((2, count, steps, 2))
        alone = [self._plan(agent, None, ()) for agent in self.agents]
        failures = {i: found for i, found in enumerate(alone) if isinstance(found, str)}
        if 0 in failures:
            return PlayedGame(bent, step, failures)
        for _ in range(iterations):
            for i, base in enumerate(alone):
                if isinstance(base, str):
                    continue
                found = self._answer(i, np.asarray(alone[0]) + bent[0], bent)
                if isinstance(found, str):
                    failures[i], step[i] = found, 0.0
                else:
                    failures.pop(i, None)
                    step[i] = found - base - bent[i]
            bent = bent + 0.5 * step
        without = list(range(count)) if 0 in failures else list(failures)
        bent[without], step[without] = 0.0, 0.0
        return PlayedGame(bent, 0.5 * step, failures)

    def _answer(self, index: int, robot: Array, bent: Array) -> Array | str:
        """Best response of one agent to the others, on the time grid.

        To an obstacle the robot is as uncertain as the obstacle is to the robot.
        """
        others = [i for i in range(1, len(self.agents)) if i != index]
        rows = [self.rows[i - 1] for i in others]
        straight = self.straight
        mean = straight.mean[rows] + bent[others][:, None]
        covariance, weight = straight.covariance[rows], straight.weight[rows]
        if index:
            own = self.rows[index - 1]
            mean = np.concatenate([np.broadcast_to(robot, (1, *mean.shape[1:])), mean])
            covariance = np.concatenate([straight.covariance[[own]], covariance])
            weight = np.concatenate([straight.weight[[own]], weight])
            others = [0, *others]
        expected = Forecast(mean, covariance, weight, straight.dt, (None,) * len(others))
        radii = tuple(self.agents[i].radius for i in others)
        return self._plan(self.agents[index], expected, radii)

    def _plan(
        self, agent: Player, others: Forecast | None, radii: tuple[float, ...]
    ) -> Array | str:
        found = self.responder.respond(agent, others, radii)
        return found if isinstance(found, str) else RobotCourse(*found, 0.0).at(self.grid)[0]

"""Manoeuvres as the solver's start, and plans with the costs of a judge."""

import numpy as np

from ...values.arrays import altered
from ..ocp.transcription import Guess
from ..problem_robot import with_carried
from .expected_contact import Judge
from .instance import Instance
from .manoeuvres import SLOWING, driven
from .multistart import MultiStartResult
from .starts import suited_each
from .verify import Candidate, verify_each


def best_manoeuvre(judge: Judge, instance: Instance, first: Guess) -> Guess:
    """Return the best of all manoeuvres and of the last plan, as a start of the solver."""
    robot, problem, size = judge.robot, instance.problem, len(judge.robot.states)
    start = instance.parameters.initial[:size]
    ahead = judge.arc + judge.speed * (problem.horizon * problem.dt + 2.0 * SLOWING)
    target = judge.path.at(np.array(ahead))
    states, inputs = driven(robot, start, target, judge.speed, problem.horizon, problem.dt)
    states = np.concatenate([first.states[None, :, :size], states])
    costs = judge.costs(states)
    best = int(costs.argmin())
    if best == 0:
        return first
    guess = Guess.bare(states[best], inputs[best - 1], instance.target)
    guess = with_carried(instance.robot, guess, instance.parameters, problem.dt)
    return suited_each(instance, [guess])[0]


def judged(judge: Judge, instance: Instance, outcome: MultiStartResult) -> MultiStartResult:
    """Price the solutions and the manoeuvre solved from; the cheapest alone goes on."""
    start = outcome.guesses[0]
    found = verify_each(instance, [start])[0]
    every = [*outcome.candidates, Candidate(start, found, way="manoeuvre")]
    size = len(judge.robot.states)
    costs = judge.costs(np.array([one.point.states[:, :size] for one in every]))
    priced = tuple(altered(one, cost=float(cost)) for one, cost in zip(every, costs, strict=True))
    best = min(priced, key=lambda one: np.inf if np.isnan(one.cost) else one.cost)
    return altered(outcome, candidates=(best,))

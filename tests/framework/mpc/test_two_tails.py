"""Plans with two tails: against the plain plan, against the tree stated anew, and at the ends."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from wideberth.framework.mpc.fallback.verify import violation
from wideberth.framework.mpc.levels.fixed import Fixed
from wideberth.framework.mpc.ocp.problem import Parameters, Problem
from wideberth.framework.mpc.ocp.reference import lay_reference
from wideberth.framework.mpc.ocp.transcription import Guess
from wideberth.framework.mpc.ocp.two_tails import Tails, two_tails
from wideberth.framework.mpc.slots.gaussian_discs import Obstacles
from wideberth.framework.mpc.solvers.base import Solution, Solver
from wideberth.framework.mpc.solvers.ipopt import Ipopt
from wideberth.framework.mpc.solvers.riccati.solver import Riccati
from wideberth.framework.numerics.symbolic import ca
from wideberth.framework.values.errors import WideberthError
from wideberth.framework.values.path import Path
from wideberth.framework.values.plan import Status
from wideberth.regions import MahalanobisEllipse
from wideberth.robots import Unicycle
from wideberth.tests.helpers.problems import assemble, fill, with_auxiliaries

ROBOT, REGION, LEVEL = Unicycle(), MahalanobisEllipse(), Fixed()
N, DT, HEAD = 12, 0.5, 3
START = np.array([0.0, 0.0, 0.0, 0.5, 0.0])
REFERENCE = lay_reference(Path(np.array([[0.0, 0.0], [20.0, 0.0]])), 0.0, 0.5, N, DT)
SOLVERS = {"ipopt": Ipopt(), "riccati": Riccati()}


def instance(*ways: tuple[float, float, float]) -> tuple[Problem, Parameters, Guess]:
    """Make an instance among people who come from x and y, m, and go along y at a speed, m/s."""
    time = DT * np.arange(1, N + 1)
    mean = np.empty((N, len(ways), 2))
    for k, (x, y, v) in enumerate(ways):
        mean[:, k, 0], mean[:, k, 1] = x, y + v * time
    spread = 0.02 * np.tile(np.eye(2), (N, len(ways), 1, 1))
    names = tuple(str(k) for k in range(len(ways)))
    obstacles = Obstacles(mean, spread, np.full(len(ways), 0.3), names)
    room = len(ways)
    given = fill(START, REFERENCE, obstacles, REGION, LEVEL, ROBOT.radius, room)
    problem = assemble(ROBOT, REGION, LEVEL, horizon=N, dt=DT, capacity=room, penalty=1e4)
    states = np.tile(START, (N + 1, 1))
    states[:, 0] += 0.5 * DT * np.arange(N + 1)
    guess = Guess.bare(states, np.zeros((N, 2)), float("nan"))
    return problem, given, with_auxiliaries(ROBOT, REGION, given, guess)


WAITS = instance((2.0, 1.6, -0.05))
"""Somebody who makes way, aside of the path."""
COMES = instance((2.0, 1.6, -0.5))
"""Somebody who crosses it."""


def solved(
    solver: Solver,
    first: tuple[Problem, Parameters, Guess],
    second: tuple[Problem, Parameters, Guess],
    share: float,
    head: int = HEAD,
) -> tuple[Guess, Guess, Solution, Tails]:
    tails = Tails(two_tails(first[0], second[0]), first[1], second[1], share, head)
    found = solver.solve(tails.problem, tails.parameters, [tails.guess(first[2], second[2])])[0]
    assert found.status is Status.SOLVED, found.message
    return *tails.cut(found.point), found, tails


def alone(one: tuple[Problem, Parameters, Guess]) -> Solution:
    found = Ipopt().solve(one[0], one[1], [one[2]])[0]
    assert found.status is Status.SOLVED
    return found


@pytest.mark.parametrize("name", SOLVERS)
def test_where_both_futures_are_the_same_the_plan_is_the_ordinary_one(name: str) -> None:
    plain = alone(COMES)
    for share in (0.3, 0.9):
        *both, found, _ = solved(SOLVERS[name], COMES, COMES, share)
        assert found.cost == pytest.approx(plain.cost, rel=1e-5)
        for one in both:
            assert one.states == pytest.approx(plain.point.states, abs=2e-3)


def tree(first: Any, second: Any, share: float, head: int) -> float:
    """Solve the tree stated anew: one variable for each shared input, a branch for each tail."""
    opti, problem = ca.Opti(), first[0]
    shared, cost = opti.variable(problem.inputs, head), 0.0
    slack = opti.variable(problem.horizon)
    opti.subject_to(slack >= 0.0)
    for (own, given, guess), weight in ((first, share), (second, 1.0 - share)):
        stages, x, rest = given.stages(), ca.DM(given.initial), None
        rest = opti.variable(problem.inputs, problem.horizon - head)
        for i in range(problem.horizon):
            u = shared[:, i] if i < head else rest[:, i - head]
            plain, numbers = own.cut(ca.DM(stages[i]))
            cost += weight * own.input_cost(x, u, plain)
            following = opti.variable(problem.states)
            opti.subject_to(following == own.dynamics(x, u))
            opti.set_initial(following, guess.states[i + 1])
            x = following
            cost += weight * own.state_cost(x, plain)
            bounded = ((x, own.state_bounds), (u, own.input_bounds))
            for values, bounds in bounded:
                for k, (low, high) in enumerate(zip(bounds.lower, bounds.upper, strict=True)):
                    if np.isfinite(low):
                        opti.subject_to(opti.bounded(low, values[k], high))
            rows = own.slots[0].all_of(x, ca.DM(0, 1), ca.DM(0, 1), numbers[0])[0]
            opti.subject_to(rows + slack[i] >= 0.0)
    opti.minimize(cost + 1e4 * ca.sum1(slack))
    opti.solver("ipopt", {"print_time": False}, {"print_level": 0, "sb": "yes", "tol": 1e-9})
    return float(opti.solve().value(opti.f))


@pytest.mark.parametrize("share", [0.2, 0.8])
@pytest.mark.parametrize("name", SOLVERS)
def test_the_cost_is_that_of_the_tree_stated_anew(name: str, share: float) -> None:
    *_, found, _ = solved(SOLVERS[name], WAITS, COMES, share)
    assert found.cost == pytest.approx(tree(WAITS, COMES, share, HEAD), rel=1e-5)


@pytest.mark.parametrize("name", SOLVERS)
def test_a_certain_future_gives_its_own_plan(name: str) -> None:
    """The other tail costs nothing; here it can still keep clear after the common beginning."""
    for share, wanted in ((1.0, WAITS), (0.0, COMES)):
        *tails, found, _ = solved(SOLVERS[name], WAITS, COMES, share, head=1)
        plain = alone(wanted)
        assert found.cost == pytest.approx(plain.cost, rel=1e-4, abs=1e-2)
        own = tails[0] if share else tails[1]
        assert own.states == pytest.approx(plain.point.states, abs=5e-3)


@pytest.mark.parametrize("name", SOLVERS)
@pytest.mark.parametrize("head", [1, 4])
def test_both_tails_have_one_beginning_and_keep_their_own_regions(name: str, head: int) -> None:
    first, second, _, _ = solved(SOLVERS[name], WAITS, COMES, 0.6, head)
    assert np.array_equal(first.inputs[:head], second.inputs[:head])
    assert np.array_equal(first.states[: head + 1], second.states[: head + 1])
    assert np.abs(first.inputs[head:] - second.inputs[head:]).max() > 1e-2
    for point, (problem, given, _) in ((first, WAITS), (second, COMES)):
        assert violation(problem, given, point).worst < 1e-4


def test_different_numbers_of_slots_fit_together() -> None:
    two = instance((2.0, 1.6, -0.5), (3.5, -1.0, 0.1))
    first, second, _, tails = solved(Riccati(), WAITS, two, 0.5)
    assert tails.problem.slots[0].count == 3
    assert violation(two[0], two[1], second).worst < 1e-4
    assert violation(WAITS[0], WAITS[1], first).worst < 1e-4


def test_what_does_not_fit_together_is_refused() -> None:
    moved = replace(COMES[1], initial=START + 1.0)
    problem = two_tails(WAITS[0], COMES[0])
    with pytest.raises(WideberthError, match="wanted one state"):
        Tails(problem, WAITS[1], moved, 0.5, 2)
    with pytest.raises(WideberthError, match=r"tails.share is 2"):
        Tails(problem, WAITS[1], COMES[1], 2.0, 2)
    with pytest.raises(WideberthError, match=r"tails.head is 0"):
        Tails(problem, WAITS[1], COMES[1], 0.5, 0)
    with pytest.raises(WideberthError, match="differ in robot"):
        two_tails(WAITS[0], replace(COMES[0], horizon=N + 1))

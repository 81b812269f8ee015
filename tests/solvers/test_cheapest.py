"""Starts that lead to no cheaper plan are given up; solves from all of them are the oracle."""

import ctypes
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from wideberth.benchmarks.recorded_instances import Instance, read_instances
from wideberth.framework.mpc.levels.paper import Paper
from wideberth.framework.mpc.ocp.problem import Problem
from wideberth.framework.mpc.ocp.transcription import Guess
from wideberth.framework.mpc.planner.starts import other_starts
from wideberth.framework.mpc.planner.watchdog import SAME
from wideberth.framework.mpc.solver import (
    CheapestSolver,
    Solution,
    enters,
    pressed,
    solve_cheapest,
)
from wideberth.framework.values.arrays import address
from wideberth.framework.values.errors import WideberthError
from wideberth.framework.values.plan import Status
from wideberth.regions.mahalanobis_ellipse import MahalanobisEllipse
from wideberth.robots.unicycle import Unicycle
from wideberth.solvers.fatrop import Fatrop
from wideberth.solvers.riccati import solver
from wideberth.solvers.riccati.solver import Riccati
from wideberth.solvers.riccati.workspace import KindTable, ProblemTable, SettingsTable
from wideberth.tests.helpers.problems import assemble
from wideberth.tests.helpers.riccati_parts import Parts, compile_parts

SAMPLE = Path(__file__).parents[1] / "data" / "mpc_instances.npz"
ROBOT = Unicycle()
WITHIN = SAME * ROBOT.radius


WB_SAME = 5
"""Of enum wb_status in riccati.h."""


@pytest.fixture(scope="module")
def library(tmp_path_factory: pytest.TempPathFactory) -> Any:
    return compile_parts(tmp_path_factory.mktemp("parts"))


@pytest.fixture(scope="module")
def recorded() -> list[Instance]:
    return list(read_instances(SAMPLE, MahalanobisEllipse()))


def problem_for(one: Instance) -> Problem:
    level = Paper(tail=float(np.exp(-5.991 / 2)))
    sizes = {"horizon": 15, "dt": 0.5, "capacity": one.obstacles}
    return assemble(ROBOT, MahalanobisEllipse(), level, **sizes)


def others(one: Instance) -> list[Guess]:
    return other_starts(ROBOT, problem_for(one), one.parameters, one.guess)


def solved(one: Instance, guesses: Sequence[Guess]) -> list[Solution]:
    return Riccati().solve(problem_for(one), one.parameters, guesses)


def raced(
    one: Instance, guesses: Sequence[Guess], known: Sequence[Solution], within: float = WITHIN
) -> list[Solution]:
    return Riccati().solve_cheapest(problem_for(one), one.parameters, guesses, known, within)


def cost(solutions: Sequence[Solution]) -> float:
    return min(one.cost for one in solutions if one.status is Status.SOLVED)


def test_the_cheapest_plan_is_that_of_full_solves_in_fewer_iterations(
    recorded: list[Instance],
) -> None:
    words, spent, full = set(), 0, 0
    for one in recorded:
        starts = others(one)
        every = solved(one, [one.guess, *starts])
        first = solved(one, [one.guess])
        found = first + raced(one, starts, first)
        assert len(found) == len(every)
        assert cost(found) <= cost(every) + 1e-3 * (1.0 + abs(cost(every)))
        for own, other in zip(found, every, strict=True):
            if own.status is Status.GIVEN_UP:
                assert own.point.multipliers is None
                words.add(own.message.partition(": ")[2])
            else:  # as alone, to the byte
                assert (own.status, own.cost) == (other.status, other.cost)
                np.testing.assert_array_equal(own.point.states, other.point.states)
        spent += sum(one.iterations for one in found)
        full += sum(one.iterations for one in every)
    assert words == {
        "it leads to the same plan as another",
        "it leads to a dearer plan than another",
        "it takes far longer than another",
    }
    assert spent < 0.6 * full


def test_where_no_region_presses_no_other_start_saves_anything(recorded: list[Instance]) -> None:
    counts = {True: 0, False: 0}
    for one in recorded:
        every = solved(one, [one.guess, *others(one)])
        counts[pressed(every[0])] += 1
        if not pressed(every[0]):
            assert every[0].cost <= cost(every) + 1e-5 * (1.0 + abs(cost(every)))
            assert pressed(replace(every[0], status=Status.LIMIT))
            assert pressed(replace(every[0], point=replace(every[0].point, multipliers=None)))
    assert min(counts.values()) >= 8


def side(one: Instance) -> tuple[Guess, Solution]:
    """A start that is given up, and the solution that it is given up for."""
    for guess in others(one):
        for first in solved(one, [one.guess]):
            if raced(one, [guess], [first])[0].status is Status.GIVEN_UP:
                return guess, first
    pytest.skip("none of this instance")


def test_what_did_not_converge_is_no_rival(recorded: list[Instance]) -> None:
    guess, first = side(recorded[-1])
    (alone,) = solved(recorded[-1], [guess])
    for known in ([], [replace(first, status=Status.LIMIT)]):
        (found,) = raced(recorded[-1], [guess], known)
        assert (found.status, found.cost) == (alone.status, alone.cost)
        np.testing.assert_array_equal(found.point.states, alone.point.states)


def test_nearness_and_cost_give_up_for_reasons_of_their_own(recorded: list[Instance]) -> None:
    one = recorded[-1]
    guess, first = side(one)
    (alone,) = solved(one, [guess])
    rival = replace(first, point=alone.point, cost=np.inf)
    (found,) = raced(one, [guess], [rival])
    assert found.status is Status.GIVEN_UP and "the same plan" in found.message
    assert found.iterations < alone.iterations
    (found,) = raced(one, [guess], [rival], within=0.0)
    assert found.status is alone.status  # never near, never dearer
    (found,) = raced(one, [guess], [replace(first, cost=-1e9)], within=0.0)
    assert found.status is Status.GIVEN_UP and "a dearer plan" in found.message


def test_a_start_beside_a_known_plan_goes_on_where_it_leads_elsewhere(
    recorded: list[Instance],
) -> None:
    """The known plan lies where the start begins; its own plan lies elsewhere."""
    for one in recorded[-3:]:
        (guess, *_), first = others(one), solved(one, [one.guess])[0]
        (alone,) = solved(one, [guess])
        away = np.abs(alone.point.states[:, :2] - guess.states[:, :2]).max()
        at_start = replace(first, point=replace(first.point, states=guess.states), cost=np.inf)
        (found,) = raced(one, [guess], [at_start], within=0.4 * away)
        assert (found.status, found.cost) == (Status.SOLVED, alone.cost)
        np.testing.assert_array_equal(found.point.states, alone.point.states)


@pytest.mark.parametrize(
    ("here", "there", "same"),
    [(0.9, 0.5, True), (0.9, 0.7, False), (1.1, 0.5, False), (0.0, 9.0, False), (0.0, 0.0, True)],
)
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_the_same_plan_is_near_now_and_nearer_after_the_whole_step(
    here: float, there: float, same: bool, sign: float, library: Any
) -> None:
    """Distances as shares of the one within which plans are the same; it ends at 1 and 0.6."""
    within, steps, moved = 0.3, 4, 3
    seen = np.array([0, 2])
    settings = SettingsTable(plans=2.0, within=within, best=np.inf)
    plans = np.random.default_rng(0).normal(size=(2, 1 + steps, 3))
    kind = KindTable(slots=1, entries=2, depends=address(seen))
    problem = ProblemTable(n=3, m=0, steps=steps)
    parts = Parts(library, problem, kind, [1.0], settings, plans)
    now, step = (parts.array(name, 3)[:, : 1 + steps] for name in ("v", "dv"))
    now[:] = plans[1].T  # the second plan; the first is far away
    plans[0] += 10.0
    now[:, 0] += 5.0  # where the robot is, which no plan changes
    now[1] += 5.0  # a state that is not compared
    now[2, moved] += sign * here * within
    step[2, moved] = sign * (there - here) * within
    outcome = library.parts_hopeless(ctypes.c_double(0.0), ctypes.c_double(0.0))
    assert outcome == (WB_SAME if same else -1)


def test_a_plan_that_enters_regions_makes_no_other_too_dear(recorded: list[Instance]) -> None:
    """It makes others the same plan, though."""
    one = recorded[-1]
    guess, first = side(one)
    (alone,) = solved(one, [guess])
    deep = replace(first.point, slack=np.full(len(first.point.slack), 2e-4))
    cheap = replace(first, cost=-1e9)
    assert enters(replace(first, point=deep)) and not enters(first)
    (found,) = raced(one, [guess], [replace(cheap, point=deep)], within=0.0)
    assert (found.status, found.cost) == (alone.status, alone.cost)
    (found,) = raced(one, [guess], [cheap], within=0.0)
    assert found.status is Status.GIVEN_UP
    there = replace(alone.point, slack=deep.slack)
    (found,) = raced(one, [guess], [replace(cheap, point=there)])
    assert found.status is Status.GIVEN_UP and "the same plan" in found.message


def test_a_start_may_take_some_times_the_iterations_of_the_quickest(
    recorded: list[Instance], monkeypatch: pytest.MonkeyPatch
) -> None:
    one = recorded[-1]
    guess, first = side(one)
    (alone,) = solved(one, [guess])
    away = replace(first.point, states=first.point.states + 100.0)
    quick = replace(first, point=away, cost=np.inf, iterations=4)
    assert alone.iterations > 9
    assert raced(one, [guess], [quick])[0].iterations == alone.iterations
    monkeypatch.setattr(solver, "PATIENT_ITERATIONS", 1.0)
    monkeypatch.setattr(solver, "PATIENT_PER_STEP", 0.0)
    (found,) = raced(one, [guess], [replace(quick, iterations=100), quick])
    assert found.status is Status.GIVEN_UP and "far longer" in found.message
    assert found.iterations == 8 and found.point.states is guess.states
    (found,) = raced(one, [guess], [replace(quick, iterations=100)])
    assert (found.status, found.cost) == (alone.status, alone.cost)
    monkeypatch.setattr(solver, "PATIENT_PER_STEP", 0.6)  # of 15 steps
    assert raced(one, [guess], [quick])[0].iterations == 9
    (stopped,) = Riccati(iterations=7).solve_cheapest(
        problem_for(one), one.parameters, [guess], [quick], WITHIN
    )
    assert stopped.status is Status.LIMIT  # that is the solver's own


def test_more_plans_than_the_core_compares_with(recorded: list[Instance]) -> None:
    """Beyond the eighth only the cost counts."""
    one = recorded[-1]
    guess, first = side(one)
    (alone,) = solved(one, [guess])
    away = replace(first.point, states=first.point.states + 100.0)
    many = [replace(first, point=away, cost=np.inf)] * 8
    last = replace(first, point=alone.point, cost=np.inf)
    assert raced(one, [guess], [*many, last])[0].status is alone.status
    assert raced(one, [guess], [*many[1:], last])[0].status is Status.GIVEN_UP
    assert raced(one, [guess], [*many, replace(last, cost=-1e9)])[0].status is Status.GIVEN_UP


def test_a_plain_solver_solves_from_each(recorded: list[Instance]) -> None:
    one = recorded[-1]
    first, starts = solved(one, [one.guess]), others(one)
    given = problem_for(one), one.parameters, starts
    assert not isinstance(Fatrop(), CheapestSolver)
    found = solve_cheapest(Fatrop(), *given, first, WITHIN)
    assert Status.GIVEN_UP not in {one.status for one in found} and len(found) == len(starts)
    with pytest.raises(WideberthError, match="states is"):
        short = replace(first[0].point, states=first[0].point.states[1:])
        raced(one, starts, [replace(first[0], point=short)])

"""The last plan's multipliers: shifted, matched by name, and used where plans follow closely."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import pytest

from wideberth.framework.mpc.ocp.problem import Parameters, Problem, SlotNumbers
from wideberth.framework.mpc.ocp.transcription import Guess, Multipliers
from wideberth.framework.mpc.planner import cycle
from wideberth.framework.mpc.planner.starts import KeptMultipliers
from wideberth.framework.mpc.slots.base import SlotAssignment
from wideberth.framework.mpc.solver import Solution, Solver
from wideberth.framework.values.motion import Observation
from wideberth.framework.values.plan import Rung
from wideberth.solvers.riccati.solver import Riccati
from wideberth.tests.helpers.planning import STRAIGHT, at, planner

NOTHING: Any = None


@dataclass(eq=False)
class Listening(Solver):
    """Riccati; keeps what it was asked to solve from, and what it found."""

    asked: list[tuple[Problem, Parameters, Guess, Solution]] = field(default_factory=list)

    def solve(
        self,
        problem: Problem,
        parameters: Parameters,
        guesses: Sequence[Guess],
        deadline: float | None = None,
    ) -> list[Solution]:
        found = Riccati().solve(problem, parameters, guesses, deadline)
        given = zip(guesses, found, strict=True)
        self.asked += [(problem, parameters, guess, one) for guess, one in given]
        return found


def chosen(*names: str) -> SlotAssignment:
    return SlotAssignment((), names, (), NOTHING, NOTHING)


def parameters(slots: int) -> Parameters:
    numbers = SlotNumbers(np.zeros((3, slots, 1)), np.zeros(slots), np.zeros((3, slots, 0)))
    return Parameters(np.zeros(1), np.zeros((3, 2)), np.zeros((3, 2)), np.zeros(3), (numbers,))


def test_slots_keep_their_multipliers_by_name() -> None:
    """Modes of one obstacle share a name; their order distinguishes them."""
    slots = np.arange(3.0)[:, None, None] + 10.0 * np.arange(4.0)[:, None]
    kept = KeptMultipliers(
        Multipliers(np.zeros((3, 1)), (slots,)), 1.0, (("a", "b", "a", "gone"),)
    )
    found = kept.at(0.0, parameters(5), (chosen("new", "a", "a", "b", "a"),)).slots[0][..., 0]
    np.testing.assert_array_equal(found[0], [np.nan, 0.0, 20.0, 10.0, np.nan])
    np.testing.assert_array_equal(found[2], [np.nan, 2.0, 22.0, 12.0, np.nan])


@pytest.mark.parametrize(
    ("share", "wanted"), [(0.0, [0, 1, 4]), (0.25, [0.25, 1.75, 4]), (1.0, [1, 4, 4])]
)
def test_between_steps_they_are_interpolated(share: float, wanted: list[float]) -> None:
    steps = np.array([[0.0], [1.0], [4.0]])
    kept = KeptMultipliers(Multipliers(steps, (steps[:, None],)), 1.0, (("a",),))
    found = kept.at(share, parameters(1), (chosen("a"),))
    np.testing.assert_allclose(found.steps[:, 0], wanted)
    np.testing.assert_allclose(found.slots[0][:, 0, 0], wanted)


def seen(time: float) -> Observation:
    return at(time, 0.5 * time, ("other", 8.0 - 0.5 * time, 0.3))


def drive(period: float, solver: Solver, **settings: Any) -> list[Any]:
    made = planner(solver=solver, period=period, **settings)
    made.set_path(STRAIGHT)
    commands = []
    for k in range(6):
        commands.append(made.command(seen(period * k)))
        assert made.plan is not None and made.plan.rung is Rung.OPTIMAL
    return commands


@pytest.mark.parametrize(
    ("period", "within", "warm"),
    [
        (0.05, 0.5, True),
        (0.25, 0.5, True),
        (0.5, 0.5, False),
        (0.05, 0.0, False),
        (0.5, 1.0, True),
    ],
)
def test_they_are_used_where_plans_follow_closely(
    period: float, within: float, warm: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(cycle, "WARM_WITHIN", within)
    solver = Listening()
    drive(period, solver, starts=())
    own = [one for one in solver.asked if one[0] is solver.asked[-1][0]][-6:]
    assert own[0][2].multipliers is None
    assert {one[2].multipliers is not None for one in own[1:]} == {warm}


def test_warm_and_cold_plans_are_the_same_within_tolerance() -> None:
    solver = Listening()
    drive(0.05, solver, starts=())
    pairs = []
    for problem, given, guess, warm in solver.asked:
        if guess.multipliers is None:
            continue
        (cold,) = Riccati().solve(problem, given, [replace(guess, multipliers=None)])
        assert warm.cost == pytest.approx(cold.cost, rel=1e-5, abs=1e-5)
        np.testing.assert_allclose(warm.point.states, cold.point.states, atol=1e-3)
        pairs.append((warm.iterations, cold.iterations))
    warm_all, cold_all = np.array(pairs).T
    assert len(pairs) >= 5 and warm_all.sum() < cold_all.sum()


def test_a_planner_that_is_reset_knows_no_multipliers() -> None:
    solver = Listening()
    made = planner(solver=solver, period=0.05, starts=())
    for k in range(3):
        made.command(seen(0.05 * k))
    assert solver.asked[-1][2].multipliers is not None
    made.reset()
    made.command(seen(0.2))
    assert solver.asked[-1][2].multipliers is None

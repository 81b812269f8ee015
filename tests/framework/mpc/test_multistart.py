"""Which starts a situation asks for."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from wideberth.framework.mpc.levels.fixed import Fixed
from wideberth.framework.mpc.levels.relaxed import Relaxed
from wideberth.framework.mpc.planner import multistart, watchdog
from wideberth.framework.mpc.planner.instance import Instance
from wideberth.framework.mpc.planner.multistart import MultiStart
from wideberth.framework.mpc.planner.starts import OTHERS, ReferenceGuess
from wideberth.framework.mpc.planner.verify import Candidate
from wideberth.framework.mpc.planner.watchdog import Budget, WatchedSolver
from wideberth.framework.mpc.slots.base import ActiveObstacles, SlotAssignment
from wideberth.framework.mpc.slots.gaussian_discs import GaussianDiscs
from wideberth.regions.mahalanobis_ellipse import MahalanobisEllipse
from wideberth.robots.holonomic_velocity import HolonomicVelocity
from wideberth.robots.unicycle import Unicycle
from wideberth.tests.helpers.problems import set_up, slots_of

TEN_METRES = np.stack([np.zeros(20), np.linspace(0.5, 10.0, 20)], axis=1)


def asked(
    gone, *, inputs=True, there=True, obstacle_in_way=True, optimal=True, starts="auto", level=3.0
):
    """Names of the starts, for a plan whose last state is ``gone`` m ahead of its first.

    Its level is asked to be 3 and must not fall below 1.
    """
    states = np.stack([np.zeros(21), np.linspace(0.0, gone, 21)], axis=1)
    point = SimpleNamespace(states=states, level=level)
    first = SimpleNamespace(optimal=optimal, point=point, solution=None)
    check = SimpleNamespace(
        robot=HolonomicVelocity(),
        last_inputs=np.zeros((20, 2)) if inputs else None,
        parameters=SimpleNamespace(initial=np.zeros(2), reference=TEN_METRES, target=3.0),
        problem=SimpleNamespace(shared=True, minimum=1.0),
    )
    attempts = MultiStart(None, starts, Budget(None, 0.0))
    return attempts._names(check, first, there, obstacle_in_way)


@pytest.mark.parametrize(
    ("expected", "settings"),
    [
        ((), {"there": False}),
        (OTHERS, {"obstacle_in_way": False}),
        (OTHERS, {"inputs": False}),
        (OTHERS, {"optimal": False, "there": False}),
        (("along",), {}),
        (("along",), {"level": 2.1}),
        (OTHERS, {"level": 1.9}),
        (("wait",), {"starts": ("wait",)}),
    ],
)
def test_what_auto_tries(expected, settings):
    assert asked(8.0, **settings) == expected


def test_a_plan_that_waits_for_ever_is_not_the_only_one_looked_at():
    assert asked(1.04) == ("along",)
    assert asked(0.9) == OTHERS
    assert asked(0.0) == OTHERS
    assert asked(-2.0) == ("along",)  # backs off: it is on its way


def test_a_plan_within_two_thirds_of_the_radius_is_the_same(monkeypatch):
    """Starts to the left and right of a body lead to plans that are a width of the robot apart."""
    asked, check = [], SimpleNamespace(robot=Unicycle(radius=0.45), problem=None, asked=None)
    watch = WatchedSolver(None)
    monkeypatch.setattr(watch, "_watched", lambda check, call, *given: asked.append(call.args[-1]))
    watch.solve_cheapest(check, [], [], Budget(None, 0.0))
    assert asked == [pytest.approx(0.3)]


@pytest.mark.parametrize(
    ("slack", "alone", "wanted"), [(1.0, True, True), (1.0, False, False), (0.5e-4, True, False)]
)
def test_only_states_alone_say_that_starts_near_a_refuted_plan_are_refuted(slack, alone, wanted):
    """Another separating line at the same states may keep a region that this one enters."""
    solution = SimpleNamespace(point=SimpleNamespace(slack=np.array([0.0, slack])))
    check = SimpleNamespace(problem=SimpleNamespace(no_auxiliaries=alone))
    assert multistart._enters(check, SimpleNamespace(solution=solution)) is wanted
    assert multistart._enters(check, SimpleNamespace(solution=None)) is False


def test_a_tenth_of_the_deadline_is_kept_and_half_of_it_waited(monkeypatch):
    clock = iter([100.0, 102.0, 102.0, 102.0])
    monkeypatch.setattr(watchdog, "perf_counter", lambda: next(clock))
    budget = Budget.start(4.0)
    assert budget.spent() == 2.0
    assert budget.left() == pytest.approx(0.9 * 4.0 - 2.0)
    assert budget.wait() == pytest.approx(0.95 * 4.0 - 2.0)
    free = Budget(None, 0.0)
    assert free.left() == free.wait() == np.inf


@pytest.mark.parametrize(
    ("y", "level", "point", "wanted"),
    [
        (0.0, Fixed(), 0.0, True),
        (9.0, Fixed(), 0.0, False),
        (9.0, Relaxed(0.05, weight=1.0), 3.0, False),
        (9.0, Relaxed(0.05, weight=1.0), 1.0, True),
    ],
)
def test_something_is_in_the_way_of_the_reference_or_of_the_level(y, level, point, wanted):
    robot, region = Unicycle(), MahalanobisEllipse()
    problem, parameters, guess = set_up(robot, region, level, 1, y=y)
    kinds = (GaussianDiscs(region),)
    chosen = SlotAssignment((1,), ("a",), (), parameters.slots[0], None)
    around = ActiveObstacles(robot, kinds, (chosen,))
    check = Instance(problem, parameters, around, level)
    solved = Candidate(replace(guess, level=point), None)
    laid = ReferenceGuess.along(robot, parameters, problem.dt)
    assert multistart._in_the_way(check, solved, laid)[0] is wanted
    empty = slots_of(parameters, active=np.zeros(1))
    for low in (point, -1.0):
        solved = SimpleNamespace(point=replace(guess, level=low))
        assert not multistart._in_the_way(replace(check, parameters=empty), solved, None)[0]

"""The tuple of rungs: names, order, a user's own, and what happens where none holds."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from types import SimpleNamespace
from typing import Any, ClassVar, final

import numpy as np
import pytest

from wideberth.framework.mpc import assembly
from wideberth.framework.mpc.levels.base import LevelPolicy
from wideberth.framework.mpc.levels.fixed import Fixed
from wideberth.framework.mpc.levels.relaxed import Relaxed
from wideberth.framework.mpc.ocp.transcription import Guess
from wideberth.framework.mpc.planner import giving_way
from wideberth.framework.mpc.planner import rungs as ladder
from wideberth.framework.mpc.planner.giving_way import achieved_levels, target_levels
from wideberth.framework.mpc.planner.instance import Instance
from wideberth.framework.mpc.planner.multistart import MultiStartResult
from wideberth.framework.mpc.planner.rollout import brake, clip, follow, steer
from wideberth.framework.mpc.planner.rungs import (
    RUNGS,
    Brake,
    Fallback,
    FallbackRung,
    FeasibleIterate,
    LadderInput,
    LeastViolation,
    NotHeld,
    Optimal,
    ShiftedPlan,
    choose,
    rungs_of,
)
from wideberth.framework.mpc.planner.starts import at_target, suited_each
from wideberth.framework.mpc.planner.verify import (
    Candidate,
    Violation,
    assess_each,
    contact,
    price,
    verify,
)
from wideberth.framework.mpc.slots.base import (
    ActiveObstacles,
    SlotAssignment,
    Touch,
    shared_target,
)
from wideberth.framework.mpc.slots.gaussian_discs import GaussianDiscs, KnownDiscs, ObstacleSet
from wideberth.framework.mpc.slots.static_polygons import StaticPolygons, choose_walls
from wideberth.framework.mpc.solver import Solution
from wideberth.framework.plugins.config import build, describe
from wideberth.framework.programs import evaluate
from wideberth.framework.region import Region
from wideberth.framework.values.errors import WideberthError
from wideberth.framework.values.motion import Twist
from wideberth.framework.values.plan import TOLERANCE, Rung, Status
from wideberth.framework.values.polygon import Polygon
from wideberth.regions.mahalanobis_ellipse import MahalanobisEllipse
from wideberth.regions.minkowski_sum import MinkowskiSum
from wideberth.regions.static.separating_line import StaticSeparatingLine
from wideberth.robots.unicycle import Unicycle
from wideberth.simulation.log.episode_log import read_episode, write_episode
from wideberth.simulation.measures.summary import robot_rows
from wideberth.tests.framework.mpc.test_judged_in_time import AWAY, clock, episode, plan, runner
from wideberth.tests.helpers.planning import Failing, approach, at, planner
from wideberth.tests.helpers.problems import DT, STEPS, set_up

BUILT_IN = tuple(str(one) for one in Rung)
OWN = f"{__name__}:Still"


@final
@dataclass(frozen=True)
class Still(FallbackRung):
    """The first point of the solver's guess, whatever it breaks."""

    name: ClassVar[str] = "still"

    def attempt(self, trial: LadderInput) -> Candidate | NotHeld:
        if trial.instance.last_inputs is None:
            return NotHeld(("still: there is no last plan",))
        first = trial.outcome.guesses[0]
        return trial.at_lowest_level(first.states, first.inputs)


@final
@dataclass(frozen=True)
class Needy(FallbackRung):
    """It has a field without a default, and returns no plan and no reason."""

    name: ClassVar[str] = "needy"

    share: float

    def attempt(self, trial: LadderInput) -> Candidate | NotHeld:
        return None  # type: ignore[return-value]


def test_a_rung_that_returns_something_else_is_named() -> None:
    wanted = r"the rung 'needy' returned None; wanted NotHeld\(reasons\), or what trial\.at_lowest"
    with pytest.raises(WideberthError, match=wanted):
        choose((Needy(0.5),), LadderInput(instance(Fixed(0.05))[0], outcome()), 0.0)


def test_the_built_in_rungs_are_those_of_plans_best_first() -> None:
    assert tuple(RUNGS) == BUILT_IN == tuple(one.name for one in rungs_of(BUILT_IN))
    assert planner().fallback.rungs == BUILT_IN


def test_a_rung_of_ones_own_stands_where_the_tuple_has_it() -> None:
    made = planner(solver=Failing(good=1), fallback=Fallback(("optimal", OWN, "brake")))
    assert approach(made, ticks=1).rung is Rung.OPTIMAL
    plan = approach(made, ticks=2)
    assert plan.rung == "still" and plan.status is Status.INFEASIBLE
    assert "; solver: told to fail" in plan.reason and "still taken: region of" in plan.reason
    fresh = planner(solver=Failing(good=0), fallback=Fallback(("optimal", OWN, "brake")))
    fresh.command(at(0.0, 0.0, ("other", 1.2, 0.0)))
    assert fresh.plan is not None and fresh.plan.rung is Rung.BRAKE
    assert "still: there is no last plan" in fresh.plan.reason


def test_rungs_are_config() -> None:
    made = planner(fallback=Fallback(("optimal", OWN, "brake")))
    assert describe(made)["fallback"]["rungs"] == ["optimal", OWN, "brake"]
    assert build("controllers", describe(made)).fallback.rungs == ("optimal", OWN, "brake")


def test_a_ladder_without_a_stop_ends_in_an_emergency_stop() -> None:
    made = planner(solver=Failing(good=0), fallback=Fallback(("optimal",)))
    command = made.command(at(0.0, 0.0, ("other", 1.2, 0.0)))
    assert made.plan is not None and made.plan.rung is Rung.BRAKE
    assert "no rung of ['optimal'] holds (solver: told to fail" in made.plan.reason
    assert command.linear[0] < 0.5


def test_brake_holds_where_the_rung_above_was_left_out() -> None:
    seen = at(0.0, 0.0, ("other", 1.2, 0.0))
    for rungs in (BUILT_IN, ("brake",), ("optimal", "brake")):
        made = planner(solver=Failing(good=0), fallback=Fallback(rungs))
        made.command(seen)
        assert made.plan is not None and made.plan.rung in (Rung.BRAKE, Rung.LEAST)
        assert rungs == BUILT_IN or made.plan.rung is Rung.BRAKE


@pytest.mark.parametrize(
    ("rungs", "words"),
    [
        ((), "wanted some of"),
        (("optimum",), "did you mean 'optimal'"),
        (("nowhere.at_all:Rung",), "cannot be imported"),
        ((f"{__name__}:planner",), "no FallbackRung"),
        ((f"{__name__}:Needy",), "cannot be made without arguments .*'share'"),
    ],
)
def test_names_that_are_no_rungs_are_refused(rungs: tuple[str, ...], words: str) -> None:
    with pytest.raises(WideberthError, match=words):
        planner(fallback=Fallback(rungs))


def test_a_plan_on_a_rung_of_ones_own_is_logged_and_counted() -> None:
    one = replace(plan(1.0, AWAY, runner(clock(1.0))), rung="still")
    played = episode(one, replace(one, rung=Rung.SHIFTED, stamp=1.5))
    again = read_episode(write_episode(played))
    assert [type(one.rung) for one in again.robots[0].plans] == [str, Rung]
    assert [one.rung for one in again.robots[0].plans] == ["still", Rung.SHIFTED]
    (row,) = robot_rows(played)
    assert row["fallbacks"] == 2 and row["rung_shifted"] == 1


# what the rungs choose from, without a solver


def instance(
    level: LevelPolicy, last: Any = None, y: float = 9.0, region: Region | None = None
) -> tuple[Instance, Guess]:
    """Somebody stands at (4, y) beside the straight path of a robot at 0.4 m/s."""
    robot, region = Unicycle(), region or MahalanobisEllipse()
    problem, parameters, guess = set_up(robot, region, level, 2, y=y)
    mean = np.tile([4.0, y], (STEPS, 1, 1))
    spread = np.tile(0.01 * np.eye(2), (STEPS, 1, 1, 1))
    kind = GaussianDiscs(region)
    known = KnownDiscs(kind, ObstacleSet(mean, spread, np.array([0.4]), ("a",)), 0.0)
    chosen = SlotAssignment((2,), ("a",), ("far",), parameters.slots[0], known)
    around = ActiveObstacles(robot, (kind,), (chosen,))
    return Instance(problem, parameters, around, level, last), guess


def assessed(check: Instance, solution: Solution) -> Candidate:
    """Re-check one solution."""
    return assess_each(check, [solution])[0]


def ended(point: Guess, status: Status, cost: float = 5.0, count: int = 3) -> Solution:
    return Solution(point, status, "as told", cost, count, 0.1 * count)


def outcome(*candidates: Candidate, before: bool = False) -> MultiStartResult:
    solutions = tuple(one.solution for one in candidates if one.solution is not None)
    return MultiStartResult(
        candidates, (), before, before, Status.FAILED, "as told", solutions=solutions
    )


def judged(
    cost: float = 0.0, broken: float = 0.0, motion: float = 0.0, status: Status = Status.SOLVED
) -> Candidate:
    """A plan of two steps that enters a region, or breaks its motion, at the second."""
    found = Violation(np.array([0.0, motion]), np.array([[0.0], [broken]]))
    point = Guess.bare(np.zeros((3, 1)), np.zeros((2, 1)), 0.0)
    return Candidate(point, found, ended(point, status, cost), cost=cost)


@pytest.mark.parametrize(("level", "kept"), [(-3.0, 0.2), (0.7, 0.7)])
def test_a_converged_plan_is_taken_as_it_is_but_for_its_level(level: float, kept: float) -> None:
    check, guess = instance(Relaxed(0.05, weight=3.0, minimum=0.2))
    for point, wanted in (
        (replace(guess, level=level), kept),
        (replace(guess, states=guess.states + 5.0, level=level), kept),
    ):
        solution = ended(point, Status.SOLVED)
        found = assessed(check, solution)
        assert found.point.level == wanted and found.cost == 5.0 and found.solution is solution
        assert found.point.states is point.states and found.point.inputs is point.inputs
        assert found.feasible == found.optimal == (point.states is guess.states)
        np.testing.assert_array_equal(found.found.touched, np.zeros(STEPS))
    check, guess = instance(Fixed())
    assert assessed(check, ended(guess, Status.SOLVED)).point is guess


def test_an_iterate_is_driven_within_the_limits_and_priced_anew() -> None:
    for y, feasible in ((9.0, True), (0.0, False)):
        check, guess = instance(Fixed(), y=y)
        inputs = guess.inputs.copy()
        inputs[0] = 50.0, -50.0
        wild = replace(guess, states=guess.states * 7.0, inputs=inputs)
        found = assessed(check, ended(wild, Status.FAILED, cost=-4.0))
        driven = clip(check.robot, inputs)
        np.testing.assert_array_equal(found.point.inputs, driven)
        states = follow(check.robot, check.parameters.initial, driven, DT)
        np.testing.assert_array_equal(found.point.states, states)
        slow = replace(guess, states=guess.states + 1.0)
        found = assessed(check, ended(slow, Status.FAILED, cost=-4.0))
        assert found.feasible is feasible and not found.optimal
        wanted = price(check.problem, check.parameters, found.point) if feasible else -4.0
        assert found.cost == wanted != (-4.0 if feasible else 0.0)


@pytest.mark.parametrize("least", [10.0, -10.0, 0.0])
def test_what_costs_little_more_than_the_cheapest_is_near_it(least: float) -> None:
    """0.05 (1 + |cost|) more; what breaks a constraint does not count, however cheap."""
    room = 0.05 * (1.0 + abs(least))
    kept = [judged(least + room - 1e-9), judged(least), judged(least, broken=TOLERANCE)]
    gone = [judged(least + room + 1e-6), judged(least - 50.0, broken=2.0 * TOLERANCE)]
    check: Any = None
    assert LadderInput(check, outcome(*kept, *gone)).near == tuple(kept)
    assert LadderInput(check, outcome(*gone[1:])).near == LadderInput(check, outcome()).near == ()


def test_the_side_is_kept_while_something_is_in_the_way() -> None:
    first, second, third = judged(3.0), judged(1.0), judged(2.0)
    for before, last, wanted in (
        (True, np.zeros((2, 1)), first), (False, np.zeros((2, 1)), second), (True, None, second),
    ):  # fmt: skip
        check: Any = SimpleNamespace(last_inputs=last)
        trial = LadderInput(check, outcome(first, second, third, before=before))
        assert trial.cheapest([first, second, third]) is wanted
        assert trial.cheapest([third, second]) is second


def test_solutions_that_can_be_driven_are_held_against_the_lowest_level() -> None:
    level = Relaxed(0.05, weight=3.0, minimum=0.2)
    check, guess = instance(level)
    kept = replace(judged(7.0, broken=1.0, motion=TOLERANCE), point=replace(guess, level=2.0))
    gone = replace(judged(motion=2.0 * TOLERANCE), point=guess)
    (found,) = LadderInput(check, outcome(gone, kept)).drivable
    assert found.point.level == 0.2 and found.cost == 7.0 and found.solution is kept.solution
    assert found.feasible and found.point.states is guess.states
    below = Relaxed(0.05, weight=3.0, minimum=-np.inf)
    assert LadderInput(instance(below)[0], outcome(kept)).drivable[0].point.level == 0.0
    assert np.isnan(LadderInput(instance(Fixed())[0], outcome(kept)).drivable[0].point.level)


@pytest.mark.parametrize("region", [MahalanobisEllipse(), MinkowskiSum()], ids=repr)
def test_a_drivable_solution_is_not_checked_twice_against_the_same_levels(region: Region) -> None:
    """With auxiliaries it is: those of a manoeuvre are not those of the solver."""
    check, guess = instance(Fixed(0.05), y=0.4, region=region)
    one = replace(judged(7.0), point=guess, found=verify(check, guess))
    (found,) = LadderInput(check, outcome(one)).drivable
    again = LadderInput(check, outcome()).at_lowest_level(guess.states, guess.inputs)
    assert (found.found is one.found) == isinstance(region, MahalanobisEllipse)
    np.testing.assert_array_equal(found.found.regions, again.found.regions)
    np.testing.assert_array_equal(found.found.motion, again.found.motion)
    assert found.point.multipliers is None and found.found.regions.max() > 0.1


def test_what_is_entered_before_a_stop_ends_is_counted() -> None:
    """Things without a level are themselves in their regions; others count where expected."""
    slots = [SimpleNamespace(levelled=True, count=2), SimpleNamespace(levelled=False, count=1)]
    regions = np.array([[9.0, 9.0, 0.1], [9.0, 9.0, 0.2], [9.0, 9.0, 0.9]])
    for depth, touched, wanted in (
        ([0.0, 0.0, 5.0], [0.0, 0.0, 5.0], 0.2),
        ([0.3, 0.0, 5.0], [0.0, 0.0, 5.0], 0.3),
        ([0.0, 0.0, 5.0], [0.0, 0.4, 5.0], 0.4),
    ):
        check: Any = SimpleNamespace(
            problem=SimpleNamespace(slots=slots),
            around=SimpleNamespace(overlap=lambda states, depth=depth: np.array(depth)),
        )
        touch = Touch(np.array(touched), ("",) * 3)
        one: Any = SimpleNamespace(
            found=Violation(np.zeros(3), regions, touch), point=SimpleNamespace(states=None)
        )
        assert contact(check, one, 2) == wanted
        assert contact(check, one, 3) == 5.0


def ways(
    monkeypatch: pytest.MonkeyPatch, straight: tuple[float, float], *others: tuple[float, float]
) -> tuple[LadderInput, list[Candidate]]:
    """Stops, and solutions, that touch so deep and enter regions so far in all.

    The robot stands in its fifth state, to a millimetre: what it touches after the step that
    leads there can still be braked for.
    """
    values: dict[float, tuple[float, float]] = {}

    def states(number: float, entry: tuple[float, float]) -> Any:
        values[number] = entry
        speed = [2.0, 1.5, 1.0, 0.0015, 0.0, 0.0009, 0.0]
        return np.stack([np.full(7, number), 5.0 + np.array(speed)], axis=1)

    def stops(*given: Any) -> Any:
        yield "straight", states(0.0, straight), np.zeros((6, 1))
        for number, entry in enumerate(others[:-1]):
            yield f"way {number}", states(1.0 + number, entry), np.zeros((6, 1))

    def verify_each(_: Any, points: Sequence[Guess]) -> list[Violation]:
        entered = [[values[point.states[0, 0]][1]] + [0.0] * 5 for point in points]
        return [Violation(np.zeros(6), np.array(one)[:, None]) for one in entered]

    def overlap(found: Any) -> Any:  # at the fifth step, the last that counts
        return np.array([0.0, 0.0, 0.0, 0.0, values[found[0, 0]][0], 8.0])

    monkeypatch.setattr(ladder, "stops", stops)
    monkeypatch.setattr(ladder, "verify_each", verify_each)
    monkeypatch.setattr(ladder, "suited_each", lambda _, points: list(points))
    slot = SimpleNamespace(levelled=True, count=1)
    problem = SimpleNamespace(horizon=6, dt=0.5, shared=False, minimum=0.0, slots=[slot])
    made: Any = SimpleNamespace(
        problem=problem,
        robot=None, parameters=SimpleNamespace(initial=None), in_contact=None,
        around=SimpleNamespace(overlap=overlap),
    )  # fmt: skip
    trial = LadderInput(made, outcome())
    return trial, [trial.at_lowest_level(states(9.0, others[-1]), np.zeros((6, 1)))]


@pytest.mark.parametrize(
    ("entries", "wanted"),
    [
        ([(0.0, 0.0), (0.0, 0.0), (0.0, 0.0)], "straight"),
        ([(0.0, 0.5), (0.0, 0.5), (0.0, 0.5)], "straight"),
        ([(0.0, 0.5), (0.0, 0.4), (0.0, 0.3)], "solution"),
        ([(0.0, 1.0), (0.0, 0.4), (0.0, 0.3)], "solution"),
        ([(0.0, 0.5), (0.0, 0.2), (0.0, 0.3)], "way 0"),
        ([(0.2, 0.1), (0.1, 0.9), (0.3, 0.0)], "way 0"),
        ([(0.2, 0.5), (0.2 + 0.5 * TOLERANCE, 0.4), (0.2, 0.6)], "way 0"),
        ([(0.2, 0.5), (0.2 + 2.0 * TOLERANCE, 0.4), (0.2, 0.6)], "straight"),
        ([(0.2, 0.0), (0.3, 0.0), (0.1, 0.0)], "solution"),
    ],
)
def test_the_gentlest_way_touches_least_and_then_enters_least(
    entries: list[tuple[float, float]], wanted: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    trial, others = ways(monkeypatch, *entries)
    assert (trial.gentlest(others).way or "solution") == wanted


def test_the_gentlest_way_is_that_of_all_pairs(monkeypatch: pytest.MonkeyPatch) -> None:
    """Against the rule itself, with ties in both numbers."""
    rng = np.random.default_rng(3)
    for _ in range(200):
        touch = rng.choice([0.0, 0.5 * TOLERANCE, 0.9 * TOLERANCE, 1.6 * TOLERANCE, 0.3], 6)
        entries = list(zip(touch, rng.choice([0.1, 0.2, 0.3], 6), strict=True))
        least = touch.min() + TOLERANCE
        numbered = zip(("", *"0123", "s"), entries, strict=True)
        order = {"": 0, "s": 1, "0": 2, "1": 3, "2": 4, "3": 5}
        kept = [(total, order[name], name) for name, (depth, total) in numbered if depth <= least]
        wanted = {"": "straight", "s": "solution"}
        *_, best = min(kept)
        trial, others = ways(monkeypatch, *entries)
        found = trial.gentlest(others).way or "solution"
        assert found == wanted.get(best, f"way {best}")


def test_what_cannot_win_is_not_held_against_bodies(monkeypatch: pytest.MonkeyPatch) -> None:
    """One that touches nothing wins against all that enter regions more."""
    trial, others = ways(monkeypatch, (0.2, 0.5), (0.0, 0.3), (0.3, 0.2), (0.0, 0.4), (0.0, 0.9))
    looked: list[float] = []

    def counted(check: Instance, one: Candidate, window: int) -> float:
        looked.append(one.found.total)
        return contact(check, one, window)

    monkeypatch.setattr(ladder, "contact", counted)
    assert trial.gentlest(others).way == "way 0" and looked == [0.5, 0.2, 0.3]


def test_the_last_plan_is_driven_from_here_at_the_lowest_level() -> None:
    robot = Unicycle()
    for y, feasible in ((9.0, True), (0.0, False)):
        check, _ = instance(Fixed(), y=y)
        assert ShiftedPlan().attempt(LadderInput(check, outcome())) == NotHeld()
        _, inputs = steer(robot, check.parameters.initial, Twist((0.5, 0.0), 0.01), STEPS, DT)
        check = replace(check, last_inputs=inputs)
        found = ShiftedPlan().attempt(LadderInput(check, outcome()))
        if feasible:
            assert isinstance(found, Candidate) and found.point.inputs is inputs
            wanted = follow(robot, check.parameters.initial, inputs, DT)
            np.testing.assert_array_equal(found.point.states, wanted)
        else:
            assert isinstance(found, NotHeld)
            assert found.reasons[0].startswith("shifted last plan: region of 'a'")


def test_an_iterate_that_keeps_the_lowest_level_is_feasible_after_all() -> None:
    lowest = Relaxed(0.05, weight=3.0, minimum=0.2)
    check, guess = instance(lowest)
    entering = replace(judged(3.0, broken=1.0), point=guess)
    found = FeasibleIterate().attempt(LadderInput(check, outcome(entering)))
    assert isinstance(found, Candidate) and found.cost == 3.0
    cheaper = replace(judged(2.0, status=Status.FAILED), point=guess)
    trial = LadderInput(check, outcome(judged(2.01), cheaper))
    assert FeasibleIterate().attempt(trial) is cheaper
    assert Optimal().attempt(trial) is trial.near[0]
    check, guess = instance(lowest, y=0.0)
    into = replace(entering, point=replace(guess, states=guess.states))
    assert FeasibleIterate().attempt(LadderInput(check, outcome(into))) == NotHeld()


def test_why_no_plan_is_optimal() -> None:
    check, guess = instance(Fixed())
    broken = replace(judged(broken=0.5), point=guess)
    near = replace(judged(status=Status.FAILED), point=guess)
    said = [
        Optimal().attempt(LadderInput(check, outcome(*given)))
        for given in ((), (broken,), (near,))
    ]
    assert said[0] == said[2] == NotHeld(("solver: as told",))
    assert isinstance(said[1], NotHeld) and said[1].reasons[0] == "solver: as told"
    assert said[1].reasons[1].startswith("its plan: region of 'a' entered by 0.5")


def test_a_plan_tells_what_it_took_and_why() -> None:
    check, guess = instance(Fixed())
    robot, start = check.robot, check.parameters.initial
    one = assessed(check, ended(guess, Status.SOLVED, cost=9.0, count=3))
    two = assessed(check, ended(guess, Status.SOLVED, cost=8.0, count=4))
    plan, point = choose(rungs_of(BUILT_IN), LadderInput(check, outcome(one, two)), 4.5)
    assert point is two.point and plan.cost == 8.0 and plan.rung is Rung.OPTIMAL
    assert (plan.stamp, plan.dt, plan.iterations, plan.reason) == (4.5, DT, 7, "")
    assert plan.seconds == pytest.approx(0.7) and plan.status is Status.SOLVED
    assert plan.ids == ("a",) and plan.left_out == ("far",) and plan.violation < TOLERANCE
    assert plan.breach is plan.given_way is None
    np.testing.assert_array_equal(plan.positions, guess.states[:, :2])
    np.testing.assert_array_equal(plan.reference, check.parameters.reference)
    level = np.full((STEPS, 1), MahalanobisEllipse().level(Fixed().tail))
    np.testing.assert_allclose(plan.level, level)
    np.testing.assert_array_equal(plan.level, plan.target)
    np.testing.assert_allclose(plan.content, 1.0 - Fixed().tail)

    inside = np.array([3.6, 0.0, 0.0, 0.4, 0.0])  # of the region, and no way leads out in time
    check, _ = instance(Fixed(), y=0.0)
    check = replace(check, parameters=replace(check.parameters, initial=inside))
    first = at_target(check, *brake(robot, inside, STEPS, DT))
    lost = assessed(check, ended(replace(first, inputs=first.inputs + 9.0), Status.FAILED))
    for candidates, status in (((lost,), Status.FAILED), ((), Status.NOT_RUN)):
        told = replace(outcome(*candidates), status=Status.NOT_RUN)
        plan, _ = choose(rungs_of(("optimal", "brake")), LadderInput(check, told), 0.0)
        assert plan.rung is Rung.BRAKE and plan.status is status and plan.breach is not None
        words = plan.reason.split("; ")
        assert words[0] == str(plan.given_way) and words[1] == "solver: as told"
        assert words[-1].startswith("brake (") and f" taken: {plan.breach}" in words[-1]
        assert plan.iterations == 3 * len(candidates) and np.isnan(plan.cost)
        assert start is not inside and plan.violation == plan.breach.amount


def test_a_solution_and_a_way_to_stop_stand_on_rungs_of_their_own() -> None:
    one, two, way, other = judged(), judged(), judged(), judged()
    for best, least, brakes in ((two, two, other), (way, NotHeld(), way)):
        trial: Any = SimpleNamespace(
            drivable=(one, two), least_harmful=best, gentlest=lambda others: other
        )
        assert LeastViolation().attempt(trial) is least or least == LeastViolation().attempt(trial)
        assert Brake().attempt(trial) is brakes


def test_a_little_is_no_breach_and_an_optimal_plan_needs_no_reason(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    asked: list[bool] = []

    def held(check: Instance, best: Candidate, target: Any, *, optimal: bool) -> Any:
        asked.append(optimal)
        return np.zeros((STEPS, 1)), None

    monkeypatch.setattr(giving_way, "achieved_levels", held)
    check, guess = instance(Fixed())
    entered = np.full((STEPS, 2), 0.5 * TOLERANCE)
    for status, rungs, reason in (
        (Status.SOLVED, (Still(), Optimal()), ""),
        (Status.FAILED, (Optimal(), FeasibleIterate()), "solver: as told"),
    ):
        point = replace(judged(status=status), point=guess)
        point = replace(point, found=Violation(np.zeros(STEPS), entered))
        plan, _ = choose(rungs, LadderInput(check, outcome(point)), 0.0)
        assert plan.breach is None and plan.violation == 0.5 * TOLERANCE
        assert plan.reason == reason
    assert asked == [True, False]


def test_only_a_shared_level_is_aimed_at() -> None:
    kinds = (GaussianDiscs(MahalanobisEllipse()),)
    assert np.isnan(shared_target(kinds, Fixed(0.05), 2))
    level = shared_target(kinds, Relaxed(0.05, weight=1.0), 2)
    assert level == pytest.approx(MahalanobisEllipse().level(0.05))
    assert judged().named("brake") == "brake"
    assert replace(judged(), way="ahead").named("brake") == "brake (ahead)"


@pytest.mark.parametrize("y", [0.0, 0.4, 0.9, 1.6])
def test_the_level_held_is_the_largest_share_that_enters_nothing(y: float) -> None:
    check, guess = instance(Fixed(0.05), y=y)
    (slot,), region = check.parameters.slots, MahalanobisEllipse()
    candidate = Candidate(guess, verify(check, guess))
    level, way = achieved_levels(check, candidate, target_levels(check), optimal=False)
    asked = region.level(0.05)
    numbers, places = slot.parameters[:, 0], guess.states[1:, :2]

    def inside(share: float) -> Any:
        return region.contains(places, numbers, np.full(STEPS, share * asked))

    entered = inside(1.0)
    if not entered.any():
        assert way is None and (level == asked).all()
        return
    assert way is not None and way.name == "a" and way.asked == pytest.approx(0.05)
    assert way.step == int(entered.argmax()) + 1
    np.testing.assert_allclose(level[~entered, 0], asked)
    share = level[entered, 0].min() / asked
    np.testing.assert_allclose(level[entered, 0], share * asked)
    if inside(0.0).any():  # even the margin alone is entered
        assert share == 0.0 and way.held == 1.0
        return
    assert not inside(share - 2e-3).any() and inside(share + 2e-3).any()
    assert way.held == pytest.approx(region.tail(share * asked))


@pytest.mark.parametrize("region", [MahalanobisEllipse(), MinkowskiSum()], ids=repr)
@pytest.mark.parametrize("level", [Fixed(0.05), Relaxed(0.05, weight=3.0, minimum=0.2)], ids=repr)
@pytest.mark.parametrize("built", [True, False])
@pytest.mark.parametrize("walled", [True, False])
def test_the_share_is_that_of_one_halving_after_the_other(
    level: LevelPolicy, region: Region, built: bool, walled: bool,
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    if not built:
        monkeypatch.setattr(evaluate, "_evaluator", None)
    found = set()
    for y in (0.2, 0.35, 0.5, 0.65):
        check, guess = instance(level, y=y, region=region)
        check = beside_a_wall(check, guess) if walled else check
        low, high = 0.0, 1.0
        for _ in range(12):
            middle = 0.5 * (low + high)
            slots = tuple(
                one if one.level is None else replace(one, level=middle * one.level)
                for one in check.parameters.slots
            )
            lower = replace(check, parameters=replace(check.parameters, slots=slots))
            point = suited_each(lower, [replace(guess, level=middle * check.parameters.target)])[0]
            if verify(lower, point).regions.max() > TOLERANCE:
                high = middle
            else:
                low = middle
        guess = suited_each(check, [guess])[0]
        plan = Candidate(guess, verify(check, guess))
        kept, way = achieved_levels(check, plan, target_levels(check), optimal=False)
        assert way is not None and low > 0.0
        assert kept.min() == low * levelled(check)[0].level.max()
        found.add(low)
    assert len(found) == 4


def beside_a_wall(check: Instance, guess: Guess) -> Instance:
    """The same instance with a wall beside the path, whose slots have auxiliaries but no level."""
    robot, (discs,) = check.robot, check.around.kinds
    wall = Polygon(((-2.0, -4.0), (9.0, -4.0), (9.0, -3.0), (-2.0, -3.0)), "wall")
    kind = StaticPolygons(StaticSeparatingLine())
    walls = choose_walls([wall], kind.region, np.zeros((1, 2)), 50.0, 3)
    own = np.zeros((STEPS, 2, 2))
    chosen = (*check.around.chosen, kind.chosen(robot, walls, check.level, 0.3, own))
    rooms = tuple(one.room for one in chosen)
    sizes = {"horizon": STEPS, "dt": DT, "rooms": rooms}
    problem = assembly.assemble(robot, (discs, kind), check.level, **sizes)
    slots = (*check.parameters.slots, chosen[1].numbers)
    around = ActiveObstacles(robot, (discs, kind), chosen)
    given = replace(check.parameters, slots=slots)
    found = Instance(problem, given, around, check.level, check.last_inputs)
    return replace(found, parameters=suited_each(found, [guess])[0].pull(given))


def levelled(check: Instance) -> list[Any]:
    return [one for one in check.parameters.slots if one.level is not None]


def test_the_level_of_an_optimal_plan_is_the_solver_s() -> None:
    check, guess = instance(Relaxed(0.05, weight=1.0, minimum=0.0), y=0.4)
    candidate = Candidate(replace(guess, level=0.7), verify(check, guess))
    level, way = achieved_levels(check, candidate, target_levels(check), optimal=True)
    assert (level == 0.7).all() and way is not None
    assert way.held == pytest.approx(MahalanobisEllipse().tail(0.7))

"""Starting points: drivable, different, for every robot; and the choice of side made on cost."""

from dataclasses import dataclass, field, replace
from pathlib import Path as File
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from wideberth.benchmarks.recorded_instances import read_instances, worst_violation
from wideberth.controllers.costs.contouring import Contouring
from wideberth.framework.mpc.levels.base import LevelPolicy
from wideberth.framework.mpc.levels.fixed import Fixed
from wideberth.framework.mpc.levels.paper import Paper
from wideberth.framework.mpc.levels.relaxed import Relaxed
from wideberth.framework.mpc.ocp.problem import Parameters, Problem
from wideberth.framework.mpc.ocp.reference import lay_reference
from wideberth.framework.mpc.ocp.transcription import Guess
from wideberth.framework.mpc.planner.planner import Planner
from wideberth.framework.mpc.planner.rollout import RobotMotion, carry, follow, steer_each
from wideberth.framework.mpc.planner.starts import NAMES, OTHERS, other_starts
from wideberth.framework.mpc.planner.watchdog import SAME
from wideberth.framework.mpc.slots.gaussian_discs import ObstacleSet
from wideberth.framework.mpc.solver import CheapestSolver, Solution, Solver, unwrapped
from wideberth.framework.plugins.config import build
from wideberth.framework.plugins.registry import names
from wideberth.framework.robot import Robot, step
from wideberth.framework.values.errors import WideberthError
from wideberth.framework.values.motion import Detection, Observation, Pose, Twist
from wideberth.framework.values.path import Path
from wideberth.framework.values.plan import Rung, Status
from wideberth.predictors.static import Static
from wideberth.regions.mahalanobis_ellipse import MahalanobisEllipse
from wideberth.robots.holonomic_velocity import HolonomicVelocity
from wideberth.robots.unicycle import Unicycle
from wideberth.solvers.fatrop import Fatrop
from wideberth.solvers.ipopt import Ipopt
from wideberth.tests.helpers.problems import assemble, fill, with_auxiliaries

SAMPLE = File(__file__).parents[2] / "data" / "mpc_instances.npz"
ROBOTS = [build("robots", name) for name in names("robots")]
STEPS, DT = 15, 0.5


def straight(robot: Robot, speed: float, turns: int = 0) -> tuple[Problem, Parameters, Guess]:
    """Somebody stands exactly in the middle of the robot's path."""
    size = robot.dimension
    pose = Pose((0.0,) * size, 2.0 * np.pi * turns)
    start = np.array(robot.state_at(pose, Twist((speed, *(0.0,) * (size - 1)))), dtype=float)
    way = np.zeros((2, size))
    way[1, 0] = 20.0
    reference = lay_reference(Path(way), 0.0, 0.5, STEPS, DT)
    mean = np.zeros((STEPS, 1, size))
    mean[..., 0] = 3.0
    covariance = np.tile(0.01 * np.eye(size), (STEPS, 1, 1, 1))
    obstacles = ObstacleSet(mean, covariance, np.array([0.3]), ("a",))
    region, level = MahalanobisEllipse(), Fixed()
    parameters = fill(start, reference, obstacles, region, level, robot.radius, 1)
    problem = assemble(robot, region, level, horizon=STEPS, dt=DT, capacity=1)
    states = np.repeat(start[None], STEPS + 1, axis=0)
    bare = Guess.bare(states, np.zeros((STEPS, len(robot.inputs))), float("nan"))
    return problem, parameters, with_auxiliaries(robot, region, parameters, bare)


@pytest.mark.parametrize("robot", ROBOTS, ids=lambda robot: type(robot).__name__)
@pytest.mark.parametrize("speed", [0.0, 0.4])
def test_every_start_begins_at_the_state_and_can_be_driven(robot: Robot, speed: float) -> None:
    problem, parameters, guess = straight(robot, speed)
    found = other_starts(robot, problem, parameters, guess, NAMES)
    assert len(found) >= 5
    bounds = robot.input_bounds()
    for one in found:
        assert one.states[0] == pytest.approx(parameters.initial)
        assert (one.inputs >= np.array(bounds.lower) - 1e-12).all()
        assert (one.inputs <= np.array(bounds.upper) + 1e-12).all()
    for one in found[1:]:  # the first lies on the reference
        for i, control in enumerate(one.inputs):
            assert one.states[i + 1] == pytest.approx(step(robot, one.states[i], control, DT))
    ends = np.array([robot.pose(tuple(one.states[-1])).position for one in found])
    apart = np.linalg.norm(ends[:, None] - ends, axis=2)[np.triu_indices(len(ends), 1)]
    assert (apart > 0.1).mean() > 0.8  # also from a standstill


@pytest.mark.parametrize("robot", ROBOTS, ids=lambda robot: type(robot).__name__)
def test_compiled_trajectories_are_those_of_the_robot_step_by_step(robot: Robot) -> None:
    rng = np.random.default_rng(0)
    start = straight(robot, 0.4)[1].initial
    inputs = rng.uniform(-0.3, 0.3, (9, len(robot.inputs)))
    wanted = [tuple(start)]
    for control in inputs:
        wanted.append(step(robot, wanted[-1], control, DT))
    for found in (
        RobotMotion(robot, 9, DT).follow(start, inputs),
        follow(robot, start, inputs, DT),
    ):
        np.testing.assert_allclose(found, wanted, rtol=0, atol=1e-12)


@pytest.mark.parametrize("robot", ROBOTS, ids=lambda robot: type(robot).__name__)
def test_manoeuvres_steered_together_are_those_driven_step_by_step(robot: Robot) -> None:
    rng = np.random.default_rng(0)
    start = straight(robot, 0.4)[1].initial
    held = [
        [
            (Twist(tuple(rng.uniform(-1.0, 1.0, robot.dimension)), rng.uniform(-1.0, 1.0)), 4),
            (Twist((0.0,) * robot.dimension), 5),
        ]
        for _ in range(3)
    ]
    found = steer_each(robot, start, held, DT)
    assert len(found) == 3
    for manoeuvre, (states, inputs) in zip(held, found, strict=True):
        point = tuple(float(value) for value in start)
        assert tuple(states[0]) == point
        for i, twist in enumerate(twist for twist, count in manoeuvre for _ in range(count)):
            control = robot.drive(point, twist, DT)
            point = step(robot, point, control, DT)
            np.testing.assert_allclose(inputs[i], control, rtol=0, atol=1e-12)
            np.testing.assert_allclose(states[i + 1], point, rtol=0, atol=1e-12)
    for states, inputs in (steer_each(robot, start, [[]], DT)[0],):
        assert states.shape == (1, len(start)) and inputs.shape == (0, len(robot.inputs))


@pytest.mark.parametrize("robot", ROBOTS, ids=lambda robot: type(robot).__name__)
def test_the_first_lies_on_the_reference_and_is_drivable_on_a_straight_one(robot: Robot) -> None:
    problem, parameters, guess = straight(robot, 0.5)
    (one,) = other_starts(robot, problem, parameters, guess, ["along"])
    place = np.stack(robot.pose(tuple(one.states[1:].T)).position, axis=-1)
    assert place == pytest.approx(parameters.reference, abs=1e-9)
    for i, control in enumerate(one.inputs):
        assert one.states[i + 1] == pytest.approx(
            step(robot, one.states[i], control, DT), abs=1e-9
        )


@pytest.mark.parametrize("robot", ROBOTS, ids=lambda robot: type(robot).__name__)
def test_left_and_right_lead_past_who_stands_in_the_middle(robot: Robot) -> None:
    """The problem is its own mirror image: both sides cost the same, one start finds one."""
    problem, parameters, guess = straight(robot, 0.4)
    starts = other_starts(robot, problem, parameters, guess, ["left", "right"])
    left, right = Fatrop().solve(problem, parameters, starts)
    assert left.status is right.status is Status.SOLVED
    assert left.cost == pytest.approx(right.cost, rel=1e-6)
    sides = [one.point.states[:, 1] for one in (left, right)]
    assert sides[0].max() > 0.3 or np.abs(sides[0]).max() < 1e-3  # past, or a stop before
    assert sides[0] == pytest.approx(-sides[1], abs=1e-3)


@pytest.mark.parametrize("solver", [Fatrop(), Ipopt()], ids=str)
def test_a_heading_off_by_whole_turns_is_the_same_heading(solver: Solver) -> None:
    robot = Unicycle()
    problem, parameters, guess = straight(robot, 0.4)
    (guess,) = other_starts(robot, problem, parameters, guess, ["left"])
    (plain,) = solver.solve(problem, parameters, [guess])
    for turns in (-3, 1, 2):
        states = guess.states + 2.0 * np.pi * turns * np.eye(5)[2]
        (other,) = solver.solve(problem, parameters, [replace(guess, states=states)])
        assert other.iterations == plain.iterations
        assert other.point.states == pytest.approx(plain.point.states, abs=1e-6)
    back = guess.states + np.pi * np.eye(5)[2]
    assert unwrapped(problem, parameters, replace(guess, states=back)).states is back


def test_more_starts_reach_the_best_cost_of_the_recorded_instances() -> None:
    """The stored best costs come from about forty set-ups."""
    robot, region, gaps = Unicycle(), MahalanobisEllipse(), []
    level = Paper(tail=float(np.exp(-5.991 / 2)))
    problems: dict[int, Problem] = {}
    for instance in read_instances(SAMPLE, region):
        count = instance.obstacles
        if count not in problems:
            problems[count] = assemble(robot, region, level, horizon=15, dt=0.5, capacity=count)
        others = other_starts(
            robot, problems[count], instance.parameters, instance.guess, ["along", "right"]
        )
        guesses = [with_auxiliaries(robot, region, instance.parameters, one) for one in others]
        solutions = Fatrop().solve(
            problems[count], instance.parameters, [instance.guess, *guesses]
        )
        sound = [one.cost for one in solutions if worst_violation(instance, one.point) < 1e-4]
        gaps.append(instance.gap(min(sound)))
    assert np.mean(np.array(gaps) < 1e-3) >= 0.98


@pytest.mark.parametrize("arc", [0.0, 2.0])
def test_theta_rides_along_on_other_starts(arc: float) -> None:
    made = planner(Fatrop(), cost=Contouring())
    made.command(seen(2.0 * arc, ("a", arc + 4.0, 0.0)))
    assert made.plan is not None
    assert made.plan.rung is Rung.OPTIMAL
    guesses = made.explain().guesses
    assert len(guesses) > 3
    for guess in guesses:
        assert guess.states[0, -1] == pytest.approx(arc)
        assert np.diff(guess.states[:, -1]) == pytest.approx(0.5 * guess.inputs[:, -1])
    assert guesses[1].states[-1, -1] == pytest.approx(arc + 3.75)  # along the reference


@dataclass(frozen=True)
class Counting(Solver):
    """Solves with fatrop and writes down from how many starts."""

    calls: list[int] = field(default_factory=list)

    def solve(self, problem: Problem, parameters: Parameters, guesses: Any, deadline: Any = None
              ) -> list[Solution]:  # fmt: skip
        self.calls.append(len(guesses))
        return Fatrop().solve(problem, parameters, guesses, deadline)


def planner(solver: Solver, level: LevelPolicy | None = None, **changes: Any) -> Planner:
    made = Planner(
        Unicycle(),
        MahalanobisEllipse(),
        Static(),
        level or Fixed(),
        solver,
        penalty=1e4,
        **changes,
    )
    made.set_path(Path(np.array([[0.0, 0.0], [20.0, 0.0]])))
    if isinstance(solver, Counting):
        solver.calls.clear()  # those of the warm-up
    return made


def seen(time: float, *others: tuple[str, float, float]) -> Observation:
    detections = tuple(
        Detection(name, np.array([x, y]), 1e-4 * np.eye(2), 0.75) for name, x, y in others
    )
    return Observation(time, np.array([0.5 * time, 0.0, 0.0, 0.5, 0.0]), detections)


def test_further_starts_are_paid_for_where_something_is_in_the_way() -> None:
    solver = Counting()
    made = planner(solver)
    made.command(seen(0.0, ("aside", 5.0, 6.0)))
    assert solver.calls == [1]  # nothing in the way, though it is the first plan
    made.command(seen(0.5, ("ahead", 5.0, 0.0)))
    assert solver.calls == [1, 1, len(OTHERS)]  # it has just come
    made.command(seen(1.0, ("ahead", 5.0, 0.0)))
    assert solver.calls[3:] == [1, 1]  # and stays: along the reference alone


@pytest.mark.parametrize(("weight", "count"), [(1e6, 1), (1e-3, len(OTHERS))])
def test_every_start_is_tried_where_the_level_gives_way_far(weight: float, count: int) -> None:
    solver = Counting()
    made = planner(solver, Relaxed(weight=weight))
    made.command(seen(0.0, ("ahead", 5.0, 0.0)))
    made.command(seen(0.5, ("ahead", 5.0, 0.0)))
    assert solver.calls[2:] == [1, count]


@dataclass(frozen=True)
class Dropping(CheapestSolver):
    """Solves with fatrop from the first of several starts, and gives the others up.

    ``spoilt`` moves that one's plan off its dynamics, ``worse`` that of the first call; with
    ``slack`` the solver knows that these are not feasible. ``calls`` are how many plans each call
    knew, -1 where it was to solve from each start, and from how many.
    """

    spoilt: bool = False
    worse: bool = False
    slack: float = 0.0
    calls: list[tuple[int, int]] = field(default_factory=list)

    def solve(self, problem: Problem, parameters: Parameters, guesses: Any, deadline: Any = None
              ) -> list[Solution]:  # fmt: skip
        self.calls.append((-1, len(guesses)))
        first, *others = Fatrop().solve(problem, parameters, guesses, deadline)
        if self.worse and not others:
            first = self._moved(first)
        return [first, *others]

    def _moved(self, one: Solution) -> Solution:
        slack = np.full(len(one.point.inputs), self.slack)
        return replace(one, point=replace(one.point, states=one.point.states + 1.0, slack=slack))

    def solve_cheapest(
        self, problem: Problem, parameters: Parameters, guesses: Any, known: Any, within: float,
        deadline: Any = None,
    ) -> list[Solution]:  # fmt: skip
        assert within == SAME * Unicycle().radius
        self.calls.append((len(known), len(guesses)))
        first, *others = Fatrop().solve(problem, parameters, guesses, deadline)
        if self.spoilt:
            first = self._moved(first)
        dropped = [
            replace(one, status=Status.GIVEN_UP, message="given up", cost=0.0, iterations=1000)
            for one in others
        ]
        return [first, *dropped]


def test_a_start_that_is_given_up_is_no_plan_and_on_record() -> None:
    solver = Dropping()
    made = planner(solver)
    solver.calls.clear()
    made.command(seen(0.0, ("ahead", 5.0, 0.0)))
    kept = made.explain()
    count = len(kept.guesses) - 1
    assert count > 2 and solver.calls == [(-1, 1), (1, count)]
    assert made.plan is not None and made.plan.rung is Rung.OPTIMAL
    assert made.plan.cost > 0.0 and made.plan.iterations > 1000 * (count - 1)
    assert kept.ends[2:] == ("given up",) * (count - 1)
    assert "start 3 was given up" in kept.text() and "start 2 was" not in kept.text()
    solver.calls.clear()
    again = replace(kept, planner={**kept.planner, "solver": "riccati"}).again()
    assert len(again) == len(kept.guesses)
    assert any(one.status is Status.GIVEN_UP for one in again)


def test_what_was_given_up_for_a_plan_that_fails_the_re_check_is_solved() -> None:
    solver = Dropping(spoilt=True)
    made = planner(solver)
    solver.calls.clear()
    made.command(seen(0.0, ("ahead", 5.0, 0.0)))
    count = len(made.explain().guesses) - 1
    assert count > 2 and solver.calls == [(-1, 1), (1, count), (-1, count - 1)]
    assert made.plan is not None and made.plan.rung is Rung.OPTIMAL
    assert made.plan.iterations > 1000 * (count - 1)
    assert "given up" not in made.explain().text()


def test_where_the_first_plan_fails_the_re_check_nothing_is_given_up() -> None:
    solver = Dropping(worse=True)
    made = planner(solver)
    solver.calls.clear()
    made.command(seen(0.0, ("ahead", 5.0, 0.0)))
    assert solver.calls == [(-1, 1), (-1, len(made.explain().guesses) - 1)]
    assert made.plan is not None and made.plan.rung is Rung.OPTIMAL


@pytest.mark.parametrize("first", [True, False])
def test_a_plan_that_enters_regions_leaves_starts_given_up(first: bool) -> None:
    """Who leads to the same plan fails the re-check as well, and nobody is too dear for it."""
    solver = Dropping(worse=first, spoilt=not first, slack=1.0)
    made = planner(solver)
    solver.calls.clear()
    made.command(seen(0.0, ("ahead", 5.0, 0.0)))
    assert solver.calls == [(-1, 1), (1, len(made.explain().guesses) - 1)]
    assert "given up" in made.explain().text()


def test_the_side_is_chosen_on_cost_and_kept() -> None:
    """Who stands a little to the left is passed on the right, wherever the last plan went."""
    made = planner(Fatrop())
    made.command(seen(0.0, ("a", 4.0, 0.3)))
    assert made.plan is not None
    assert made.plan.positions[:, 1].min() < -0.5
    sides = []
    for k, y in enumerate((0.01, -0.01, 0.02, -0.02)):  # noise about the middle
        made.command(seen(0.5 * (k + 1), ("a", 4.0, 0.3 * (k == 0) + y)))
        sides.append(np.sign(made.plan.positions[np.abs(made.plan.positions[:, 1]).argmax(), 1]))
    assert len(set(sides)) == 1


def test_names_that_are_no_start_are_refused() -> None:
    with pytest.raises(WideberthError, match=r"\['up'\]; wanted some of"):
        planner(Fatrop(), starts=("up", "left"))
    with pytest.raises(WideberthError, match="or auto"):
        planner(Fatrop(), starts="always")


def test_a_robot_that_is_carried_along_follows_the_smoother_s_ramp() -> None:
    """In steps of at most 0.05 s, each towards the twist at its end; without one it coasts."""
    for duration, count in ((1e-12, 1), (0.05, 1), (0.1, 2), (0.12, 3), (0.10001, 3), (1.0, 20)):
        asked: list[float] = []

        def at(time: float, asked: list[float] = asked) -> Twist:
            asked.append(time)
            return Twist((0.1 * len(asked), 0.0))

        ramp: Any = SimpleNamespace(at=at)
        robot = HolonomicVelocity(max_speed=9.0)
        moved = carry(robot, np.array([1.0, 2.0]), ramp, 7.0, duration)
        piece = duration / count
        np.testing.assert_allclose(asked, 7.0 + piece * np.arange(1, count + 1), rtol=1e-15)
        way = 0.1 * piece * count * (count + 1) / 2.0
        np.testing.assert_allclose(moved, [1.0 + way, 2.0], rtol=1e-12)
    coasting = carry(Unicycle(), np.array([1.0, 2.0, np.pi / 2, 0.5, 0.0]), None, 7.0, 1.2)
    np.testing.assert_allclose(coasting, [1.0, 2.6, np.pi / 2, 0.5, 0.0], atol=1e-12)


@pytest.mark.parametrize(("speeds", "pace"), [((0.2, 0.6, 0.4), 0.6), ((-0.3, 0.1, 0.0), 0.3)])
def test_backing_is_at_the_greatest_speed_of_the_reference(
    speeds: tuple[float, ...], pace: float
) -> None:
    """And of a robot that is to stand, at a millimetre a second."""
    robot = Unicycle()
    problem, parameters, guess = straight(robot, 0.0)
    for asked, wanted in ((np.resize(speeds, STEPS), pace), (np.zeros(STEPS), 1e-3)):
        there = replace(parameters, speed=asked, initial=np.zeros(5))
        (back,) = other_starts(robot, problem, there, guess, ("back-left",))
        assert back.states[-1, 3] == pytest.approx(-wanted)


def test_a_start_that_is_another_one_s_is_left_out() -> None:
    """A robot that stands goes nowhere by waiting or coasting; each name counts once."""
    robot = Unicycle()
    problem, parameters, guess = straight(robot, 0.0)
    (left,) = other_starts(robot, problem, parameters, guess, ("wait", "coast", "left", "left"))
    assert not np.array_equal(left.states, guess.states)
    (wait,) = other_starts(robot, problem, parameters, left, ("left", "wait", "coast"))
    np.testing.assert_array_equal(wait.states, guess.states)

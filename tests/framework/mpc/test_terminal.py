"""Plans that end at rest: the last one, continued by standing, is always there to fall back on."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pytest

from wideberth.framework.mpc.assembly import REST
from wideberth.framework.mpc.levels.fixed import Fixed
from wideberth.framework.mpc.ocp.problem import Parameters, Problem
from wideberth.framework.mpc.ocp.transcription import Guess
from wideberth.framework.mpc.planner.planner import Planner
from wideberth.framework.mpc.planner.rollout import follow, shift, stand, steer
from wideberth.framework.mpc.planner.rungs import Fallback
from wideberth.framework.mpc.solver import Solution, Solver
from wideberth.framework.plugins.config import build
from wideberth.framework.plugins.registry import names
from wideberth.framework.robot import Robot, start_state, step
from wideberth.framework.values.motion import Detection, Observation, Truth, Twist
from wideberth.framework.values.path import Path
from wideberth.framework.values.plan import Plan, Rung, Status
from wideberth.predictors.oracle import Oracle
from wideberth.regions.mahalanobis_ellipse import MahalanobisEllipse
from wideberth.robots.holonomic_velocity import HolonomicVelocity
from wideberth.robots.unicycle import Unicycle
from wideberth.robots.unicycle_velocity import UnicycleVelocity
from wideberth.solvers.fatrop import Fatrop
from wideberth.tests.helpers.problems import assemble

ROBOTS = [build("robots", name) for name in names("robots")]
TAKES_VELOCITIES = HolonomicVelocity, UnicycleVelocity
DT, RADIUS = 0.5, 0.3
TIMES = np.arange(0.0, 60.0, 0.1)


@dataclass(frozen=True)
class Fading(Solver):
    """Solves the first calls with fatrop and then nothing any more."""

    good: int
    calls: list[int] = field(default_factory=list)

    def solve(
        self,
        problem: Problem,
        parameters: Parameters,
        guesses: Sequence[Guess],
        deadline: float | None = None,
    ) -> list[Solution]:
        self.calls.append(len(guesses))
        if len(self.calls) > self.good:
            raise RuntimeError("out of order")
        return Fatrop().solve(problem, parameters, guesses, deadline)


class World:
    """A robot without noise among discs whose future is known exactly."""

    def __init__(self, robot: Robot, futures: dict[str, Any], solver: Solver, **changes: Any):
        self.robot, self.futures, self.time = robot, futures, 0.0
        settings: dict[str, Any] = {
            "starts": (),
            "fallback": Fallback(stop_at_end=True),
            **changes,
        }
        self.planner = Planner(robot, MahalanobisEllipse(), Oracle(), Fixed(), solver, **settings)
        way = np.zeros((2, robot.dimension))
        way[1, 0] = 30.0
        self.planner.set_path(Path(way))
        if isinstance(solver, Fading):
            solver.calls.clear()  # those of the warm-up
        first = np.eye(robot.dimension)[0]
        self.state = np.array(start_state(robot, 0.0 * first, first, 0.3)[0], dtype=float)

    def decide(self) -> Plan:
        """One call, and the robot does exactly what the plan says."""
        here = {
            name: np.array([np.interp(self.time, TIMES, column) for column in track.T])
            for name, track in self.futures.items()
        }
        size = self.robot.dimension
        detections = tuple(
            Detection(name, place, 1e-8 * np.eye(size), RADIUS) for name, place in here.items()
        )
        truth = Truth(TIMES, self.futures)
        self.planner.command(Observation(self.time, self.state, detections, truth=truth))
        plan = self.planner.plan
        assert plan is not None
        self.state = np.array(step(self.robot, tuple(self.state), tuple(plan.inputs[0]), DT))
        self.time += DT
        return plan


def passing(rng: np.random.Generator, size: int, count: int) -> dict[str, Any]:
    """Discs that cross the robot's path somewhere, straight on and at a constant speed."""
    found = {}
    for i in range(count):
        meets = np.zeros(size)
        meets[0], when = rng.uniform(2.0, 6.0), rng.uniform(3.0, 10.0)
        velocity = rng.normal(size=size)
        velocity *= rng.uniform(0.2, 0.6) / np.linalg.norm(velocity)
        found[f"o{i}"] = meets + (TIMES - when)[:, None] * velocity
    return found


def clear(place: np.ndarray, futures: dict[str, Any], body: float, since: float) -> bool:
    """Whether nobody comes where the robot would stand from some time on."""
    later = since + 0.5 <= TIMES
    gaps = [np.linalg.norm(track[later] - place, axis=1).min() for track in futures.values()]
    return min(gaps, default=np.inf) > body + RADIUS + 0.15


@pytest.mark.parametrize("robot", ROBOTS, ids=lambda robot: type(robot).__name__)
def test_the_plan_ends_at_rest(robot: Robot) -> None:
    world = World(robot, {}, Fatrop())
    plan = world.decide()
    assert plan.rung is Rung.OPTIMAL
    pushed = robot.twist(tuple(plan.states[-1]), (0.0,) * len(robot.inputs))
    speed = np.abs([*pushed.linear, pushed.angular]).max()
    assert speed <= REST + 1e-4
    free = World(robot, {}, Fatrop(), fallback=Fallback()).decide()
    if not isinstance(robot, TAKES_VELOCITIES):
        assert np.linalg.norm(free.states[-1] - plan.states[-1]) > 0.1
    assert free.positions[-1, 0] >= plan.positions[-1, 0] - 1e-6


def test_a_robot_that_takes_velocities_needs_no_condition() -> None:
    for robot in ROBOTS:
        rows = {
            wanted: assemble(
                robot, MahalanobisEllipse(), Fixed(), horizon=5, dt=0.5, capacity=0,
                stop_at_end=wanted,
            ).terminal_constraints.size1_out(0)
            for wanted in (True, False)
        }  # fmt: skip
        assert rows[False] == 0
        assert (rows[True] == 0) == isinstance(robot, TAKES_VELOCITIES)


@pytest.mark.parametrize("robot", ROBOTS, ids=lambda robot: type(robot).__name__)
@pytest.mark.parametrize("share", [0.3, 1.0, 2.4, 40.0])
def test_what_lies_beyond_the_end_stands(robot: Robot, share: float) -> None:
    """Also from another state than the plan was made for."""
    axis = np.eye(robot.dimension)[0]
    start = np.array(start_state(robot, 0.0 * axis, axis, 0.35)[0], dtype=float)
    _, inputs = steer(robot, start, Twist((0.0,) * robot.dimension, 0.0), 10, DT)
    later = stand(robot, start, shift(inputs, share), share, DT)
    states = follow(robot, start, later, DT)
    twist = robot.twist(tuple(states[-1]), (0.0,) * len(robot.inputs))
    assert np.abs([*twist.linear, twist.angular]).max() < 1e-9
    if share == 1.0:
        assert later[:-1] == pytest.approx(inputs[1:])


def encounter(robot: Robot, rng: np.random.Generator) -> tuple[World, Plan]:
    """First plan among two who pass, kept where it is feasible and nobody comes to its end."""
    for _ in range(20):
        futures = passing(rng, robot.dimension, 2)
        world = World(robot, futures, Fading(good=1))
        first = world.decide()
        end = first.stamp + DT * len(first.inputs)
        if first.rung is Rung.OPTIMAL and clear(first.positions[-1], futures, robot.radius, end):
            return world, first
    raise AssertionError("no encounter of twenty can be solved")


@pytest.mark.parametrize("robot", ROBOTS, ids=lambda robot: type(robot).__name__)
@pytest.mark.parametrize("seed", range(2))
def test_without_a_solver_the_last_plan_carries_on_and_stands(robot: Robot, seed: int) -> None:
    """Recursive safety: from the first feasible plan on, no step falls below the third rung."""
    world, first = encounter(robot, np.random.default_rng(seed))
    plans = [world.decide() for _ in range(20)]
    for plan in plans:
        assert plan.rung is Rung.SHIFTED, plan.reason
        assert plan.status is Status.FAILED
        assert plan.violation <= 1e-4
    plan = plans[-1]
    assert np.ptp(plan.positions, axis=0).max() < 0.01  # it stands
    assert plan.positions[0] == pytest.approx(first.positions[-1], abs=0.01)


@pytest.mark.parametrize("seed", range(3))
def test_a_long_run_among_crossing_obstacles_never_falls_below_the_third_rung(seed: int) -> None:
    """As long as nobody comes, after the forecast's end, to where the last plan would stand."""
    rng = np.random.default_rng(100 + seed)
    futures = passing(rng, 2, 3)
    world = World(Unicycle(), futures, Fatrop(), starts="auto")
    good, promised, kept = {Rung.OPTIMAL, Rung.FEASIBLE, Rung.SHIFTED}, False, 0
    for _ in range(40):
        plan = world.decide()
        assert plan.rung in good or not promised, plan.reason
        kept += promised
        end = plan.stamp + DT * len(plan.inputs)
        promised = plan.rung in good and clear(plan.positions[-1], futures, 0.75, end)
    assert kept > 10

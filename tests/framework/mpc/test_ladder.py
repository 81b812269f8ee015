"""The fallback ladder: each rung when the one above does not hold, and always with the reason."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import pytest

from wideberth.framework.mpc.levels.fixed import Fixed
from wideberth.framework.mpc.ocp.problem import Parameters, Problem
from wideberth.framework.mpc.ocp.transcription import Guess
from wideberth.framework.mpc.planner.planner import Planner
from wideberth.framework.mpc.planner.rollout import brake
from wideberth.framework.mpc.planner.stopping import stops
from wideberth.framework.mpc.planner.verify import Violation
from wideberth.framework.mpc.solver import Solution, Solver
from wideberth.framework.plugins.config import build
from wideberth.framework.plugins.registry import names
from wideberth.framework.robot import Robot, start_state, step
from wideberth.framework.values.motion import Detection, Observation, Pose, Twist
from wideberth.framework.values.path import Path
from wideberth.framework.values.plan import Breach, BreachKind, Plan, Rung, Status
from wideberth.predictors.static import Static
from wideberth.regions.mahalanobis_ellipse import MahalanobisEllipse
from wideberth.robots.unicycle import Unicycle
from wideberth.solvers.fatrop import Fatrop

ROBOTS = [build("robots", name) for name in names("robots")]


@dataclass(frozen=True)
class Failing(Solver):
    """Solves the first calls with fatrop; then drives on without input, or raises."""

    good: int = 0
    raises: bool = False
    calls: list[int] = field(default_factory=list)

    def solve(
        self,
        problem: Problem,
        parameters: Parameters,
        guesses: Sequence[Guess],
        deadline: float | None = None,
    ) -> list[Solution]:
        self.calls.append(len(guesses))
        if len(self.calls) <= self.good:
            return Fatrop().solve(problem, parameters, guesses, deadline)
        if self.raises:
            raise RuntimeError("out of order")
        wild = [replace(guess, inputs=0.0 * guess.inputs) for guess in guesses]
        return [Solution(one, Status.INFEASIBLE, "gave up", 0.0, 3, 0.001) for one in wild]


def planner(robot: Robot | None = None, **changes: Any) -> Planner:
    robot = Unicycle() if robot is None else robot
    settings: dict[str, Any] = {"solver": Failing(), "starts": (), **changes}
    made = Planner(robot, MahalanobisEllipse(), Static(), Fixed(), **settings)
    way = np.zeros((2, robot.dimension))
    way[1, 0] = 20.0
    made.set_path(Path(way))
    if isinstance(made.solver, Failing):
        made.solver.calls.clear()  # those of the warm-up
    return made


def ahead(
    robot: Robot, time: float, *others: tuple[float, ...], speed: float = 0.5
) -> Observation:
    """The robot at the origin, and what stands around it."""
    size = robot.dimension
    state, _ = start_state(robot, [0.0] * size, np.eye(size)[0], speed)
    detections = tuple(
        Detection(f"o{i}", np.array([*place, 0.0][:size]), 1e-4 * np.eye(size), 0.3)
        for i, place in enumerate(others)
    )
    return Observation(time, np.array(state), detections)


def decided(made: Planner, observation: Observation) -> Plan:
    made.command(observation)
    assert made.plan is not None
    return made.plan


def check_drivable(robot: Robot, states: np.ndarray, inputs: np.ndarray, dt: float) -> None:
    for i, control in enumerate(inputs):
        assert states[i + 1] == pytest.approx(step(robot, states[i], control, dt), abs=1e-9)
        assert min((0.0, *robot.constraints(states[i], control))) > -1e-9
    low, high = np.array(robot.input_bounds().lower), np.array(robot.input_bounds().upper)
    assert (inputs >= low - 1e-9).all() and (inputs <= high + 1e-9).all()
    low, high = np.array(robot.state_bounds().lower), np.array(robot.state_bounds().upper)
    assert (states[1:] >= low - 1e-9).all() and (states[1:] <= high + 1e-9).all()


@pytest.mark.parametrize("robot", ROBOTS, ids=lambda robot: type(robot).__name__)
@pytest.mark.parametrize("steps", [1, 4, 15])
def test_every_way_to_stop_can_be_driven_and_ends_at_rest(robot: Robot, steps: int) -> None:
    size = robot.dimension
    state, _ = start_state(robot, [0.0] * size, np.eye(size)[0], 0.5)
    found = list(stops(robot, np.array(state), steps, 0.5))
    assert found[0][0] == "straight"
    assert len({name for name, _, _ in found}) > 3
    for _, states, inputs in found:
        assert states.shape == (steps + 1, len(robot.states))
        check_drivable(robot, states, inputs, 0.5)
        if steps == 15:
            twist = robot.twist(tuple(states[-1]), tuple(inputs[-1]))
            assert np.hypot(twist.angular, np.linalg.norm(twist.linear)) < 0.02


@pytest.mark.parametrize("robot", ROBOTS, ids=lambda robot: type(robot).__name__)
def test_the_stop_taken_is_no_worse_than_braking_straight_on(robot: Robot) -> None:
    """Somebody stands too near: turning or backing off enters less than braking does."""
    better = []
    for side in (0.15, -0.15):
        made = planner(robot)
        plan = decided(made, ahead(robot, 0.0, (robot.radius + 0.3, side)))
        assert plan.rung is Rung.BRAKE
        assert plan.status is Status.INFEASIBLE
        check_drivable(robot, plan.states, plan.inputs, made.dt)
        place = np.array([robot.radius + 0.3, side, 0.0])[: robot.dimension]
        straight, _ = brake(robot, plan.states[0], made.horizon, made.dt)
        halt = np.stack(robot.pose(tuple(straight.T)).position, axis=-1)
        taken = np.linalg.norm(plan.positions - place, axis=1)
        assert taken[1:].sum() >= np.linalg.norm(halt - place, axis=1)[1:].sum() - 1e-6
        better.append(taken[-1] > np.linalg.norm(halt[-1] - place) + 0.1)
        if plan.breach is None:  # a robot that stops at once is out of it in a step
            assert np.ptp(halt, axis=0) == pytest.approx(0.0)
            continue
        assert (plan.breach.kind, plan.breach.name) == (BreachKind.REGION, "o0")
        assert plan.breach.amount == pytest.approx(plan.violation)
    assert all(better)


def test_the_reason_names_every_rung_that_did_not_hold() -> None:
    made = planner(solver=Failing(good=1))
    first = decided(made, ahead(made.robot, 0.0))
    assert (first.rung, first.reason, first.breach) == (Rung.OPTIMAL, "", None)
    plan = decided(made, ahead(made.robot, 0.5, (1.15, 0.05)))
    assert plan.rung is Rung.BRAKE
    gave_way, solver, its, shifted, taken = plan.reason.split("; ")
    assert gave_way == str(plan.given_way) and gave_way.startswith("asked 95 %, holds ")
    assert solver == "solver: gave up"
    assert its.startswith("its plan: region of 'o0' entered by")
    assert shifted.startswith("shifted last plan: region of 'o0' entered by")
    assert taken.startswith("brake (") and "taken: region of 'o0' entered by" in taken
    assert str(plan.breach) in taken


def test_braking_straight_on_is_taken_where_it_breaks_nothing() -> None:
    made = planner()
    plan = decided(made, ahead(made.robot, 0.0, (2.5, 0.0)))
    assert plan.rung is Rung.BRAKE
    assert plan.breach is None
    assert plan.violation <= 1e-4
    assert np.abs(plan.positions[:, 1]).max() < 1e-9
    assert plan.reason.startswith("solver: gave up; its plan: region of 'o0'")


@pytest.mark.parametrize("raises", [False, True])
def test_a_solver_that_fails_or_raises_leaves_the_shifted_plan(raises: bool) -> None:
    made = planner(solver=Failing(good=1, raises=raises))
    first = decided(made, ahead(made.robot, 0.0, (3.0, 0.4)))
    state = np.array(step(made.robot, first.states[0], first.inputs[0], 0.5))
    seen = replace(ahead(made.robot, 0.5, (3.0, 0.4)), state=state)
    plan = decided(made, seen)
    assert plan.rung is Rung.SHIFTED
    assert plan.inputs[:-1] == pytest.approx(first.inputs[1:])
    assert ("RuntimeError: out of order" if raises else "gave up") in plan.reason
    assert plan.status is (Status.FAILED if raises else Status.INFEASIBLE)


def test_the_worst_of_several_breaches_is_named() -> None:
    regions = np.zeros((4, 3))
    regions[2, 1], regions[3, 0] = 0.3, 0.2
    found = Violation(np.array([0.0, 0.25, 0.0, 0.0]), regions)
    assert found.breach(("a", "b", "c")) == Breach(BreachKind.REGION, "b", 3, 0.3)
    assert found.breach(("a",)) == Breach(BreachKind.REGION, "?", 3, 0.3)
    motion = replace(found, motion=np.array([0.0, 0.35, 0.0, 0.0])).breach(("a", "b", "c"))
    assert motion == Breach(BreachKind.MOTION, "", 2, 0.35)
    assert str(motion) == "motion limits broken by 0.35 at step 2"
    assert Violation(np.zeros(4), np.zeros((4, 0))).breach(()) is None


def test_standing_inside_a_region_ends_outside_for_every_solver_state() -> None:
    """Whatever the solver says, the plan leaves, keeps the limits, and says what it breaks."""
    robot = Unicycle()
    for solver in (Failing(), Failing(raises=True), Fatrop()):
        for heading in (0.0, 2.0, np.pi):
            made = planner(robot, solver=solver, starts="auto")
            state = robot.state_at(Pose((0.0, 0.0), heading), Twist((0.0, 0.0)))
            seen = replace(ahead(robot, 0.0, (0.8, 0.1)), state=np.array(state))
            plan = decided(made, seen)
            apart = np.linalg.norm(plan.positions - [0.8, 0.1], axis=1)
            assert apart[-1] > apart[0] + 0.1
            assert plan.violation > 0.0 and plan.breach is not None
            assert "'o0' entered" in plan.reason
            check_drivable(robot, plan.states, plan.inputs, made.dt)

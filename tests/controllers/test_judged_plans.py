"""A planner that judges plans by the contact to expect: what it drives, and under attack."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest

from wideberth.controllers.costs.contouring import Contouring
from wideberth.controllers.judging.expected_contact import ContactJudge, ExpectedContact
from wideberth.framework.control.command_limits import broken_limit
from wideberth.framework.mpc.levels.fixed import Fixed
from wideberth.framework.mpc.ocp.problem import Parameters, Problem
from wideberth.framework.mpc.ocp.transcription import Guess
from wideberth.framework.mpc.planner.instance import Instance
from wideberth.framework.mpc.planner.judge import ByCost
from wideberth.framework.mpc.planner.multistart import MultiStartResult
from wideberth.framework.mpc.planner.planner import Planner
from wideberth.framework.mpc.planner.rungs import Fallback
from wideberth.framework.mpc.solver import Solution, Solver
from wideberth.framework.plugins.config import build, describe
from wideberth.framework.predictor import Predictor
from wideberth.framework.robot import Robot, start_state, step
from wideberth.framework.values.arrays import Array
from wideberth.framework.values.errors import WideberthError
from wideberth.framework.values.forecast import Forecast, Scene
from wideberth.framework.values.motion import Command, Detection, Observation
from wideberth.framework.values.path import Path
from wideberth.framework.values.plan import TOLERANCE, Rung, Status
from wideberth.framework.values.polygon import Polygon
from wideberth.framework.values.tracks import Tracks
from wideberth.predictors.constant_velocity import ConstantVelocity
from wideberth.predictors.turning import TurningPeople
from wideberth.regions.mahalanobis_ellipse import MahalanobisEllipse
from wideberth.regions.static.separating_line import StaticSeparatingLine
from wideberth.robots.unicycle import Unicycle
from wideberth.solvers.riccati.solver import Riccati

DT = 0.2
ROBOT = Unicycle(0.3, 1.0, 1.0, 0.7, 1.0)
STRAIGHT = Path(np.array([[0.0, 0.0], [12.0, 0.0]]))
SQUARE = ((-5.0, -5.0), (5.0, -5.0), (5.0, 5.0), (-5.0, 5.0))


def made(path: Path = STRAIGHT, **changes: Any) -> Planner:
    settings: dict[str, Any] = {
        "robot": ROBOT, "region": MahalanobisEllipse(), "predictor": ConstantVelocity(),
        "level": Fixed(), "solver": Riccati(), "penalty": 1e4, "dt": DT, "period": DT,
        "track_dt": DT, "horizon": 12, "reference_speed": 1.0,
        "expected_contact": ExpectedContact(), **changes,
    }  # fmt: skip
    planner = Planner(**settings)
    planner.set_path(path)
    return planner


Walkers = dict[str, tuple[tuple[float, float], tuple[float, float]]]


def seen(time: float, state: Array, walkers: Walkers, **more: Any) -> Observation:
    """Observe people who walk straight on: place at 0 s and velocity of each."""
    people = tuple(
        Detection(name, np.array(place) + time * np.array(velocity), 1e-4 * np.eye(2), 0.3)
        for name, (place, velocity) in walkers.items()
    )
    return Observation(time, state, people, **more)


def decided(planner: Planner, state: Array, walkers: Walkers, **more: Any) -> Command:
    """Decide at 0 s after people were watched for 2 s."""
    for k in range(-10, 0):
        planner.remember(seen(k * DT, state, walkers, **more))
    command = planner.command(seen(0.0, state, walkers, **more))
    assert not broken_limit(planner.robot, command)
    assert planner.plan is not None
    return command


def driving(x: float, y: float = 0.0, heading: float = 0.0, speed: float = 0.7) -> Array:
    return np.array([x, y, heading, speed, 0.0])


def driven(
    planner: Planner, start: Array, walkers: Walkers, ticks: int, **more: Any
) -> tuple[Array, list[str]]:
    """Drive in a loop; return the states at each decision and the rungs."""
    states, rungs, state = [start], list[str](), start
    for k in range(ticks):
        command = planner.command(seen(DT * k, state, walkers, **more))
        assert not broken_limit(planner.robot, command)
        assert planner.plan is not None
        rungs.append(str(planner.plan.rung))
        for _ in range(4):
            inputs = planner.robot.drive(tuple(state), command.twist, DT / 4)
            state = np.array(step(planner.robot, tuple(state), inputs, DT / 4))
        states.append(state)
    return np.array(states), rungs


# ---- What it drives


def test_a_person_near_a_border_who_may_turn_is_reckoned_with() -> None:
    """He leaves the way of the robot if he walks on, and the area, which people do not leave."""
    leaving: Walkers = {"a": ((-2.2, 4.2), (0.0, 1.0))}
    path, start = Path(np.array([[-5.0, 3.3], [8.0, 3.3]])), driving(-4.2, 3.3)
    expecting, straight = (
        made(path, predictor=one) for one in (TurningPeople(area=SQUARE), ConstantVelocity())
    )
    commands = [decided(one, start, leaving) for one in (expecting, straight)]
    assert commands[0] != commands[1]
    plan = expecting.plan
    assert plan is not None and plan.forecast is not None
    assert plan.forecast.mean.shape[1] > 1


def test_the_plan_driven_is_the_cheapest_of_all_that_were_tried(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """And its cost is what the judge says."""
    looked: list[tuple[ContactJudge, MultiStartResult]] = []
    judged = ContactJudge.judged

    def watching(
        judge: ContactJudge, instance: Instance, outcome: MultiStartResult
    ) -> MultiStartResult:
        looked.append((judge, outcome))
        return judged(judge, instance, outcome)

    monkeypatch.setattr(ContactJudge, "judged", watching)
    rng, kept = np.random.default_rng(0), 0
    for _ in range(12):
        planner = made(predictor=TurningPeople(area=SQUARE))
        people: Walkers = {
            str(k): (tuple(rng.uniform(-1.0, 5.0, 2)), tuple(rng.normal(0.0, 0.7, 2)))
            for k in range(4)
        }
        looked.clear()
        decided(planner, driving(-3.0), people)
        plan = planner.plan
        assert plan is not None and len(looked) == 1
        judge, outcome = looked[0]
        points = [*(one.point for one in outcome.candidates), outcome.guesses[0]]
        costs = judge.costs(np.array([one.states for one in points]))
        if plan.rung in (Rung.OPTIMAL, Rung.FEASIBLE):
            assert plan.cost == pytest.approx(costs.min(), abs=1e-9)
            kept += 1
        assert judge.costs(plan.states[None]) == pytest.approx([plan.cost], abs=1e-9)
    assert kept >= 6


def test_the_same_scene_gives_the_same_bytes() -> None:
    walkers: Walkers = {"a": ((2.0, 0.3), (-0.8, 0.0)), "b": ((3.0, 2.0), (0.0, -0.9))}
    found = []
    for _ in range(2):
        states, _ = driven(made(predictor=TurningPeople()), driving(0.0), walkers, 12)
        found.append(states.tobytes())
    assert found[0] == found[1]


# ---- Under attack

ROBOTS: list[dict[str, Any]] = [
    {"type": "unicycle"}, {"type": "unicycle_velocity"},
    {"type": "bicycle"}, {"type": "holonomic_velocity"}, {"type": "holonomic_3d"},
]  # fmt: skip


@pytest.mark.parametrize("away", [False, True], ids=["facing", "facing away"])
@pytest.mark.parametrize("config", ROBOTS, ids=lambda one: one["type"])
def test_a_goal_is_reached_and_the_robot_rests_there(config: dict[str, Any], away: bool) -> None:
    robot: Robot = build("robots", {**config, "radius": 0.35})
    rest = [0.0] * (robot.dimension - 1)
    goal = np.array([1.6, *rest])
    planner = made(Path(np.stack([0.0 * goal, goal])), robot=robot, reference_speed=0.6)
    start, _ = start_state(robot, [0.0, *rest], [-1.0 if away else 1.0, *rest], 0.0)
    states, _ = driven(planner, np.array(start), {}, 45)
    places = states[:, : robot.dimension]
    assert np.linalg.norm(places[-8:] - goal, axis=1).max() < 0.3
    assert np.linalg.norm(np.diff(places[-8:], axis=0), axis=1).max() < 0.05


WALL = Polygon(((1.2, -3.0), (1.4, -3.0), (1.4, 3.0), (1.2, 3.0)), "wall")


@pytest.mark.parametrize("dt", [0.2, 0.5])
@pytest.mark.parametrize("speed", [0.0, 0.7])
def test_no_plan_goes_through_a_wall(speed: float, dt: float) -> None:
    """Nor does one that comes to it late, where a contact with a person would have faded."""
    planner = made(static_region=StaticSeparatingLine(), dt=dt)
    state = driving(0.0, speed=speed)
    for _ in range(8):
        states, _ = driven(planner, state, {}, 1, polygons=(WALL,))
        state = states[-1]
        plan = planner.plan
        assert plan is not None and plan.positions[:, 0].max() < 0.9 + 1e-3


@pytest.mark.parametrize(
    "changes",
    [
        {"fallback": Fallback(rungs=("brake",))},
        {"fallback": Fallback(stop_at_end=True)},
        {"fallback": Fallback(stop_at_end=True, steps_at_rest=4)},
        {"fallback": Fallback(rungs=("feasible iterate", "least violation", "brake"))},
        {"cost": Contouring()},
        {"latency": 0.1},
        {"penalty": None},
        {"most_obstacles": 1},
        {"horizon": 1},
        {"level": {"type": "relaxed", "weight": 100.0, "minimum": 0.0}},
        {"starts": ("left",)},
    ],
    ids=lambda one: str(*one.items())[:60],
)
def test_nothing_raises_whatever_is_set(changes: dict[str, Any]) -> None:
    if isinstance(changes.get("level"), dict):
        changes = {"level": build("levels", changes["level"])}
    walkers: Walkers = {"a": ((2.0, 0.1), (-0.8, 0.0)), "b": ((1.5, 1.0), (0.0, -0.9))}
    planner = made(predictor=TurningPeople(), **changes)
    driven(planner, driving(0.0), walkers, 5)
    assert planner.plan is not None and "Error" not in planner.plan.reason


@dataclass(frozen=True)
class Raising(Predictor):
    """Cannot forecast."""

    def predict(self, tracks: Tracks, steps: int, scene: Scene | None = None) -> Forecast:
        raise RuntimeError("no forecast today")


def test_a_predictor_that_raises_brakes_the_robot() -> None:
    planner = made(predictor=Raising())
    command = planner.command(seen(0.0, driving(0.0), {"a": ((2.0, 0.0), (0.0, 0.0))}))
    assert not broken_limit(ROBOT, command)
    assert planner.plan is not None and "no forecast today" in planner.plan.reason


@pytest.mark.parametrize("bad", [np.nan, np.inf, 1e9])
def test_numbers_that_are_none_raise_nothing(bad: float) -> None:
    planner, state = made(predictor=TurningPeople()), driving(0.0)
    decided(planner, state, {"a": ((2.0, 0.5), (0.0, -0.3))})
    place = Detection("b", np.array([bad, 0.0]), 1e-4 * np.eye(2), 0.3)
    assert not broken_limit(ROBOT, planner.command(Observation(DT, state, (place,))))
    lost = replace(seen(2 * DT, state, {}), state=np.array([bad, 0.0, 0.0, 0.0, 0.0]))
    assert not broken_limit(ROBOT, planner.command(lost))
    assert not broken_limit(ROBOT, planner.command(seen(3 * DT, state, {})))


@pytest.mark.parametrize("side", [(0.4, 0.0), (-0.4, 0.0), (0.0, 0.4), (0.0, 0.0)], ids=str)
def test_in_contact_the_robot_does_not_press_on(side: tuple[float, float]) -> None:
    """It ends no nearer to the person than it is, as without a judge."""
    planner = made(predictor=TurningPeople())
    decided(planner, driving(0.0, speed=0.0), {"a": (side, (0.0, 0.0))})
    plan = planner.plan
    assert plan is not None
    away = np.linalg.norm(plan.positions - np.array(side), axis=1)
    assert away.min() >= away[0] - 1e-6


@dataclass(frozen=True)
class Lying(Solver):
    """Calls something solved that no robot can drive: a jump to the goal, or no number."""

    value: float

    def solve(
        self, problem: Problem, parameters: Parameters, guesses: Sequence[Guess],
        deadline: float | None = None,
    ) -> list[Solution]:  # fmt: skip
        found = []
        for guess in guesses:
            states = guess.states.copy()
            states[1:, 0] = self.value
            point = replace(guess, states=states)
            found.append(Solution(point, Status.SOLVED, "solved", 0.0, 1, 0.0))
        return found


@pytest.mark.parametrize("value", [12.0, np.nan], ids=["jump", "nan"])
def test_a_solution_that_cannot_be_driven_does_not_displace_a_manoeuvre(value: float) -> None:
    """It would look the best of all, or be compared as no number."""
    planner = made(solver=Lying(value))
    command = decided(planner, driving(0.0), {"a": ((6.0, 3.0), (0.0, 0.0))})
    plan = planner.plan
    assert plan is not None and plan.rung is Rung.FEASIBLE
    assert plan.violation <= TOLERANCE and command.linear[0] > 0.5


def test_a_judge_that_no_config_states_is_not_described_as_another() -> None:
    planner = build("controllers", {"type": "recommended", "robot": "unicycle"})
    with pytest.raises(WideberthError, match=r"expected_contact is .*; wanted None or Expected"):
        describe(replace(planner, expected_contact=ByCost()))

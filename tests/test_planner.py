"""The planner as a Controller: safe whatever happens, and always with the reason."""

import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import pytest

from wideberth.framework.errors import WideberthError
from wideberth.framework.forecast import Forecast, Scene
from wideberth.framework.integration import step
from wideberth.framework.motion import Detection, Observation, Truth
from wideberth.framework.mpc.levels.fixed import Fixed
from wideberth.framework.mpc.levels.relaxed import Relaxed
from wideberth.framework.mpc.planner import Planner
from wideberth.framework.mpc.problem import Parameters, Problem
from wideberth.framework.mpc.solvers.base import Solution, Solver
from wideberth.framework.mpc.solvers.fatrop import Fatrop
from wideberth.framework.mpc.solvers.ipopt import Ipopt
from wideberth.framework.mpc.transcription import Guess
from wideberth.framework.path import Path
from wideberth.framework.plan import Plan, Rung, Status
from wideberth.framework.predictor import Predictor
from wideberth.framework.tracks import Tracks
from wideberth.predictors.constant_velocity import ConstantVelocity
from wideberth.predictors.kalman import Kalman
from wideberth.predictors.oracle import Oracle
from wideberth.regions.mahalanobis_ellipse import MahalanobisEllipse
from wideberth.regions.minkowski_sum import MinkowskiSum
from wideberth.robots.holonomic import Holonomic
from wideberth.robots.holonomic_velocity import HolonomicVelocity
from wideberth.robots.unicycle import Unicycle

STRAIGHT = Path(np.array([[0.0, 0.0], [20.0, 0.0]]))


def planner(**changes: Any) -> Planner:
    settings: dict[str, Any] = {
        "robot": Unicycle(),
        "region": MahalanobisEllipse(),
        "predictor": Kalman(),
        "level": Relaxed(weight=100.0),
        "solver": Fatrop(),
        "penalty": 1e4,
        **changes,
    }
    made = Planner(**settings)
    made.set_path(STRAIGHT)
    if isinstance(made.solver, Failing):
        made.solver.calls.clear()  # those of the warm-up
    return made


def at(
    time: float, x: float, *seen: tuple[str, float, float], y: float = 0.0, v: float = 0.5
) -> Observation:
    detections = tuple(
        Detection(name, np.array([a, b]), 1e-4 * np.eye(2), 0.75) for name, a, b in seen
    )
    return Observation(time, np.array([x, y, 0.0, v, 0.0]), detections)


def approach(made: Planner, ticks: int = 6, gap: float = 9.0) -> Plan:
    """The robot drives on while another one comes towards it."""
    for k in range(ticks):
        made.command(at(0.5 * k, 0.25 * k, ("other", gap - 0.25 * k, 0.8)))
    assert made.plan is not None
    return made.plan


@dataclass(frozen=True)
class Refusing(Predictor):
    """Raises, or returns nonsense, after a number of good forecasts."""

    def predict(self, tracks: Tracks, steps: int, scene: Scene | None = None) -> Forecast:
        if tracks.stamp > 1.2:
            raise RuntimeError("sensor unplugged")
        return Kalman().predict(tracks, steps, scene)


@dataclass(frozen=True)
class Failing(Solver):
    """Solves the first calls and then returns what it is told to."""

    good: int = 3
    status: Status = Status.INFEASIBLE
    calls: list[int] = field(default_factory=list)

    def solve(
        self,
        problem: Problem,
        parameters: Parameters,
        guesses: Sequence[Guess],
        deadline: float | None = None,
    ) -> list[Solution]:
        self.calls.append(1)
        solutions = Fatrop().solve(problem, parameters, guesses, deadline)
        if len(self.calls) <= self.good:
            return solutions
        wild = [replace(s.point, inputs=s.point.inputs * 0 + 9.0) for s in solutions]
        return [
            replace(s, point=w, status=self.status, message="told to fail")
            for s, w in zip(solutions, wild, strict=True)
        ]


def test_a_plan_reports_all_that_it_should() -> None:
    plan = approach(planner())
    assert plan.rung is Rung.OPTIMAL
    assert plan.status is Status.SOLVED
    assert plan.reason == ""
    assert plan.violation < 1e-4
    assert plan.iterations > 0
    assert plan.ids == ("other",)
    assert plan.states.shape == (16, 5)
    assert plan.inputs.shape == (15, 2)
    assert plan.level.shape == plan.content.shape == (15, 1)
    assert plan.content[0, 0] == pytest.approx(1 - np.exp(-0.5 * plan.level[0, 0] ** 2))
    assert plan.forecast is not None
    assert plan.forecast.mean.shape == (1, 1, 15, 2)
    assert plan.fallbacks == (None,)
    assert np.isfinite(plan.cost)
    clearance = np.linalg.norm(plan.positions[1:] - plan.forecast.mean[0, 0], axis=1)
    assert clearance.min() > 1.5 - 1e-3


def test_the_command_aims_at_the_next_step() -> None:
    made = planner()
    command = made.command(at(0.0, 0.0, y=0.5, v=0.3))
    assert made.plan is not None
    assert command.linear[0] == pytest.approx(made.plan.states[1, 3])
    assert command.omega == pytest.approx(made.plan.states[1, 4])
    assert command.ramp == 0.5
    direct = planner(robot=HolonomicVelocity())
    velocity = direct.command(Observation(0.0, np.zeros(2)))
    assert direct.plan is not None
    assert velocity.linear == pytest.approx(tuple(direct.plan.inputs[0]))
    assert velocity.ramp == 0.0


def test_the_same_observations_give_the_same_plan() -> None:
    first, second = approach(planner()), approach(planner())
    again = planner()
    approach(again)
    again.reset()
    third = approach(again)
    for other in (second, third):
        assert np.array_equal(first.states, other.states)
        assert np.array_equal(first.inputs, other.inputs)


def test_a_raising_plug_in_ends_in_a_safe_plan() -> None:
    made = planner(predictor=Refusing())
    plan = approach(made)
    assert plan.rung is Rung.BRAKE
    assert "RuntimeError: sensor unplugged" in plan.reason
    assert abs(plan.states[-1, 3]) < 1e-6
    assert np.abs(plan.inputs[:, 0]).max() <= 0.7 + 1e-9


def test_no_path_is_a_reason_not_a_crash() -> None:
    made = Planner(Unicycle(), MahalanobisEllipse(), Kalman(), Relaxed(), Fatrop())
    command = made.command(at(0.0, 0.0))
    assert made.plan is not None
    assert "set_path" in made.plan.reason
    assert abs(command.linear[0]) < 0.5


@pytest.mark.parametrize("status", [Status.INFEASIBLE, Status.DEADLINE, Status.FAILED])
def test_a_failed_solve_takes_the_shifted_plan_while_it_is_feasible(status: Status) -> None:
    solver = Failing(status=status)
    made = planner(solver=solver)
    approach(made, ticks=3)
    last = made.plan
    assert last is not None
    state = step(made.robot, last.states[0], last.inputs[0], 0.5)
    seen = (Detection("other", np.array([8.25, 0.8]), 1e-4 * np.eye(2), 0.75),)
    made.command(Observation(1.5, np.array(state), seen))
    assert made.plan is not None
    assert made.plan.rung is Rung.SHIFTED
    assert made.plan.status is status
    assert "told to fail" in made.plan.reason
    assert made.plan.inputs[:-1] == pytest.approx(last.inputs[1:])
    assert made.plan.violation <= 1e-4


def test_a_shifted_plan_that_would_collide_is_not_taken() -> None:
    made = planner(solver=Failing(good=2))
    made.command(at(0.0, 0.0, ("other", 9.0, 0.0)))
    made.command(at(0.5, 0.25, ("other", 9.0, 0.0)))
    made.command(at(1.0, 0.5, ("other", 9.0, 0.0), ("sudden", 2.3, 0.0)))
    assert made.plan is not None
    assert made.plan.rung in (Rung.BRAKE, Rung.LEAST)
    assert "told to fail" in made.plan.reason


def test_starting_inside_a_region_gives_a_plan_that_leaves() -> None:
    made = planner()
    made.command(at(0.0, 0.0, ("wall", 1.2, 0.1), v=0.0))
    plan = made.plan
    assert plan is not None
    assert plan.rung is not Rung.OPTIMAL
    assert "'wall' entered" in plan.reason
    assert plan.violation > 0
    start, end = (np.linalg.norm(p - [1.2, 0.1]) for p in plan.positions[[0, -1]])
    assert end > start
    hard = planner(penalty=None, solver=Ipopt())
    hard.command(at(0.0, 0.0, ("wall", 1.2, 0.1), v=0.0))
    assert hard.plan is not None
    assert hard.plan.rung in (Rung.BRAKE, Rung.LEAST)
    assert "'wall'" in hard.plan.reason


def test_what_does_not_fit_is_named() -> None:
    crowd = [(f"p{i:02d}", 3.0 + i, 4.0) for i in range(8)]
    made = planner(most_obstacles=5)
    made.command(at(0.0, 0.0, *crowd))
    assert made.plan is not None
    assert len(made.plan.ids) == 5
    assert set(made.plan.left_out) == {"p05", "p06", "p07"}
    assert made.plan.tracked == tuple(name for name, _, _ in crowd)
    assert made.plan.forecast is not None
    assert len(made.plan.forecast.mean) == 8


def test_nothing_seen_is_the_plain_tracking_problem() -> None:
    made = planner()
    made.command(at(0.0, 0.0, y=1.0))
    plan = made.plan
    assert plan is not None
    assert plan.rung is Rung.OPTIMAL
    assert plan.ids == ()
    assert np.isnan(plan.lowest_content)
    assert abs(plan.positions[-1, 1]) < 0.3


def test_more_starts_never_cost_more() -> None:
    for gap in (5.0, 6.0, 7.0):
        single, several = planner(), planner(starts=("left", "right", "wait"))
        for made in (single, several):
            made.command(at(0.0, 0.0, ("other", gap, 0.0)))
        assert single.plan is not None
        assert several.plan is not None
        assert several.plan.cost <= single.plan.cost * (1 + 1e-6)
    flying = planner(robot=Holonomic(), starts=("left", "right", "coast"))
    flying.command(
        Observation(0.0, np.array([0.0, 0.0, 0.4, 0.0]), at(0, 0, ("a", 4, 0)).detections)
    )
    assert flying.plan is not None
    assert flying.plan.rung is Rung.OPTIMAL


def test_latency_plans_from_where_the_robot_will_be() -> None:
    made = planner(latency=0.2)
    made.command(at(0.0, 0.0))
    made.command(at(0.5, 0.25))
    plan = made.plan
    assert plan is not None
    assert plan.stamp == pytest.approx(0.7)
    assert plan.positions[0, 0] == pytest.approx(0.35, abs=0.01)


def test_late_detections_are_predicted_up_to_now() -> None:
    made = planner(predictor=ConstantVelocity())
    for k in range(10):
        time = 0.5 * k
        old = Detection("a", np.array([10 - 0.4 * (time - 0.3), 2.0]), 1e-4 * np.eye(2), 0.5, 0.3)
        made.command(Observation(time, np.array([0.0, 0.0, 0.0, 0.0, 0.0]), (old,)))
    assert made.plan is not None
    assert made.plan.forecast is not None
    expected = 10 - 0.4 * (4.5 + 0.5 * np.arange(1, 16))
    assert made.plan.forecast.mean[0, 0, :, 0] == pytest.approx(expected, abs=0.02)


def test_the_oracle_sees_the_truth() -> None:
    made = planner(predictor=Oracle())
    times = np.arange(0.0, 20.0, 0.1)
    turning = np.stack([6 - 0.3 * times, np.sin(times)], -1)
    seen = at(0.0, 0.0, ("other", 6.0, 0.0))
    made.command(replace(seen, truth=Truth(times, {"other": turning})))
    assert made.plan is not None
    assert made.plan.forecast is not None
    future = made.plan.forecast.mean[0, 0]
    assert future[:, 1] == pytest.approx(np.sin(0.5 * np.arange(1, 16)), abs=0.01)
    assert made.plan.fallbacks == (None,)


def test_the_path_may_change_without_losing_history() -> None:
    made = planner()
    approach(made)
    made.set_path(Path(np.array([[1.0, 0.0], [1.0, 9.0]])))
    made.command(at(3.0, 1.5, ("other", 4.5, 0.1)))
    assert made.plan is not None
    assert made.plan.reference[-1, 1] > 2.0
    assert made.plan.fallbacks == (None,)
    with pytest.raises(WideberthError, match="columns"):
        made.set_path(Path(np.array([[1.0, 0.0, 0.0], [1.0, 9.0, 0.0]])))


def test_the_robot_stops_at_the_goal() -> None:
    made = planner()
    state = np.array([18.0, 0.0, 0.0, 0.5, 0.0])
    for k in range(30):
        made.command(Observation(0.5 * k, state))
        assert made.plan is not None
        state = np.array(step(made.robot, state, made.plan.inputs[0], 0.5))
    assert np.linalg.norm(state[:2] - [20.0, 0.0]) < 0.1
    assert abs(state[3]) < 0.05


def test_heading_beyond_pi_is_no_different() -> None:
    plain, wrapped = planner(), planner()
    for made, turns in ((plain, 0), (wrapped, 3)):
        for k in range(4):
            heading = 2 * np.pi * turns * (k % 2)
            state = np.array([0.25 * k, 0.0, heading, 0.5, 0.0])
            seen = at(0.5 * k, 0.0, ("other", 6.0 - 0.25 * k, 0.3)).detections
            made.command(Observation(0.5 * k, state, seen))
    assert plain.plan is not None
    assert wrapped.plan is not None
    assert wrapped.plan.positions == pytest.approx(plain.plan.positions, abs=1e-4)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"horizon": 0}, "planner.horizon is 0"),
        ({"dt": -0.5}, "planner.dt is -0.5"),
        ({"latency": -0.1}, "planner.latency"),
        ({"deadline": 0.0}, "planner.deadline"),
        ({"starts": ("up",)}, "wanted some of"),
        ({"most_obstacles": -1}, "most_obstacles"),
        ({"most_obstacles": 101}, "at most 100"),
        ({"margin": -0.1}, "planner.margin"),
        ({"reference_speed": float("nan")}, "reference_speed"),
    ],
)
def test_settings_that_make_no_planner_are_refused(change: dict[str, float], words: str) -> None:
    with pytest.raises(WideberthError, match=words):
        planner(**change)


def test_an_exact_region_and_a_fixed_level_work_in_the_loop() -> None:
    plan = approach(planner(region=MinkowskiSum(), level=Fixed(0.2)), gap=14.0)
    assert plan.rung is Rung.OPTIMAL
    assert plan.auxiliaries.shape == (15, 1, 1)
    assert plan.content == pytest.approx(np.full((15, 1), 0.8))


@dataclass(frozen=True)
class Odd(Predictor):
    """Returns something else than was asked for."""

    how: str

    def predict(self, tracks: Tracks, steps: int, scene: Scene | None = None) -> Forecast:
        good = Kalman().predict(tracks, steps, scene)
        first = [0]
        if self.how == "fewer":
            return Forecast(
                good.mean[first], good.covariance[first], good.weight[first], good.dt, (None,)
            )
        if self.how == "steps":
            short = good.covariance[:, :, :-1]
            return replace(good, mean=good.mean[:, :, :-1], covariance=short, joint_source=None)
        if self.how == "dt":
            return replace(good, dt=2 * good.dt)
        return None  # type: ignore[return-value]


@pytest.mark.parametrize("how", ["fewer", "steps", "dt", "nothing"])
def test_a_forecast_that_was_not_asked_for_is_named(how: str) -> None:
    made = planner(predictor=Odd(how))
    made.command(at(0.0, 0.0, ("a", 9.0, 3.0), ("b", 4.0, 0.0)))
    assert made.plan is not None
    assert made.plan.rung is Rung.BRAKE
    assert "Odd" in made.plan.reason
    assert np.isnan(made.plan.violation)


def test_a_clock_that_goes_back_does_not_raise() -> None:
    made = planner()
    approach(made)
    for time in (1.0, 0.2, 0.7):
        made.command(at(time, 0.0, ("other", 9.0, 0.8)))
        assert made.plan is not None
        assert np.isfinite(made.plan.inputs).all()
        assert made.plan.ids == ("other",)
    made.command(at(0.1, 0.0, ("other", 9.0, 0.8)))
    assert "clock went back" in made.plan.reason


def test_a_state_of_the_wrong_length_stops_the_robot() -> None:
    made = planner()
    command = made.command(Observation(0.0, np.zeros(3)))
    assert made.plan is not None
    assert "the state has 3 entries" in made.plan.reason
    assert command.linear == (0.0, 0.0)


def test_nothing_is_lost_of_what_is_seen() -> None:
    made = planner()
    twice = at(0.0, 0.0, ("b", 9.0, 3.0), ("b", 4.0, 0.0))
    made.command(twice)
    assert made.plan is not None
    assert made.plan.ids == ("b", "b#2")
    flying = Detection("bird", np.array([1.0, 2.0, 3.0]), np.eye(3), 0.1)
    made.command(replace(at(0.5, 0.2, ("b", 9.0, 3.0)), detections=(flying, *twice.detections)))
    assert "'bird' has 3 coordinates" in made.plan.reason
    assert made.plan.rung is Rung.OPTIMAL
    late = planner()
    old = Detection("late", np.array([6.0, 0.5]), 1e-4 * np.eye(2), 0.5, age=5.0)
    late.command(Observation(0.0, np.array([0.0, 0.0, 0.0, 0.5, 0.0]), (old,)))
    assert late.plan is not None
    assert late.plan.ids == ("late",)


def test_what_was_seen_before_the_first_path_is_kept() -> None:
    made = Planner(Unicycle(), MahalanobisEllipse(), Kalman(), Relaxed(), Fatrop())
    for k in range(20):
        made.remember(at(0.5 * k, 0.0, ("other", 15 - 0.2 * k, 1.0)))
    made.set_path(STRAIGHT)
    made.command(at(10.0, 0.0, ("other", 11.0, 1.0)))
    assert made.plan is not None
    assert made.plan.forecast is not None
    assert made.plan.forecast.mean[0, 0, -1, 0] == pytest.approx(11.0 - 0.4 * 7.5, abs=0.3)


def test_a_new_path_is_joined_where_the_robot_is() -> None:
    made = planner()
    made.command(at(0.0, 0.0))
    made.command(at(0.5, 12.0))
    made.set_path(Path(np.array([[0.0, 0.0], [30.0, 0.0]])))
    made.command(at(1.0, 12.2))
    assert made.plan is not None
    assert made.plan.reference[0, 0] == pytest.approx(12.45)


def test_a_loop_starts_at_its_start_and_a_hairpin_is_not_cut() -> None:
    angle = np.linspace(0, 2 * np.pi, 60)
    loop = planner()
    loop.set_path(Path(np.stack([5 * np.sin(angle), 5 - 5 * np.cos(angle)], -1)))
    loop.command(at(0.0, -0.02))
    assert loop.plan is not None
    assert loop.plan.reference[-1, 0] > 2.0
    hairpin = planner()
    hairpin.set_path(Path(np.array([[0.0, 0.0], [10.0, 0.0], [10.0, 0.4], [0.0, 0.4]])))
    for k in range(5):
        hairpin.command(at(0.5 * k, 0.25 * k, y=0.1 * k))
    assert hairpin.plan is not None
    assert hairpin.plan.reference[0, 0] == pytest.approx(1.25, abs=0.05)
    assert hairpin.plan.reference[0, 1] == 0.0


def test_a_push_beyond_the_limits_is_no_reason_to_stop() -> None:
    made = planner()
    made.command(Observation(0.0, np.array([0.0, 0.0, 0.0, 0.75, 0.36])))
    assert made.plan is not None
    assert made.plan.rung is Rung.OPTIMAL
    assert made.plan.states[0, 4] == 0.3


def test_a_plan_tells_when_it_is_below_its_reference() -> None:
    free = approach(planner(level=Relaxed(weight=1.0)), gap=7.0)
    assert free.below_reference is True
    far = planner()
    far.command(at(0.0, 0.0, ("other", 50.0, 30.0)))
    assert far.plan is not None
    assert far.plan.below_reference is False
    far.command(at(9.0, 0.0))
    assert far.plan.below_reference is None
    with pytest.raises(WideberthError, match=r"wanted at most 2\.448"):
        planner(level=Relaxed(minimum=3.0))


def test_a_feasible_plan_at_a_lower_level_is_not_thrown_away() -> None:
    """The soft optimum may pay for a high level with slack; at the minimum it is feasible."""
    made = planner(level=Relaxed(weight=1e6, minimum=0.0), penalty=10.0)
    made.command(at(0.0, 0.0, ("other", 4.5, 0.6)))
    assert made.plan is not None
    if made.plan.rung is Rung.FEASIBLE:
        assert made.plan.violation <= 1e-4
        assert made.plan.level.max() < 2.44
    assert made.plan.rung in (Rung.FEASIBLE, Rung.LEAST, Rung.BRAKE)


def test_everything_is_loaded_before_the_first_decision() -> None:
    """A subprocess, since here statsmodels has long been imported."""
    script = """
import sys
from wideberth import Path, build
planner = build("controllers", {"type": "mpc", "robot": "unicycle",
    "predictor": {"type": "var", "backend": "statsmodels"},
    "region": "mahalanobis_ellipse", "level": "relaxed", "solver": "fatrop"})
planner.set_path(Path([(0, 0), (9, 0)]))
assert "statsmodels" in sys.modules
assert planner.plan is None
"""
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr

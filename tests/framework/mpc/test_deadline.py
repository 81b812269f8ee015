"""The deadline caps the whole call, and is shared out over the starts; told by a made-up clock."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import pytest

from wideberth.framework.mpc.levels.fixed import Fixed
from wideberth.framework.mpc.ocp.problem import Parameters, Problem
from wideberth.framework.mpc.ocp.transcription import Guess
from wideberth.framework.mpc.planner import watchdog
from wideberth.framework.mpc.planner.planner import Planner
from wideberth.framework.mpc.solver import Solution, Solver
from wideberth.framework.plugins.config import build
from wideberth.framework.predictor import Predictor
from wideberth.framework.values.forecast import Forecast, Scene
from wideberth.framework.values.motion import Detection, Observation
from wideberth.framework.values.path import Path
from wideberth.framework.values.plan import Plan, Rung, Status
from wideberth.framework.values.tracks import Tracks
from wideberth.predictors.static import Static
from wideberth.regions.mahalanobis_ellipse import MahalanobisEllipse
from wideberth.robots.unicycle import Unicycle
from wideberth.solvers.fatrop import Fatrop


class Clock:
    """Moves only when told to."""

    now = 0.0

    def __call__(self) -> float:
        return self.now


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    made = Clock()
    monkeypatch.setattr(watchdog, "perf_counter", made)
    return made


@dataclass(frozen=True)
class Timed(Solver):
    """Takes so many seconds for a solve, and writes down what it was given."""

    clock: Clock
    takes: float
    late: bool = False
    given: list[float | None] = field(default_factory=list)

    def solve(
        self,
        problem: Problem,
        parameters: Parameters,
        guesses: Sequence[Guess],
        deadline: float | None = None,
    ) -> list[Solution]:
        self.given.append(deadline)
        found = Fatrop().solve(problem, parameters, guesses)
        self.clock.now += self.takes * len(guesses)
        if self.late:
            found = [replace(one, status=Status.DEADLINE, message="late") for one in found]
        return [replace(one, seconds=self.takes) for one in found]


@dataclass(frozen=True)
class Slow(Predictor):
    """Takes so many seconds for a forecast."""

    clock: Clock
    takes: float

    def predict(self, tracks: Tracks, steps: int, scene: Scene | None = None) -> Forecast:
        self.clock.now += self.takes
        return Static().predict(tracks, steps, scene)


def decided(predictor: Predictor, solver: Timed, **changes: Any) -> Plan:
    """Somebody stands in the way: all starts are asked for."""
    made = Planner(
        Unicycle(), MahalanobisEllipse(), predictor, Fixed(), solver, penalty=1e4, **changes
    )
    made.set_path(Path(np.array([[0.0, 0.0], [20.0, 0.0]])))
    solver.given.clear()  # those of the warm-up
    seen = Detection("a", np.array([4.0, 0.2]), 1e-4 * np.eye(2), 0.5)
    made.command(Observation(0.0, np.array([0.0, 0.0, 0.0, 0.5, 0.0]), (seen,)))
    assert made.plan is not None
    return made.plan


def test_the_first_start_gets_all_and_the_others_what_is_left(clock: Clock) -> None:
    solver = Timed(clock, 10.0)
    plan = decided(Slow(clock, 5.0), solver, deadline=50.0, starts="auto")
    # 50 less a tenth in reserve less the forecast; the next ones while 10 s are left
    assert solver.given == pytest.approx([40.0, 30.0, 20.0, 10.0], abs=1e-7)
    assert plan.rung is Rung.OPTIMAL


def test_as_long_as_time_is_left_it_is_used(clock: Clock) -> None:
    solver = Timed(clock, 0.1)
    plan = decided(Slow(clock, 1.0), solver, deadline=2.0)
    assert solver.given[0] == pytest.approx(0.8, abs=1e-7)
    assert plan.rung is Rung.OPTIMAL


def test_without_a_deadline_all_other_starts_are_one_call(clock: Clock) -> None:
    solver = Timed(clock, 10.0)
    decided(Slow(clock, 9.0), solver, starts="auto")
    assert solver.given == [None, None]


def test_a_slow_first_solve_leaves_no_time_for_others(clock: Clock) -> None:
    solver = Timed(clock, 30.0)
    plan = decided(Slow(clock, 0.0), solver, deadline=50.0, starts="auto")
    assert solver.given == pytest.approx([45.0])
    assert plan.rung is Rung.OPTIMAL


def test_a_late_result_is_used_if_it_is_feasible(clock: Clock) -> None:
    plan = decided(Slow(clock, 0.0), Timed(clock, 90.0, late=True), deadline=50.0)
    assert plan.rung is Rung.FEASIBLE
    assert plan.status is Status.DEADLINE
    assert plan.reason == "solver: late"
    assert plan.violation <= 1e-4


def test_a_plug_in_that_does_not_say_that_it_was_late(clock: Clock) -> None:
    plan = decided(Slow(clock, 0.0), Timed(clock, 90.0), deadline=50.0)
    assert (plan.rung, plan.status) == (Rung.FEASIBLE, Status.DEADLINE)
    assert "later than the deadline" in plan.reason


def test_a_forecast_that_took_all_the_time_ends_in_a_checked_stop(clock: Clock) -> None:
    solver = Timed(clock, 10.0)
    plan = decided(Slow(clock, 60.0), solver, deadline=50.0)
    assert solver.given == []
    assert (plan.rung, plan.status) == (Rung.BRAKE, Status.DEADLINE)
    assert plan.reason == "solver: no time was left to solve"
    assert plan.violation <= 1e-4


@pytest.mark.parametrize("solver", ["riccati", "fatrop"])
def test_what_polygons_need_is_compiled_before_the_loop(solver: str) -> None:
    """The first wall cost three decisions that braked, since their solves were left behind."""
    planner = build("controllers", {
        "type": "mpc", "robot": "unicycle", "region": "mahalanobis_ellipse", "level": "fixed",
        "predictor": "static", "solver": solver, "static_region": "separating_line",
        "horizon": 4, "most_obstacles": 1, "deadline": 0.4,
    })  # fmt: skip
    assert isinstance(planner, Planner)
    planner.set_path(Path(np.array([[0.0, 0.0], [9.0, 0.0]])))
    rooms = {rooms[1] for rooms in planner._services.problems._made}
    assert (1, 4) in rooms

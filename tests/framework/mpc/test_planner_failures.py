"""The planner when something fails: safe whatever happens, and always with the reason."""

from dataclasses import dataclass, replace

import numpy as np
import pytest

from wideberth.framework.control.command_limits import broken_limit
from wideberth.framework.mpc.levels.relaxed import Relaxed
from wideberth.framework.predictor import Predictor
from wideberth.framework.robot import step
from wideberth.framework.values.errors import WideberthError
from wideberth.framework.values.forecast import Forecast, Scene
from wideberth.framework.values.motion import Detection, Observation
from wideberth.framework.values.plan import Rung, Status
from wideberth.framework.values.tracks import Tracks
from wideberth.predictors.kalman import Kalman
from wideberth.solvers.ipopt import Ipopt
from wideberth.tests.helpers.planning import Failing, approach, at, planner


@dataclass(frozen=True)
class Refusing(Predictor):
    """Raises, or returns nonsense, after a number of good forecasts."""

    def predict(self, tracks: Tracks, steps: int, scene: Scene | None = None) -> Forecast:
        if tracks.stamp > 1.2:
            raise RuntimeError("sensor unplugged")
        return Kalman().predict(tracks, steps, scene)


def test_a_raising_plug_in_ends_in_a_safe_plan() -> None:
    made = planner(predictor=Refusing())
    plan = approach(made)
    assert plan.rung is Rung.BRAKE
    assert "RuntimeError: sensor unplugged" in plan.reason
    assert abs(plan.states[-1, 3]) < 1e-6
    assert np.abs(plan.inputs[:, 0]).max() <= 0.7 + 1e-9


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


def test_wrong_use_raises_at_once() -> None:
    made = planner()
    for use in (made.command, made.remember):
        with pytest.raises(WideberthError, match=r"the state has 3 entries; .*omega"):
            use(Observation(0.0, np.zeros(3)))
        with pytest.raises(WideberthError, match="takes an Observation; this is a dict"):
            use({})  # type: ignore[arg-type]


def test_numbers_that_are_none_stop_the_robot_with_a_reason() -> None:
    made = planner()
    made.command(at(0.0, 0.0))
    for state in (np.full(5, np.nan), np.array([0.0, 0.0, 0.0, np.inf, 0.0])):
        command = made.command(Observation(0.5, state))
        assert made.plan is not None and "the observation's state is [" in made.plan.reason
        assert command.linear == (0.0, 0.0) and command.omega == 0.0
    seen = at(0.5, 0.0)
    made.command(replace(seen, stamp=np.nan))
    assert made.plan.rung is Rung.BRAKE and "stamp is nan" in made.plan.reason
    made.command(replace(seen, covariance=-np.eye(5)))
    assert made.plan.rung is Rung.BRAKE and "eigenvalue -1" in made.plan.reason
    flawed = Detection("ghost", np.array([np.nan, 1.0]), np.eye(2), 0.3)
    command = made.command(replace(at(1.0, 0.0, ("other", 9.0, 3.0)), detections=(flawed,)))
    assert made.plan.rung is Rung.BRAKE and command.linear[0] < 0.5
    assert "detection 'ghost' refused: position is [nan, 1.0]" in made.plan.reason
    assert "'ghost' seen without a place: the robot stops" in made.plan.reason


@pytest.mark.parametrize("speed", [0.75, 5.0, -30.0, 1e200])
def test_an_emergency_brake_from_beyond_the_limits_commands_within_them(speed: float) -> None:
    """The plant brakes towards it as hard as it can; a speed of its own is no excuse."""
    made = planner(predictor=Odd("nothing"), latency=0.1)
    for k in range(3):
        seen = at(0.5 * k, 0.0, ("other", 4.0, 0.0), v=speed)
        command = made.command(seen)
        assert made.plan is not None and made.plan.rung is Rung.BRAKE
        assert abs(command.linear[0]) <= made.robot.max_speed  # type: ignore[attr-defined]
        assert broken_limit(made.robot, command) == ""


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


def test_a_feasible_plan_at_a_lower_level_is_not_thrown_away() -> None:
    """The soft optimum may pay for a high level with slack; at the minimum it is feasible."""
    made = planner(level=Relaxed(weight=1e6, minimum=0.0), penalty=10.0)
    made.command(at(0.0, 0.0, ("other", 5.5, 0.3)))
    plan = made.plan
    assert plan is not None
    assert plan.status is Status.SOLVED and plan.rung is Rung.FEASIBLE
    assert plan.violation <= 1e-4 and plan.breach is None
    assert plan.given_way is not None and 0.05 < plan.given_way.held < 1.0
    assert plan.reason.startswith(f"{plan.given_way}; solver: ")
    assert "its plan: region of 'other' entered by" in plan.reason  # at the level it asked for
    assert plan.positions[-1, 0] > 1.0  # it drives on

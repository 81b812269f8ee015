"""Contingency: for whom there are two tails, what is handed out, and what is not promised."""

from dataclasses import dataclass, replace
from typing import final

import numpy as np
import pytest

from wideberth.framework.controller import fresh
from wideberth.framework.mpc.costs.base import Weights
from wideberth.framework.mpc.costs.tracking import Tracking
from wideberth.framework.mpc.fallback.verify import violation
from wideberth.framework.mpc.levels.discounted import Discounted
from wideberth.framework.mpc.planner import multistart
from wideberth.framework.mpc.planner.contingency import LEAST_SHARE, Contingency
from wideberth.framework.mpc.planner.cycle import Decision, PlannerState, Services, remember, step
from wideberth.framework.mpc.planner.planner import Planner
from wideberth.framework.mpc.solvers.base import Solution
from wideberth.framework.mpc.solvers.riccati.solver import Riccati
from wideberth.framework.mpc.solvers.watchdog import LeftBehind
from wideberth.framework.predictor import Branching
from wideberth.framework.values.arrays import Array
from wideberth.framework.values.errors import WideberthError
from wideberth.framework.values.forecast import Forecast, Futures, Scene
from wideberth.framework.values.motion import Detection, Observation
from wideberth.framework.values.path import Path
from wideberth.framework.values.plan import Rung
from wideberth.framework.values.tracks import Tracks
from wideberth.predictors import ConstantVelocity, Kalman
from wideberth.regions import MahalanobisEllipse
from wideberth.robots import Unicycle

PATH = Path(np.array([[0.0, 0.0], [12.0, 0.0]]))
DT, N, HEAD = 0.2, 20, 3


@final
@dataclass(frozen=True)
class TwoWays(Branching):
    """Everybody goes on at a constant velocity, or steps aside along y at a speed, m/s."""

    aside: float = 0.6
    share: float = 0.5
    broken: bool = False

    def predict(self, tracks: Tracks, steps: int, scene: Scene | None = None) -> Forecast:
        return ConstantVelocity(window=1, acceleration_density=0.01).predict(tracks, steps, scene)

    def futures(self, tracks: Tracks, steps: int, scene: Scene | None = None) -> Futures:
        if self.broken:
            raise ValueError("no futures")
        on = self.predict(tracks, steps, scene)
        moved = on.mean.copy()
        moved[..., 1] += self.aside * tracks.dt * np.arange(1, steps + 1)
        shares = np.full(len(tracks), self.share)
        return Futures(replace(on, mean=moved, joint_source=None), on, shares)


def planner(**changes: object) -> Planner:
    settings = {
        "robot": Unicycle(max_acceleration=1.0), "region": MahalanobisEllipse(),
        "predictor": TwoWays(), "level": Discounted(tail=0.05, final_tail=0.9, full_steps=5),
        "solver": Riccati(), "horizon": N, "dt": DT, "period": DT, "track_dt": DT, "history": 10,
        "penalty": 1e4, "contingency": Contingency(head=HEAD * DT), "reference_speed": 0.5,
        "cost": Tracking(Weights(1.0, 0.01, 0.1, 0.1)),
    }  # fmt: skip
    return Planner(**{**settings, **changes})  # type: ignore[arg-type]


def seen(k: int, state: Array | None = None) -> Observation:
    """Somebody who crosses the robot's path at 0.5 m/s, 2.2 m ahead."""
    ego = np.array([0.0, 0.0, 0.0, 0.5, 0.0]) if state is None else state
    here = np.array([2.2, 2.2 - 0.5 * DT * k])
    return Observation(DT * k, ego, (Detection("p", here, 1e-4 * np.eye(2), 0.3),))


def decided(settings: Planner, ticks: int = 4) -> Decision:
    """Decide once, after so many observations."""
    state, services = PlannerState.initial(settings, PATH), Services.of(settings)
    for k in range(ticks - 1):
        state = remember(settings, state, seen(k))
    return step(settings, state, seen(ticks - 1), services)[1]


def futures_of(differences: list[float], shares: list[float]) -> Futures:
    """Forecasts of some obstacles that differ by so much, m."""
    mean = np.zeros((len(shares), 2, 2))
    on = Forecast.single(mean, np.tile(0.01 * np.eye(2), (len(shares), 2, 1, 1)), 0.5)
    moved = on.mean.copy()
    moved[:, :, 1, 0] = np.array(differences)[:, None]
    return Futures(replace(on, mean=moved), on, np.array(shares))


def test_who_differs_most_makes_way_as_long_as_that_is_likely() -> None:
    futures = futures_of([0.05, 0.5, 2.0, 1.0], [0.9, 0.5, 0.4, 0.15])
    branch = Contingency(matters=0.1).branch(futures)
    assert branch is not None
    assert branch.share == pytest.approx(0.4 * 0.15)  # with the third it would be 0.03
    assert branch.share >= LEAST_SHARE
    assert branch.forecast.mean[:, 0, 1, 0].tolist() == [0.0, 0.0, 2.0, 1.0]
    few = Contingency(matters=0.6).branch(futures_of([0.5, 0.9], [0.9, 0.9]))
    assert few is not None and few.share == 0.9
    assert Contingency().branch(futures_of([0.05], [0.9])) is None
    assert Contingency().branch(futures_of([5.0], [0.01])) is None


def test_a_case_with_fewer_modes_is_filled_up_with_modes_of_no_weight() -> None:
    few = futures_of([1.0, 2.0], [0.9, 0.9])
    two = few.makes_way
    weight = np.array([[0.25, 0.75]] * 2)
    mean = np.concatenate([two.mean, two.mean + 3.0], axis=1)
    twice = replace(
        two, mean=mean, covariance=two.covariance.repeat(2, axis=1), weight=weight,
        joint_source=None,
    )  # fmt: skip
    for makes_way, keeps_on in ((twice, few.keeps_on), (few.makes_way, twice)):
        found = Futures(makes_way, keeps_on, few.share).if_all_make_way([1])
        for row, case in enumerate((keeps_on, makes_way)):
            modes = case.mean.shape[1]
            np.testing.assert_array_equal(found.mean[row, :modes], case.mean[row])
            np.testing.assert_array_equal(
                found.weight[row], np.resize([*case.weight[row], 0.0], 2)
            )


def test_the_beginning_is_common_and_the_plan_holds_for_who_keeps_on() -> None:
    found = decided(planner())
    plan, other = found.plan, found.other_tail
    assert plan.rung is Rung.OPTIMAL and other is not None and found.solved is not None
    np.testing.assert_array_equal(other.positions, other.states[:, :2])
    assert np.array_equal(plan.inputs[:HEAD], other.inputs[:HEAD])
    assert np.array_equal(plan.states[: HEAD + 1], other.states[: HEAD + 1])
    assert np.abs(plan.inputs[HEAD:] - other.inputs[HEAD:]).max() > 0.05
    check = found.solved.check
    assert plan.forecast is not None
    assert plan.forecast.mean[0, 0, -1, 1] < 0.0  # who keeps on
    assert violation(check.problem, check.parameters, found.solved.point).worst < 1e-4
    inputs = [found.command.twist.linear[0], plan.states[1, 3]]
    assert inputs[0] == pytest.approx(inputs[1], abs=1e-9)  # the common beginning is driven


def test_the_more_likely_people_make_way_the_farther_the_beginning_is_from_the_plain_plan() -> (
    None
):
    alone = decided(planner(contingency=None)).plan.states[: HEAD + 1]
    shares = (0.06, 0.5, 0.95)
    begun = [
        decided(planner(predictor=TwoWays(share=one))).plan.states[: HEAD + 1] for one in shares
    ]
    apart = [float(np.abs(one - alone).max()) for one in begun]
    assert apart[0] < 0.1 * apart[2]
    assert apart[0] < apart[1] < apart[2]


def test_where_nobody_matters_the_plan_is_the_ordinary_one() -> None:
    plain = decided(planner(contingency=None))
    for settings in (planner(predictor=TwoWays(aside=0.0)), planner(predictor=TwoWays(share=0.0))):
        found = decided(settings)
        assert found.other_tail is None
        assert np.array_equal(found.plan.states, plain.plan.states)


def test_futures_that_cannot_be_had_leave_the_forecast() -> None:
    found = decided(planner(predictor=TwoWays(broken=True)))
    plain = decided(planner(contingency=None))
    assert found.other_tail is None and np.array_equal(found.plan.states, plain.plan.states)
    assert found.notes == ("futures not forecast: ValueError: no futures",)
    assert plain.notes == ()


def test_a_solver_that_hangs_has_more_patience_once_for_each_problem(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The problem of both is another one than that of one; the reason names the solver."""
    limits: list[float] = []

    def hangs(call: object, limit: float) -> list[Solution]:
        limits.append(limit)
        raise LeftBehind("did not return")

    monkeypatch.setattr(multistart, "watched", hangs)
    two, one = planner(patience=2.0), planner(patience=2.0, contingency=None)
    services, state = Services.of(two), PlannerState.initial(two, PATH)
    for k in range(3):
        state = remember(two, state, seen(k))
    for settings in (one, one, two, two, one, two):
        _, found = step(settings, state, seen(3), services)
        assert "Riccati did not return" in found.plan.reason
    assert limits == [20.0, 2.0, 20.0, 2.0, 2.0, 2.0]


def test_a_drive_past_somebody_goes_on_from_both_tails() -> None:
    settings = fresh(planner())
    assert isinstance(settings, Planner)
    state, services = PlannerState.initial(settings, PATH), Services.of(settings)
    ego, two = np.array([0.0, 0.0, 0.0, 0.5, 0.0]), 0
    for k in range(4):
        state = remember(settings, state, seen(k))
    for k in range(4, 16):
        state, found = step(settings, state, seen(k, ego), services)
        two += found.other_tail is not None
        assert found.plan.rung is Rung.OPTIMAL, found.plan.reason
        assert (state.other_tail is None) == (found.other_tail is None)
        ego = found.plan.states[1]
    assert two >= 8


def test_settings_that_do_not_fit_are_refused() -> None:
    with pytest.raises(WideberthError, match="two futures, and Kalman has one"):
        planner(predictor=Kalman())
    with pytest.raises(WideberthError, match=r"contingency.head"):
        Contingency(head=0.0)
    on = futures_of([0.0], [0.5]).keeps_on
    with pytest.raises(WideberthError, match="probabilities"):
        Futures(on, on, np.array([1.5]))
    with pytest.raises(WideberthError, match="same obstacles"):
        Futures(futures_of([0.0, 1.0], [0.5, 0.5]).keeps_on, on, np.array([0.5, 0.5]))


def test_the_beginning_has_a_stage_at_least_and_leaves_one() -> None:
    assert [Contingency(head=h).stages(0.2, 5) for h in (0.01, 0.6, 9.0)] == [1, 3, 4]

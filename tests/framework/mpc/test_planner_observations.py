"""What the planner makes of what it sees: late, twice, too much, out of order, or the truth."""

import logging
from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from wideberth.framework.mpc.levels.relaxed import Relaxed
from wideberth.framework.mpc.planner.planner import Planner
from wideberth.framework.mpc.slots.gaussian_discs import GaussianDiscs
from wideberth.framework.tracking import perception
from wideberth.framework.values.motion import Detection, Observation, Truth
from wideberth.framework.values.plan import Rung
from wideberth.predictors.constant_velocity import ConstantVelocity
from wideberth.predictors.kalman import Kalman
from wideberth.predictors.oracle import Oracle
from wideberth.regions.mahalanobis_ellipse import MahalanobisEllipse
from wideberth.robots.unicycle import Unicycle
from wideberth.solvers.fatrop import Fatrop
from wideberth.tests.helpers.planning import STRAIGHT, approach, at, planner


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


def test_a_kind_sees_where_the_last_plan_goes_at_each_step(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    seen, choose = [], GaussianDiscs.choose

    def watched(self: GaussianDiscs, robot: Any, view: Any) -> Any:
        seen.append(view)
        return choose(self, robot, view)

    monkeypatch.setattr(GaussianDiscs, "choose", watched)
    made = planner()
    for tick in range(2):
        made.command(at(0.5 * tick, 0.25 * tick, ("a", 9.0, 6.0)))
    plan = made.plan
    assert plan is not None
    for view in seen:
        assert view.planned.shape == view.route[1].shape == view.reference.position.shape
        steps = np.linalg.norm(np.diff(view.planned, axis=0, prepend=view.route[1][:1]), axis=1)
        assert (steps <= 0.75 * 0.5 + 1e-6).all()  # the first is a step from here


def test_a_planner_may_have_room_for_nobody() -> None:
    made = planner(most_obstacles=0)
    made.command(at(0.0, 0.0, ("a", 3.0, 4.0)))
    assert made.plan is not None and made.plan.left_out == ("a",)


def test_a_noise_is_logged_at_first_and_where_it_has_changed_by_a_fifth(
    caplog: pytest.LogCaptureFixture,
) -> None:
    caplog.set_level(logging.INFO, "wideberth.perception")
    logged: dict[str, float] = {}
    for deviation in (0.0, 0.1, 0.115, 0.13, 0.15, 0.11, 0.1):
        found = SimpleNamespace(
            samples=int(100 * deviation), deviation=deviation, text=str(deviation)
        )
        logged = perception._logged(cast(Any, {"lidar": found}), logged)
    assert caplog.messages == [f"sensor lidar: {one}" for one in (0.1, 0.13, 0.1)]


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


def test_nothing_is_lost_of_what_is_seen() -> None:
    made = planner()
    twice = at(0.0, 0.0, ("b", 9.0, 3.0), ("b", 4.0, 0.0))
    made.command(twice)
    assert made.plan is not None
    assert set(made.plan.ids) == {"#1", "#2"}
    assert "detection 'b' comes 2 times: each is an obstacle of its own" in made.plan.reason
    flying = Detection("bird", np.array([1.0, 2.5, 3.0]), 1e-4 * np.eye(3), 0.1)
    made.command(replace(at(0.5, 0.2, ("b", 9.0, 3.0)), detections=(flying, *twice.detections)))
    assert "detection 'bird' taken in part: it has 3 coordinates" in made.plan.reason
    assert set(made.plan.ids) == {"#1", "#2", "bird"} and made.plan.forecast is not None
    bird = made.plan.forecast.mean[made.plan.tracked.index("bird"), 0, 0]
    assert bird == pytest.approx([1.0, 2.5])
    assert made.plan.rung is Rung.OPTIMAL
    late = planner()
    old = Detection("late", np.array([6.0, 0.5]), 1e-4 * np.eye(2), 0.5, age=2.9)
    late.command(Observation(0.0, np.array([0.0, 0.0, 0.0, 0.5, 0.0]), (old,)))
    assert late.plan is not None
    assert late.plan.ids == ("late",)


def test_what_was_seen_before_the_first_path_is_kept() -> None:
    made = Planner(
        Unicycle(), MahalanobisEllipse(), Kalman(), Relaxed(weight=1.0, minimum=0.0), Fatrop()
    )
    for k in range(20):
        made.remember(at(0.5 * k, 0.0, ("other", 15 - 0.2 * k, 1.0)))
    made.set_path(STRAIGHT)
    made.command(at(10.0, 0.0, ("other", 11.0, 1.0)))
    assert made.plan is not None
    assert made.plan.forecast is not None
    assert made.plan.forecast.mean[0, 0, -1, 0] == pytest.approx(11.0 - 0.4 * 7.5, abs=0.3)

"""Numbers of any magnitude: one obstacle's are its own affair, and work stays bounded."""

import warnings
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest

from wideberth.controllers.orca import Orca
from wideberth.framework.predictor import Adaptive, Predictor
from wideberth.framework.testing.predictor import check_predictor
from wideberth.framework.tracking.history import MOST, History
from wideberth.framework.values.arrays import Array, checked_covariance
from wideberth.framework.values.errors import WideberthError
from wideberth.framework.values.forecast import Forecast, Scene
from wideberth.framework.values.motion import Detection, Observation
from wideberth.framework.values.number_limits import FARTHEST, bounded
from wideberth.framework.values.plan import Plan, Rung
from wideberth.framework.values.tracks import Tracks
from wideberth.predictors.adaptive_conformal import AdaptiveConformal
from wideberth.predictors.game import Game
from wideberth.predictors.interacting_models import InteractingModels
from wideberth.predictors.kalman import Kalman
from wideberth.predictors.social_force import SocialForce
from wideberth.tests.helpers.planning import STRAIGHT, planner

HERE = np.array([0.0, 0.0, 0.0, 0.5, 0.0])


@pytest.fixture(autouse=True)
def _no_warnings() -> Iterator[None]:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        yield


def seen(name: str, x: float, y: float, spread: float = 1e-4, age: float = 0.0) -> Detection:
    return Detection(name, np.array([x, y]), spread * np.eye(2), 0.3, age)


def planned(made: Any, stamp: float, *detections: Detection) -> Plan:
    made.command(Observation(stamp, HERE, detections))
    assert isinstance(made.plan, Plan)
    return made.plan


def around(path: Array, dt: float = 0.5, noise: float = 1e-4) -> Tracks:
    count, size = len(path), path.shape[2]
    ids = tuple(map(str, range(count)))
    return Tracks(path, dt, ids, np.full(count, 0.3), np.tile(noise * np.eye(size), (count, 1, 1)))


def walk(count: int = 2, rows: int = 20) -> Array:
    rng = np.random.default_rng(4)
    return np.cumsum(0.3 + 0.02 * rng.standard_normal((count, rows, 2)), axis=1)


@pytest.mark.parametrize("age", [3.1, 50.0])
def test_an_age_above_forget_is_refused_with_a_reason(age: float) -> None:
    """It would size the forecast: 1e6 s took 322 MB, 1e9 s ended in a MemoryError."""
    made = planner()
    planned(made, 0.0, seen("a", 5.0, 3.0))
    plan = planned(made, 0.5, seen("a", 5.0, 3.0), seen("old", 6.0, 3.0, age=age))
    assert plan.rung is Rung.OPTIMAL
    assert plan.ids == ("a",)
    assert f"'old' refused: it was measured {age:.3g} s ago, at most 3 s" in plan.reason
    assert plan.forecast is not None
    assert plan.forecast.steps == 15


@pytest.mark.parametrize("age", [1e6, 1e9, 1e300])
def test_an_age_of_another_clock_leaves_no_place_and_the_robot_brakes(age: float) -> None:
    made = planner()
    planned(made, 0.0, seen("a", 5.0, 3.0))
    plan = planned(made, 0.5, seen("a", 5.0, 3.0), seen("old", 6.0, 3.0, age=age))
    assert plan.rung is Rung.BRAKE
    assert f"'old' refused: age is {age:g} s, at most 60 s" in plan.reason
    assert plan.forecast is not None
    assert plan.forecast.steps == 15


@pytest.mark.parametrize("spread", [1e30, 1e200, 1e307])
def test_a_huge_covariance_is_that_obstacles_own_affair(spread: float) -> None:
    """The predictor raised, and the planner braked blind."""
    made, plain = planner(), planner()
    for k in range(4):
        both = seen("a", 5.0 - 0.1 * k, 3.0), seen("b", 60.0, 30.0, spread)
        plan, alone = planned(made, 0.5 * k, *both), planned(plain, 0.5 * k, both[0])
    assert plan.rung is not Rung.BRAKE
    assert plan.forecast is not None and alone.forecast is not None
    assert plan.fallbacks[0] is None
    assert "known to more than 1e+06 m" in str(plan.fallbacks[1])
    assert np.array_equal(plan.forecast.mean[0], alone.forecast.mean[0])
    assert plan.forecast.mean[1, 0, 0] == pytest.approx([60.0, 30.0])


@dataclass(frozen=True)
class Picky(Predictor):
    """Raises where an obstacle of this name is among them."""

    dislikes: str = "b"

    def predict(self, tracks: Tracks, steps: int, scene: Scene | None = None) -> Forecast:
        if self.dislikes in tracks.ids:
            raise ArithmeticError("division by b")
        return InteractingModels(modes="kept").predict(tracks, steps, scene)


def test_a_predictor_that_raises_for_one_obstacle_serves_the_others() -> None:
    made = planner(predictor=Picky())
    for k in range(3):
        plan = planned(made, 0.5 * k, seen("a", 5.0 - 0.1 * k, 3.0), seen("b", 60.0, 30.0))
    assert plan.rung is Rung.OPTIMAL
    none, reason = plan.fallbacks
    assert none is None and reason is not None
    assert reason.startswith(f"ArithmeticError: division by b ({__file__}, line ")
    assert plan.forecast is not None
    assert plan.forecast.mean[1, 0] == pytest.approx(np.tile([60.0, 30.0], (15, 1)))
    times = 0.5 * np.arange(1, 16)
    assert plan.forecast.covariance[1, 0, :, 0, 0] == pytest.approx(1e-4 + times**2)
    assert plan.forecast.weight[1] == pytest.approx([1.0, 0.0, 0.0])


@pytest.mark.parametrize("jump", [1e9, 1e17, 1e300, 1.7e308, -1e300])
def test_a_clock_that_leaps_costs_neither_time_nor_the_plan(jump: float) -> None:
    made = planner()
    for stamp in (0.0, 0.5, jump, jump + 0.5, -jump, 1.0):
        plan = planned(made, stamp, seen("a", 5.0, 3.0))
        assert plan.rung is Rung.OPTIMAL, plan.reason
        assert plan.ids == ("a",)


@pytest.mark.parametrize("jump", [1e9, 1e300, 1.7e308])
def test_what_adapts_survives_a_clock_that_leaps(jump: float) -> None:
    """Found by `make fuzz`: the number of steps that had fallen due was infinite."""
    learning: Adaptive = AdaptiveConformal(Kalman(), observed=4)
    for stamp in (-jump, -jump + 0.5, 0.0, 0.5, 1.0, jump, -jump, jump, jump + 0.5):
        tracks = replace(around(walk()), stamp=stamp)
        learning = learning.update(tracks)
        assert np.isfinite(learning.predict(tracks, 5).covariance).all()


def test_a_clock_too_large_for_its_steps_is_named() -> None:
    assert "clock counts in steps of 16 s" in planned(planner(), 1e17).reason


def test_of_many_obstacles_the_nearest_are_kept() -> None:
    rng = np.random.default_rng(1)
    crowd = tuple(seen(str(k), *(900.0 * rng.standard_normal(2) + 10.0)) for k in range(3 * MOST))
    made = planner()
    near = seen("near", 7.0, 3.0)
    plan = planned(made, 0.0, *crowd, near)
    assert "near" in plan.ids
    assert plan.forecast is not None
    assert len(plan.forecast.mean) == MOST
    assert f"{2 * MOST + 1} of {3 * MOST + 1} beyond the nearest" in plan.reason
    orca = Orca(made.robot)
    orca.set_path(STRAIGHT)
    orca.command(Observation(0.0, HERE, (*crowd, near)))
    assert len(orca._neighbours.now()[0]) == MOST


def test_identities_that_never_repeat_do_not_pile_up() -> None:
    history = History(dt=0.5, samples=10, forget=1e3, gap=1.0)
    for k in range(5 * MOST):
        history = history.add(0.01 * k, (seen(str(k), 1.0, 1.0),))
    tracks = history.tracks()
    assert tracks is not None
    assert set(tracks.ids) == {str(k) for k in range(4 * MOST, 5 * MOST)}


def test_a_fast_clock_does_not_grow_a_log() -> None:
    history = History(dt=0.5, samples=4, forget=3.0, gap=1.0)
    for k in range(20_000):
        history = history.add(1e-4 * k, (seen("a", 1e-4 * k, 1.0),))
    log = history.logs["a"]
    assert len(log.times) < 64 * (4 + 2) + 2
    tracks = history.tracks()
    assert tracks is not None
    assert tracks.positions[0, -1, 0] == pytest.approx(1.9999)
    assert np.diff(tracks.positions[0, :, 0]) == pytest.approx(0.5)


def test_instants_of_almost_the_same_time_are_interpolated() -> None:
    """Found by `make fuzz`: the share of the way between them overflowed."""
    history = History(dt=0.5, samples=4, forget=3.0, gap=1.0)
    for stamp in (0.0, 1e-300, 2e-300, 0.5):
        history = history.add(stamp, (seen("a", 1.0 + stamp, 1.0),))
    tracks = history.tracks()
    assert tracks is not None
    assert tracks.positions[0, -2:, 0].tolist() == [1.0, 1.5]


@pytest.mark.parametrize("dt", [1e-6, 1e-5])
def test_a_game_of_microseconds_is_not_played(dt: float) -> None:
    """Its forecasts had 7.5 million steps: 82 s for one call."""
    ego = np.array([0.0, 0.0, 0.0, 0.5, 0.0])
    forecast = Game().predict(around(walk(), dt), 3, Scene(ego=ego))
    assert all("horizon is" in str(reason) for reason in forecast.fallback)


def test_steps_of_a_thousand_seconds_leave_every_model_possible() -> None:
    """A model's weight became 0, and 0 / 0 the share of those that follow it."""
    path = walk(3, 40)
    path[1] *= 3e4
    for dt in (1e3, 1e4):
        forecast = InteractingModels().predict(around(path, dt), 5)
        assert forecast.fallback == (None, None, None)


@pytest.mark.parametrize("dt", [1e4, 1e300])
def test_leaps_over_long_gaps_do_not_drown_the_noise(dt: float) -> None:
    """Found by `make fuzz`: in steps of 1e300 s no way was too long."""
    path = 1e9 * np.random.default_rng(3).uniform(-1.0, 1.0, (4, 60, 2))
    path[:, np.arange(60) % 3 > 0] = np.nan
    forecast = InteractingModels().predict(around(path, dt), 15)
    assert all("leap" in str(reason) for reason in forecast.fallback)


def test_a_plan_from_another_age_pushes_nobody() -> None:
    """Found by `make fuzz`: the clock could not tell the instants of the plan apart."""
    tracks = replace(around(walk()), stamp=1e300)
    plan = np.arange(8.0)[:, None] * np.ones(2)
    scene = Scene(plan=plan, plan_times=np.arange(8.0))
    forecast = SocialForce().predict(tracks, 5, scene)
    assert np.array_equal(forecast.mean, SocialForce().predict(tracks, 5).mean)


def test_within_the_limits_nothing_is_copied() -> None:
    tracks = around(walk())
    assert bounded(tracks, Scene(ego=HERE)) is None


def test_what_is_beyond_a_limit_counts_as_not_observed() -> None:
    path = walk(3)
    path[0, 5], path[1, :12] = 2 * FARTHEST, path[1, :12] + 1e5
    known = bounded(around(path), None)
    assert known is not None
    assert np.isnan(known.tracks.positions[0]).all(axis=1).tolist() == [k == 5 for k in range(20)]
    assert np.isnan(known.tracks.positions[1, :12]).all()
    assert np.array_equal(known.tracks.positions[1, 12:], path[1, 12:])
    assert [str(reason)[:7] for reason in known.reasons] == ["samples", "a leap ", "None"]


def test_a_capped_covariance_keeps_its_axes() -> None:
    turn = np.array([[0.6, -0.8], [0.8, 0.6]])
    wide = turn @ np.diag([1e40, 4.0]) @ turn.T
    tracks = replace(around(walk()), noise=np.stack([0.5 * (wide + wide.T), np.eye(2)]))
    known = bounded(tracks, None)
    assert known is not None
    assert np.linalg.eigvalsh(known.tracks.noise[0])[1] == pytest.approx(1e12)
    assert turn[:, 0] @ known.tracks.noise[0] @ turn[:, 0] == pytest.approx(1e12)
    assert np.array_equal(known.tracks.noise[1], np.eye(2))


@pytest.mark.parametrize("scale", [5e-324, 1e-300, 1e-160, 1e155, 1e200, 1e308])
def test_covariances_are_judged_at_any_magnitude(scale: float) -> None:
    fine = scale * np.array([[1.0, 0.3], [0.3, 0.5]])
    assert np.array_equal(checked_covariance("c", fine, (2, 2)), fine)
    if scale > 1e-300:
        for wrong in ([[1.0, 1.2], [1.2, 1.0]], [[1.0, 0.2], [-0.2, 1.0]]):
            with pytest.raises(WideberthError):
                checked_covariance("c", scale * np.array(wrong), (2, 2))


@pytest.mark.parametrize(
    "changes",
    [
        {"history": 10**9},
        {"horizon": 10**6},
        {"latency": 1e6},
        {"track_dt": 1e-6},
    ],
    ids=str,
)
def test_settings_of_absurd_length_are_refused(changes: dict[str, Any]) -> None:
    with pytest.raises(WideberthError, match="wanted at most"):
        planner(**changes)


@dataclass(frozen=True)
class Careless(Predictor):
    """Gives up on everybody as soon as one position is not known to 1 km."""

    def predict(self, tracks: Tracks, steps: int, scene: Scene | None = None) -> Forecast:
        forecast = Kalman().predict(tracks, steps, scene)
        if tracks.noise.max(initial=0.0) < 1e6:
            return forecast
        return replace(forecast, fallback=("careless: too vague",) * len(tracks))


def test_the_check_finds_who_lets_one_obstacle_spoil_the_others() -> None:
    with pytest.raises(AssertionError, match="an absurd obstacle changes no other"):
        check_predictor(Careless(), dimensions=(2,), dataset=())

"""What was forecast for an instant is judged by that instant, wherever forecasts are judged.

Everybody here gets faster and every forecast is certain to 1 mm, so that a truth one step early
or late is outside by metres.
"""

from dataclasses import dataclass, field, replace

import numpy as np
import pytest

from wideberth.experiments.studies.planner_parts import kept, promised
from wideberth.experiments.studies.prediction_data import PredictionData, Protocol
from wideberth.experiments.studies.prediction_scores import calibration, run_along
from wideberth.framework.mpc.planner.verify import Violation
from wideberth.framework.mpc.slots.base import Touch
from wideberth.framework.predictor import Predictor
from wideberth.framework.values.arrays import Array
from wideberth.framework.values.forecast import Forecast, Scene
from wideberth.framework.values.path import Path
from wideberth.framework.values.plan import Plan, Rung, Status
from wideberth.framework.values.tracks import Tracks
from wideberth.metrics import comfort as metrics_comfort
from wideberth.metrics.episode import content_bound
from wideberth.predictors.adaptive_conformal import AdaptiveConformal, Stated, _truth
from wideberth.predictors.conformal import Conformal
from wideberth.predictors.core.calibration import replayed, squared_distances
from wideberth.predictors.data.recordings import Recording
from wideberth.predictors.data.windows import cut_windows
from wideberth.simulation.log.episode_log import AgentLog, CommandLog, Episode
from wideberth.simulation.measures.episode_measures import Sampled, measures
from wideberth.simulation.measures.plan_calibration import promises
from wideberth.simulation.measures.summary import forecast_coverage, robot_rows

DT, STEPS, SPREAD = 0.5, 4, 1e-3
TIMES = np.linspace(0.0, 6.0, 121)
EMPTY = CommandLog(np.zeros(0), np.zeros(0), np.zeros((0, 2)), np.zeros(0), np.zeros(0))


def runner(times: Array) -> Array:
    """Where somebody is who starts at rest and gets faster, (T, 2)."""
    return np.stack([0.8 * times**2, 3.0 - 0.5 * times**2], axis=-1)


def clock(stamp: float) -> Array:
    """Instants of the steps 1..N."""
    return stamp + DT * np.arange(1.0, STEPS + 1.0)


def robot(places: Array) -> AgentLog:
    unknown = np.full(len(TIMES), np.nan)
    path = Path(np.array([[0.0, 0.0], [4.0, 0.0]]))
    return AgentLog(
        "robot", "robot", 0.5, places, np.zeros(len(TIMES)), unknown, np.zeros(len(TIMES)),
        ((0.0, path),), 1.0, DT, np.nan, 0, EMPTY, (),
    )  # fmt: skip


def plan(stamp: float, positions: Array, mean: Array) -> Plan:
    """A plan whose forecast of the runner is ``mean``, (N, 2)."""
    wide = np.tile(SPREAD**2 * np.eye(2), (1, STEPS, 1, 1))
    level, content = np.full((STEPS, 1), 2.0), np.full((STEPS, 1), 0.9)
    return Plan(
        stamp, DT, positions, np.zeros((STEPS, 2)), positions, positions[1:],
        np.zeros((STEPS, 1, 0)), level, level, content, ("runner",), Status.SOLVED, Rung.OPTIMAL,
        forecast=Forecast.single(mean[None], wide, DT), tracked=("runner",),
    )  # fmt: skip


def episode(*plans: Plan) -> Episode:
    away = np.tile([-9.0, -9.0], (len(TIMES), 1))
    log = replace(robot(away), plans=plans)
    other = replace(robot(runner(TIMES)), name="runner", kind="person")
    return Episode(TIMES, (log, other), "time limit", 0.25, 0)


AWAY = np.tile([-9.0, -9.0], (STEPS + 1, 1))


@pytest.mark.parametrize(("shift", "share"), [(0.0, 1.0), (-DT, 0.0), (DT, 0.0)])
def test_coverage_in_closed_loop(shift: float, share: float) -> None:
    """The forecast of the true places covers all; that of places a step off covers none."""
    plans = [plan(stamp, AWAY, runner(clock(stamp) + shift)) for stamp in (1.0, 2.5)]
    covered, number, overall = forecast_coverage(episode(*plans), 0.05)
    assert covered.tolist() == [share] * STEPS and number.tolist() == [2.0] * STEPS
    assert overall == share
    log = episode(*plans).robots[0]
    assert promises(episode(*plans), log, 0.05)["tail_observed"] == 1.0 - share


@pytest.mark.parametrize("step", range(1, STEPS + 1))
def test_a_touch_counts_at_the_step_at_which_they_meet(step: int) -> None:
    """The plan is where the runner is at one step alone, and the forecast right."""
    positions = AWAY.copy()
    positions[step] = runner(clock(1.0))[step - 1]
    one = plan(1.0, positions, runner(clock(1.0)))
    played = episode(one)
    row = promises(played, played.robots[0], 0.05)
    assert row["step_touched"] == 1.0 / STEPS
    assert row["step_risk"] == pytest.approx(1.0 / STEPS, rel=1e-5)
    assert row["plan_risk_max"] == pytest.approx(1.0, rel=1e-5)
    assert row["episode_touched"] == float(step == 1)
    assert row["episode_risk"] == pytest.approx(float(step == 1), rel=1e-5)
    assert kept(played) == 1.0 - 1.0 / STEPS
    assert promised(played) == pytest.approx(0.9)


def test_a_robot_and_the_others_are_sampled_at_the_same_instants() -> None:
    """They pass the same places, one of them a second later: 1 m apart at 1 m/s."""
    east = np.stack([TIMES, np.zeros(len(TIMES))], axis=-1)
    ahead, behind = robot(east), replace(robot(east - [1.0, 0.0]), name="b", kind="person")
    one = Sampled.of(Episode(TIMES, (ahead, behind), "time limit", 0.25, 0), ahead)
    np.testing.assert_allclose(one.others[0] - one.positions, [[-1.0, 0.0]] * len(one.positions))
    first = np.arange(len(one.positions))[:, None] * [one.step, 0.0]
    np.testing.assert_allclose(one.positions, first, atol=1e-9)


@dataclass(frozen=True)
class Knowing(Predictor):
    """Knows how the runner moves, but is ``wrong`` by so many deviations at each step."""

    wrong: tuple[float, ...] = field(default=(0.0,) * STEPS)

    def predict(self, tracks: Tracks, steps: int, scene: Scene | None = None) -> Forecast:
        ahead = tracks.stamp + tracks.dt * np.arange(steps + 1)
        moved = runner(ahead[1:]) - runner(ahead[:1])
        mean = tracks.positions[0, -1] + moved
        mean = mean + SPREAD * np.stack([self.wrong[:steps], np.zeros(steps)], axis=-1)
        wide = np.tile(SPREAD**2 * np.eye(2), (len(tracks), steps, 1, 1))
        return Forecast.single(np.tile(mean, (len(tracks), 1, 1)), wide, tracks.dt)


def seen(rows: int = 30) -> Tracks:
    """The runner from 0 s on."""
    places = runner(DT * np.arange(rows))[None]
    noise = 1e-6 * np.eye(2)[None]
    return Tracks(places, DT, ("runner",), np.full(1, 0.3), noise, DT * (rows - 1))


def test_scores_hold_each_step_against_its_own_truth() -> None:
    times = DT * np.arange(30)
    recording = Recording(DT, times, ("runner",), runner(times)[None], (None,))
    how = Protocol(observed=3, predicted=STEPS, draws=9)
    wrong = (0.0, 1.0, 9.0, 2.0)
    scores, _, _ = run_along(Knowing(wrong), [recording], PredictionData(), how)
    assert len(scores.error) == 30 - 3 - STEPS + 1
    np.testing.assert_allclose(scores.error, np.tile(SPREAD * np.array(wrong), (24, 1)), atol=1e-9)
    tails = np.exp(-0.5 * np.square(wrong))  # of chi^2 with two degrees of freedom
    np.testing.assert_allclose(scores.tail, np.tile(tails, (24, 1)), rtol=1e-6)
    # Contents 0.05, 0.1, ...: all hold what is exact, none what is 9 deviations off.
    held = np.array(calibration(scores))
    assert held[0].tolist() == [1.0] * held.shape[1] and held[2].max() == 0.0


def test_calibration_replays_each_window_at_its_own_time() -> None:
    windows = cut_windows(seen(), 3, STEPS)
    wrong = (0.0, 1.0, 9.0, 2.0)
    square = squared_distances(*replayed(Knowing(wrong), seen(), windows), windows.future)
    np.testing.assert_allclose(square, np.tile(np.square(wrong), (len(windows), 1)), atol=1e-5)


def test_conformal_scales_are_of_their_own_step() -> None:
    """All windows are wrong by the same, so that the scale of step h is wrong_h^2 / q."""
    wrong = (3.0, 1.0, 9.0, 2.0)
    fitted = Conformal(Knowing(wrong), observed=3, steps=STEPS).fit([seen()]).fitted
    assert fitted is not None
    np.testing.assert_allclose(
        np.array(fitted.scale), np.square(wrong) / content_bound(2, 0.05), rtol=1e-5
    )


def test_adaptive_scales_learn_from_their_own_step() -> None:
    """Only step 3 misses: its scale grows with every truth, the others shrink."""
    whole = seen()
    predictor = AdaptiveConformal(
        Knowing((0.0, 1.0, 9.0, 2.0)), rate=0.25, observed=3, steps=STEPS, speeds=()
    )
    for rows in range(5, 16):
        past = replace(whole, positions=whole.positions[:, :rows], stamp=DT * (rows - 1))
        predictor = predictor.update(past)
    assert predictor.state is not None
    # Step h of the first forecast falls due at the h-th update after it.
    due = np.array([10 - step for step in range(STEPS)])
    missed = np.array([0.0, 0.0, 1.0, 0.0])
    want = predictor.rate * due * (missed - predictor.tail)
    scales, appeared = np.reshape(predictor.state.log_scale, (2, len(want)))
    want[2] = scales[2]  # hits again once it has grown
    np.testing.assert_allclose(scales, want, rtol=1e-9)
    assert scales[2] > 1.0 and not appeared.any()


def place_at(tracks: Tracks, time: float) -> Array:
    """Return where the only person was at a time, (2,), m."""
    none = np.zeros(1, dtype=np.int64)
    parts = np.zeros((1, 1, 2)), np.zeros((1, 1, 2, 2)), np.ones((1, 1))
    return _truth(tracks, Stated(none, np.array([time]), none, none, *parts))[0]


def test_truth_between_two_samples_is_on_the_line_between_them() -> None:
    """On a sample, also when a clock misses it by rounding, the one beside it does not count."""
    tracks = seen(6)
    places, newest = tracks.positions[0], tracks.stamp
    np.testing.assert_allclose(place_at(tracks, newest), places[5])
    middle = 0.5 * (places[3] + places[4])
    np.testing.assert_allclose(place_at(tracks, newest - 1.5 * DT), middle)
    quarter = place_at(tracks, newest - 2.25 * DT)
    np.testing.assert_allclose(quarter, 0.25 * places[2] + 0.75 * places[3])
    gone = tracks.positions.copy()
    gone[:, [1, 2, 4]] = np.nan
    broken = replace(tracks, positions=gone)
    for miss in (-1e-15, 0.0, 1e-15):
        np.testing.assert_array_equal(place_at(broken, newest - 2.0 * DT + miss), places[3])
    # Two steps between measurements are on a line, three are not.
    middle = 0.25 * places[5] + 0.75 * places[3]
    np.testing.assert_allclose(place_at(broken, newest - 1.5 * DT), middle)
    assert np.isnan(place_at(broken, newest - 2.5 * DT)).all()
    assert np.isnan(place_at(tracks, newest - 5.5 * DT)).all()


def test_one_plan_that_touches_is_enough_for_the_episode() -> None:
    hits = AWAY.copy()
    hits[1] = runner(clock(2.0))[0]
    played = episode(plan(1.0, AWAY, runner(clock(1.0))), plan(2.0, hits, runner(clock(2.0))))
    row = promises(played, played.robots[0], 0.05)
    assert row["episode_touched"] == 1.0
    assert row["step_touched"] == pytest.approx(1.0 / (2 * STEPS))


def test_the_work_on_others_is_that_of_the_samples() -> None:
    played = episode()
    one = Sampled.of(played, played.robots[0])
    want = metrics_comfort.social_work(one.positions, one.others, one.step)
    assert measures(played, 0.05, 60.0)["social_work"] == pytest.approx(want)
    assert np.isfinite(want)


def test_every_plan_that_is_not_the_best_is_a_fallback() -> None:
    one = plan(1.0, AWAY, runner(clock(1.0)))
    for rungs in ((Rung.FEASIBLE,) * 2, (Rung.FEASIBLE, Rung.OPTIMAL), (Rung.OPTIMAL,) * 2):
        (row,) = robot_rows(episode(*(replace(one, rung=rung) for rung in rungs)))
        assert row["fallbacks"] == sum(rung is not Rung.OPTIMAL for rung in rungs)


@pytest.mark.parametrize("step", range(1, STEPS + 1))
def test_a_touched_wall_is_named_with_its_step(step: int) -> None:
    """Steps are counted from 1, those at which motion limits are broken as well."""
    depth = np.where(np.arange(1, STEPS + 1) == step, 0.3, 0.0)
    names = tuple(f"wall {i}" for i in range(1, STEPS + 1))
    none = np.zeros(STEPS)
    breach = Violation(none, none[:, None], Touch(depth, names)).breach(("a",))
    assert breach is not None
    assert (breach.name, breach.step, breach.amount) == (f"wall {step}", step, 0.3)
    broken = Violation(depth, none[:, None]).breach(("a",))
    assert broken is not None and broken.step == step

"""Turning people against simulated walks, closed forms and other predictors."""

from dataclasses import replace

import numpy as np
import pytest

from wideberth.framework.predictor import Adaptive
from wideberth.framework.testing.predictor import check_predictor
from wideberth.framework.values.errors import WideberthError
from wideberth.framework.values.forecast import LIGHT
from wideberth.framework.values.tracks import Tracks
from wideberth.metrics.scoring import displacement, energy_score, reached_tail
from wideberth.predictors import turning
from wideberth.predictors.constant_velocity import ConstantVelocity
from wideberth.predictors.core import straight_stretch
from wideberth.predictors.core.history import gather
from wideberth.predictors.core.propagation import white_acceleration
from wideberth.predictors.core.straight_stretch import LONGEST_STRETCH, since_jump
from wideberth.predictors.interacting_models import InteractingModels
from wideberth.predictors.kalman import DriftingVelocity, Kalman
from wideberth.predictors.turning import TurningPeople
from wideberth.tests.oracles.linear_filter import filter_one_by_one

DT = 0.2
NOISE = 0.01
SQUARE = ((-5.0, -5.0), (5.0, -5.0), (5.0, 5.0), (-5.0, 5.0))


def tracks_of(positions, noise=NOISE, dt=DT, stamp=0.0):
    positions = np.asarray(positions, dtype=float)
    count, _, size = positions.shape
    spread = np.tile(noise**2 * np.eye(size), (count, 1, 1))
    return Tracks(positions, dt, tuple(map(str, range(count))), np.full(count, 0.3), spread, stamp)


def straight(place, velocity, rows=12):
    """A walk (1, T, 2) that is at a place now."""
    back = DT * np.arange(1.0 - rows, 1.0)[:, None]
    return (np.asarray(place) + back * np.asarray(velocity))[None]


def corner(old, new, rows, since):
    """A walk (1, T, 2), m, that has turned ``since`` s ago from one velocity to another."""
    times = DT * np.arange(1.0 - rows, 1.0)[:, None] + since
    return np.where(times < 0, times * np.asarray(old), times * np.asarray(new))[None]


@pytest.fixture
def fine(monkeypatch):
    """Modes without number that stand for nothing but themselves."""
    monkeypatch.setattr(turning, "LIGHT", 1e-9)
    monkeypatch.setattr(turning, "SECTORS", 720)
    monkeypatch.setattr(turning, "CELL", 1e-6)
    monkeypatch.setattr(turning, "WALK", DriftingVelocity(1e-12, 2.0))


def drawn_walks(count, place, velocity, tendency, rng):
    """Walk on, turn before the border towards a place anywhere in the square, and walk on."""
    half = 5.0 + turning.GIVEN_BORDER
    speed = np.hypot(*velocity)
    border = min(
        (half - np.sign(v) * p) / abs(v) for p, v in zip(place, velocity, strict=True) if v
    )
    time = border * (1.0 - rng.random(count) ** (1.0 / tendency))
    turned = place + time[:, None] * velocity
    way = rng.uniform(-half, half, (count, 2)) - turned
    new = speed * way / np.linalg.norm(way, axis=1)[:, None]
    steps = DT * np.arange(1.0, 21.0)
    before = np.minimum(steps, time[:, None])[..., None]
    return place + before * velocity + (steps[:, None] - before) * new[:, None]


@pytest.mark.parametrize("tendency", [1.0, 0.3])
def test_moments_are_those_of_the_stated_walk(fine, tendency):
    """Thousands of modes against as many drawn walks, within three standard errors."""
    place, velocity = np.array([1.0, -2.0]), np.array([1.1, 0.4])
    predictor = TurningPeople(3000, SQUARE, tendency=tendency)
    forecast = predictor.predict(tracks_of(straight(place, velocity)), 20)
    count = 20000
    walks = drawn_walks(count, place, velocity, tendency, np.random.default_rng(1))
    weight, mean = forecast.weight[0], forecast.mean[0]
    centre = np.einsum("m,mnd->nd", weight, mean)
    error = walks.std(axis=0) / np.sqrt(count)
    assert (np.abs(walks.mean(axis=0) - centre) < 3 * error + 1e-3).all()
    apart, gap = mean - centre, walks - centre
    second = np.einsum("m,mni,mnj->nij", weight, apart, apart)
    squares = gap[..., :, None] * gap[..., None, :]
    error = squares.std(axis=0) / np.sqrt(count)
    assert (np.abs(squares.mean(axis=0) - second) < 3 * error + 2e-3).all()


def test_few_modes_have_nearly_the_same_moments(monkeypatch):
    monkeypatch.setattr(turning, "WALK", DriftingVelocity(1e-12, 2.0))
    place, velocity = np.array([1.0, -2.0]), np.array([1.1, 0.4])
    predictor = TurningPeople(area=SQUARE)
    forecast = predictor.predict(tracks_of(straight(place, velocity)), 20)
    walks = drawn_walks(20000, place, velocity, 1.0, np.random.default_rng(1))
    centre = np.einsum("m,mnd->nd", forecast.weight[0], forecast.mean[0])
    assert np.abs(centre - walks.mean(axis=0)).max() < 0.15
    apart = forecast.mean[0] - centre
    second = np.einsum("m,mni,mnj->nij", forecast.weight[0], apart, apart)
    second += np.einsum("m,mnij->nij", forecast.weight[0], forecast.covariance[0])
    for step in (9, 19):
        assert np.trace(second[step]) == pytest.approx(np.trace(np.cov(walks[:, step].T)), rel=0.2)


def test_without_an_area_the_rate_is_the_hazard():
    """Exponential times, and directions that cancel: E[p(t)] - p = v (1 - exp(-t h)) / h."""
    hazard = 0.2
    track = tracks_of(straight((3.0, 1.0), (0.8, -0.9)))
    forecast = TurningPeople(hazard=hazard).predict(track, 20)
    times = DT * np.arange(1.0, 21.0)
    assert forecast.weight[0, 0] == pytest.approx(np.exp(-hazard * times[-1]))
    centre = np.einsum("m,mnd->nd", forecast.weight[0], forecast.mean[0])
    wanted = np.array([3.0, 1.0]) - np.outer(np.expm1(-hazard * times) / hazard, [0.8, -0.9])
    assert np.abs(centre - wanted).max() < 0.06


def test_all_modes_weigh_what_plans_heed():
    track = tracks_of(straight((0.0, 0.0), (1.0, 0.0)))
    for hazard, number in ((0.001, 0), (0.005, 1), (0.02, 7), (0.5, 23)):
        weight = TurningPeople(hazard=hazard).predict(track, 20).weight[0]
        assert (weight[1:] > 0).sum() == number
        assert (weight[1:][weight[1:] > 0] >= LIGHT).all()


def test_modes_keep_the_speed_and_lead_into_the_area():
    track = tracks_of(straight((4.0, 4.0), (1.0, 0.2)))
    forecast = TurningPeople(area=SQUARE).predict(track, 12)
    steps = np.linalg.norm(np.diff(forecast.mean[0], axis=1), axis=-1)
    assert steps.max() < DT * np.hypot(1.0, 0.2) + 1e-9
    assert (np.median(steps, axis=1) > 0.99 * DT * np.hypot(1.0, 0.2)).all()
    inside = np.abs(forecast.mean[0, 1:]).max(axis=-1) < 5.2
    assert inside.mean() > 0.9 and forecast.weight[0, 0] < 0.05


def test_straight_on_is_what_kalman_says():
    """The same mean, covariance and joint covariance, where nothing jumped."""
    rng = np.random.default_rng(1)
    walks = np.concatenate([straight((y, 0.0), (1.0, 0.1 * y)) for y in range(9)])
    track = tracks_of(walks + 0.03 * rng.standard_normal(walks.shape), noise=0.03)
    track = replace(
        track, positions=np.where(np.arange(12)[:, None] == 7, np.nan, track.positions)
    )
    forecast = TurningPeople().predict(track, 8)
    newest = replace(track, positions=track.positions[:, -LONGEST_STRETCH - 1 :])
    wanted = Kalman(speed=2.0).predict(newest, 8)
    assert forecast.mean[:, 0] == pytest.approx(wanted.mean[:, 0], abs=1e-12)
    assert forecast.covariance[:, 0] == pytest.approx(wanted.covariance[:, 0], abs=1e-12)
    assert forecast.joint[:, 0] == pytest.approx(wanted.joint[:, 0], abs=1e-12)


def test_the_joint_covariance_contains_that_of_each_step():
    rng = np.random.default_rng(0)
    track = tracks_of(np.cumsum(0.2 * rng.standard_normal((5, 12, 2)), axis=1), noise=0.03)
    forecast = TurningPeople(area=SQUARE).predict(track, 6)
    blocks = forecast.joint.reshape(5, 24, 6, 2, 6, 2)
    each = np.einsum("omninj->omnij", blocks)
    assert each == pytest.approx(forecast.covariance, abs=1e-12)
    assert np.linalg.eigvalsh(forecast.joint).min() > -1e-12


def test_a_turn_mode_errs_as_place_and_velocity_do(fine):
    """Covariance of a mode against drawn errors of the state carried through its turn."""
    track = tracks_of(straight((0.0, 0.0), (1.0, 0.5)), noise=0.05)
    forecast = TurningPeople(9, hazard=0.5).predict(track, 12)
    newest = replace(track, positions=track.positions[:, -11:])
    spread = filter_one_by_one(newest, turning.WALK, 0.01).values[2][:, 0, :, 0, 0, 0]
    first, cross, second = spread[[0, 0, 1], [0, 1, 1]]
    rng = np.random.default_rng(2)
    root = np.linalg.cholesky([[first, cross], [cross, second]])
    place, velocity = np.einsum("ij,jcd->icd", root, rng.standard_normal((2, 40000, 2)))
    mode, step = 3, 11
    moved = np.diff(forecast.mean[0, mode], axis=0)
    angle = np.arctan2(*moved[-1][::-1]) - np.arctan2(0.5, 1.0)
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    # The whole way is b v + h R v with b + h = t, which gives b.
    whole = forecast.mean[0, mode, step] / np.hypot(1.0, 0.5)
    start, end = np.array([1.0, 0.5]) / np.hypot(1.0, 0.5), moved[-1] / np.linalg.norm(moved[-1])
    before, behind = np.linalg.solve(np.stack([start, end], axis=1), whole)
    assert before + behind == pytest.approx(12 * DT, rel=1e-3) and before > 0.1 < behind
    drawn = place + before * velocity + behind * velocity @ turn.T
    assert np.cov(drawn.T) == pytest.approx(forecast.covariance[0, mode, step], rel=0.05, abs=1e-4)


def waypoint_crowd(count, seconds, rng):
    """People (O, T, 2) who walk from goal to goal in the square."""
    walks = []
    for _ in range(count):
        place, speed = rng.uniform(-5.0, 5.0, 2), rng.uniform(0.9, 1.7)
        points, times = [place], [0.0]
        while times[-1] < seconds:
            goal = rng.uniform(-5.0, 5.0, 2)
            times.append(times[-1] + np.linalg.norm(goal - points[-1]) / speed)
            points.append(goal)
        steps = np.arange(0.0, seconds, DT)
        walks.append([np.interp(steps, times, np.array(points)[:, axis]) for axis in range(2)])
    return np.transpose(walks, (0, 2, 1))


def watched(predictor, walks, rows=20):
    """Update along walks (O, T, 2)."""
    for end in range(1, walks.shape[1] + 1):
        part = walks[:, max(end - rows, 0) : end]
        predictor = predictor.update(tracks_of(part, stamp=DT * end))
    return predictor


def test_the_tendency_is_the_mean_of_its_posterior():
    """Gamma prior and Poisson turns: (4 k + turns) / (4 + exposure), the latter by hand."""
    walk = np.concatenate(
        [corner((1.0, 0.0), (0.0, 1.0), 20, 2.0), corner((0.9, 0.0), (0.9, 0.1), 20, 2.0)]
    )
    predictor = watched(TurningPeople(area=SQUARE, tendency=0.5), walk)
    assert predictor.state.turns == 1
    lag, exposure = 3, 0.0
    for row in range(2 * lag + 1, 20):
        for path in walk:
            velocity = (path[row] - path[row - lag]) / (lag * DT)
            with np.errstate(divide="ignore", invalid="ignore"):
                left = (5.0 + turning.GIVEN_BORDER - np.sign(velocity) * path[row]) / np.abs(
                    velocity
                )
            exposure += DT / left.min(where=velocity != 0, initial=np.inf)
    assert predictor.state.exposure == pytest.approx(exposure)
    assert predictor.learnt_tendency == pytest.approx((4 * 0.5 + 1) / (4 + exposure))


def test_turns_seen_in_one_look_are_those_seen_step_by_step():
    walks = waypoint_crowd(6, 3.9, np.random.default_rng(5))
    at_once = TurningPeople(area=SQUARE).update(tracks_of(walks, stamp=3.8))
    assert watched(TurningPeople(area=SQUARE), walks).state.turns == at_once.state.turns > 0


def test_watching_finds_the_area_and_who_turns():
    rng = np.random.default_rng(3)
    about = watched(TurningPeople(), waypoint_crowd(10, 30.0, rng))
    corners = np.array(about.state.corners)
    assert 4.0 < np.abs(corners).max(axis=0).min() and np.abs(corners).max() <= 5.0
    assert 0.4 < about.learnt_tendency < 1.5
    passing = [straight((6.0, y), (0.9 + 0.01 * y, 0.0), 60) for y in range(-5, 6)]
    through = np.concatenate(passing)
    assert watched(TurningPeople(), through).learnt_tendency < 0.2


def test_learnt_area_moves_with_the_world():
    walks = waypoint_crowd(8, 8.0, np.random.default_rng(4))
    turn = np.array([[0.6, -0.8], [0.8, 0.6]])
    shift = np.array([30.0, -7.0])
    first, second = (
        watched(TurningPeople(), walks),
        watched(TurningPeople(), walks @ turn.T + shift),
    )
    still = first.predict(tracks_of(walks[:, -12:]), 12)
    moved = second.predict(tracks_of(walks[:, -12:] @ turn.T + shift), 12)
    assert moved.mean == pytest.approx(still.mean @ turn.T + shift, abs=1e-6)
    assert moved.weight == pytest.approx(still.weight, abs=1e-9)


def cold_errors(predictors, walks, dt, steps):
    """Mean error, m, of predictors that know nothing as walks (O, T, 2) begin."""
    errors = {name: [] for name in predictors}
    for end in range(2, walks.shape[1] - steps + 1):
        part = walks[:, max(end - 20, 0) : end]
        track = tracks_of(part, noise=0.03, dt=dt, stamp=dt * end)
        for name, predictor in predictors.items():
            if isinstance(predictor, Adaptive):
                predictors[name] = predictor = predictor.update(track)
            forecast = predictor.predict(track, steps)
            truth = walks[:, end : end + steps]
            errors[name].append(displacement(forecast.mean, forecast.weight, truth).mean())
    return {name: np.mean(values) for name, values in errors.items()}


@pytest.mark.parametrize(("people", "bend"), [(1, 0.05), (3, 0.0), (10, 0.03), (40, 0.02)])
def test_until_the_area_is_known_it_errs_no_more_than_imm(people, bend):
    """Clips of 14 s of people who cross a place larger than what was seen, by 0.03 m of noise."""
    found = {"turning": [], "imm": []}
    for seed in range(max(12 // people, 2)):
        rng = np.random.default_rng(seed)
        heading = rng.choice([0.0, np.pi], people) + 0.2 * rng.standard_normal(people)
        angle = heading[:, None] + 0.4 * np.arange(35.0) * bend * rng.standard_normal((people, 1))
        way = np.stack([np.cos(angle), np.sin(angle)], axis=2).cumsum(axis=1)
        walks = rng.uniform(-10.0, 10.0, (people, 1, 2)) + 0.4 * 1.3 * way
        walks += 0.03 * rng.standard_normal(walks.shape)
        cold = {"turning": TurningPeople(), "imm": InteractingModels()}
        for name, error in cold_errors(cold, walks, 0.4, 12).items():
            found[name].append(error)
    assert np.mean(found["turning"]) < 1.02 * np.mean(found["imm"])


def test_the_area_of_people_who_walk_about_is_known_within_seconds():
    """Ten people in a square of 10 m: few are then expected to walk straight on for 4 s."""
    for seed in range(3):
        walks = waypoint_crowd(10, 12.0, np.random.default_rng(seed))
        track = tracks_of(walks[:, -12:])
        straight_on = watched(TurningPeople(), walks).predict(track, 20).weight[:, 0]
        assert straight_on.mean() < 0.6
        assert TurningPeople().predict(track, 20).weight[:, 0].mean() > 0.95


def test_the_hull_of_the_first_seconds_is_not_the_area():
    """People side by side extend it as fast as they walk, whatever rows the first look has."""
    walks = np.concatenate([straight((3.0, y), (1.2, 0.0), 40) for y in range(-6, 7)])
    track = tracks_of(walks[:, -12:], stamp=DT * 40)
    wanted = TurningPeople().predict(track, 20).weight
    for rows, first in ((20, 1), (40, 40), (40, 20)):
        predictor = TurningPeople()
        for end in range(first, 41):
            part = walks[:, max(end - rows, 0) : end]
            predictor = predictor.update(tracks_of(part, stamp=DT * end))
        assert predictor.state.area is not None
        assert np.array_equal(predictor.predict(track, 20).weight, wanted)


def test_it_is_calibrated_and_sharper_on_people_who_walk_about():
    """95 % regions hold 93 to 99 %, and the energy score is a third below that of Kalman."""
    rng = np.random.default_rng(6)
    walks = waypoint_crowd(40, 20.0, rng)
    seen = walks + NOISE * rng.standard_normal(walks.shape)
    tails, scores = [], {"turning": [], "kalman": []}
    for end in range(30, 80, 5):
        track, truth = tracks_of(seen[:, end - 12 : end]), walks[:, end : end + 20]
        for name, predictor in (("turning", TurningPeople(area=SQUARE)), ("kalman", Kalman())):
            forecast = predictor.predict(track, 20)
            draws = forecast.sample(np.random.default_rng(end), 40)
            scores[name].append(energy_score(draws, truth).mean())
            if name == "turning":
                parts = forecast.mean[:, :, 4::5], forecast.covariance[:, :, 4::5]
                tails.append(reached_tail(*parts, forecast.weight, truth[:, 4::5]))
    inside = (np.array(tails) >= 0.05).mean()
    assert 0.92 < inside < 0.99
    assert np.mean(scores["turning"]) < 0.67 * np.mean(scores["kalman"])


def begun(walk, noise=NOISE, density=0.02):
    """Steps since each history begins."""
    past = gather(tracks_of(walk))
    found = since_jump(past, np.full(len(walk), noise**2), DT, density)
    assert (found.samples == found.length).all()
    return found.length - 1


def velocity_of(forecast):
    """Of walking straight on, m/s."""
    return (forecast.mean[:, 0, 1] - forecast.mean[:, 0, 0]) / forecast.dt


def test_a_jump_at_a_sample_is_followed_one_step_later():
    old, new = (1.2, 0.0), (-0.4, 0.9)
    for since in (1, 2, 5):
        walk = corner(old, new, 15, since * DT)
        assert begun(walk) == since
        gap = velocity_of(TurningPeople().predict(tracks_of(walk), 2))[0] - new
        assert np.abs(gap).max() < 0.01
    assert begun(corner(old, new, 15, 0.0)) == LONGEST_STRETCH


def test_a_jump_between_samples_is_followed_two_steps_later():
    old, new = (1.2, 0.0), (-0.4, 0.9)
    walk = corner(old, new, 15, 2.5 * DT)
    assert begun(walk) == 2
    gap = velocity_of(TurningPeople().predict(tracks_of(walk), 2))[0] - new
    assert np.abs(gap).max() < 0.01


def test_jumps_are_followed_sooner_than_by_others_and_walks_known_as_well():
    """Mean error of the velocity, m/s, 0.4 s after a turn, and without one, with 1 cm of noise."""
    rng = np.random.default_rng(7)
    errors = {}
    for since in (2.2 * DT, 50 * DT):
        walks = np.concatenate([corner((1.3, 0.0), (-0.6, 1.1), 20, since)] * 200)
        track = tracks_of(walks + NOISE * rng.standard_normal(walks.shape))
        for predictor in (TurningPeople(), Kalman(), ConstantVelocity(window=1)):
            gap = velocity_of(predictor.predict(track, 2)) - [-0.6, 1.1]
            errors[type(predictor).__name__, since] = np.linalg.norm(gap, axis=1).mean()
    turned, steady = 2.2 * DT, 50 * DT
    assert errors["TurningPeople", turned] < 0.2 * errors["Kalman", turned]
    assert errors["TurningPeople", turned] < 1.2 * errors["ConstantVelocity", turned]
    assert errors["TurningPeople", steady] < 0.5 * errors["ConstantVelocity", steady]


def test_straight_walks_are_refused_as_seldom_as_stated(monkeypatch):
    """With three samples, of nothing but noise, with the stated probability."""
    monkeypatch.setattr(straight_stretch, "DOUBT", 0.02)
    straight_stretch._lines.cache_clear()
    rng = np.random.default_rng(8)
    walks = np.repeat(straight((0.0, 0.0), (1.0, -0.3), rows=3), 20000, axis=0)
    refused = begun(walks + NOISE * rng.standard_normal(walks.shape), density=1e-12) == 1
    straight_stretch._lines.cache_clear()
    assert abs(refused.mean() - 0.02) < 3 * np.sqrt(0.02 * 0.98 / 20000)


def test_acceleration_moves_walks_off_a_line_as_stated():
    """Mean square of the residuals of drawn walks against w - 1 times r + q dt^3 g_w."""
    residual, _, drift = straight_stretch._lines(10, 2)
    density, rng = 0.5, np.random.default_rng(9)
    transition, process = white_acceleration(DT, density, 1)
    root = np.linalg.cholesky(process)
    state, walks = np.zeros((20000, 2)), []
    for _ in range(11):
        walks.append(state[:, 0])
        state = state @ transition.T + rng.standard_normal(state.shape) @ root.T
    seen = np.transpose(walks) + 0.1 * rng.standard_normal((20000, 11))
    for steps in (2, 5, 10):
        squares = ((seen @ residual[steps].T) ** 2).sum(axis=1)
        wanted = (steps - 1) * (0.01 + density * DT**3 * drift[steps])
        error = squares.std() / np.sqrt(len(squares))
        assert abs(squares.mean() - wanted) < 3 * error


def test_who_has_just_jumped_may_jump_again():
    """Variance of the velocity, less with every step since, and none after a straight walk."""
    spread = []
    for since in (1, 5, 9, 12):
        track = tracks_of(corner((1.2, 0.0), (-0.4, 0.9), 15, since * DT))
        forecast = TurningPeople().predict(track, 2)
        rows = min(since, LONGEST_STRETCH) + 1
        newest = replace(track, positions=track.positions[:, -rows:])
        plain = Kalman(speed=2.0).predict(newest, 2)
        added = forecast.covariance[0, 0, 1] - plain.covariance[0, 0, 1]
        assert added[0, 1] == pytest.approx(0.0, abs=1e-12)
        spread.append(added[0, 0] / (2 * DT) ** 2)
    assert spread == pytest.approx([0.16 * 0.9, 0.16 * 0.5, 0.16 * 0.1, 0.0], abs=1e-12)


def test_short_histories_are_left_to_the_fallback():
    walk = np.concatenate([straight((0.0, 0.0), (1.0, 0.0))] * 3)
    walk[1, :-1], walk[2] = np.nan, np.nan
    reasons = TurningPeople().predict(tracks_of(walk), 6).fallback
    assert reasons[0] is None and reasons[1] == "turning: 1 sample, needs 2"
    assert reasons[2] == "turning: 1 sample, needs 2; kalman: never observed"
    flight = TurningPeople().predict(tracks_of(np.zeros((1, 5, 3))), 6)
    assert flight.fallback == ("turning: 3 coordinates, needs 2",)


def test_laws_of_another_setting():
    check_predictor(TurningPeople(modes=7, hazard=0.3), dimensions=(2,))


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"modes": 1}, r"turning\.modes is 1"),
        ({"hazard": 0.0}, r"turning\.hazard is 0"),
        ({"tendency": -1.0}, r"turning\.tendency"),
        ({"area": ((0.0, 0.0), (1.0, 0.0))}, r"turning\.area is .*three corners"),
        ({"area": ((0.0, 0.0), (1.0, 0.0), (2.0, 0.0))}, r"turning\.area is .*three corners"),
    ],
)
def test_refused(settings, words):
    with pytest.raises(WideberthError, match=words):
        TurningPeople(**settings)


def test_a_clock_that_goes_back_begins_anew():
    walks = waypoint_crowd(4, 6.0, np.random.default_rng(9))
    known = watched(TurningPeople(), walks)
    again = known.update(replace(tracks_of(walks[:, :20]), stamp=1.0))
    fresh = TurningPeople().update(replace(tracks_of(walks[:, :20]), stamp=1.0))
    assert repr(again) == repr(fresh) != repr(known)

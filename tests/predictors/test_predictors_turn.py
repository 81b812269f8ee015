"""Turning bodies: the filter against filterpy and closed forms, and when they step aside."""

from dataclasses import replace

import numpy as np
import pytest

from wideberth.framework.testing.predictor import check_predictor
from wideberth.framework.values.errors import WideberthError
from wideberth.framework.values.measurements import NO_LOG, Measurements
from wideberth.framework.values.tracks import Tracks
from wideberth.predictors import coordinated_turn
from wideberth.predictors.constant_acceleration import singer
from wideberth.predictors.coordinated_turn import (
    CHORD,
    CoordinatedTurn,
    TurnModel,
    floored_root,
    position_update,
    unscented_step,
)
from wideberth.predictors.core.propagation import white_steps
from wideberth.predictors.kalman import Kalman

DT = 0.5
NAN = np.nan
LASTING = 1e6
"""s; a yaw rate that does not decay within any horizon."""


def tracks_of(positions, noise=0.01, dt=DT):
    positions = np.asarray(positions, dtype=float)
    count, _, size = positions.shape
    spread = np.tile(noise**2 * np.eye(size), (count, 1, 1))
    return Tracks(positions, dt, tuple(map(str, range(count))), np.full(count, 0.3), spread)


def circle(samples, speed=1.0, rate=0.3, heading=0.4):
    angle = heading + rate * DT * np.arange(samples)
    return speed / rate * np.stack([np.sin(angle), -np.cos(angle)], axis=1)


def model_of(turn_time=2.0, times=(DT,)):
    transition, process = singer(np.array(times), 0.3, turn_time)
    _, along = white_steps(np.array(times), 0.05)
    return TurnModel(np.array(times), along, transition[1:, 1:], process[1:, 1:])


def states(count, seed=0):
    rng = np.random.default_rng(seed)
    state = rng.standard_normal((count, 5))
    root = 0.2 * rng.standard_normal((count, 5, 5))
    return state, root @ root.swapaxes(1, 2) + 1e-3 * np.eye(5)


def test_an_arc_is_the_textbooks_and_has_no_hole_at_zero():
    model = model_of(LASTING)
    state, _ = states(50)
    x, y, theta, v, omega = state.T
    moved = model.moved(state)
    turned = theta + omega * DT
    wanted = x + v / omega * (np.sin(turned) - np.sin(theta))
    np.testing.assert_allclose(moved[:, 0], wanted, rtol=0, atol=1e-6)
    wanted = y - v / omega * (np.cos(turned) - np.cos(theta))
    np.testing.assert_allclose(moved[:, 1], wanted, rtol=0, atol=1e-6)
    state[:, 4] = 0.0
    straight = model.moved(state)[:, :2] - state[:, :2]
    wanted = DT * v[:, None] * np.stack([np.cos(theta), np.sin(theta)], axis=1)
    np.testing.assert_allclose(straight, wanted, atol=1e-14)


def test_noise_acts_along_the_heading_and_on_the_turn():
    """Q = G diag(Q_along, Q_turn) G' with the heading's direction in G; told apart by sizes."""
    along, turn = np.array([[0.7, 0.2], [0.2, 0.3]]), np.array([[0.05, 0.02], [0.02, 0.04]])
    model = TurnModel(np.array([DT]), *(one[..., None] for one in (along, np.eye(2), turn)))
    state, _ = states(6)
    for one, noise in zip(state, model.process(state), strict=True):
        lead = np.zeros((5, 4))
        lead[:2, 0] = np.cos(one[2]), np.sin(one[2])
        lead[3, 1] = lead[2, 2] = lead[4, 3] = 1.0
        wanted = lead @ np.block([[along, np.zeros((2, 2))], [np.zeros((2, 2)), turn]]) @ lead.T
        np.testing.assert_allclose(noise, wanted, atol=1e-15)


def test_steps_of_different_times_are_each_alone():
    state, spread = states(3)
    times = (0.1, 0.5, 0.83)
    together = unscented_step(state, spread, model_of(times=times))
    for k, time in enumerate(times):
        alone = unscented_step(state[[k]], spread[[k]], model_of(times=(time,)))
        for part, wanted in zip(together, alone, strict=True):
            np.testing.assert_allclose(part[[k]], wanted, rtol=1e-12, atol=1e-15)


def measured(seed=2, irregular=False):
    """Return tracks of two people on a circle, measured with an error that correlates."""
    rng = np.random.default_rng(seed)
    times, places, noise = [], [], []
    for count in (12, 9):
        lags = rng.uniform(0.1, 1.9, count) if irregular else np.full(count, DT)
        time = np.cumsum(lags)
        angle = 0.4 + 0.3 * time
        circle = np.stack([np.sin(angle), -np.cos(angle)], axis=1) / 0.3
        places.append(circle + 0.03 * rng.standard_normal((count, 2)))
        times.append(time - time[-1])
        root = 0.03 * (np.eye(2) + 0.4 * rng.standard_normal((count, 2, 2)))
        noise.append(root @ root.swapaxes(1, 2))
    grid = np.stack([one[-9:] for one in places])
    last = np.stack([one[-1] for one in noise])
    return Tracks(grid, DT, ("a", "b"), np.full(2, 0.3), last, 0.0,
                  sightings=Measurements(times, places, noise, (3, 5)))  # fmt: skip


def filterpy_filter(predictor, times, places, noise, dt):
    """Filter with filterpy from the first measurement on, in the frame of the first chord."""
    from filterpy.kalman import MerweScaledSigmaPoints, UnscentedKalmanFilter

    later = np.flatnonzero(times >= times[0] + 3.0 * dt - 1e-6)
    end = int(later[0]) if len(later) else len(times) - 1
    chord = places[end] - places[0]
    length = np.hypot(*chord)
    frame = np.array([[chord[0], -chord[1]], [chord[1], chord[0]]]) / length
    places = (places - places[0]) @ frame
    noise = frame.T @ (noise + 0.03**2 * np.eye(2)) @ frame
    steps = {}

    def ahead(state, lag):
        return steps[lag].moved(state[None])[0]

    points = MerweScaledSigmaPoints(5, alpha=1.0, beta=2.0, kappa=0.0)
    engine = UnscentedKalmanFilter(5, 2, dt, hx=lambda x: x[:2], fx=ahead, points=points)
    engine.x = np.array([0.0, 0.0, 0.0, length / (times[end] - times[0]), 0.0])
    doubt = min(np.trace(noise[0]) / length**2, np.pi**2 / 3)
    first = [0.5**2 + doubt, predictor.speed**2, predictor.yaw_rate**2]
    engine.P = np.diag([0.0, 0.0, *first])
    engine.P[:2, :2] = noise[0]
    for k in range(1, len(times)):
        number = max(1, round((times[k] - times[k - 1]) / dt))
        lag = (times[k] - times[k - 1]) / number
        steps[lag] = predictor._model(np.array([lag]))
        for _ in range(number):
            engine.Q = steps[lag].process(engine.x[None])[0]
            engine.predict(dt=lag)
        engine.update(places[k], R=noise[k])
    return engine.x, engine.P, frame


@pytest.mark.parametrize("irregular", [False, True])
def test_unscented_filter_equals_filterpy(irregular):
    tracks, predictor = measured(irregular=irregular), CoordinatedTurn()
    beliefs = predictor.filtered(tracks)
    state, covariance, frame, origin, _ = beliefs.values
    sightings = tracks.measured
    for k in range(2):
        parts = sightings.times[k], sightings.positions[k], sightings.noise[k]
        wanted, spread, axes = filterpy_filter(predictor, *parts, DT)
        np.testing.assert_allclose(frame[..., k], axes, rtol=0, atol=1e-12)
        np.testing.assert_array_equal(origin[:, k], sightings.positions[k][0])
        np.testing.assert_allclose(state[:, k], wanted, rtol=0, atol=1e-9)
        np.testing.assert_allclose(covariance[..., k], spread, rtol=0, atol=1e-9)


@pytest.mark.parametrize("stride", [1, 4])
def test_filtering_on_is_filtering_from_the_first_measurement(stride):
    """Also while the first chord still changes, and over a pause after which it begins anew."""
    tracks, predictor = measured(irregular=True), CoordinatedTurn()
    times = list(tracks.measured.times)
    times[1] = np.where(np.arange(9) < 4, times[1] - 5.0, times[1])
    parts = times, tracks.measured.positions, tracks.measured.noise
    sightings = Measurements(*parts, (3, 5))
    beliefs = None
    for end in [*range(1, 12, stride), 12]:
        seen = replace(tracks, sightings=sightings.part([slice(end)] * 2))
        beliefs = predictor.filtered(seen, beliefs)
        whole = predictor.filtered(seen)
        assert beliefs.count.tolist() == whole.count.tolist() and beliefs.log == whole.log
        for part, wanted in zip(beliefs.values, whole.values, strict=True):
            np.testing.assert_allclose(part, wanted, rtol=1e-12, atol=1e-15)
    assert beliefs.count.tolist() == [12, 5]


def test_floored_root_is_choleskys_and_survives_singular_ones():
    _, covariance = states(30)
    np.testing.assert_allclose(
        floored_root(covariance), np.linalg.cholesky(covariance), atol=1e-12
    )
    flat = np.ones((1, 3, 3))
    root = floored_root(np.concatenate([flat, 0.0 * flat]))
    assert np.isfinite(root).all()
    np.testing.assert_allclose(
        root @ root.swapaxes(1, 2), np.concatenate([flat, 0 * flat]), atol=1e-13
    )
    thin = np.array([[[1.0, 0.0], [1.0, 1e-6]]])  # a pivot of 1e-12, far above rounding
    np.testing.assert_allclose(floored_root(thin @ thin.swapaxes(1, 2)), thin, rtol=1e-3)


def test_sigma_points_give_mean_and_spread_of_a_turn_better_than_a_tangent():
    state = np.array([[0.0, 0.0, 0.0, 1.0, 0.0]])
    spread = np.diag([1e-4, 1e-4, 0.3**2, 0.01, 0.3**2])[None]
    model = model_of()
    rng = np.random.default_rng(3)
    draws = model.moved(rng.multivariate_normal(state[0], spread[0], size=400_000))
    mean, covariance = draws.mean(axis=0), np.cov(draws.T) + model.process(state)[0]
    sigma, sigma_spread, _ = unscented_step(state, spread, model)
    tangent = model.moved(state)
    assert abs(sigma[0, 0] - mean[0]) < 0.1 * abs(tangent[0, 0] - mean[0])
    np.testing.assert_allclose(sigma_spread[0, :2, :2], covariance[:2, :2], atol=3e-3)


def test_the_returned_slope_is_the_cross_covariance():
    """For small covariances that is the derivative of the motion."""
    state, spread = states(6, seed=4)
    spread *= 1e-6
    _, after, slope = unscented_step(state, spread, model_of())
    shifts = 1e-6 * np.eye(5)[:, None]
    wanted = (model_of().moved(state + shifts) - model_of().moved(state - shifts)) / 2e-6
    np.testing.assert_allclose(slope, np.moveaxis(wanted, 0, 2), atol=1e-2)
    rest = after - slope @ spread @ slope.swapaxes(1, 2) - model_of().process(state)
    assert np.linalg.eigvalsh(rest).min() > -1e-12


def test_it_drives_on_along_the_circle(monkeypatch):
    monkeypatch.setattr(coordinated_turn, "NOISE_FLOOR", 1e-3)
    path = circle(60)
    predictor = CoordinatedTurn(turn_time=LASTING, yaw_rate=0.5)
    forecast = predictor.predict(tracks_of([path[:45]], noise=1e-4), 15)
    assert forecast.fallback == (None,)
    error = np.linalg.norm(forecast.mean[0, 0] - path[45:], axis=1)
    plain = Kalman().predict(tracks_of([path[:45]], noise=1e-4), 15).mean[0, 0]
    # Sigma points of an uncertain yaw rate lie on arcs: their mean is inside the circle.
    assert error[3] < 0.05 and error[-1] < 0.7
    assert error[-1] < 0.15 * np.linalg.norm(plain[-1] - path[-1])


def test_many_turns_wrap_nothing():
    path = circle(400, rate=1.0)
    predictor = CoordinatedTurn(turn_time=LASTING, yaw_rate=0.5)
    early = predictor.predict(tracks_of([path[:200]]), 5)
    assert early.fallback == (None,)
    error = np.linalg.norm(early.mean[0, 0] - path[200:205], axis=1)
    assert error.max() < 0.2


def test_joint_and_marginal_covariances_agree():
    rng = np.random.default_rng(6)
    paths = np.stack([circle(20, heading=h) for h in (0.0, 2.0, -2.0)])
    positions = paths + 0.01 * rng.standard_normal(paths.shape)
    positions[1, -2:] = NAN
    forecast = CoordinatedTurn().predict(tracks_of(positions), 6)
    assert forecast.fallback == (None,) * 3
    blocks = forecast.joint[:, 0].reshape(3, 6, 2, 6, 2)[:, np.arange(6), :, np.arange(6)]
    np.testing.assert_allclose(blocks.swapaxes(0, 1), forecast.covariance[:, 0], atol=1e-12)


def test_updates_measure_how_well_the_model_fits():
    state, spread = states(4000)
    rng = np.random.default_rng(7)
    noise = np.tile(0.05 * np.eye(2), (4000, 1, 1))
    root = np.linalg.cholesky(spread[:, :2, :2] + noise)
    seen = state[:, :2] + np.einsum("bij,bj->bi", root, rng.standard_normal((4000, 2)))
    _, _, surprise = position_update(state, spread, seen, noise)
    assert surprise.mean() == pytest.approx(2.0, abs=4 * np.sqrt(4 / 4000))


def test_it_says_why_another_predictor_is_asked():
    rng = np.random.default_rng(8)
    standing = 0.01 * rng.standard_normal((20, 2))
    jumping = 20.0 * rng.standard_normal((20, 2))
    two = np.where(np.arange(20)[:, None] < 18, NAN, circle(20))
    predictor = CoordinatedTurn()
    tracks = tracks_of([standing, jumping, two, np.full((20, 2), NAN), circle(20)])
    forecast = predictor.predict(tracks, 5)
    reasons = forecast.fallback
    assert reasons[0].startswith("coordinated_turn: heading known to")
    assert reasons[1].startswith("coordinated_turn: innovations")
    assert reasons[2] == "coordinated_turn: 2 samples, needs 3"
    assert reasons[3] == "coordinated_turn: 0 samples, needs 3; kalman: never observed"
    assert reasons[4] is None
    np.testing.assert_array_equal(forecast.mean[:4], Kalman().predict(tracks, 5).mean[:4])
    space = tracks_of(np.zeros((1, 5, 3)))
    reason = predictor.predict(space, 4).fallback[0]
    assert reason == "coordinated_turn: 3 coordinates, needs 2"


def test_settings():
    check_predictor(CoordinatedTurn(turn_time=LASTING))
    with pytest.raises(WideberthError, match=r"coordinated_turn\.yaw_rate is 0"):
        CoordinatedTurn(yaw_rate=0.0)


def test_filtering_together_is_filtering_one_by_one():
    """With samples missing and histories that begin later; the fit counts what was seen."""
    rng = np.random.default_rng(6)
    positions = np.stack([circle(9), circle(9, 0.5, -0.4), circle(9, 2.0, 0.1)])
    positions += 0.01 * rng.standard_normal(positions.shape)
    positions[1, :3] = NAN
    positions[1, 5] = positions[2, 4:6] = NAN
    tracks, predictor = tracks_of(positions), CoordinatedTurn()
    found = predictor.filtered(tracks)
    model = predictor._model(np.array([DT]))
    noise = tracks.noise[0] + 0.03**2 * np.eye(2)
    for o in range(3):
        first = predictor.filtered(replace(tracks.select([o]), positions=positions[[o], :9]))
        frame, origin = first.values[2][..., 0], first.values[3][:, 0]
        seen = np.isfinite(positions[o]).all(axis=1)
        began = int(np.argmax(seen))
        chord = (positions[o, began + 3] - positions[o, began]) @ frame
        assert chord[1] == pytest.approx(0.0, abs=1e-12)
        doubt = np.trace(noise) / chord[0] ** 2
        state = np.array([[0.0, 0.0, 0.0, chord[0] / (3 * DT), 0.0]])
        spread = np.zeros((1, 5, 5))
        spread[0, :2, :2] = noise
        spread[0, [2, 3, 4], [2, 3, 4]] = 0.25 + doubt, 1.0, 0.09
        fit = []
        for column in range(began + 1, 9):
            state, spread, _ = unscented_step(state, spread, model)
            if seen[column]:
                place = ((positions[o, column] - origin) @ frame)[None]
                state, spread, surprise = position_update(state, spread, place, noise[None])
                fit.append(float(surprise[0]))
                assert np.array_equal(spread, spread.swapaxes(1, 2))
        np.testing.assert_allclose(found.values[0][:, o], state[0], rtol=1e-9, atol=1e-11)
        np.testing.assert_allclose(found.values[1][..., o], spread[0], rtol=1e-8, atol=1e-13)
        assert found.values[4][:, o] == pytest.approx([np.sum(fit), len(fit)], rel=1e-9)


def test_the_first_chord_is_over_the_steps_that_it_takes():
    """To the first sample seen at least `CHORD` steps on, else to the newest."""
    paths = np.full((4, CHORD + 3, 2), np.nan)
    paths[0] = np.arange(CHORD + 3.0)[:, None] ** 2 * [1.0, 0.5]
    paths[1, -2:] = [[1.0, 1.0], [3.0, 1.0]]
    paths[2, -1:] = 5.0
    paths[3] = paths[0]
    paths[3, CHORD] = np.nan
    names, spread = ("a", "b", "c", "d"), np.tile(1e-4 * np.eye(2), (4, 1, 1))
    tracks = Tracks(paths, 0.5, names, np.full(4, 0.3), spread)
    log, measured = [1, 2, 3, 4], tracks.measured
    found = coordinated_turn._starts(tracks, np.zeros(4, dtype=np.int64), np.full(4, -np.inf), log)
    wanted = [[CHORD**2, 0.5 * CHORD**2], [2.0, 0.0], [0.0, 0.0]]
    wanted.append([(CHORD + 1) ** 2, 0.5 * (CHORD + 1) ** 2])
    np.testing.assert_allclose([found[k][0] for k in range(4)], wanted)
    spans = [found[k][1] / 0.5 for k in range(4)]
    assert spans == pytest.approx([CHORD, 1.0, 1.0, CHORD + 1.0], rel=1e-12)
    # Those who were seen for less than the chord are filtered again with it.
    assert log == [1, NO_LOG, NO_LOG, 4] and len(measured.times[3]) == CHORD + 2


def test_a_heading_of_which_nothing_is_known_has_the_spread_of_a_uniform_one():
    """(2 pi)^2 / 12, where the first chord is of length 0."""
    beliefs = CoordinatedTurn().filtered(tracks_of(np.zeros((1, 1, 2))))
    uniform = (2.0 * np.pi) ** 2 / 12.0
    wanted = coordinated_turn.FIRST_HEADING**2 + uniform
    assert beliefs.values[1][2, 2, 0] == pytest.approx(wanted, rel=1e-12)

"""The noise of measured positions, estimated from the tracks alone."""

import numpy as np
import pytest

from wideberth.experiments.studies.crowd import DATA
from wideberth.framework.tracking.history import History
from wideberth.framework.tracking.noise import (
    DEVIATIONS,
    STRENGTHS,
    USUAL,
    NoiseEvidence,
    estimated_noise,
    window_likelihoods,
)
from wideberth.framework.values.arrays import Array
from wideberth.framework.values.motion import Detection
from wideberth.predictors.data.recordings import read_tracks
from wideberth.predictors.data.resampled import resampled_tracks

WALK, DRIVE = (1.3, 1.0), (0.5, 0.7)
"""Speed, m/s, and largest acceleration, m/s^2."""


def way(rng: np.random.Generator, dt: float, rows: int, pace: tuple[float, float]) -> Array:
    """Walk or drive straight on, pause, and turn, in steps of 0.02 s, (T, 2)."""
    fine = round(dt / 0.02)
    speed = pace[0] * rng.uniform(0.7, 1.3)
    heading, turn, wanted, now, left = rng.uniform(-np.pi, np.pi), 0.0, speed, speed, 3.0
    place, places = np.zeros(2), []
    for tick in range(rows * fine):
        left -= 0.02
        if left < 0:
            kind, turn, left = rng.random(), 0.0, rng.exponential(5)
            wanted = 0.0 if kind < 0.3 else speed * rng.uniform(0.7, 1.3)
            if 0.3 < kind < 0.6:
                turn, left = 0.8 * rng.standard_normal(), rng.uniform(0.5, 3)
        now += np.clip(wanted - now, -0.02 * pace[1], 0.02 * pace[1])
        heading += 0.02 * turn
        place = place + 0.02 * now * np.array([np.cos(heading), np.sin(heading)])
        if tick % fine == fine - 1:
            places.append(place)
    return np.array(places)


def recorded(
    noise: float, dt: float, pace: tuple[float, float], seed: int, gaps: float = 0.1
) -> Array:
    """Make 9 tracks of 25 rows with a tenth of the samples missing: some 200 of them."""
    rng = np.random.default_rng([seed, round(1000 * noise)])
    positions = np.stack([way(rng, dt, 25, pace) for _ in range(9)])
    positions = positions + noise * rng.standard_normal(positions.shape)
    positions[rng.random((9, 25)) < gaps] = np.nan
    return positions


@pytest.mark.parametrize("noise", [0.005, 0.02, 0.05, 0.1, 0.2])
@pytest.mark.parametrize("dt", [0.1, 0.3, 0.5])
@pytest.mark.parametrize("pace", [WALK, DRIVE])
def test_two_hundred_samples_suffice(noise: float, dt: float, pace: tuple[float, float]) -> None:
    """Pauses, turns and gaps: within 20 %, on average over four recordings within 10 %."""
    found = [estimated_noise(recorded(noise, dt, pace, seed)).deviation for seed in range(4)]
    assert 0.8 * noise < min(found) and max(found) < 1.2 * noise
    assert abs(np.mean(found) / noise - 1) < 0.1


@pytest.mark.parametrize("noise", [0.01, 0.05, 0.2])
def test_a_steady_turn_is_no_noise(noise: float) -> None:
    """Everybody on a circle of 4 m at 1.2 m/s, and nothing straight at all."""
    rng = np.random.default_rng(0)
    angle = 0.3 * 0.4 * np.arange(30) + np.arange(8)[:, None]
    circle = 4 * np.stack([np.cos(angle), np.sin(angle)], axis=2)
    found = estimated_noise(circle + noise * rng.standard_normal(circle.shape)).deviation
    assert abs(found / noise - 1) < 0.2


def test_jumps_copies_and_digits_do_not_decide() -> None:
    """One sample in thirty 10 times as noisy; tracks that stand copied; positions in whole cm."""
    for seed in range(3):
        positions = recorded(0.05, 0.4, WALK, seed, gaps=0.0)
        rng = np.random.default_rng(seed)
        jump = rng.random(positions.shape[:2]) < 0.03
        wild = positions + 0.5 * jump[..., None] * rng.standard_normal(positions.shape)
        held = positions.copy()
        held[:3, 5:20] = held[:3, 5:6]
        for changed in (wild, held, positions.round(2)):
            assert abs(estimated_noise(changed).deviation / 0.05 - 1) < 0.2


def test_noise_added_to_recorded_people_is_found() -> None:
    crowd = read_tracks(DATA / "crowd.txt", dt=0.4)
    own = crowd.noise.deviation
    rng = np.random.default_rng(1)
    for noise in (0.05, 0.1, 0.2):
        found = estimated_noise(crowd.positions + noise * rng.standard_normal((12, 60, 2)))
        assert abs(found.deviation / np.hypot(noise, own) - 1) < 0.15


def test_a_window_is_scored_by_the_density_of_its_model() -> None:
    """Dense algebra: differences of all orders from the third on, by a null space of SciPy."""
    from scipy.linalg import null_space

    times = np.array([0.0, 1.0, 2.0, 3.5, 4.5, 5.5, 7.0])
    positions = np.random.default_rng(2).standard_normal((7, 2)) * 0.05
    fine = np.linspace(0, 7, 7001)[:-1] + 0.0005  # the white noise of each of many short steps
    reach = np.maximum(times[:, None] - fine, 0.0)
    rest = null_space(np.vander(times, 3).T)
    densities = []
    for push in ((times[:, None] > fine) * reach, reach**2 / 2):
        kernel = 0.001 * push @ push.T
        spread = STRENGTHS[:, None, None] * kernel + (DEVIATIONS**2)[:, None, None, None] * np.eye(
            7
        )
        spread = rest.T @ spread @ rest
        seen = rest.T @ positions
        square = np.sum(
            seen * np.linalg.solve(spread, np.broadcast_to(seen, (41, 19, 4, 2))), (2, 3)
        )
        densities.append(np.exp(-0.5 * square - np.linalg.slogdet(spread)[1]))
    density = np.sum(densities, axis=(0, 2))
    wanted = np.log(density / density.max())
    (found,) = window_likelihoods([(10 + 0.4 * times, positions + 100.0)])
    assert np.allclose(found, np.logaddexp(wanted, -10), atol=1e-3)


def test_too_little_says_so() -> None:
    none = estimated_noise(np.zeros((3, 7, 2)))
    assert (none.deviation, none.samples) == (USUAL, 0)
    assert none.text.startswith("measurement noise not estimated: no track has 6 measured")
    copied = estimated_noise(np.zeros((3, 20, 2)))
    assert copied.samples == 0
    some = estimated_noise(recorded(0.1, 0.4, WALK, 0))
    assert some.text.startswith("measurement noise estimated as 0.")
    assert f"m from {some.samples} samples of 9 tracks" in some.text
    assert 170 < some.samples <= 225


def test_an_estimate_at_the_end_of_its_range_says_so() -> None:
    rng = np.random.default_rng(0)
    steady = np.cumsum(np.tile([0.5, 0.1], (20, 60, 1)), axis=1)
    for noise, words in ((3.0, "as at least 1 m"), (1e-5, "as at most 0.001 m"), (0.1, "as 0.")):
        found = estimated_noise(steady + noise * rng.standard_normal(steady.shape))
        assert words in found.text


def test_absurd_windows_are_left_out() -> None:
    times, places = np.arange(8.0), np.random.default_rng(0).standard_normal((8, 2))
    absurd = [(times, 1e200 * places), (0 * times, places), (times**9, places)]
    assert np.isnan(window_likelihoods(absurd)).all()
    evidence = NoiseEvidence.none().joined(window_likelihoods(absurd), 8, 1)
    assert evidence.estimate.samples == 0


def seen(history: History, positions: Array, dt: float, **stated: Array) -> History:
    """Show tracks to a history; ``stated`` is the covariance of some obstacles."""
    for tick in range(positions.shape[1]):
        history = history.add(
            dt * tick,
            tuple(
                Detection(f"o{i}", track[tick], stated.get(f"o{i}"), 0.3, sensor=f"s{i % 2}")
                for i, track in enumerate(positions)
                if np.isfinite(track[tick]).all()
            ),
        )
    return history


def test_sensors_that_state_no_noise_have_it_estimated_as_they_measure() -> None:
    """Odd obstacles are seen by a sensor of 10 cm, even ones by one of 2 cm; one is stated."""
    rng = np.random.default_rng(3)
    clean = np.stack([way(rng, 0.2, 60, WALK) for _ in range(8)])
    scale = np.where(np.arange(8) % 2, 0.1, 0.02)[:, None, None]
    positions = clean + scale * rng.standard_normal(clean.shape)
    positions[rng.random((8, 60)) < 0.1] = np.nan
    history = History(dt=0.4, samples=20, forget=3.0, gap=1.0)
    stated = np.diag([0.09, 0.04])
    history = seen(history, positions, 0.2, o4=stated)
    tracks = history.tracks()
    assert tracks is not None
    assert np.array_equal(tracks.noise[4], stated)
    deviation = np.sqrt(tracks.noise[:, 0, 0])
    assert abs(deviation[1] / 0.1 - 1) < 0.2 and abs(deviation[0] / 0.02 - 1) < 0.2
    assert np.array_equal(deviation[[1, 3, 5]], deviation[[3, 5, 7]])
    assert history.noise["s1"].tracks == 4 and history.noise["s0"].tracks == 3
    assert history.noise["s1"].samples > 150


def test_before_anything_is_measured_the_usual_noise_is_taken() -> None:
    history = History(dt=0.4, samples=20, forget=3.0, gap=1.0)
    history = seen(history, np.zeros((1, 3, 2)), 0.4)
    tracks = history.tracks()
    assert tracks is not None
    assert np.allclose(tracks.noise, USUAL**2 * np.eye(2))


def test_a_stated_noise_wins_and_an_estimate_is_the_default() -> None:
    crowd = read_tracks(DATA / "crowd.txt", dt=0.4)
    estimate = crowd.noise.deviation
    for made, wanted in (
        (crowd.scene(), estimate),
        (crowd.scene(noise=0.3), 0.3),
        (crowd.tracks(30, 8), estimate),
        (crowd.tracks(30, 8, noise=0.3), 0.3),
    ):
        assert np.allclose(made.noise, wanted**2 * np.eye(2))
    tracks = {str(i): (0.4 * np.arange(60), p) for i, p in enumerate(recorded(0.1, 0.4, WALK, 1))}
    known = {i: (t[ok], p[ok]) for i, (t, p) in tracks.items()
             if (ok := np.isfinite(p[:, 0])).any() for t in [t[: len(p)]]}  # fmt: skip
    assert abs(np.sqrt(resampled_tracks(known, 0.4).noise[0, 0, 0]) / 0.1 - 1) < 0.3
    assert resampled_tracks(known, 0.4, noise=0.3).noise[0, 0, 0] == pytest.approx(0.09)

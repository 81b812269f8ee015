"""The planar filters against filterpy, finite differences, Monte Carlo, and bad samples."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2

from wideberth.framework.numerics.integration import slopes
from wideberth.framework.plugins.config import build
from wideberth.framework.values.sensing import Scan
from wideberth.simulation.sensing.perceived import InertialSample, WheelSample
from wideberth.tests.helpers.driven import driven
from wideberth_perception.state import planar
from wideberth_perception.state.model import (
    FORWARD,
    LATERAL,
    SPEED,
    YAW_RATE,
    corrected,
    moved,
    slope,
)
from wideberth_perception.state.noise import SETTINGS, MotionNoise
from wideberth_perception.state_estimator import poses_at

RUNS = 50


def made(name="ekf", **settings):
    estimator = build("state_estimators", {"type": name, **settings})
    estimator.reset(np.zeros(3), 0.0)
    return estimator


def given(estimator, samples):
    """Feed samples; return the reasons why some were left out."""
    return [reason for sample in samples if (reason := estimator.take(sample))]


def wild_samples(rng, count=1500):
    """Samples at 30 Hz, two of the unit to one of the wheels, too wild for a gate."""
    angles, time, samples = np.zeros(4), 0.0, []
    for step in range(count):
        for _ in range(2):
            time += 0.016 if step % 2 else 0.018
            felt = rng.normal(0.0, 0.5, 2)
            samples.append(InertialSample("unit", time, rng.normal(0.3, 0.2), felt))
        angles = angles + (rng.normal(4.0, 1.0) + rng.normal(0.0, 0.1, 4)) * 0.034
        samples.append(WheelSample("wheels", time, angles))
    return samples


def ticks(samples, noise):
    """Yield (dt, measurements) of each update: what the filters are to make of the samples."""
    rates, pushes, before, last = [], [], None, 0.0
    for sample in samples:
        if isinstance(sample, InertialSample):
            rates.append(sample.yaw_rate)
            pushes.append(sample.acceleration[0])
            continue
        if before is not None:
            m = len(rates)
            speed = np.mean(sample.angles - before.angles) * 0.1 / (sample.time - before.time)
            yield sample.time, sample.time - last, [
                (SPEED, speed, noise.wheels**2),
                (LATERAL, 0.0, noise.slip**2),
                (YAW_RATE, np.mean(rates), noise.gyro**2 / m + noise.jitter**2),
                (FORWARD, np.mean(pushes),
                 noise.accelerometer**2 / m + noise.accelerometer_bias**2),
            ]  # fmt: skip
            rates, pushes, last = [], [], sample.time
        before = sample


def started(noise):
    start = [*[noise.start] * 3, *[noise.start_speed] * 3, *[noise.start_acceleration] * 2]
    return np.diag([*start, noise.gyro_bias**2])


def growth(noise):
    return np.diag([
        noise.position, noise.position, noise.heading, noise.speed, noise.lateral_speed,
        noise.yaw_rate, noise.acceleration, noise.acceleration, noise.bias_walk**2,
    ])  # fmt: skip


def rows(measured):
    matrix = np.zeros((len(measured), 9))
    for row, (entries, _, _) in zip(matrix, measured, strict=True):
        row[list(entries)] = 1.0
    return matrix


def unwrapped_difference(one, other):
    off = one - other
    off[2] = np.angle(np.exp(1j * off[2]))
    return np.abs(off).max()


def test_ekf_equals_filterpy(monkeypatch):
    from filterpy.kalman import ExtendedKalmanFilter

    class Planar(ExtendedKalmanFilter):
        def predict_x(self, u=0):
            self.x = np.array(moved(self.x, self.dt))

    noise = SETTINGS["small"]
    monkeypatch.setattr(planar, "_GATE", 1e-300)
    estimator, samples = made(rest=0.0), wild_samples(np.random.default_rng(1))
    oracle = Planar(9, 1)
    oracle.x, oracle.P = np.zeros(9), started(noise)
    steps = {time: (dt, measured) for time, dt, measured in ticks(samples, noise)}
    worst = spread = 0.0
    for sample in samples:
        assert not estimator.take(sample)
        if isinstance(sample, WheelSample) and sample.time in steps:
            oracle.dt, measured = steps[sample.time]
            oracle.F, oracle.Q = slope(oracle.x, oracle.dt), growth(noise) * oracle.dt
            oracle.predict()
            for row, (_, value, variance) in zip(rows(measured), measured, strict=True):
                h = row[None]
                oracle.update(np.array([value]), lambda x, h=h: h, lambda x, h=h: h @ x, variance)
            found = estimator.at(sample.time)
            worst = max(worst, unwrapped_difference(found.mean, oracle.x[:6]))
            spread = max(spread, np.abs(found.covariance - oracle.P[:6, :6]).max())
    assert len(steps) > 1400
    assert worst < 1e-11, worst
    assert spread < 1e-12, spread


def test_ukf_equals_filterpy(monkeypatch):
    from filterpy.kalman import MerweScaledSigmaPoints, UnscentedKalmanFilter

    noise = SETTINGS["small"]
    monkeypatch.setattr(planar, "_GATE", 1e-300)
    estimator, samples = made("ukf", rest=0.0), wild_samples(np.random.default_rng(2))
    oracle = UnscentedKalmanFilter(
        9, 4, 0.0, hx=None, fx=lambda x, dt: np.array(moved(x, dt)),
        points=MerweScaledSigmaPoints(9, 1.0, 2.0, 0.0),
    )  # fmt: skip
    oracle.x, oracle.P = np.zeros(9), started(noise)
    steps = {time: (dt, measured) for time, dt, measured in ticks(samples, noise)}
    worst = spread = 0.0
    for sample in samples:
        assert not estimator.take(sample)
        if isinstance(sample, WheelSample) and sample.time in steps:
            dt, measured = steps[sample.time]
            matrix = rows(measured)
            oracle.Q = growth(noise) * dt
            oracle.predict(dt)
            oracle.update(
                np.array([value for _, value, _ in measured]),
                R=np.diag([variance for _, _, variance in measured]),
                hx=lambda x, matrix=matrix: matrix @ x,
            )
            found = estimator.at(sample.time)
            worst = max(worst, unwrapped_difference(found.mean, oracle.x[:6]))
            spread = max(spread, np.abs(found.covariance - oracle.P[:6, :6]).max())
    assert worst < 1e-10, worst
    assert spread < 1e-11, spread


@pytest.mark.parametrize("dt", [0.033, 0.5, -0.1])
def test_slope_is_the_derivative(dt):
    rng = np.random.default_rng(3)
    for _ in range(20):
        state = rng.normal(0.0, [5, 5, 3, 1, 0.2, 0.5, 0.5, 0.5, 0.01])
        wanted = slopes(lambda x: np.array(moved(x, dt)), state)
        assert np.allclose(slope(state.tolist(), dt), wanted, atol=1e-8)


def band(dimension, runs=RUNS):
    """The interval that holds the mean of that many NEES with probability 0.95."""
    return chi2.ppf([0.025, 0.975], dimension * runs) / runs


def model_errors(noise, filter_, rng, seconds=20.0):
    """Simulate the model with the stated noises; return error and covariance at the end."""
    dt = 1.0 / 30.0
    covariance = started(noise)
    covariance[8, 8] = noise.gyro**2 / 200  # as after the rest
    truth = rng.multivariate_normal(np.zeros(9), covariance)
    mean = np.zeros(9)
    q = np.sqrt(np.diag(growth(noise)) * dt)
    kinds = (
        (SPEED, noise.wheels), (LATERAL, noise.slip),
        (YAW_RATE, np.hypot(noise.gyro, noise.jitter)),
        (FORWARD, np.hypot(noise.accelerometer, noise.accelerometer_bias)),
    )  # fmt: skip
    for _ in range(round(seconds / dt)):
        truth = np.array(moved(truth, dt)) + q * rng.standard_normal(9)
        mean, covariance = filter_.carried(mean, covariance, dt)
        covariance = covariance + np.diag(q**2)
        for entries, deviation in kinds:
            value = truth[list(entries)].sum() + deviation * rng.standard_normal()
            mean, covariance, *_ = corrected(mean, covariance, entries, value, deviation**2)
    return truth - mean, covariance


@pytest.mark.parametrize("name", ["ekf", pytest.param("ukf", marks=pytest.mark.slow)])
@pytest.mark.parametrize("size", ["small", "large"])
def test_nees_lies_in_its_band_on_a_plant_of_the_model(name, size):
    rng = np.random.default_rng(4)
    ends = [model_errors(SETTINGS[size], made(name), rng) for _ in range(RUNS)]
    for part in (slice(0, 3), slice(3, 6), slice(0, 9)):
        nees = [e[part] @ np.linalg.solve(p[part, part], e[part]) for e, p in ends]
        low, high = band(len(range(*part.indices(9))))
        assert low < np.mean(nees) < high, (part, np.mean(nees), low, high)


def pose_nees(estimator, drive):
    """Return NEES of the pose and the error of the position, m, at the end of a drive."""
    assert not given(estimator, drive.samples)
    found = estimator.at(drive.times[-1])
    off = found.mean - drive.truth[-1]
    off[2] = np.angle(np.exp(1j * off[2]))
    nees = off[:3] @ np.linalg.solve(found.covariance[:3, :3], off[:3])
    return nees, np.hypot(*off[:2]), off[2]


def drives(runs, **settings):
    return [driven(np.random.default_rng([7, run]), **settings) for run in range(runs)]


@pytest.fixture(scope="module")
def fifty():
    return drives(RUNS, seconds=20.0)


def test_drift_stays_below_a_percent_of_the_way(fifty):
    """Samples of wheels in ticks and a gyro with a bias, through `take`, gates on."""
    found = np.array([pose_nees(made(), drive) for drive in fifty])
    share = found[:, 1] / [drive.way for drive in fifty]
    low, high = band(3)
    assert share.max() < 0.03
    assert np.mean(share) < 0.01
    assert low < found[:, 0].mean() < high, found[:, 0].mean()


def test_robot_localizations_noise_is_no_model(fifty):
    """The same mean within centimetres, but a deviation of metres: NEES near 0 instead of 3."""
    drive = fifty[0]
    ours, theirs = made(), made(noise="robot_localization")
    nees, _, _ = pose_nees(theirs, drive)
    pose_nees(ours, drive)
    end = drive.times[-1]
    assert nees < 0.01
    assert np.sqrt(theirs.at(end).covariance[0, 0]) > 1.0
    assert np.hypot(*(theirs.at(end).mean - ours.at(end).mean)[:2]) < 0.1


def test_calibration_at_rest_is_what_keeps_the_heading():
    """A bias of 0.01 rad/s: taken off at rest, it changes nothing; else it turns the heading."""
    drive = driven(np.random.default_rng(8), 30.0, bias=0.0, noisy=False)
    biased = [
        replace(sample, yaw_rate=sample.yaw_rate + 0.01)
        if isinstance(sample, InertialSample) else sample
        for sample in drive.samples
    ]  # fmt: skip
    free, calibrated, raw = made(), made(), made(rest=0.0)
    for estimator, samples in ((free, drive.samples), (calibrated, biased), (raw, biased)):
        assert not given(estimator, samples)
    exact, kept, turned = (one.at(drive.times[-1]) for one in (free, calibrated, raw))
    assert np.allclose(kept.mean, exact.mean, atol=1e-9)
    off = turned.mean[2] - drive.truth[-1, 2]
    assert off > 0.15  # of 0.3: the wheels say nothing of the bias, and its prior is 0
    assert off < 4.0 * np.sqrt(turned.covariance[2, 2])


def test_any_order_within_the_memory_gives_the_same_bytes():
    rng = np.random.default_rng(9)
    drive = driven(rng, 6.0)
    lag = rng.uniform(0.0, 0.45, len(drive.samples))
    arrival = np.argsort([s.time + late for s, late in zip(drive.samples, lag, strict=True)])
    ordered, late = made(), made()
    assert not given(ordered, drive.samples)
    given(late, [drive.samples[index] for index in arrival])
    one, other = ordered.at(drive.times[-1]), late.at(drive.times[-1])
    assert np.array_equal(one.mean, other.mean)
    assert np.array_equal(one.covariance, other.covariance)


def test_what_comes_later_than_the_memory_is_left_out():
    drive = driven(np.random.default_rng(10), 4.0)
    whole, without = made(), made()
    missing = drive.samples[300]
    given(whole, [s for s in drive.samples if s is not missing])
    given(without, [s for s in drive.samples if s is not missing])
    assert "settled" in whole.take(missing)
    assert np.array_equal(whole.at(6.0).mean, without.at(6.0).mean)


def test_missing_samples_cost_little():
    drive = driven(np.random.default_rng(11), 20.0)
    rng = np.random.default_rng(12)
    estimator = made()
    given(estimator, [s for s in drive.samples if rng.random() > 0.3])
    found = estimator.at(drive.times[-1])
    error = np.hypot(*(found.mean - drive.truth[-1])[:2])
    assert error < 0.03 * drive.way
    assert error < 4.0 * np.sqrt(np.trace(found.covariance[:2, :2]))


def test_without_wheels_the_inertial_unit_carries_on_and_says_so_after():
    drive = driven(np.random.default_rng(13), 10.0)
    gap = [s for s in drive.samples if isinstance(s, InertialSample) or not 6.0 < s.time < 7.0]
    estimator = made()
    reasons = given(estimator, gap)
    assert len(reasons) == 1 and "their speed is unknown" in reasons[0]
    found = estimator.at(drive.times[-1])
    off = found.mean[:2] - drive.truth[-1, :2]
    assert off @ np.linalg.solve(found.covariance[:2, :2], off) < chi2.ppf(0.999, 2)


def test_a_wild_measurement_is_left_out_with_its_reason():
    drive = driven(np.random.default_rng(14), 6.0)
    calm, wild = made(), made()
    given(calm, drive.samples)
    index = next(i for i, s in enumerate(drive.samples) if s.time > 6.0)
    sample = drive.samples[index]
    spike = replace(sample, yaw_rate=30.0)
    reasons = given(wild, [*drive.samples[:index], spike, *drive.samples[index + 1 :]])
    assert len(reasons) == 1 and reasons[0].startswith("yaw rate ")
    assert "deviations from the expected" in reasons[0]
    assert np.abs(calm.at(8.0).mean - wild.at(8.0).mean).max() < 0.02


def test_a_push_is_believed_at_the_second_update():
    """The yaw rate jumps from 0 to 0.6 rad/s and stays: the heading loses nothing by the gate."""
    estimator, clock = made(rest=0.0), 0.01 * np.arange(1, 301)
    reasons = []
    for index, time in enumerate(clock.tolist()):
        rate = 0.6 if time > 1.501 else 0.0
        reasons.append(estimator.take(InertialSample("unit", time, rate, np.zeros(2))))
        if index % 3 == 2:
            reasons.append(estimator.take(WheelSample("wheels", time, np.zeros(4))))
    found = estimator.at(3.0)
    assert sum(map(bool, reasons)) == 1
    assert abs(found.mean[2] - 0.6 * 1.5) < 0.02
    assert found.mean[5] == pytest.approx(0.6, abs=1e-3)


def test_a_jumping_clock_is_not_followed_before_it_is_sure():
    drive = driven(np.random.default_rng(15), 4.0)
    estimator = made()
    given(estimator, drive.samples)
    before = estimator.at(6.0)
    ahead = [InertialSample("unit", 50.0 + 0.01 * k, 0.0, np.zeros(2)) for k in range(99)]
    assert all("ahead of all samples so far" in estimator.take(sample) for sample in ahead)
    assert np.array_equal(estimator.at(6.0).mean, before.mean)
    assert estimator.at(50.0).time == pytest.approx(6.0 + 1.0)
    estimator.take(InertialSample("unit", 51.5, 0.0, np.zeros(2)))
    assert estimator.at(51.5).time == 51.5  # for a second nobody else has spoken
    assert np.trace(estimator.at(51.5).covariance[:2, :2]) > 1.0
    assert "reset" in estimator.take(InertialSample("unit", 1e6, 0.0, np.zeros(2)))
    assert "set back" in estimator.take(InertialSample("unit", 7.0, 0.0, np.zeros(2)))


def test_one_sensor_with_a_clock_of_its_own_does_not_win():
    drive = driven(np.random.default_rng(16), 4.0)
    estimator = made()
    for sample in drive.samples:
        if isinstance(sample, InertialSample) and sample.time > 3.0:
            assert estimator.take(replace(sample, time=sample.time + 100.0))
        else:
            assert not estimator.take(sample)
    assert estimator.at(200.0).time < 7.1


def test_sensors_that_nobody_reads_are_named():
    estimator = made(rest=0.0)
    estimator.take(WheelSample("wheels", 0.01, np.zeros(4)))
    estimator.take(InertialSample("unit", 0.01, 0.0, np.zeros(2)))
    assert "4 of 'wheels'" in estimator.take(WheelSample("others", 0.05, np.zeros(4)))
    assert "2 wheels" in estimator.take(WheelSample("wheels", 0.05, np.zeros(2)))
    assert "'spare'" in estimator.take(InertialSample("spare", 0.05, 0.0, np.zeros(2)))
    scan = Scan("lidar", np.zeros(1), np.zeros(1), np.ones(1))
    assert "wheels and inertial units" in estimator.take(scan)


def test_a_robot_that_drives_off_early_is_calibrated_with_what_came_before():
    drive = driven(np.random.default_rng(17), 10.0)
    early = [replace(s, time=s.time - 1.0) for s in drive.samples if s.time > 1.0]
    estimator = made()
    assert not given(estimator, early)
    found = estimator.at(drive.times[-1] - 1.0)
    off = found.mean[:3] - drive.truth[-1, :3]
    assert off @ np.linalg.solve(found.covariance[:3, :3], off) < chi2.ppf(0.999, 3)


def test_poses_of_beams_are_interpolated():
    estimator = made()
    drive = driven(np.random.default_rng(18), 4.0)
    given(estimator, drive.samples)
    times = np.linspace(5.6, 5.7, 90)
    wanted = np.array([estimator.at(float(time)).pose for time in times])
    assert np.abs(poses_at(estimator, times) - wanted).max() < 0.003
    assert poses_at(estimator, np.zeros(0)).shape == (0, 3)


def test_noise_settings_are_those_of_their_sources():
    theirs = SETTINGS["robot_localization"]
    named = (theirs.position, theirs.heading, theirs.speed, theirs.yaw_rate, theirs.acceleration)
    assert named == (0.05, 0.06, 0.025, 0.02, 0.01)
    assert MotionNoise().wheels == pytest.approx(np.hypot(0.006, 0.0025))

"""A tracker's velocity and state covariance on their way from detections to forecasts."""

from dataclasses import replace

import numpy as np
import pytest

from wideberth import Detection, Observation, WideberthError
from wideberth.framework.tracking.history import History, admitted
from wideberth.framework.values.arrays import FARTHEST
from wideberth.framework.values.number_limits import bounded
from wideberth.framework.values.tracks import Tracks
from wideberth.predictors.constant_velocity import ConstantVelocity
from wideberth.predictors.core.propagation import white_acceleration
from wideberth.predictors.kalman import Kalman

DT = 0.5
R = 0.01**2 * np.eye(2)
SPEED = np.array([0.5, -0.2])
JOINT = np.kron(np.array([[4e-5, 3e-5], [3e-5, 9e-4]]), np.eye(2))


def seen(name: str, time: float, age: float, tracked: bool = True) -> Detection:
    start = np.array([float(len(name)), 2.0])
    place = start + SPEED * (time - age)
    return Detection(name, place, R, 0.3, age, "lidar", *((SPEED, JOINT) if tracked else ()))


def remembered(ages: dict[str, float], tracked: bool = True) -> Tracks:
    """Tracks of obstacles that move alike and are reported at 2 Hz with ages of their own."""
    history = History(DT, 20, 6.0, 1.25)
    for tick in range(12):
        stamp = 1.0 + DT * tick
        history = history.add(
            stamp, tuple(seen(name, stamp, age, tracked) for name, age in ages.items())
        )
    found = history.tracks()
    assert found is not None
    return found


def test_obstacles_measured_at_different_ages_are_forecast_alike() -> None:
    tracks = remembered({"a": 0.02, "bb": 0.08})
    forecast = Kalman(acceleration_density=0.01).predict(tracks, 8)
    one, two = forecast.covariance[:, 0]
    # Deviations differ by what 0.06 s at the velocity's 3 cm/s are worth, 2 mm at most.
    assert np.abs(np.sqrt(two[:, 0, 0]) - np.sqrt(one[:, 0, 0])).max() < 2e-3
    np.testing.assert_allclose(two, one, rtol=0.1)
    offset = forecast.mean[1] - forecast.mean[0]
    np.testing.assert_allclose(offset, np.broadcast_to([1.0, 0.0], offset.shape), atol=1e-9)
    # Without a tracker's motion the older one is as uncertain as the other would be 0.06 s later.
    tracks = remembered({"a": 0.02, "bb": 0.08}, False)
    plain = Kalman(acceleration_density=0.01).predict(tracks, 8)
    younger = tracks.select([0])
    later = replace(younger, stamp=younger.stamp + 0.06)
    alone = Kalman(acceleration_density=0.01).predict(later, 8)
    np.testing.assert_allclose(plain.covariance[1], alone.covariance[0], rtol=1e-9)
    offset = plain.mean[1] - plain.mean[0]
    np.testing.assert_allclose(offset, np.broadcast_to([1.0, 0.0], offset.shape), atol=1e-3)


def test_the_state_is_carried_to_the_newest_instant() -> None:
    tracks = remembered({"a": 0.02, "bb": 0.08})
    lag = 0.06
    moved = np.eye(4) + lag * np.eye(4, k=2)
    assert tracks.state_covariance is not None and tracks.velocity is not None
    np.testing.assert_allclose(tracks.state_covariance[0], JOINT, rtol=1e-12)
    np.testing.assert_allclose(tracks.state_covariance[1], moved @ JOINT @ moved.T, rtol=1e-9)
    np.testing.assert_array_equal(tracks.velocity, np.tile(SPEED, (2, 1)))
    np.testing.assert_allclose(tracks.noise[1], R + lag**2 * JOINT[2:, 2:], rtol=1e-9)
    np.testing.assert_allclose(tracks.positions[1, -1], [2.0, 2.0] + SPEED * (6.5 - 0.02))
    Tracks(**vars(tracks))  # what was assembled passes the checks


def test_one_that_was_not_seen_for_longer_than_a_sample_is_left_to_the_predictor() -> None:
    tracks = remembered({"a": 0.0, "bb": 0.7})
    assert np.isnan(tracks.positions[1, -1]).all() and tracks.velocity is not None
    assert tracks.state_covariance is not None
    np.testing.assert_array_equal(tracks.state_covariance[1], JOINT)


def test_without_a_stated_motion_the_last_two_measurements_carry() -> None:
    tracks = remembered({"a": 0.02, "bb": 0.08}, tracked=False)
    assert tracks.state_covariance is None and tracks.velocity is None
    np.testing.assert_allclose(tracks.positions[1, -1], [2.0, 2.0] + SPEED * (6.5 - 0.02))
    np.testing.assert_array_equal(tracks.noise, np.tile(R, (2, 1, 1)))


def test_a_sensor_without_velocities_beside_a_tracker() -> None:
    """The tracked one is still carried; the tracks carry no covariance that one would lack."""
    history = History(DT, 20, 6.0, 1.25)
    for tick in range(4):
        stamp = DT * (tick + 1)
        history = history.add(stamp, (seen("a", stamp, 0.02, False), seen("bb", stamp, 0.08)))
    tracks = history.tracks()
    assert tracks is not None and tracks.state_covariance is None and tracks.velocity is None
    assert np.isfinite(tracks.positions[:, -1]).all()


def test_a_late_report_does_not_bring_an_old_motion_back() -> None:
    history = History(DT, 20, 6.0, 1.25).add(1.0, (seen("a", 1.0, 0.0),))
    old = replace(seen("a", 1.0, 0.5), velocity=[9.0, 9.0])
    tracks = history.add(1.1, (replace(old, age=0.6),)).tracks()
    assert tracks is not None and tracks.velocity is not None
    np.testing.assert_array_equal(tracks.velocity[0], SPEED)
    # A newer one without a motion ends it.
    tracks = history.add(1.2, (seen("a", 1.2, 0.0, False),)).tracks()
    assert tracks is not None and tracks.velocity is None


@pytest.mark.parametrize("samples", [1, 6])
@pytest.mark.parametrize("predictor", [Kalman(), ConstantVelocity()])
def test_predictors_start_from_the_trackers_state(
    predictor: Kalman | ConstantVelocity, samples: int
) -> None:
    rng = np.random.default_rng(3)
    root = 0.1 * rng.standard_normal((2, 4, 4))
    joint, velocity = root @ root.swapaxes(1, 2), rng.standard_normal((2, 2))
    paths = rng.standard_normal((2, samples, 2))
    tracks = Tracks(paths, DT, ("a", "b"), [0.3, 0.3], np.tile(R, (2, 1, 1)), 0.0, joint, velocity)
    forecast = predictor.predict(tracks, 4)
    transition, process = white_acceleration(DT, predictor.acceleration_density, 2)
    spread = joint
    for h in range(4):
        spread = transition @ spread @ transition.T + process
        np.testing.assert_allclose(forecast.covariance[:, 0, h], spread[:, :2, :2], atol=1e-12)
        ahead = paths[:, -1] + (h + 1) * DT * velocity
        np.testing.assert_allclose(forecast.mean[:, 0, h], ahead, atol=1e-12)
    assert forecast.fallback == (None, None)


def test_velocity_and_state_covariance_come_together() -> None:
    with pytest.raises(WideberthError, match=r"detection.velocity comes alone; .* together"):
        Detection("a", [0.0, 0.0], R, 0.3, velocity=SPEED)
    with pytest.raises(WideberthError, match=r"detection.state_covariance comes alone"):
        Detection("a", [0.0, 0.0], R, 0.3, state_covariance=JOINT)
    with pytest.raises(
        WideberthError, match=r"detection.velocity has shape \(3,\); wanted \(2,\)"
    ):
        Detection("a", [0.0, 0.0], R, 0.3, velocity=np.zeros(3), state_covariance=JOINT)
    with pytest.raises(
        WideberthError, match=r"state_covariance has shape \(2, 2\); wanted \(4, 4"
    ):
        Detection("a", [0.0, 0.0], R, 0.3, velocity=SPEED, state_covariance=R)
    with pytest.raises(WideberthError, match=r"tracks.velocity comes alone"):
        Tracks(np.zeros((1, 3, 2)), DT, ("a",), [0.3], R[None], velocity=[[0.0, 0.0]])


def test_a_motion_that_is_none_is_a_flaw() -> None:
    spoilt = replace(seen("a", 0.0, 0.0), velocity=[np.nan, 0.0])
    assert spoilt.flaw == "velocity is [nan, 0.0]"
    spoilt = replace(seen("a", 0.0, 0.0), state_covariance=-JOINT)
    assert "state_covariance" in spoilt.flaw and "eigenvalue" in spoilt.flaw
    (kept,), reasons, _ = admitted(Observation(0.0, np.zeros(3), (spoilt,)), 2, 5.0, None)
    assert kept.velocity is None and kept.state_covariance is None and not kept.flaw
    assert "its velocity is left out: state_covariance" in reasons[0]


def test_a_motion_too_large_to_compute_with_is_refused() -> None:
    fast = replace(seen("a", 0.0, 0.0), velocity=[2 * FARTHEST, 0.0])
    vague = replace(seen("b", 0.0, 0.0), state_covariance=2e18 * np.eye(4))
    kept, reasons, _ = admitted(Observation(0.0, np.zeros(3), (fast, vague)), 2, 5.0, None)
    assert [one.velocity for one in kept] == [None, None]
    assert "its velocity holds 2e+09" in reasons[0]
    assert "its state covariance holds 2e+18" in reasons[1]
    velocity = np.array([[1e300, 0.0]])
    tracks = Tracks(np.zeros((1, 3, 2)), DT, ("a",), [0.3], R[None], 0.0, JOINT[None], velocity)
    within = bounded(tracks, None)
    assert within is not None and within.reasons[0] is not None and "velocity" in within.reasons[0]
    assert np.isfinite(Kalman().predict(tracks, 3).mean).all()


def test_selected_tracks_keep_their_velocities() -> None:
    tracks = remembered({"a": 0.02, "bb": 0.08})
    assert tracks.velocity is not None and tracks.state_covariance is not None
    part = tracks.select([1])
    np.testing.assert_array_equal(part.velocity, tracks.velocity[1:])
    np.testing.assert_array_equal(part.state_covariance, tracks.state_covariance[1:])

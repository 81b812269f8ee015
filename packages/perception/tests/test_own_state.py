"""What a controller is told of its own robot: closed forms, Monte Carlo, and never twice."""

import numpy as np
import pytest

from wideberth.framework.plugins.config import build
from wideberth.framework.values.errors import WideberthError
from wideberth.simulation.sensing.perceived import MotionEstimate
from wideberth_perception.observed_state import own_state

MEAN = np.array([1.0, -2.0, 0.6, 0.4, 0.0, 0.2])
ROOT = 0.02 * np.random.default_rng(0).standard_normal((6, 6))
ESTIMATE = MotionEstimate(3.0, MEAN, ROOT @ ROOT.T)


def test_a_unicycle_takes_pose_speed_and_yaw_rate():
    state, covariance = own_state(build("robots", "unicycle"), ESTIMATE, seen_from_here=False)
    taken = [0, 1, 2, 3, 5]
    assert np.allclose(state, MEAN[taken])
    assert np.allclose(covariance, ESTIMATE.covariance[np.ix_(taken, taken)], atol=1e-12)


def test_what_is_seen_from_here_shares_the_error_of_the_pose():
    robot = build("robots", "unicycle")
    state, covariance = own_state(robot, ESTIMATE, seen_from_here=True)
    assert np.allclose(state, MEAN[[0, 1, 2, 3, 5]])
    assert not covariance[:3].any() and not covariance[:, :3].any()
    speeds = ESTIMATE.covariance[np.ix_([3, 5], [3, 5])]
    assert np.allclose(covariance[3:, 3:], speeds, atol=1e-12)


@pytest.mark.parametrize("name", ["differential_drive", "bicycle", "holonomic"])
def test_covariance_is_that_of_many_draws(name):
    robot, rng = build("robots", name), np.random.default_rng(1)
    gentle = np.array([1.0, -2.0, 0.6, 0.5, 0.0, 0.05])  # well within the limits of all
    small = MotionEstimate(0.0, gentle, 1e-4 * ESTIMATE.covariance)
    _, covariance = own_state(robot, small, seen_from_here=False)
    drawn = rng.multivariate_normal(small.mean, small.covariance, 4000)
    exact = np.zeros((6, 6))
    states = np.array([
        own_state(robot, MotionEstimate(0.0, mean, exact), seen_from_here=False)[0]
        for mean in drawn
    ])  # fmt: skip
    found = np.cov(states.T)
    scale = np.sqrt(np.outer(np.diag(covariance), np.diag(covariance))).max()
    assert np.abs(found - covariance).max() < 3.0 * np.sqrt(2.0 / len(drawn)) * scale


def test_the_speed_of_a_robot_without_heading_is_turned_into_the_frame():
    aside = MotionEstimate(3.0, MEAN + 0.1 * np.eye(6)[4], ESTIMATE.covariance)
    state, _ = own_state(build("robots", "holonomic"), aside, seen_from_here=True)
    cosine, sine = np.cos(0.6), np.sin(0.6)
    world = [0.4 * cosine - 0.1 * sine, 0.4 * sine + 0.1 * cosine]
    assert np.allclose(state, [1.0, -2.0, *world])


def test_state_keeps_the_limits():
    wild = MotionEstimate(0.0, np.array([0.0, 0.0, 9.0, 3.0, 0.0, -0.4]), np.eye(6))
    state, _ = own_state(build("robots", "unicycle"), wild, seen_from_here=True)
    assert state.tolist() == [0.0, 0.0, 9.0, 0.7, -0.3]


def test_a_robot_that_flies_is_refused():
    with pytest.raises(WideberthError, match="in 3 dimensions"):
        own_state(build("robots", "holonomic_3d"), ESTIMATE, seen_from_here=True)

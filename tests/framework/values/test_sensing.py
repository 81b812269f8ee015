"""Samples of sensors are refused where they cannot be meant, and marked where they are broken."""

import numpy as np
import pytest

from wideberth.framework.values.errors import WideberthError
from wideberth.framework.values.sensing import Scan
from wideberth.simulation.sensing.perceived import (
    InertialSample,
    MotionEstimate,
    Sightings,
    WheelSample,
)


def test_a_scan_tells_which_beams_met_something() -> None:
    ranges = np.array([1.0, np.inf, np.nan, 0.0, 15.0, 15.1, -2.0])
    scan = Scan("lidar", np.linspace(0.0, 0.1, 7), np.linspace(-3.0, 3.0, 7), ranges)
    assert scan.met.tolist() == [True, False, False, False, True, False, False]
    assert scan.stamp == 0.1
    empty = Scan("lidar", np.zeros(0), np.zeros(0), np.zeros(0))
    assert np.isnan(empty.stamp) and not empty.met.any()


def test_a_scan_of_another_shape_is_refused() -> None:
    with pytest.raises(WideberthError, match=r"scan.ranges has shape \(2,\); wanted \(3,\)"):
        Scan("lidar", np.zeros(3), np.zeros(3), np.zeros(2))
    with pytest.raises(WideberthError, match=r"scan\.deviation"):
        Scan("lidar", np.zeros(1), np.zeros(1), np.ones(1), deviation=0.0)


def test_broken_samples_say_what_is_wrong_with_them() -> None:
    assert WheelSample("wheels", 0.0, np.array([1.0, 2.0])).flaw == ""
    assert WheelSample("wheels", 0.0, np.array([1.0, np.nan])).flaw == "angles are [1.0, nan]"
    assert InertialSample("imu", np.inf, 0.0, np.zeros(2)).flaw == "time is inf"
    assert InertialSample("imu", 0.0, np.nan, np.zeros(2)).flaw == "yaw rate is nan"
    with pytest.raises(WideberthError, match="has 3 entries; wanted the left wheels' angles"):
        WheelSample("wheels", 0.0, np.zeros(3))


def test_conclusions_hold_finite_numbers_and_covariances() -> None:
    with pytest.raises(WideberthError, match=r"motion_estimate.mean\[1\] is nan"):
        MotionEstimate(0.0, np.array([0.0, np.nan, 0.0, 0.0, 0.0, 0.0]), np.eye(6))
    with pytest.raises(WideberthError, match=r"sightings\.covariance"):
        Sightings(0.0, np.zeros((1, 2)), -np.eye(2)[None], np.ones(1))
    assert MotionEstimate(0.0, np.arange(6.0), np.eye(6)).pose.tolist() == [0.0, 1.0, 2.0]

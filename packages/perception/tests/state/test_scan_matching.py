"""Scan matching: a least-squares oracle, NEES, drift, corridors, people, a wrong map."""

import numpy as np
import pytest
import shapely
from scipy.optimize import least_squares
from scipy.stats import chi2

from wideberth.framework.plugins.config import build
from wideberth.framework.values.errors import WideberthError
from wideberth.framework.values.sensing import Scan
from wideberth.simulation.sensing.perceived import InertialSample, WheelSample
from wideberth.tests.helpers.driven import block, cast, driven, in_order, room, scans
from wideberth_perception.state import scan_matching

WALLS = room()


def made(walls=WALLS, start=(0.0, 0.0, 0.0), **settings):
    estimator = build("state_estimators", {"type": "scan_matching", "walls": walls, **settings})
    estimator.reset(np.array(start), 0.0)
    return estimator


def standing_scan(walls, pose, rng=None, time=1.0, beams=240):
    bearings = 2.0 * np.pi * np.arange(beams) / beams
    ranges = cast(walls, np.tile(pose[:2], (beams, 1)), bearings + pose[2])
    noise = 0.0 if rng is None else 0.01 * rng.standard_normal(beams)
    return Scan("lidar", np.full(beams, time), bearings, ranges + noise, 0.01, 15.0)


def error(estimator, drive):
    off = estimator.at(drive.times[-1]).mean - drive.truth[-1]
    off[2] = np.angle(np.exp(1j * off[2]))
    return off


def test_equals_least_squares_on_distances_to_the_outlines(monkeypatch):
    """An optimiser that knows nothing of faces: distances of the points to the walls' outlines."""
    rng = np.random.default_rng(1)
    truth = np.array([0.03, -0.02, 0.01])
    scan = standing_scan(WALLS, truth, rng)
    noise = {"start": 1.0, "start_speed": 1e-9, "start_acceleration": 1e-9}
    for name, value in (("_BEAMS", 240), ("_GATE", 1e-9), ("_MAP_DEVIATION", 1.0)):
        monkeypatch.setattr(scan_matching, name, value)
    estimator = made(odometry={"type": "ekf", "noise": noise})
    prior = estimator.at(1.0).covariance[:3, :3]
    assert not estimator.take(scan)
    found = estimator.at(1.0)
    outlines = shapely.union_all([shapely.LinearRing(wall.points) for wall in WALLS])
    beams = np.stack([np.cos(scan.bearings), np.sin(scan.bearings)], axis=1)
    points = (scan.ranges[:, None] * beams)[scan.met]
    deviation = 1.0  # beside which that of a range is nothing, whatever its angle
    weight = np.linalg.cholesky(np.linalg.inv(prior)).T

    def misfit(pose):
        turn = np.array([[np.cos(pose[2]), np.sin(pose[2])], [-np.sin(pose[2]), np.cos(pose[2])]])
        distance = shapely.distance(outlines, shapely.points(points @ turn + pose[:2]))
        return np.concatenate([distance / deviation, weight @ pose])

    wanted = least_squares(misfit, np.zeros(3), x_scale=(1, 1, 0.1), xtol=1e-12, ftol=1e-12)
    assert np.abs(found.mean[:3] - wanted.x).max() < 3e-4  # a corner or two beyond a face
    assert np.abs(found.mean[:3] - truth).max() < 4e-3
    inverse = np.linalg.inv(wanted.jac.T @ wanted.jac)
    assert np.allclose(np.diag(found.covariance)[:3], np.diag(inverse), rtol=0.05)


@pytest.mark.parametrize("runs", [20])
def test_drift_is_bounded_and_nees_in_its_band(runs, monkeypatch):
    """After 20 s the odometry is off by centimetres and more; the map holds it to millimetres."""
    monkeypatch.setattr(scan_matching, "_MAP_DEVIATION", 0.0)
    nees, matched, dead = [], [], []
    for run in range(runs):
        rng = np.random.default_rng([2, run])
        drive = driven(rng, 20.0, wander=1.0)
        estimator = made()
        for sample in in_order(drive.samples, scans(drive, WALLS, rng, beams=90)):
            assert not estimator.take(sample)
        off, found = error(estimator, drive), estimator.at(drive.times[-1])
        nees.append(off[:3] @ np.linalg.solve(found.covariance[:3, :3], off[:3]))
        matched.append(np.hypot(*off[:2]))
        dead.append(np.hypot(*error(estimator.odometry, drive)[:2]))
        assert found.frame == "map"
    low, high = chi2.ppf([0.025, 0.975], 3 * runs) / runs
    assert low < np.mean(nees) < high, np.mean(nees)
    assert np.mean(dead) > 3.0 * np.mean(matched)
    assert max(matched) < 0.03


def test_without_scans_the_covariance_is_that_of_the_odometry():
    drive = driven(np.random.default_rng(3), 10.0)
    start = np.array([1.0, 2.0, 2.5])
    estimator = made(start=start)
    for sample in drive.samples:
        estimator.take(sample)
    found, odometry = estimator.at(drive.times[-1]), estimator.odometry.at(drive.times[-1])
    assert np.allclose(found.mean, odometry.mean, atol=1e-9)
    size = np.abs(odometry.covariance[:3, :3]).max()
    assert np.abs(found.covariance - odometry.covariance)[:3, :3].max() < 1e-6 * size


def test_along_a_corridor_the_odometry_decides():
    corridor = (block(-100.0, 1.5, 100.0, 2.0), block(-100.0, -2.0, 100.0, -1.5))
    estimator = made(corridor)
    for time in np.arange(0.1, 10.0, 0.1).tolist():
        estimator.take(InertialSample("unit", time, 0.0, np.zeros(2)))
        estimator.take(WheelSample("wheels", time, np.zeros(4)))
        assert not estimator.take(standing_scan(corridor, np.zeros(3), time=time))
    found = estimator.at(10.0)
    along, across = np.sqrt(np.diag(found.covariance)[:2])
    assert across < 0.005
    assert along == pytest.approx(np.sqrt(estimator.odometry.at(10.0).covariance[0, 0]), rel=0.1)


def test_people_whom_the_map_has_not_are_left_out():
    rng = np.random.default_rng(5)
    drive = driven(rng, 10.0)
    people = tuple(
        block(x, y, x + 0.5, y + 0.5) for x, y in ((2.0, -2.0), (-3.0, 1.5), (3.0, 3.0))
    )
    estimator = made()
    for sample in in_order(drive.samples, scans(drive, WALLS, rng, people)):
        assert not estimator.take(sample)
    assert np.hypot(*error(estimator, drive)[:2]) < 0.02


def test_a_scan_of_another_place_is_left_out_with_its_reason():
    estimator = made()
    before = estimator.at(1.0)
    other = standing_scan((block(2.0, -3.0, 2.2, 3.0), block(-1.2, -3.0, -1.0, 3.0)), np.zeros(3))
    assert "beams fit the map" in estimator.take(other)
    nothing = Scan("lidar", np.ones(4), np.arange(4.0), np.full(4, np.inf))
    assert "no beam met anything" in estimator.take(nothing)
    after = estimator.at(1.0)
    assert np.allclose(after.mean, before.mean, atol=1e-12)
    assert np.trace(after.covariance[:2, :2]) > np.trace(before.covariance[:2, :2])


def test_a_robot_that_was_pushed_is_found_again():
    """The pose jumps by 0.3 m and 0.1 rad, of which wheels and gyro know nothing."""
    estimator, truth = made(), np.array([0.25, -0.15, 0.1])
    reasons = [
        estimator.take(standing_scan(WALLS, truth, np.random.default_rng(6), time=time))
        for time in np.linspace(0.05, 0.95, 10).tolist()
    ]
    assert reasons[0] and not reasons[-1]
    assert np.abs(estimator.at(0.95).mean[:3] - truth).max() < 0.01


def test_a_late_scan_and_one_of_no_known_time_are_left_out():
    estimator = made()
    assert not estimator.take(standing_scan(WALLS, np.zeros(3), time=0.5))
    assert "matched already" in estimator.take(standing_scan(WALLS, np.zeros(3), time=0.4))
    assert "cannot speak" in estimator.take(standing_scan(WALLS, np.zeros(3), time=50.0))


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"walls": []}, "walls is empty"),
    ],
)
def test_bad_settings_name_themselves(settings, message):
    config = {"type": "scan_matching", "walls": WALLS, **settings}
    with pytest.raises(WideberthError, match=message):
        build("state_estimators", config)


def test_missing_walls_are_asked_for():
    with pytest.raises(WideberthError, match="'walls' is missing"):
        build("state_estimators", "scan_matching")

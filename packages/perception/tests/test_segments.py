"""Segments on known walls: where they are, how sure, and how few."""

from dataclasses import replace

import numpy as np
import pytest

from wideberth import WideberthError
from wideberth.framework.values.arrays import Array
from wideberth.framework.values.polygon import Polygon
from wideberth.framework.values.sensing import Scan
from wideberth.simulation.sensing.perceived import Segments, Sightings
from wideberth.tests.oracles.ray_casting import box_corners, scan_of
from wideberth_perception.detection.chords import Chords
from wideberth_perception.detection.discs import DiscDetector
from wideberth_perception.detection.hits import DRIFT, TURN, hits_of
from wideberth_perception.detection.outside_map import OutsideMap
from wideberth_perception.detection.over_time import OverTime
from wideberth_perception.detection.segments import STRAIGHT, segments_of
from wideberth_perception.detector import Detector

ROOM = np.array([[-6.0, -4.0], [8.0, -4.0], [8.0, 4.0], [-6.0, 4.0]])
CRATE = box_corners(np.array([3.0, 2.5]), (0.8, 0.6), 0.4)
SIDES = [side for one in (ROOM, CRATE) for side in zip(one, np.roll(one, -1, axis=0), strict=True)]


def seen(pose: Array, rng: np.random.Generator, noise: float = 0.01, beams: int = 360) -> Scan:
    poses = np.tile(pose, (beams, 1))
    return scan_of(poses, rng, [], [ROOM, CRATE], deviation=noise, dropped=0.01)


def across(ends: Array) -> Array:
    """Return how far both ends, (2, 2), lie across the side that is next to their middle."""
    found = []
    for first, second in SIDES:
        along = (second - first) / np.linalg.norm(second - first)
        share = np.clip((ends.mean(axis=0) - first) @ along, 0.0, np.linalg.norm(second - first))
        away = float(np.linalg.norm(ends.mean(axis=0) - first - share * along))
        found.append((away, (ends - first) @ np.array([-along[1], along[0]])))
    return min(found, key=lambda one: one[0])[1]


@pytest.mark.parametrize(("noise", "beams"), [(0.01, 360), (0.03, 360), (0.01, 720)])
def test_segments_are_as_sure_as_they_say(noise: float, beams: int) -> None:
    """NEES of two ends across: 2 is exact; 5 % of corners and dents more than 9 times that."""
    rng, squares, counts = np.random.default_rng(1), [], []
    for _ in range(60):
        pose = np.array([*rng.uniform((-5.0, -3.0), (1.0, 3.0)), rng.uniform(-3.0, 3.0)])
        scan = seen(pose, rng, noise, beams)
        off = rng.standard_normal(3) * [DRIFT, DRIFT, TURN]  # of the poses, the same in the scan
        hits, _ = hits_of(scan, np.tile(pose + off, (beams, 1)))
        found = segments_of(hits, noise)
        counts.append(len(found))
        for ends, spread in zip(found.ends, found.covariance, strict=True):
            if np.linalg.norm(ends[1] - ends[0]) > 0.0:
                error = across(ends)
                squares.append(error @ np.linalg.solve(spread, error))
    assert len(squares) > 250
    assert 1.5 < np.mean(squares) < 3.0
    assert 1.0 < np.median(squares) < 1.386 + 0.35
    assert np.mean(np.array(squares) < 5.991) > 0.9
    assert np.mean(counts) < 11.0  # four walls, of which the crate hides a part, and two sides


def test_one_wall_is_the_least_squares_line_with_its_covariance() -> None:
    """Points at right angles to the sensor's beams, all alike: the closed form of a regression."""
    rng, runs = np.random.default_rng(2), 400
    bearings = np.linspace(-0.01, 0.01, 21)  # so far away that all beams are parallel
    found = []
    for _ in range(runs):
        ranges = 10.0 / np.cos(bearings) + 0.01 * rng.standard_normal(21)
        hits, _ = hits_of(Scan("lidar", np.zeros(21), bearings, ranges), np.zeros((21, 3)))
        found.append(segments_of(hits, 0.01, 0.0, 0.0))
    assert all(len(one) == 1 for one in found)
    errors = 10.0 - np.array([one.ends[0, :, 0] for one in found])
    place = 10.0 * np.tan(bearings)
    arms = np.stack([np.ones(2), place[[0, -1]]], axis=1)
    slopes = np.stack([np.ones(21), place], axis=1)
    wanted = 1e-4 * arms @ np.linalg.inv(slopes.T @ slopes) @ arms.T
    even = [one for one in found if np.trace(one.covariance[0]) < 1.5 * np.trace(wanted)]
    assert len(even) > 0.99 * runs  # of the others chance has made an uneven wall
    np.testing.assert_allclose(even[0].covariance[0], wanted, rtol=5e-3)
    scatter = 5.0 * np.sqrt(2.0 / runs) * wanted[0, 0]
    np.testing.assert_allclose(np.cov(errors.T), wanted, atol=scatter)


def test_a_round_pillar_is_as_unsure_as_it_is_uneven() -> None:
    rng, poses = np.random.default_rng(3), np.zeros((720, 3))
    hits, _ = hits_of(scan_of(poses, rng, [([6.0, 0.0], 2.0)], deviation=0.003), poses)
    found = segments_of(hits, 0.003)
    assert 3 <= len(found) <= 12
    sure = np.sqrt(np.diagonal(found.covariance, axis1=1, axis2=2))
    for ends, deviation in zip(found.ends, sure, strict=True):
        middle = np.linalg.norm(ends.mean(axis=0) - [6.0, 0.0])
        assert 2.0 - middle < max(3.0 * deviation.min(), 0.02)  # the bulge is within 3 deviations
    assert np.median(sure) < STRAIGHT


def test_openings_are_kept_open_and_what_hides_a_wall_splits_it() -> None:
    rng, poses = np.random.default_rng(4), np.zeros((360, 3))
    walls = [box_corners(np.array([3.0, y]), (0.1, 1.0), 0.0) for y in (-1.6, 1.6)]
    hits, _ = hits_of(scan_of(poses, rng, [], walls), poses)
    long = [one for one in segments_of(hits, 0.01).ends if np.linalg.norm(one[1] - one[0]) > 1.0]
    assert len(long) == 2  # 1.2 m apart
    assert sorted(round(float(np.abs(one[:, 1]).min()), 1) for one in long) == [0.6, 0.6]


def test_a_post_of_one_beam_is_a_segment_of_no_length() -> None:
    bearings = np.arctan(np.linspace(-1.0, 1.0, 41) / 4.0)
    ranges = 4.0 / np.cos(bearings)
    ranges[20] = 3.8
    hits, _ = hits_of(Scan("lidar", np.zeros(41), bearings, ranges), np.zeros((41, 3)))
    found = segments_of(hits, 0.01, 0.0, 0.0)
    short = np.linalg.norm(found.ends[:, 1] - found.ends[:, 0], axis=1) == 0.0
    np.testing.assert_allclose(found.ends[short], [[[3.8, 0.0], [3.8, 0.0]]], atol=1e-9)
    np.testing.assert_allclose(found.covariance[short], [np.full((2, 2), 1e-4)])
    assert (~short).sum() == 1  # the wall behind it


MAP = tuple(
    Polygon(tuple(map(tuple, box_corners(np.array(centre), half, 0.0))))
    for centre, half in (
        ([1.0, 4.1], (7.2, 0.1)), ([1.0, -4.1], (7.2, 0.1)),
        ([-6.1, 0.0], (0.1, 4.2)), ([8.1, 0.0], (0.1, 4.2)),
    )
)  # fmt: skip


@pytest.mark.parametrize(
    "detector",
    [
        DiscDetector((0.3,)),
        Chords(),
        OverTime(DiscDetector((0.3,))),
        OutsideMap(DiscDetector((0.3,)), MAP),
    ],
    ids=lambda one: type(one).__name__,
)
def test_detectors_hand_on_segments_through_all_that_stands(detector: Detector) -> None:
    rng, poses = np.random.default_rng(5), np.zeros((360, 3))
    found = Sightings(0.0, *(np.zeros(shape) for shape in ((0, 2), (0, 2, 2), 0)))
    for number in range(35):
        scan = scan_of(poses, rng, [([2.0, -2.0], 0.3)], [ROOM, CRATE], end=0.1 * (number + 1))
        found = detector.detect(scan, poses)
    ends = found.segments.ends
    along, away = ends[:, 1] - ends[:, 0], found.static[:, None] - ends[:, 0]
    size = np.maximum((along**2).sum(axis=1), 1e-12)
    share = np.clip((away * along).sum(axis=2) / size, 0.0, 1.0)
    off = np.linalg.norm(away - share[..., None] * along, axis=2).min(axis=1)
    assert len(found.static) > 250 and off.max() < 0.06
    assert len(ends) < 0.06 * len(found.static)


def test_segments_that_are_none_are_refused() -> None:
    with pytest.raises(WideberthError, match=r"segments.ends has shape"):
        Segments(np.zeros((1, 2)))
    one = Segments(np.zeros((1, 2, 2)), np.zeros((1, 2, 2)))
    with pytest.raises(WideberthError, match=r"segments.covariance"):
        replace(one, covariance=-np.eye(2)[None])
    assert len(one.and_those(one)) == 2

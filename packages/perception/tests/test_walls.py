"""Polygons behind segments of walls: they cover what was met and leave free what was seen."""

import numpy as np
import pytest
import shapely

from wideberth.framework.values.arrays import FARTHEST
from wideberth.simulation.sensing.perceived import Segments
from wideberth.tests.oracles.ray_casting import scan_of
from wideberth_perception.detection.hits import hits_of
from wideberth_perception.detection.segments import segments_of
from wideberth_perception.walls import DEPTH, SURE, walls_behind

ROOM = np.array([[-6.0, -4.0], [7.0, -4.0], [7.0, 5.0], [-6.0, 5.0]])
CRATE = np.array([[2.0, 1.0], [3.2, 1.0], [3.2, 2.0], [2.0, 2.0]])


def segments(
    *ends: tuple[tuple[float, float], tuple[float, float]], sure: float = 0.0
) -> Segments:
    spread = np.tile(sure**2 * np.eye(2), (len(ends), 1, 1))
    return Segments(np.array(ends).reshape(-1, 2, 2), spread)


@pytest.mark.parametrize("noise", [0.003, 0.01])
@pytest.mark.parametrize("sensor", [(0.0, 0.0), (4.0, -3.0), (5.5, 4.0)], ids=str)
def test_walls_cover_what_was_met_and_leave_what_was_seen_free(
    sensor: tuple[float, float], noise: float
) -> None:
    rng, poses = np.random.default_rng(0), np.tile([*sensor, 0.0], (360, 1))
    hits, _ = hits_of(scan_of(poses, rng, [], [ROOM, CRATE], deviation=noise), poses)
    walls = walls_behind(segments_of(hits, noise), np.array(sensor), 1.5)
    shapes = shapely.union_all([shapely.Polygon(wall.points) for wall in walls])
    true = hits_of(scan_of(poses, rng, [], [ROOM, CRATE], deviation=1e-9), poses)[0].points
    away = true - np.array(sensor)
    unit = away / np.linalg.norm(away, axis=1)[:, None]
    behind = shapely.distance(shapely.points(true + 0.02 * unit), shapes)
    assert (behind < 1e-9).mean() > 0.95 and behind.max() < 0.06  # where two walls meet
    before = shapely.distance(shapely.points(true - 0.2 * unit), shapes)
    assert (before > 0.0).mean() > 0.97  # a grazing beam passes close to the wall it will meet
    assert len(walls) <= 10
    assert [wall.name for wall in walls] == [f"wall {i}" for i in range(len(walls))]


def test_a_wall_begins_as_far_before_its_segment_as_that_is_unsure() -> None:
    (wall,) = walls_behind(segments(((3.0, -1.0), (3.0, 1.0)), sure=0.01), np.zeros(2), 0.5)
    low, high = wall.points.min(axis=0), wall.points.max(axis=0)
    assert np.allclose(low, [3.0 - SURE * 0.01, -1.0]) and np.allclose(high, [3.0 + DEPTH, 1.0])


def test_segments_that_line_up_are_one_wall_where_nobody_fits_between() -> None:
    parts = segments(((4.0, -3.0), (4.0, -1.0)), ((4.02, 1.0), (4.0, 3.0)))
    assert len(walls_behind(parts, np.zeros(2), 1.5)) == 2
    (one,) = walls_behind(parts, np.zeros(2), 2.5)
    assert np.allclose(one.points.min(axis=0), [4.0, -3.0])
    assert np.allclose(one.points.max(axis=0), [4.02 + DEPTH, 3.0], atol=0.02)
    aside = segments(((4.0, -3.0), (4.0, -1.0)), ((4.2, 1.0), (4.2, 3.0)))
    assert len(walls_behind(aside, np.zeros(2), 2.5)) == 2


def test_a_single_point_is_a_small_box_across_the_line_of_sight() -> None:
    (one,) = walls_behind(segments(((3.0, 4.0), (3.0, 4.0))), np.zeros(2), 1.5)
    assert shapely.Polygon(one.points).area == pytest.approx(DEPTH**2)
    assert np.linalg.norm(one.points, axis=1).min() == pytest.approx(np.hypot(5.0, DEPTH / 2))
    assert walls_behind(Segments(), np.zeros(2), 1.5) == ()


def test_a_wall_across_the_seam_of_the_angles_is_one() -> None:
    parts = segments(((-3.0, 1.0), (-3.0, 0.1)), ((-3.0, -0.1), (-3.0, -1.0)))
    assert len(walls_behind(parts, np.zeros(2), 0.5)) == 1


def test_what_reaches_too_far_is_no_wall() -> None:
    """It was refused as a polygon, in the middle of a node's decision."""
    far = segments(((FARTHEST, -1.0), (FARTHEST, 1.0)), ((3.0, -1.0), (3.0, 1.0)))
    (wall,) = walls_behind(far, np.zeros(2), 0.5)
    assert wall.points.max() < 4.0

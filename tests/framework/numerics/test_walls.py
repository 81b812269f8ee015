"""Polygons behind the points of walls: they cover all points and little else."""

import numpy as np
import pytest
import shapely

from wideberth.framework.numerics.walls import DEPTH, STRAIGHT, walls_behind

ROOM = shapely.box(-6.0, -4.0, 7.0, 5.0)
CRATE = shapely.box(2.0, 1.0, 3.2, 2.0)


def scan(sensor: tuple[float, float], beams: int = 360, noise: float = 0.0) -> np.ndarray:
    """Return where the beams from a place meet the room's walls or the crate, (beams, 2)."""
    rng, found = np.random.default_rng(0), []
    outline = shapely.union(ROOM.exterior, CRATE.exterior)
    for angle in np.linspace(0.0, 2.0 * np.pi, beams, endpoint=False):
        unit = np.array([np.cos(angle), np.sin(angle)])
        beam = shapely.LineString([sensor, sensor + 30.0 * unit])
        away = shapely.distance(shapely.Point(sensor), shapely.intersection(beam, outline))
        found.append(sensor + (away + noise * rng.standard_normal()) * unit)
    return np.array(found)


@pytest.mark.parametrize("noise", [0.0, 0.01])
@pytest.mark.parametrize("sensor", [(0.0, 0.0), (4.0, -3.0), (5.5, 4.0)], ids=str)
def test_walls_cover_all_points_and_leave_what_was_seen_free(
    sensor: tuple[float, float], noise: float
) -> None:
    points = scan(sensor, noise=noise)
    walls = walls_behind(np.random.default_rng(1).permutation(points), np.array(sensor), 1.5)
    shapes = shapely.union_all([shapely.Polygon(wall.points) for wall in walls])
    assert shapely.distance(shapely.points(points), shapes).max() < 1e-9
    away = points - np.array(sensor)
    before = points - (3.0 * STRAIGHT + 0.05) * away / np.linalg.norm(away, axis=1)[:, None]
    free = shapely.distance(shapely.points(before), shapes) > 0.0
    assert free.mean() > 0.97  # a grazing beam passes close to the wall that it will meet
    assert len(walls) < (16 if noise else 12)
    assert [wall.name for wall in walls] == [f"wall {i}" for i in range(len(walls))]


def test_a_wall_is_as_thick_as_said_and_lies_behind_its_points() -> None:
    points = np.column_stack([np.full(20, 3.0), np.linspace(-1.0, 1.0, 20)])
    (wall,) = walls_behind(points, np.zeros(2), 0.5)
    low, high = wall.points.min(axis=0), wall.points.max(axis=0)
    assert np.allclose(low, [3.0, -1.0]) and np.allclose(high, [3.0 + DEPTH, 1.0])


def test_a_gap_is_kept_open_and_single_points_are_kept() -> None:
    y = np.concatenate([np.linspace(-3.0, -1.0, 21), np.linspace(1.0, 3.0, 21)])
    points = np.column_stack([np.full(42, 4.0), y])
    assert len(walls_behind(points, np.zeros(2), 1.5)) == 2
    assert len(walls_behind(points, np.zeros(2), 2.5)) == 1
    (one,) = walls_behind(points[:1], np.zeros(2), 1.5)
    assert shapely.Polygon(one.points).area == pytest.approx(DEPTH**2)
    assert walls_behind(np.zeros((0, 2)), np.zeros(2), 1.5) == ()


def test_a_wall_across_the_seam_of_the_angles_is_one() -> None:
    points = np.column_stack([np.full(21, -3.0), np.linspace(-1.0, 1.0, 21)])
    assert len(walls_behind(points, np.zeros(2), 0.5)) == 1

"""Local costmaps: what rays mark and free, what is left behind, and the exact view."""

import numpy as np
import pytest

from wideberth.framework.values.arrays import Array
from wideberth.framework.values.costmap import LETHAL, Costmap
from wideberth.framework.values.errors import WideberthError
from wideberth.framework.values.polygon import Polygon
from wideberth.framework.values.sensing import Scan
from wideberth_nav2.costmap.footprint import RobotFootprint
from wideberth_nav2.costmap.local_costmap import (
    CostmapSurroundings,
    CostmapView,
    LayeredCostmap,
    _shares,
)
from wideberth_nav2.costmap.rays import Rays

ROBOT = RobotFootprint.round_of(0.2)
NOBODY = np.zeros((0, 2))


def seen(
    pose: Array, centres: Array, radius: float = 0.3, *polygons: Polygon
) -> CostmapSurroundings:
    radii = np.full(len(centres), radius)
    rays = Rays.cast(pose[:2], centres, radii, polygons, beams=720)
    return CostmapSurroundings(rays, centres, radii, polygons)


def lethal(costmap: Costmap) -> Array:
    """Centres of lethal cells, (L, 2)."""
    my, mx = np.nonzero(costmap.cells == LETHAL)
    return costmap.map_to_world(np.stack([mx, my], axis=1))


def test_rays_end_at_the_nearest_body() -> None:
    wall = Polygon(((3.0, -1.0), (4.0, -1.0), (4.0, 1.0), (3.0, 1.0)))
    centres = np.array([[0.0, 2.0], [-5.0, 0.0]])
    rays = Rays.cast(np.zeros(2), centres, np.array([0.5, 1.0]), (wall,), beams=4)
    assert rays.ranges == pytest.approx([3.0, 1.5, 4.0, np.inf])
    assert rays.met.tolist() == [True, True, True, False]
    turned = np.array([np.cos(0.1), np.sin(0.1)])
    rays = Rays.cast(np.zeros(2), 4.0 * turned[None], np.array([1.0]), (), beams=3600)
    # Law of cosines: |t way - c| = r.
    met = rays.ranges[rays.met, None] * rays.directions[rays.met]
    assert np.hypot(*(met - 4.0 * turned).T) == pytest.approx(np.ones(len(met)))
    assert rays.met.sum() == pytest.approx(3600 * 2.0 * np.arcsin(0.25) / (2.0 * np.pi), abs=1.5)


def test_a_scan_gives_the_same_rays() -> None:
    pose, centres = np.array([1.0, 2.0, 0.7]), np.array([[3.0, 2.5]])
    cast = Rays.cast(pose[:2], centres, np.array([0.4]), (), beams=360)
    bearings = 2.0 * np.pi / 360 * np.arange(360) - 0.7
    scan = Scan("lidar", np.zeros(360), bearings, cast.ranges, longest=12.0)
    rays = Rays.of_scan(scan, pose)
    assert rays.directions == pytest.approx(cast.directions)
    assert np.array_equal(rays.met, cast.met)
    mounted = Rays.of_scan(Scan("l", [0.0], [0.0], [1.0], mount=np.array([0.5, 0.0, 0.0])), pose)
    assert mounted.origin == pytest.approx([1.0 + 0.5 * np.cos(0.7), 2.0 + 0.5 * np.sin(0.7)])


def test_the_near_side_of_a_body_is_marked_and_inflated() -> None:
    layers = LayeredCostmap(CostmapView(), ROBOT)
    costmap = layers.update(0.0, np.zeros(3), seen(np.zeros(3), np.array([[1.0, 0.0]])))
    found = lethal(costmap)
    assert len(found) and (np.abs(np.hypot(*(found - [1.0, 0.0]).T) - 0.3) < 0.04).all()
    assert (found[:, 0] < 1.0).all()
    assert costmap.at(np.array([0.61, 0.0]), 0) == 253  # within the inscribed radius
    assert 0 < costmap.at(np.array([0.2, 0.0]), 0) < 253


def test_bodies_beyond_the_range_of_marking_are_left_out() -> None:
    wide = CostmapView(width=8.0, height=8.0)
    layers = LayeredCostmap(wide, ROBOT)
    shown = layers.update(0.0, np.zeros(3), seen(np.zeros(3), np.array([[2.9, 0.0]]), 0.3))
    assert not len(lethal(shown))
    shown = layers.update(1.0, np.zeros(3), seen(np.zeros(3), np.array([[2.7, 0.0]]), 0.3))
    assert len(lethal(shown))


def test_a_mark_stays_until_a_ray_passes() -> None:
    layers, here = LayeredCostmap(CostmapView(), ROBOT), np.zeros(3)
    layers.update(0.0, here, seen(here, np.array([[1.0, 0.0]])))
    # Somebody in front hides the place: the mark stays although the body has gone.
    hidden = layers.update(0.2, here, seen(here, np.array([[0.6, 0.0]]), 0.25))
    assert (lethal(hidden)[:, 0] > 0.65).any()
    freed = layers.update(0.4, here, seen(here, NOBODY))
    assert not len(lethal(freed))


def test_without_infinite_ranges_marks_in_the_open_stay_for_ever() -> None:
    layers, here = LayeredCostmap(CostmapView(inf_is_valid=False), ROBOT), np.zeros(3)
    layers.update(0.0, here, seen(here, np.array([[1.0, 0.0]])))
    assert len(lethal(layers.update(0.2, here, seen(here, NOBODY))))
    wall = Polygon(((1.4, -2.0), (2.0, -2.0), (2.0, 2.0), (1.4, 2.0)))
    shown = layers.update(0.4, here, seen(here, NOBODY, 0.3, wall))
    assert (lethal(shown)[:, 0] > 1.35).all()


def test_a_ray_that_was_lost_does_nothing() -> None:
    layers, here = LayeredCostmap(CostmapView(), ROBOT), np.zeros(3)
    before = seen(here, np.array([[1.0, 0.0]]))
    layers.update(0.0, here, before)
    lost = Rays(np.zeros(2), before.rays.directions, np.full(720, np.nan), 12.0)
    shown = layers.update(0.2, here, CostmapSurroundings(lost, NOBODY, np.zeros(0)))
    assert len(lethal(shown))


def test_it_is_updated_at_its_own_rate() -> None:
    layers, here = LayeredCostmap(CostmapView(), ROBOT), np.zeros(3)
    first = layers.update(0.0, here, seen(here, NOBODY))
    assert layers.update(0.15, here, seen(here, np.array([[1.0, 0.0]]))) is first
    assert layers.update(0.2, here, seen(here, np.array([[1.0, 0.0]]))) is not first
    layers.clear()
    assert not len(lethal(layers.update(0.21, here, seen(here, NOBODY))))


def test_the_window_rolls_by_whole_cells_and_keeps_its_marks() -> None:
    layers, body = LayeredCostmap(CostmapView(), ROBOT), np.array([[1.0, 0.0]])
    first = layers.update(0.0, np.zeros(3), seen(np.zeros(3), body))
    there = np.array([0.33, -0.12, 0.0])
    blind = Rays(there[:2], np.zeros((0, 2)), np.zeros(0), 12.0)
    moved = layers.update(0.2, there, CostmapSurroundings(blind, NOBODY, np.zeros(0)))
    shift = (np.array(moved.origin) - first.origin) / 0.05
    assert shift == pytest.approx(np.round(shift)) and shift.tolist() == pytest.approx([6, -2])
    assert np.array_equal(lethal(moved).round(6), lethal(first).round(6))
    gone = layers.update(
        0.4, np.array([9.0, 0.0, 0.0]), CostmapSurroundings(blind, NOBODY, np.zeros(0))
    )
    assert not len(lethal(gone))


def test_the_robot_frees_its_own_place() -> None:
    layers = LayeredCostmap(CostmapView(), ROBOT)
    layers.update(0.0, np.zeros(3), seen(np.zeros(3), np.array([[0.5, 0.0]]), 0.1))
    there = np.array([0.4, 0.0, 0.0])
    blind = Rays(there[:2], np.zeros((0, 2)), np.zeros(0), 12.0)
    shown = layers.update(0.2, there, CostmapSurroundings(blind, NOBODY, np.zeros(0)))
    assert not len(lethal(shown))


def test_the_exact_view_covers_what_bodies_touch() -> None:
    view, rng = CostmapView.privileged(), np.random.default_rng(3)
    centres, wall = rng.uniform(-5.0, 5.0, (6, 2)), Polygon(((1, 1), (2, 1), (1, 2)))
    shown = LayeredCostmap(view, ROBOT).update(
        0.0, np.zeros(3), seen(np.zeros(3), centres, 0.4, wall)
    )
    places = rng.uniform(-5.5, 5.5, (20_000, 2))
    inside = (np.hypot(*(places[:, None] - centres).transpose(2, 0, 1)) <= 0.4).any(axis=1)
    inside |= (places.min(axis=1) >= 1.0) & (places.sum(axis=1) <= 3.0)
    costs = shown.at(places, 0)
    assert (costs[inside] == LETHAL).all()
    apart = np.hypot(*(places[:, None] - centres).transpose(2, 0, 1)).min(axis=1)
    far = (apart > 0.4 + 0.072) & ((places < 0.92).any(axis=1) | (places.sum(axis=1) > 3.15))
    assert (costs[far] != LETHAL).all()


def test_a_known_map_is_seen_where_no_ray_goes() -> None:
    wall = Polygon(((0.8, -0.2), (1.2, -0.2), (1.2, 0.2), (0.8, 0.2)))
    shown = LayeredCostmap(CostmapView(static_layer=True), ROBOT).update(
        0.0, np.zeros(3), seen(np.zeros(3), NOBODY, 0.3, wall)
    )
    assert shown.at(np.array([1.1, 0.0]), 0) == LETHAL
    unknown = LayeredCostmap(CostmapView(), ROBOT).update(
        0.0, np.zeros(3), seen(np.zeros(3), NOBODY, 0.3, wall)
    )
    assert unknown.at(np.array([1.1, 0.0]), 0) < LETHAL


def test_without_its_layer_nothing_is_marked() -> None:
    here, body = np.zeros(3), np.array([[1.0, 0.0]])
    for layer in (True, False):
        costmap = LayeredCostmap(CostmapView(obstacle_layer=layer), ROBOT)
        shown = costmap.update(0.0, here, seen(here, body, 0.3))
        assert (shown.cells == LETHAL).any() == layer == shown.cells.any()


def test_a_view_without_size_is_refused() -> None:
    with pytest.raises(WideberthError, match=r"view\.width"):
        CostmapView(width=0.0)


def test_an_edge_is_looked_at_within_the_window_alone() -> None:
    """Half a cell apart over 1e9 m that was 149 GiB, and the controller failed."""
    rng = np.random.default_rng(0)
    grid = Costmap(np.zeros((20, 30), np.uint8), 0.1, (-1.0, -1.0))
    low, high = np.array([-1.0, -1.0]), np.array([2.0, 1.0])
    for _ in range(300):
        begin, edge = 3.0 * rng.standard_normal(2), 6.0 * rng.standard_normal(2)
        edge[rng.random(2) < 0.1] = 0.0
        some = begin + _shares(begin, edge, low, high, 0.1)[:, None] * edge
        count = 2 + int(np.ceil(2.0 * np.abs(edge).max() / 0.1))
        every = begin + np.linspace(0.0, 1.0, count)[:, None] * edge
        np.testing.assert_array_equal(some[grid.inside(some)], every[grid.inside(every)])
    long = _shares(np.array([-5e8, 0.0]), np.array([1e9, 0.1]), low, high, 0.1)
    assert len(long) < 100

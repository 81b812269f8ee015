"""Smoothing: the closed form at a corner, Nav2's iteration, and walls that it keeps clear of."""

import numpy as np
import pytest

from wideberth import Costmap, Inflation, Path, Route, WideberthError
from wideberth.routes.navfn import NavFn
from wideberth.routes.smoothed import SmoothedRoutes, smoothed

FREE = Costmap(np.zeros((60, 60), dtype=int), 0.1)


def corner(step: float) -> Path:
    along = np.arange(0.5, 3.0, step)
    first = np.stack([along, np.full_like(along, 0.5)], axis=1)
    second = np.stack([np.full_like(along, 3.0), along], axis=1)
    return Path(np.concatenate([first, second]))


@pytest.mark.parametrize("length", [0.1, 0.3])
def test_a_right_angle_is_cut_at_the_length_over_the_root_of_two(length: float) -> None:
    path = smoothed(corner(0.01), FREE, length)
    gap = np.hypot(*(path.points - (3.0, 0.5)).T).min()
    assert gap == pytest.approx(length / np.sqrt(2.0), rel=0.03)


def test_the_number_of_points_does_not_matter() -> None:
    one, other = (smoothed(corner(step), FREE, 0.3) for step in (0.02, 0.04))
    far = [np.hypot(*(other.points - point).T).min() for point in one.points]
    assert max(far) < 0.03


def test_it_is_where_the_iteration_of_the_simple_smoother_ends() -> None:
    """Its weights are in the ratio (length / step)^2 where all steps are the same."""
    turn = np.cumsum(np.sin(np.arange(30)))
    points = np.cumsum(0.1 * np.stack([np.cos(turn), np.sin(turn)], axis=1), axis=0) + 3.0
    wanted = points.copy()
    data, smooth = 0.2, 0.2 * (0.3 / 0.1) ** 2
    for _ in range(3000):
        pull = wanted[2:] + wanted[:-2] - 2.0 * wanted[1:-1]
        wanted[1:-1] += 0.2 * (data * (points[1:-1] - wanted[1:-1]) + smooth * pull)
    found = smoothed(Path(points), FREE, 0.3)
    assert np.abs(found.points - wanted).max() < 1e-9


def test_ends_stay_and_paths_shorten() -> None:
    costmap = Costmap(np.pad(np.zeros((58, 58), dtype=int), 1, constant_values=254), 0.1)
    plain, smooth = (
        planner.plan(costmap, (0.5, 0.7), (5.1, 3.3)).path
        for planner in (NavFn(), SmoothedRoutes(NavFn(), 0.5))
    )
    assert plain is not None and smooth is not None
    assert np.array_equal(smooth.points[[0, -1]], plain.points[[0, -1]])
    assert smooth.length <= plain.length + 1e-9


@pytest.mark.parametrize("seed", range(5))
def test_no_step_of_a_smoothed_path_is_newly_blocked(seed: int) -> None:
    cells = np.where(np.random.default_rng(seed).random((60, 60)) < 0.02, 254, 0)
    cells[5:8, 5:8] = cells[52:55, 52:55] = 0
    costmap = Inflation(0.12, 0.3).inflated(Costmap(cells, 0.1))
    route = NavFn().plan(costmap, (0.65, 0.65), (5.35, 5.35))
    assert route.path is not None
    before = costmap.blocked_steps(route.path.points)
    after = smoothed(route.path, costmap, 1.0)
    assert not (costmap.blocked_steps(after.points) & ~before).any()
    assert np.abs(after.points - route.path.points).max() > 0.01


def test_without_a_path_the_reason_stays() -> None:
    route: Route = SmoothedRoutes().plan(FREE, (99.0, 0.0), (1.0, 1.0))
    assert route.path is None and "start" in route.reason


def test_a_length_of_nothing_is_refused() -> None:
    with pytest.raises(WideberthError, match=r"smoothed\.length is 0"):
        SmoothedRoutes(length=0.0)

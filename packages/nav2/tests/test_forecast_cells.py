"""Cells that people may cover: against draws, against exact regions and risks cell by cell."""

from dataclasses import replace
from time import perf_counter

import numpy as np
import pytest

from wideberth.framework.risk.collision_probability import collision_probability
from wideberth.framework.values.errors import WideberthError
from wideberth.framework.values.forecast import Forecast, GaussianObstacle
from wideberth.framework.values.occupancy_grid import OccupancyGrid
from wideberth.regions.minkowski_sum import MinkowskiSum
from wideberth_nav2.forecast_cells import ForecastCells

FLOOR = OccupancyGrid(np.zeros((60, 80)), 0.1, (-4.0, -3.0))
CENTRES = FLOOR.map_to_world(np.stack(np.meshgrid(np.arange(80), np.arange(60)), axis=-1))
"""(60, 80, 2), m."""


def crowd(seed: int, people: int = 4, modes: int = 2, instants: int = 5) -> Forecast:
    """People who walk straight, known ever less, along axes of their own; some beside the grid."""
    rng = np.random.default_rng(seed)
    start = rng.uniform(-4.5, 4.5, (people, modes, 1, 2))
    mean = start + 0.3 * np.arange(instants)[:, None] * rng.normal(0.0, 1.0, (people, modes, 1, 2))
    root = rng.normal(0.0, 0.25, (people, modes, 1, 2, 2))
    grown = 1.0 + 0.3 * np.arange(instants)[:, None, None]
    weight = rng.dirichlet(np.ones(modes), people)
    return Forecast(mean, root @ np.swapaxes(root, -1, -2) * grown, weight, 0.3, (None,) * people)


def test_a_share_of_draws_lies_in_the_region_that_is_its_content() -> None:
    """Without a radius the cells of one Gaussian hold its content: Monte Carlo, 3 sigma."""
    rng = np.random.default_rng(3)
    fine = OccupancyGrid(np.zeros((800, 800)), 0.01, (-4.0, -4.0))
    covariance = np.array([[0.5, 0.3], [0.3, 0.4]])
    one = Forecast.single(np.array([[[0.2, -0.3]]]), covariance[None, None], 0.2)
    draws = rng.multivariate_normal([0.2, -0.3], covariance, 20_000)
    for tail in (0.05, 0.3, 0.7):
        shown = ForecastCells(0.2, tail=tail).on(fine, one, np.zeros(1))
        inside = float((shown.at(draws, outside=0) == 100).mean())
        assert inside == pytest.approx(1.0 - tail, abs=3.0 * np.sqrt(tail * (1.0 - tail) / 20_000))


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("radius", [0.0, 0.3])
def test_a_region_is_the_union_of_exact_sums_cell_by_cell(seed: int, radius: float) -> None:
    forecast, cells = crowd(seed), ForecastCells(1.2, 0.3, tail=0.2, margin=0.05)
    shown = cells.on(FLOOR, forecast, np.full(4, radius)).cells
    sum_, wanted = MinkowskiSum(), np.full(CENTRES.shape[:2], np.inf)
    level = np.array(np.sqrt(-2.0 * np.log(0.2)))
    for o, m in zip(*np.nonzero(forecast.weight >= 0.01), strict=True):
        for k in range(forecast.steps):
            obstacle = GaussianObstacle(forecast.mean[o, m, k], forecast.covariance[o, m, k])
            parameters = sum_.parameters(obstacle, np.array(radius + 0.05))
            distance = sum_.signed_distance(CENTRES.reshape(-1, 2), parameters, level)
            wanted = np.minimum(wanted, distance.reshape(wanted.shape))
    assert set(np.unique(shown)) <= {0, 100} and (shown == 100).any()
    assert (shown == 100)[wanted < -2e-3].all()
    assert not (shown == 100)[wanted > 2e-3].any()


@pytest.mark.parametrize("seed", range(3))
def test_a_probability_is_that_of_exact_risks_cell_by_cell(seed: int) -> None:
    forecast, radii = crowd(seed), np.array([0.3, 0.4, 0.5, 0.3])
    cells = ForecastCells(1.2, 0.3, margin=0.1, shows="probability")
    covariance = forecast.covariance + 0.01 * np.eye(2)
    forecast = replace(forecast, covariance=covariance)
    free = np.ones(CENTRES.shape[:2])
    for o in range(4):
        there = np.zeros(free.shape)
        for m in range(2):
            away = CENTRES[:, :, None] - forecast.mean[o, m]
            chance = collision_probability(away, covariance[o, m], radii[o] + 0.1)
            there += forecast.weight[o, m] * chance.max(axis=-1) * (forecast.weight[o, m] >= 0.01)
        free *= 1.0 - there
    shown = cells.on(FLOOR, forecast, radii).cells
    assert shown == pytest.approx(100.0 * (1.0 - free), abs=2.5)  # interpolated, and rounded
    assert shown.max() > 30


def test_a_probability_is_the_share_of_draws_that_cover_a_cell() -> None:
    """One person at one instant: Monte Carlo, 3 sigma and the tables' own 0.01."""
    rng = np.random.default_rng(4)
    covariance = np.array([[0.3, -0.1], [-0.1, 0.2]])
    one = Forecast.single(np.array([[[0.0, 0.5]]]), covariance[None, None], 0.2)
    shown = ForecastCells(0.2, shows="probability").on(FLOOR, one, np.array([0.5]))
    draws = rng.multivariate_normal([0.0, 0.5], covariance, 4000)
    for place in rng.uniform(-1.5, 1.5, (20, 2)):
        centre = FLOOR.map_to_world(FLOOR.world_to_map(place))
        share = float((np.hypot(*(draws - centre).T) < 0.5).mean())
        noise = 3.0 * np.sqrt(max(share * (1.0 - share), 1e-3) / 4000)
        assert shown.at(centre, outside=0) / 100 == pytest.approx(share, abs=noise + 0.015)


def test_nobody_covers_nothing_and_light_modes_are_left_out() -> None:
    nobody = Forecast(np.zeros((0, 1, 3, 2)), np.zeros((0, 1, 3, 2, 2)), np.zeros((0, 1)), 0.2, ())
    light = Forecast(
        np.array([[[[0.0, 0.0]], [[2.0, 2.0]]]]), np.full((1, 2, 1, 1, 1), 0.01) * np.eye(2),
        np.array([[0.995, 0.005]]), 0.2, (None,),
    )  # fmt: skip
    for shows in ("region", "probability"):
        cells = ForecastCells(shows=shows)
        assert not cells.on(FLOOR, nobody, np.zeros(0)).cells.any()
        shown = cells.on(FLOOR, light, np.array([0.3]))
        assert shown.at([(0.0, 0.0), (2.0, 2.0)], outside=-1).tolist()[1] == 0
        assert shown.at((0.0, 0.0), outside=-1) >= 95


def test_instants_begin_now_and_reach_the_horizon() -> None:
    assert ForecastCells(1.0, 0.4).times.tolist() == pytest.approx([0.0, 0.4, 0.8, 1.2])
    assert ForecastCells(1.2, 0.4).times.tolist() == pytest.approx([0.0, 0.4, 0.8, 1.2])


@pytest.mark.parametrize(
    "wrong",
    [{"horizon": 0.0}, {"step": -1.0}, {"tail": 1.0}, {"margin": -0.1}, {"shows": "both"}],
)
def test_numbers_out_of_range_are_refused(wrong: dict[str, float]) -> None:
    with pytest.raises(WideberthError, match=f"cells.{next(iter(wrong))}"):
        ForecastCells(**wrong)  # type: ignore[arg-type]


def test_twenty_people_on_forty_thousand_cells_take_milliseconds() -> None:
    forecast, radii = crowd(0, 20, 1, 21), np.full(20, 0.3)
    wide = OccupancyGrid(np.zeros((200, 200)), 0.05, (-5.0, -5.0))
    for shows, most in (("region", 0.02), ("probability", 0.15)):  # 1 and 15 ms on a free core
        cells = ForecastCells(4.0, 0.2, shows=shows)  # type: ignore[arg-type]
        cells.on(wide, forecast, radii)
        spent = []
        for _ in range(10):
            begin = perf_counter()
            cells.on(wide, forecast, radii)
            spent.append(perf_counter() - begin)
        assert min(spent) < most

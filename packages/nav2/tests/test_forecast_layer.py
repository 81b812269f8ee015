"""People's forecasts as a layer of the costmaps, as the static layer takes a published grid."""

from dataclasses import replace

import numpy as np
import pytest

from wideberth.framework.values.costmap import LETHAL, Costmap
from wideberth.framework.values.motion import Detection, Observation
from wideberth.framework.values.occupancy_grid import OccupancyGrid
from wideberth.framework.values.path import Path
from wideberth.packages.nav2.tests.test_people_forecasts import Broken
from wideberth.predictors import Kalman
from wideberth.robots import Unicycle
from wideberth.routes import NavFn
from wideberth_nav2.costmap.footprint import RobotFootprint
from wideberth_nav2.costmap.forecast_layer import ForecastLayer
from wideberth_nav2.costmap.local_costmap import CostmapSurroundings, CostmapView, LayeredCostmap
from wideberth_nav2.forecast_cells import ForecastCells
from wideberth_nav2.server.navigator import Nav2

LAYER = ForecastLayer(Kalman(acceleration_density=1e-3), ForecastCells(2.0, 0.1))
VELOCITY = np.array([0.8, 0.0])


def passing(time: float) -> Observation:
    """Someone walks past the robot, 1 m beside it."""
    place = np.array([-2.0, 1.0]) + time * VELOCITY
    one = Detection("a", place, 1e-4 * np.eye(2), 0.3)
    return Observation(time, np.zeros(5), (one,))


def driven(nav2: Nav2, until: float) -> Costmap:
    nav2.set_path(Path(np.array([[0.0, 0.0], [5.0, 0.0]])))
    for time in np.arange(0.0, until + 1e-9, 0.05).tolist():
        nav2.command(passing(time))
    assert nav2.costmap is not None
    return nav2.costmap


def test_cells_are_lethal_where_a_person_will_be_and_not_where_it_was() -> None:
    view = CostmapView(width=8.0, height=8.0, obstacle_max_range=5.0, raytrace_max_range=6.0)
    plain = Nav2(Unicycle(radius=0.2), planner=NavFn())
    plain = replace(plain, settings=replace(plain.settings, view=view))
    costmap = driven(replace(plain, forecasts=LAYER), 2.0)  # the person is at -0.4, 1.0
    there = np.stack([np.linspace(-0.4, 1.2, 20), np.ones(20)], axis=1)
    assert (costmap.at(there, outside=0) == LETHAL).all()
    assert costmap.at((-1.2, 1.0), outside=0) < LETHAL  # 0.5 m behind its back
    assert costmap.at((2.2, 1.0), outside=0) < LETHAL  # beyond the horizon
    now = driven(plain, 2.0).at(there, outside=0)
    assert (now[8:] < LETHAL).all()  # rays show where it is alone


def test_the_robots_own_outline_is_freed() -> None:
    robot = RobotFootprint.round_of(0.2)
    here = Detection("a", np.array([0.3, 0.0]), 1e-4 * np.eye(2), 0.3)
    people = LAYER.begun(0.05)
    people.take(Observation(0.0, np.zeros(3), (here,)), np.zeros(2), 0.2)
    around = CostmapSurroundings(None, np.zeros((0, 2)), np.zeros(0), (), LAYER.shown(people, 0.0))
    view = CostmapView(inflation_radius=0.0)
    costmap = LayeredCostmap(view, robot).update(0.0, np.zeros(3), around)
    assert costmap.at((0.1, 0.0), outside=0) < LETHAL
    assert costmap.at((0.4, 0.0), outside=0) == LETHAL


def test_nothing_is_shown_while_no_one_is_known() -> None:
    assert LAYER.shown(LAYER.begun(0.05), 1.0) is None


def test_probabilities_become_costs_as_of_a_map_that_is_not_trinary() -> None:
    """floor(254 p / threshold), as Nav2's static layer has it; at the threshold lethal."""
    grid = OccupancyGrid(np.array([[0, 1, 50, 99, 100, -1]]), 0.1)
    shown = Costmap.from_grid(grid, lethal_threshold=100, trinary=False).cells
    assert shown.tolist() == [[0, 2, 127, 251, 254, 255]]
    shown = Costmap.from_grid(grid, lethal_threshold=50, trinary=False).cells
    assert shown.tolist() == [[0, 5, 254, 254, 254, 255]]


@pytest.mark.parametrize("shows", ["region", "probability"])
def test_a_reset_forgets_people(shows: str) -> None:
    cells = replace(LAYER.cells, shows=shows)  # type: ignore[arg-type]
    nav2 = Nav2(Unicycle(radius=0.2), forecasts=ForecastLayer(Kalman(), cells))
    driven(nav2, 0.5)
    nav2.reset()
    nav2.command(Observation(1.0, np.zeros(5)))
    assert nav2.costmap is not None and not nav2.costmap.cells.any()


def test_a_predictor_that_raises_leaves_what_rays_show(caplog: pytest.LogCaptureFixture) -> None:
    view = CostmapView(width=8.0, height=8.0, obstacle_max_range=5.0, raytrace_max_range=6.0)
    plain = Nav2(Unicycle(radius=0.2))
    plain = replace(plain, settings=replace(plain.settings, view=view))
    broken = replace(plain, forecasts=ForecastLayer(Broken()))
    shown = driven(broken, 1.0)
    broken.remember(passing(1.2))
    assert "forecast: ValueError: broken" in caplog.text
    assert np.array_equal(shown.cells, driven(plain, 1.0).cells)

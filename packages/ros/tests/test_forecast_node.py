"""Forecasts on the network: where people are by now, on grids that others take."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from wideberth.framework.plugins.config import build
from wideberth.framework.predictor import Predictor
from wideberth.framework.values.errors import WideberthError
from wideberth.framework.values.forecast import Forecast
from wideberth.framework.values.occupancy_grid import OccupancyGrid
from wideberth.framework.values.sensing import Scan
from wideberth.predictors import BUILT_IN, Kalman
from wideberth.predictors.core.forecaster import KEPT
from wideberth.tests.helpers.bags import obstacles, odometry, transform
from wideberth.tests.helpers.network import Network
from wideberth_nav2.forecast_cells import ForecastCells
from wideberth_ros.cli.ros_forecast import read_forecast
from wideberth_ros.decoding import ObstaclesMessage, decode_message
from wideberth_ros.encoding import MessageEncoder
from wideberth_ros.forecast_node import (
    HEIGHT,
    WELL,
    FixedArea,
    ForecastNode,
    ForecastSettings,
    RobotArea,
)
from wideberth_ros.obstacle_sources import ScanTopic

pytest.importorskip("rosbags", reason="pip install 'wideberth[ros]'")

EXAMPLE = Path(__file__).parents[3] / "examples" / "forecast.yaml"
EPOCH = 1000.0
VELOCITY = np.array([1.0, 0.5])
START = np.array([-7.0, -3.5])
POINT = ForecastCells(0.2, 0.2, tail=0.05)
"""Now, and hardly more."""


class Loop:
    """A node with a clock of its own, and someone who walks straight on."""

    def __init__(self, predictor: Predictor | None = None, **settings: Any) -> None:
        self.network = Network()
        self.now = 5.0
        self.shift = 0.0
        """s, by which the clock of the others differs."""
        settings.setdefault("cells", POINT)
        predictor = predictor or Kalman(acceleration_density=1e-4)
        self.node = ForecastNode(
            predictor,
            ForecastSettings(**settings),
            self.network,
            lambda: round(1e9 * (EPOCH + self.now)),
        )

    def come(self, topic: str, message: Any) -> None:
        self.network.wires[topic].take(message)

    def person(self, time: float | None = None) -> np.ndarray:
        return START + (self.now if time is None else time) * VELOCITY

    def centre(self) -> np.ndarray:
        """Where a body is that a LiDAR sees, m: it walks around the robot."""
        return np.array([2.0 + 0.2 * (self.now - 5.0), -0.5 + 0.4 * (self.now - 5.0)])

    def see(self, frame: str = "odom", late: float = 0.0) -> None:
        time = EPOCH + self.now - late + self.shift
        place = self.person(self.now - late)
        self.come("/obstacles", obstacles(time, [(float(place[0]), float(place[1]))], frame))

    def odom(self, x: float = 0.0) -> None:
        self.come("/odom", odometry(EPOCH + self.now + self.shift, (x, 0, 0), (0, 0, 0)))

    def walk(self, seconds: float, late: float = 0.0, frame: str = "odom") -> None:
        for _ in range(round(seconds / 0.1)):
            self.now = round(self.now + 0.1, 9)
            if "/odom" in self.network.wires:
                self.odom()
            self.see(frame, late)

    def sent(self, name: str) -> Any:
        return self.network.wires[f"/wideberth/people/{name}"].gone[-1]

    def grid(self) -> OccupancyGrid:
        found = decode_message("nav_msgs/msg/OccupancyGrid", self.sent("grid")).content
        assert isinstance(found, OccupancyGrid)
        return found


def middle(grid: OccupancyGrid) -> np.ndarray:
    """Centre of the cells that are covered, m."""
    rows, columns = np.nonzero(grid.cells == 100)
    return np.asarray(grid.map_to_world(np.stack([columns, rows], axis=1)).mean(axis=0))


@pytest.mark.parametrize("late", [0.0, 0.3])
@pytest.mark.parametrize("shift", [0.0, -0.4, -300.0])
def test_a_person_is_drawn_where_it_is_by_now(late: float, shift: float) -> None:
    """Seen ``late`` s ago at v, it is ahead of there by as much times v, whatever clock says.

    A clock of the others that is off by less than a second cannot be known from one that is late.
    """
    loop = Loop()
    loop.shift = shift
    loop.walk(2.0, late)
    loop.now += 0.3
    assert loop.node.publish() and loop.node.status == WELL
    own = loop.now - (shift if abs(shift) < 1.0 else 0.0)
    wanted = loop.person(own) + 0.5 * 0.2 * VELOCITY  # now and a step on
    assert middle(loop.grid()) == pytest.approx(wanted, abs=0.03)
    stamp = loop.sent("grid").header.stamp
    assert stamp.sec + 1e-9 * stamp.nanosec == pytest.approx(EPOCH + loop.now)
    assert loop.sent("grid").header.frame_id == "odom"


def test_all_messages_say_the_same() -> None:
    loop = Loop(cells=ForecastCells(1.0, 0.25))
    loop.walk(2.0)
    loop.node.publish()
    grid, cloud = loop.grid(), loop.sent("points")
    points = np.frombuffer(cloud.data.tobytes(), np.float32).reshape(-1, 3)
    assert (grid.at(points[:, :2], outside=0) == 100).all() and (points[:, 2] == HEIGHT).all()
    assert len(points) == (grid.cells == 100).sum() > 50
    decoded = decode_message("mpc_planner_msgs/msg/ObstacleArray", loop.sent("gaussians"))
    assert isinstance(decoded.content, ObstaclesMessage)
    (one,) = decoded.content.seen
    assert one.forecast is not None and one.forecast.mean.shape == (1, 4, 2)
    wanted = loop.person() + 0.25 * np.arange(1, 5)[:, None] * VELOCITY
    assert one.forecast.mean[0] == pytest.approx(wanted, abs=0.02)
    assert one.pose[:2] == pytest.approx(loop.person(), abs=0.02)
    markers = loop.sent("markers").markers
    assert len(markers) == 1 + 5 and markers[1].pose.position.x == pytest.approx(
        loop.person()[0], abs=0.02
    )
    assert loop.node.counts.published == 1 and len(loop.node.counts.spent) == 1


def test_the_grid_follows_the_robot_by_whole_cells() -> None:
    loop = Loop(area=RobotArea(width=4.0, height=2.0), resolution=0.1)
    corners = []
    for x in (0.0, 0.43, 7.77):
        loop.walk(0.1)
        loop.odom(x)
        loop.node.publish()
        grid = loop.grid()
        assert (grid.width, grid.height) == (40, 20)
        assert abs(grid.origin[0] + 2.0 - x) <= 0.05 + 1e-9 and grid.origin[1] == -1.0
        corners.append(grid.origin[0])
    assert np.abs(np.array(corners) * 10 - np.round(np.array(corners) * 10)).max() < 1e-6


def test_a_fixed_area_needs_no_odometry_and_places_people_by_tf() -> None:
    area = FixedArea("map", -6.0, -6.0, 12.0, 12.0)
    loop = Loop(area=area)
    assert "/odom" not in loop.network.wires
    loop.come("/tf_static", transform(EPOCH, "map", "camera", (1.0, 2.0, np.pi / 2)))
    loop.walk(1.5, frame="camera")
    loop.node.publish()
    x, y = loop.person() + 0.1 * VELOCITY
    assert middle(loop.grid()) == pytest.approx([1.0 - y, 2.0 + x], abs=0.03)
    assert loop.grid().origin == (-6.0, -6.0) and loop.sent("grid").header.frame_id == "map"
    assert loop.sent("grid").header.stamp.sec == EPOCH + 6


def test_it_says_what_is_silent_and_forgets_who_is_gone() -> None:
    loop = Loop()
    assert not loop.node.publish() and loop.node.status == "waiting for odometry"
    loop.odom()
    assert not loop.node.publish() and loop.node.status == "waiting for obstacles"
    loop.walk(1.0)
    loop.node.publish()
    covered = [int((loop.grid().cells == 100).sum())]
    last = loop.now
    for silent in (0.6, KEPT - 0.7, KEPT + 0.2):
        loop.now = last + silent
        loop.odom()
        loop.node.publish()
        assert loop.node.status.startswith("obstacles are silent")
        covered.append(int((loop.grid().cells == 100).sum()))
    assert covered[0] < covered[1] < covered[2] and covered[3] == 0
    loop.node.publish_diagnostics()
    status = loop.network.wires["/diagnostics"].gone[-1].status[0]
    assert status.level == 1 and "silent" in status.message
    loop.now += 1.0
    loop.node.publish()
    assert loop.node.status.startswith("odometry is silent")


def test_messages_of_no_use_are_counted() -> None:
    loop = Loop()
    loop.walk(0.5)
    refused = loop.node.counts.refused
    loop.see("unknown")
    loop.come("/obstacles", odometry(EPOCH, (0, 0, 0), (0, 0, 0)))
    loop.come("/odom", odometry(EPOCH, (np.nan, 0, 0), (0, 0, 0)))
    assert loop.node.counts.refused == refused + 3
    assert loop.node.publish() and "unknown" in loop.node.status
    loop.node.publish_diagnostics()


class Broken(Predictor):
    """Raises."""

    def predict(self, tracks: Any, steps: int, scene: Any = None) -> Forecast:
        raise ValueError("broken")


def test_a_predictor_that_raises_ends_nothing() -> None:
    loop = Loop(Broken())
    loop.walk(0.5)
    assert not loop.node.publish() and "broken" in loop.node.status
    assert loop.node.counts.failures == 1


@pytest.mark.parametrize("name", BUILT_IN)
def test_every_predictor_forecasts(name: str) -> None:
    loop = Loop(build("predictors", name, "predictor"), cells=ForecastCells(1.0, 0.25))
    loop.walk(2.0)
    assert loop.node.publish() and loop.node.status == WELL and not loop.node.counts.refused
    assert loop.grid().at(loop.person(), outside=0) == 100
    loop.node.publish_diagnostics()
    said = {
        one.key: one.value for one in loop.network.wires["/diagnostics"].gone[-1].status[0].values
    }
    assert name not in ("oracle", "kalman") or ("by another method" in said) == (name == "oracle")


def test_clocks_that_tremble_forget_no_one() -> None:
    """Without stamps that agree, the instant is that of arrival, which comes early and late."""
    loop, rng = Loop(), np.random.default_rng(5)
    loop.shift = -300.0
    for _ in range(40):
        loop.now = round(loop.now + 0.1, 9)
        late = float(rng.uniform(0.0, 0.05))
        loop.shift = -300.0 - late
        loop.odom()
        loop.see()
        assert loop.node.publish()
    decoded = decode_message("mpc_planner_msgs/msg/ObstacleArray", loop.sent("gaussians"))
    assert isinstance(decoded.content, ObstaclesMessage)
    (one,) = decoded.content.seen
    assert one.forecast is not None
    assert one.forecast.mean[0, 0] == pytest.approx(loop.person(loop.now + 0.2), abs=0.15)


def test_scans_are_tracked_and_forecast() -> None:
    loop = Loop(sees=ScanTopic())
    loop.come("/tf_static", transform(EPOCH, "base_link", "laser", (0.0, 0.0, 0.0)))
    bearings = 2.0 * np.pi / 360 * np.arange(360) - np.pi
    rays = np.stack([np.cos(bearings), np.sin(bearings)], axis=1)
    for _ in range(25):
        loop.now = round(loop.now + 0.1, 9)
        loop.odom()
        along = rays @ loop.centre()
        inside = 0.3**2 - loop.centre() @ loop.centre() + along**2
        met = (along > 0.0) & (inside > 0.0)
        ranges = np.where(met, along - np.sqrt(np.maximum(inside, 0.0)), 9.0)
        scan = Scan("laser", np.zeros(360), np.asarray(bearings), np.asarray(ranges), longest=20.0)
        encoder = MessageEncoder(round(1e9 * (EPOCH + loop.now)), "laser")
        loop.come("/scan", encoder.scan(scan, "laser"))
    assert loop.node.publish(), loop.node.status
    grid = loop.grid()
    assert grid.at(loop.centre(), outside=0) == 100 and (grid.cells == 100).mean() < 0.1


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({"topics": "people"}, "forecast.topics"),
        ({"rate": 0.0}, "forecast.rate"),
        ({"resolution": 1e-4}, "forecast.area"),
        ({"resolution": 50.0}, "forecast.area"),
    ],
)
def test_settings_out_of_range_are_refused(wrong: dict[str, Any], words: str) -> None:
    with pytest.raises(WideberthError, match=words):
        ForecastSettings(**wrong)
    with pytest.raises(WideberthError, match="width"):
        RobotArea(width=0.0)
    with pytest.raises(WideberthError, match="area"):
        FixedArea(x=np.nan)


def test_the_example_is_read() -> None:
    predictor, settings = read_forecast(EXAMPLE, ["forecast.sees={type: scans, topic: /front}"])
    assert isinstance(predictor, Kalman) and isinstance(settings.sees, ScanTopic)
    assert settings.area == RobotArea() and settings.shape == (200, 200)
    area = "forecast.area={type: fixed, frame: world, x: 1.0}"
    assert read_forecast(EXAMPLE, [area])[1].area == FixedArea("world", 1.0)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ("planner=mpc", "planner"),
        ("forecast.rats=3", "did you mean 'rate'"),
        ("forecast.area=map", "fixed, robot"),
        ("predictor=kalmann", "did you mean 'kalman'"),
        ("forecast.cells.tail=2", "tail"),
    ],
)
def test_a_config_that_is_wrong_is_refused(change: str, words: str) -> None:
    with pytest.raises(WideberthError, match=words):
        read_forecast(EXAMPLE, [change])

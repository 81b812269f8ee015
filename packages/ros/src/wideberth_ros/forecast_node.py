"""Forecasts of people on a network of ROS 2, as other planners can use them."""

import logging
from collections.abc import Callable, Sequence
from contextlib import nullcontext, suppress
from dataclasses import dataclass, field
from functools import partial
from time import perf_counter
from typing import Any, final

import numpy as np

from wideberth.framework.predictor import Predictor
from wideberth.framework.values.arrays import Array, checked, positive
from wideberth.framework.values.errors import WideberthError, short
from wideberth.framework.values.forecast import Forecast
from wideberth.framework.values.motion import Detection, Observation
from wideberth.framework.values.occupancy_grid import OccupancyGrid
from wideberth.framework.values.sensing import Scan
from wideberth.framework.values.tracks import Tracks
from wideberth.predictors.core.forecaster import Forecaster
from wideberth_nav2.forecast_cells import ForecastCells

from .decoding import DecodedMessage, OdometryMessage, Transforms, decode_message
from .encoding import MessageEncoder
from .link import RosLink, Transport, ros, ros_process
from .node import MOST_BEAMS
from .obstacle_sources import (
    LASERSCAN,
    ObstacleSource,
    ObstacleTopic,
    ScanSource,
    ScanTopic,
    TopicSource,
    check_topic,
)
from .own_motion import OLDEST, OwnMotion, ReceivedMessage

PERIOD = 0.2
"""s, that are meant to lie between two messages of obstacles."""
MOST_CELLS = 4_000_000
"""Of a grid; more means that a unit is wrong."""
HEIGHT = 0.5
"""m, of the points: Nav2's obstacle layer takes those from 0 to 2 m."""
TOPICS = {
    "grid": "nav_msgs/msg/OccupancyGrid",
    "points": "sensor_msgs/msg/PointCloud2",
    "markers": "visualization_msgs/msg/MarkerArray",
    "gaussians": "mpc_planner_msgs/msg/ObstacleArray",
}
"""Last part of a topic -> type of its messages."""
KEPT = "grid"
"""The one whose last message is given to who joins later, too: a static layer asks for it."""
NAME = "wideberth_forecast"
"""Of the node, where ``-r __node:=NAME`` states no other."""
WELL = "forecasting"
"""The status of a node where all is well."""
_LOG = logging.getLogger("wideberth")


@final
@dataclass(frozen=True)
class RobotArea:
    """A rectangle that moves with a robot, which is in its middle; its axes are the odometry's.

    Parameters
    ----------
    odometry : topic of `nav_msgs/msg/Odometry`. base_frame : of the robot.
    width, height : m.

    Raises
    ------
    WideberthError : no topic, a length that is not above zero.
    """

    odometry: str = "/odom"
    base_frame: str = "base_link"
    width: float = 10.0
    height: float = 10.0

    def __post_init__(self) -> None:
        check_topic("forecast.area.odometry", self.odometry)
        for name in ("width", "height"):
            positive(f"forecast.area.{name}", getattr(self, name))


@final
@dataclass(frozen=True)
class FixedArea:
    """A rectangle that stands still in a frame; no odometry is needed.

    Parameters
    ----------
    frame : as in "map". x, y : m, of its lower left corner. width, height : m.

    Raises
    ------
    WideberthError : a length that is not above zero, a number that is not finite.
    """

    frame: str = "map"
    x: float = -5.0
    y: float = -5.0
    width: float = 10.0
    height: float = 10.0

    def __post_init__(self) -> None:
        checked("forecast.area.x and .y", (self.x, self.y), (2,))
        for name in ("width", "height"):
            positive(f"forecast.area.{name}", getattr(self, name))


@final
@dataclass(frozen=True)
class ForecastSettings:
    """Topics, rate and contents of a `ForecastNode`.

    Parameters
    ----------
    sees : where people come from.
    area : of the grid and the points.
    resolution : m, side of a cell.
    cells : which of them a forecast covers.
    topics : their beginning; behind it are ``/grid``, ``/points``, ``/markers``, ``/gaussians``.
    rate : Hz, at which forecasts are published.
    patience : s, for which people or odometry may be silent; then the diagnostics warn.

    Raises
    ------
    WideberthError : no topic, a number that is out of range, too many cells.
    """

    sees: ObstacleTopic | ScanTopic = field(default_factory=ObstacleTopic)
    area: RobotArea | FixedArea = field(default_factory=RobotArea)
    resolution: float = 0.05
    cells: ForecastCells = field(default_factory=ForecastCells)
    topics: str = "/wideberth/people"
    rate: float = 10.0
    patience: float = 0.5

    def __post_init__(self) -> None:
        check_topic("forecast.topics", self.topics)
        for name in ("resolution", "rate", "patience"):
            positive(f"forecast.{name}", getattr(self, name))
        if not 0 < np.prod(self.shape, dtype=np.float64) <= MOST_CELLS:
            raise WideberthError(
                f"forecast.area has {self.shape[0]} x {self.shape[1]} cells; wanted at least one "
                f"and at most {MOST_CELLS}"
            )

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns of the grid."""
        return tuple(round(one / self.resolution) for one in (self.area.height, self.area.width))  # type: ignore[return-value]


@final
@dataclass
class ForecastCounts:
    """What a node has done so far.

    Attributes
    ----------
    published, seen : forecasts, and messages of people that were of use.
    refused : messages that were malformed or of no use. failures : forecasts that raised.
    spent : s, that the last forecasts took, their messages included.
    """

    published: int = 0
    seen: int = 0
    refused: int = 0
    failures: int = 0
    spent: list[float] = field(default_factory=list)


@final
class ForecastNode:
    """Takes people in, and publishes where they may be from now on.

    A forecast is for the instants k dt after the node's clock at which it is published, however
    old the last message of people is: its age is forecast, too. `publish` is called at a rate;
    neither it nor a message raises.

    Parameters
    ----------
    predictor : of the people.
    settings : topics and rate.
    link : the network.
    wall : ns, the node's clock.
    """

    def __init__(
        self,
        predictor: Predictor,
        settings: ForecastSettings,
        link: Transport,
        wall: Callable[[], int],
    ) -> None:
        self.settings: ForecastSettings = settings
        self.counts: ForecastCounts = ForecastCounts()
        self.status: str = "waiting for odometry"
        """What it does now, or waits for."""
        self._known, self._wall = link.known, wall
        self._predictor = predictor
        self._forecaster = Forecaster(predictor, PERIOD)
        self._taken: ReceivedMessage | None = None
        self._instead: list[str] = []
        self._now = -np.inf
        area, sees, lock = settings.area, settings.sees, nullcontext()
        base = area.base_frame if isinstance(area, RobotArea) else area.frame
        self._own = OwnMotion(base)
        self._source: ObstacleSource = (
            TopicSource(sees, self._own, lock, self._refuse)
            if isinstance(sees, ObstacleTopic)
            else ScanSource(sees, self._own, 0.0, False, lock, self._refuse)
        )
        self._open_topics(link)

    def _open_topics(self, link: Transport) -> None:
        """Open all topics."""
        s, tf = self.settings, "tf2_msgs/msg/TFMessage"
        kind = s.sees.kind if isinstance(s.sees, ObstacleTopic) else LASERSCAN
        come: list[tuple[str, str, bool]] = [
            ("/tf", tf, False), ("/tf_static", tf, True), (s.sees.topic, kind, False),
        ]  # fmt: skip
        if isinstance(s.area, RobotArea):
            come.append((s.area.odometry, "nav_msgs/msg/Odometry", False))
        for topic, kind, kept in come:
            link.subscriber(topic, kind, self._taker(kind), reliable=kept, kept=kept)
        self._to = {
            name: link.publisher(f"{s.topics}/{name}", kind, kept=name == KEPT)
            for name, kind in TOPICS.items()
            if kind in link.known
        }
        self._diagnostics = link.publisher("/diagnostics", "diagnostic_msgs/msg/DiagnosticArray")

    def _taker(self, kind: str) -> Callable[[Any], None]:
        """Return what takes messages of a type."""

        def take(message: Any) -> None:
            try:
                self._take(decode_message(kind, message))
            except Exception as error:  # whatever a message holds, the node goes on
                self._refuse(short(str(error)))

        return take

    def _take(self, decoded: DecodedMessage) -> None:
        content, stamp = decoded.content, self._wall()
        came = 1e-9 * stamp
        if isinstance(content, Transforms):
            return self._own.take_frames(content)
        if isinstance(content, OdometryMessage):
            return self._own.take(decoded, came)
        if isinstance(content, Scan) and len(content.ranges) > MOST_BEAMS:
            return self._refuse(f"a scan of {len(content.ranges)} beams is too long")
        now = self._instant(stamp)
        self._source.receive(decoded, came)
        self._source.process()
        placed = self._source.placed
        if not np.isfinite(now) or placed is None or placed is self._taken:
            return None
        self._taken, self.counts.seen = placed, self.counts.seen + 1
        view = self._source.view(self._own, now)
        for detections in (*view.earlier, view.detections):
            self._notice(Observation(now, self._own.pose, detections))
        return None

    def _notice(self, observation: Observation) -> None:
        for note in self._forecaster.take(observation, self._own.pose[:2], 0.0):
            self._refuse(note)

    def _refuse(self, why: str) -> None:
        self.counts.refused += 1
        if self.counts.refused in (1, 10, 100, 1000):
            _LOG.warning("forecast: refused %d; the last: %s", self.counts.refused, why)

    def _instant(self, stamp: int) -> float:
        """Return an instant of the node's clock, ns, on that of the odometry, s; NaN if unknown.

        By stamps, or where the odometry's is of another clock than the node's by when it came:
        that trembles, and does not go back unless a clock is set.
        """
        if isinstance(self.settings.area, FixedArea):
            still = OdometryMessage("", np.zeros(3), np.zeros(3))
            self._own.take(DecodedMessage(stamp, self.settings.area.frame, still), 1e-9 * stamp)
        found = self._own.instant_of(stamp, 1e-9 * stamp)
        if abs(found - self._own.now) > OLDEST:
            found = self._own.instant_of(0, 1e-9 * stamp)
        if self._now - OLDEST < found < self._now:
            return self._now
        self._now = found if np.isfinite(found) else self._now
        return found

    def waits_for(self) -> str:
        """Return what is silent, and so what forecasts lack; "" where nothing is."""
        now, patience, seen = 1e-9 * self._wall(), self.settings.patience, self._source.newest
        what = "obstacles" if isinstance(self.settings.sees, ObstacleTopic) else "scans"
        if self._own.newest is None:
            return self._own.unplaced or "waiting for odometry"
        if now - self._own.newest.time > patience:
            return f"odometry is silent for {now - self._own.newest.time:.2g} s"
        if seen is None:
            return f"waiting for {what}"
        if now - seen.time > patience:
            return f"{what} are silent for {now - seen.time:.2g} s"
        return self._source.unplaced

    def publish(self) -> bool:
        """Publish forecasts from now on; return whether there were any to publish."""
        begin = perf_counter()
        try:
            done = self._publish()
        except Exception as error:  # whatever a predictor raises, the node goes on
            self.counts.failures += 1
            self.status = f"no forecast: {short(str(error))}"
            return False
        if done:
            self.counts.published += 1
            self.counts.spent = [*self.counts.spent[-999:], perf_counter() - begin]
        return done

    def _publish(self) -> bool:
        stamp = self._wall()
        now = self._instant(stamp)
        self.status = self.waits_for() or WELL
        if not np.isfinite(now) or self._source.newest is None:
            return False
        self._notice(Observation(now, self._own.pose))  # who is silent for long is dropped
        found = self._forecaster.at(now, self.settings.cells.times)
        self._instead = [] if found is None else [why for why in found[1].fallback if why]
        encoder = MessageEncoder(stamp - round(1e9 * now), self._own.frame, self._known)
        messages = self._messages(encoder, now, found)
        for name, topic in self._to.items():
            if name == KEPT or topic.has_subscribers:
                topic.send(messages[name]())
        return True

    def _messages(
        self, encoder: MessageEncoder, now: float, found: tuple[Tracks, Forecast] | None
    ) -> dict[str, Callable[[], Any]]:
        """Return what makes the message of each topic."""
        cells = self.settings.cells
        names: Sequence[str] = ()
        forecast, radii = no_one(cells.times), np.zeros(0)
        if found is not None:
            names, forecast, radii = found[0].ids, found[1], found[0].radius
        grid = cells.on(self._blank(), forecast, radii)

        def points() -> Any:
            rows, columns = np.nonzero(grid.cells >= max(100.0 * cells.tail, 1.0))
            places = grid.map_to_world(np.stack([columns, rows], axis=1))
            return encoder.points(now, np.column_stack([places, np.full(len(places), HEIGHT)]))

        return {
            "grid": lambda: encoder.grid(now, grid),
            "points": points,
            "markers": lambda: encoder.spread(now, names, forecast, cells.tail),
            "gaussians": lambda: encoder.gaussians(now, names, forecast),
        }

    def _blank(self) -> OccupancyGrid:
        """Return an empty grid where the area is; one that moves does so by whole cells."""
        area, side = self.settings.area, self.settings.resolution
        high, wide = self.settings.shape
        corner = (
            np.array([area.x, area.y])
            if isinstance(area, FixedArea)
            else (side * np.round(self._own.pose[:2] / side - 0.5 * np.array([wide, high])))
        )
        return OccupancyGrid(np.zeros((high, wide), np.int8), side, tuple(corner))

    def warm_up(self) -> None:
        """Import and compile what forecasts need, before the first is due."""
        here, still = np.zeros(3), Detection("", np.zeros(2), 0.01 * np.eye(2), 0.3)
        cells, forecaster = self.settings.cells, Forecaster(self._predictor, PERIOD)
        with suppress(Exception):  # it goes wrong again in `publish`, which says so
            self._source.warm_up()
            for tick in range(3):
                forecaster.take(Observation(PERIOD * tick, here, (still,)), here[:2], 0.0)
            found = forecaster.at(2 * PERIOD, cells.times)
            assert found is not None
            cells.on(OccupancyGrid(np.zeros((2, 2)), 0.1), found[1], np.array([0.3]))

    def publish_diagnostics(self) -> None:
        """Publish diagnostics."""
        counts = self.counts
        numbers = {name: str(getattr(counts, name)) for name in ("published", "seen", "refused",
                                                                 "failures")}  # fmt: skip
        if counts.spent:
            numbers["forecast median, ms"] = f"{1e3 * float(np.median(counts.spent)):.1f}"
        if self._source.unnamed:
            numbers["without an identity"] = str(self._source.unnamed)
        if self._instead:
            numbers["by another method"] = f"{len(self._instead)}, {short(self._instead[0])}"
        encoder = MessageEncoder(0, "", self._known)
        level = 0 if self.status == WELL else 1
        self._diagnostics.send(
            encoder.diagnostics(
                1e-9 * self._wall(), "wideberth: forecasts", level, self.status, numbers
            )
        )


def no_one(times: Array) -> Forecast:
    """Return a forecast of no one at some times, (N,) s."""
    return Forecast.single(np.zeros((0, len(times), 2)), np.zeros((0, len(times), 2, 2)), 1.0)


def run_forecasts(
    predictor: Predictor,
    settings: ForecastSettings,
    arguments: Sequence[str] = (),
    seconds: float | None = None,
) -> ForecastNode:
    """Run a node of forecasts until it is stopped; return it.

    Parameters
    ----------
    predictor, settings : as of `ForecastNode`.
    arguments : for ROS, as in ``["--ros-args", "-p", "use_sim_time:=true"]``.
    seconds : after which it stops; None for never.

    Raises
    ------
    WideberthError : ROS 2 is not found.
    """
    with ros_process(arguments) as process:
        own = ros("rclpy").create_node(NAME)
        wall = partial(_nanoseconds, own.get_clock())
        node = ForecastNode(predictor, settings, RosLink(own), wall)
        node.warm_up()
        own.create_timer(1.0 / settings.rate, node.publish)
        own.create_timer(1.0, node.publish_diagnostics)
        executor = ros("rclpy.executors").SingleThreadedExecutor()
        executor.add_node(own)
        process.spin(executor, seconds)
        own.destroy_node()
    return node


def _nanoseconds(clock: Any) -> int:
    return int(clock.now().nanoseconds)

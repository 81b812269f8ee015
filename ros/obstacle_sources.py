"""Where a node gets its obstacles from: messages that hold them, or scans of a LiDAR."""

from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from copy import deepcopy
from dataclasses import dataclass, field, replace
from functools import partial
from math import inf
from typing import Any, Literal, Protocol, final

import numpy as np

from ..framework.detector import Detector
from ..framework.plugins.config import build
from ..framework.plugins.registry import unknown
from ..framework.tracker import Tracker
from ..framework.values.arrays import LATEST, Array, positive
from ..framework.values.errors import WideberthError
from ..framework.values.motion import Detection
from ..framework.values.polygon import Polygon
from ..framework.values.sensing import PlacedScan, Scan, Sightings, beams_of
from ..perception.handover import Batch, Handover
from ..perception.walls import walls_behind
from .decoding import OBSTACLES, DecodedMessage, ObstacleMessage, ObstaclesMessage
from .frames import composed
from .own_motion import OwnMotion, ReceivedMessage

MOST_SEEN = 500
"""Obstacles of one message that are looked at, the nearest first."""
WAITING = 10
"""Scans that wait to be looked at; of more the oldest are left out."""
LASERSCAN = "sensor_msgs/msg/LaserScan"
UNKNOWN_POSE = "a scan is of a time at which the robot's own pose is not known"

Refuse = Callable[[str], None]
"""Counts something that is of no use, with the reason."""


@final
@dataclass(frozen=True)
class ObstacleTopic:
    """A topic of obstacles that other software has detected and tracked.

    Parameters
    ----------
    topic : of the messages. kind : their type, one of `wideberth.ros.decoding.OBSTACLES`.
    radius : m, of obstacles whose size is not stated.
    deviation : m per axis, of obstacles whose covariance is not stated; 0 where places are exact.

    Raises
    ------
    WideberthError : no topic, a type that is not known, a number that is out of range.
    """

    topic: str = "/obstacles"
    kind: str = "nav2_dynamic_msgs/msg/ObstacleArray"
    radius: float = 0.3
    deviation: float = 0.05

    def __post_init__(self) -> None:
        check_topic("node.sees.topic", self.topic)
        if self.kind not in OBSTACLES:
            raise WideberthError(unknown("obstacle type", self.kind, sorted(OBSTACLES)))
        positive("node.sees.radius", self.radius)
        if not 0.0 <= self.deviation < inf:
            raise WideberthError(f"node.sees.deviation is {self.deviation}; wanted 0 m or more")


@final
@dataclass(frozen=True, eq=False)
class ScanTopic:
    """A topic of `sensor_msgs/msg/LaserScan`, in which we detect and track obstacles ourselves.

    Parameters
    ----------
    topic : of the scans. The frame of a scan has to be connected with the robot's by tf.
    detector : finds bodies in a scan.
    tracker : gives them identities and velocities.
    handover : how the controller is given the tracked obstacles, see
        `wideberth.perception.handover.Handover`.
    deviation : m, standard deviation of a range, which the messages do not state.

    Raises
    ------
    WideberthError : no topic, another handover, a deviation that is not above zero.
    """

    topic: str = "/scan"
    detector: Detector = field(default_factory=partial(build, "detectors", "discs"))
    tracker: Tracker = field(default_factory=partial(build, "trackers", "nearest"))
    handover: Literal["measured", "filtered"] = "filtered"
    deviation: float = 0.01

    def __post_init__(self) -> None:
        check_topic("node.sees.topic", self.topic)
        Handover(self.handover)
        positive("node.sees.deviation", self.deviation)


def check_topic(label: str, topic: str) -> None:
    """Refuse what is no name of a topic.

    Raises
    ------
    WideberthError : it is not.
    """
    if not topic.startswith("/"):
        raise WideberthError(f"{label} is {topic!r}; wanted a topic, as in '/odom'")


@final
@dataclass(frozen=True, eq=False)
class ScanView:
    """What a node knows of its surroundings at the instant of its newest odometry.

    Attributes
    ----------
    detections : the obstacles.
    earlier : measurements that the controller should remember first, oldest first.
    polygons : what stands still.
    scan : newest one, with the pose that it was cast from.
    """

    detections: Batch = ()
    earlier: tuple[Batch, ...] = ()
    polygons: tuple[Polygon, ...] = ()
    scan: PlacedScan | None = None


class ObstacleSource(Protocol):
    """Turns the messages of one topic into obstacles.

    `receive` and `view` are called under the node's lock, `process` is not: it may take long.

    Attributes
    ----------
    newest : the last message. placed : the last one whose place is known, so that it is of use.
    unplaced : why the last message that was processed could not be placed; "" where it could.
    """

    newest: ReceivedMessage | None
    placed: ReceivedMessage | None
    unplaced: str

    def receive(self, decoded: DecodedMessage, came: float) -> None:
        """Take a message."""
        ...

    def process(self) -> None:
        """Process the messages that have come."""
        ...

    def view(self, own: OwnMotion, now: float | None = None) -> ScanView:
        """Return what is known, in the frame of the odometry.

        Parameters
        ----------
        own : poses of the robot. now : s on their clock, from which ages count; by default the
            instant of the newest odometry.
        """
        ...

    def warm_up(self) -> None:
        """Import and compile what `process` needs, and change nothing."""
        ...


@final
class TopicSource:
    """Obstacles as other software reports them.

    Parameters
    ----------
    settings : the topic. own : poses of the robot, and the motions between frames.
    lock : held while ``own`` is read.
    refuse : called with the reason for each message that is of no use.
    """

    def __init__(
        self,
        settings: ObstacleTopic,
        own: OwnMotion,
        lock: AbstractContextManager[Any],
        refuse: Refuse,
    ) -> None:
        self.newest: ReceivedMessage | None = None
        self.placed: ReceivedMessage | None = None
        self.unplaced: str = ""
        self._settings, self._own, self._lock, self._refuse = settings, own, lock, refuse
        self._refused: ReceivedMessage | None = None

    def receive(self, decoded: DecodedMessage, came: float) -> None:
        """Take a message; the one before is forgotten."""
        self.newest = ReceivedMessage(decoded, came)

    def process(self) -> None:
        """Find out whether the newest message can be placed."""
        with self._lock:
            if self.newest is not None and self._own.newest is not None:
                self._frame_of(self.newest)

    def _frame_of(self, received: ReceivedMessage) -> Array | None:
        """Return the pose of a message's frame in that of the odometry; None if it is unknown.

        Either is noted in `placed` and `unplaced`.
        """
        frame = self._own.placed(received.decoded.frame)
        if frame is not None:
            self.placed, self.unplaced = received, ""
            return frame
        self.unplaced = f"no motion connects {received.decoded.frame!r} with odometry"
        if received is not self._refused:
            self._refused = received
            self._refuse(self.unplaced)
        return None

    def view(self, own: OwnMotion, now: float | None = None) -> ScanView:
        """Return the obstacles of the last message that was placed, in the odometry's frame."""
        received = self.placed
        if received is None or (frame := own.placed(received.decoded.frame)) is None:
            self.placed = None  # the odometry has another frame by now
            return ScanView()
        assert isinstance(received.decoded.content, ObstaclesMessage)
        seen = received.decoded.content.seen[: 10 * MOST_SEEN]
        age = max((own.now if now is None else now) - own.instant(received), 0.0)
        with np.errstate(over="ignore", invalid="ignore"):  # controllers leave out what is absurd
            found = self._placed_in(frame, seen, own, age)
        return ScanView(tuple({one.ident: one for one in found}.values()))

    def _placed_in(
        self, frame: Array, seen: Sequence[ObstacleMessage], own: OwnMotion, age: float
    ) -> list[Detection]:
        """Return the nearest of some obstacles of a frame whose pose is known, (3,)."""
        places = composed(frame, np.array([one.pose for one in seen]).reshape(-1, 3))[:, :2]
        away = np.hypot(*(places - own.poses(np.array([own.now]))[0, :2]).T)
        cosine, sine = np.cos(frame[2]), np.sin(frame[2])
        turn = np.array([[cosine, -sine], [sine, cosine]])
        found = []
        for i in sorted(np.argsort(away, kind="stable")[:MOST_SEEN]):
            one = seen[i]
            spread = one.covariance
            if spread is None:
                spread = self._settings.deviation**2 * np.eye(2)
            radius = one.radius if np.isfinite(one.radius) else self._settings.radius
            name = one.ident or f"unnamed {i}"
            found.append(Detection(name, places[i], turn @ spread @ turn.T, radius, age))
        return found

    def warm_up(self) -> None:
        """Do nothing: other software has detected and tracked."""


@final
class ScanSource:
    """Obstacles that a detector and a tracker find in scans.

    The tracker lives on the clock of the odometry's stamps. Each beam is placed by the pose of
    its own instant.

    Parameters
    ----------
    settings : the topic, the detector, the tracker; copies of both are used.
    own : poses of the robot. gap : m, as of `wideberth.perception.walls.walls_behind`.
    walls : whether the controller is given what stands still, as polygons.
    lock : held while ``own`` is read.
    refuse : called with the reason for each message that is of no use.
    """

    def __init__(
        self,
        settings: ScanTopic,
        own: OwnMotion,
        gap: float,
        walls: bool,
        lock: AbstractContextManager[Any],
        refuse: Refuse,
    ) -> None:
        self.newest: ReceivedMessage | None = None
        self.placed: ReceivedMessage | None = None
        self.unplaced: str = ""
        self._settings, self._own, self._gap, self._walls = settings, own, gap, walls
        self._lock, self._refuse = lock, refuse
        self._detector, self._tracker = deepcopy((settings.detector, settings.tracker))
        self._detector.reset()
        self._tracker.reset()
        self._handover = Handover(settings.handover)
        self._waiting: list[ReceivedMessage] = []
        self._polygons: tuple[Polygon, ...] = ()
        self._scan: PlacedScan | None = None
        self._met: tuple[ReceivedMessage | None, Array, float] = None, np.zeros((0, 2)), -np.inf

    def receive(self, decoded: DecodedMessage, came: float) -> None:
        """Take a scan; it waits until it is processed."""
        self.newest = ReceivedMessage(decoded, came)
        self._waiting.append(self.newest)
        if len(self._waiting) > WAITING:
            self._waiting.pop(0)
            self._refuse("scans come faster than they are processed")

    def process(self) -> None:
        """Detect and track in the scans that have come."""
        with self._lock:
            waiting, self._waiting = self._waiting, []
        for received in waiting:
            with self._lock:
                found = self._placed_scan(received)
                if isinstance(found, str) and self._own.newest is not None:
                    self._leave_out(found)
            if not isinstance(found, str):
                self._conclude(received, *found)

    def points(self) -> tuple[Array, float]:
        """Return what the newest scan of known place has met, and when.

        Scans count as they come, before they are processed, which may take long.

        Returns
        -------
        points : (N, 2), m, in the frame of the odometry.
        instant : s, on the clock of the odometry's stamps; -inf where no scan has been placed.
        """
        newest = self.newest
        if newest is not None and newest is not self._met[0]:
            found = self._placed_scan(newest)
            if not isinstance(found, str):
                ends = beams_of(*found).ends
                instant = float(found[0].times[-1])
                self._met = newest, ends[np.isfinite(ends).all(axis=1)], instant
        return self._met[1:]

    def _placed_scan(self, received: ReceivedMessage) -> tuple[Scan, Array] | str:
        """Return a scan on our clock, with the robot's pose of each beam, or why not."""
        scan, frame = received.decoded.content, received.decoded.frame
        assert isinstance(scan, Scan)
        mount = self._own.mount(frame)
        if mount is None:
            return f"no motion connects the scan's frame {frame!r} with the robot"
        if not len(scan.times):
            return "a scan has no beams"
        times = self._own.instant(received, float(scan.times[-1])) + scan.times
        poses = self._own.poses(times)
        if not np.isfinite(poses).any() or not (np.abs(times) <= LATEST).all():
            return UNKNOWN_POSE
        deviation = self._settings.deviation
        return replace(scan, times=times, mount=mount, deviation=deviation), poses

    def _leave_out(self, reason: str) -> None:
        """Count a scan that cannot be placed."""
        self.unplaced = reason
        self._refuse(reason)

    def _conclude(self, received: ReceivedMessage, scan: Scan, poses: Array) -> None:
        """Look for obstacles in a scan, and track them."""
        sightings: Sightings = self._detector.detect(scan, poses)
        reason = self._tracker.update(sightings) if np.isfinite(sightings.time) else ""
        with self._lock:
            for note in (sightings.note, reason):
                if note:
                    self._refuse(note)
            if not np.isfinite(poses[-1]).all():
                return self._leave_out(UNKNOWN_POSE)
            self.placed, self.unplaced = received, ""
            self._scan = PlacedScan(scan, poses[-1])
            if self._walls:
                sensor = poses[-1, :2] if sightings.origin is None else sightings.origin
                self._polygons = walls_behind(sightings.segments, sensor, self._gap)
        return None

    def view(self, own: OwnMotion, now: float | None = None) -> ScanView:
        """Return the tracked obstacles, carried on to now."""
        now = own.now if now is None else now
        self._handover, earlier, present = self._handover.detections(self._tracker.at(now), now)
        return ScanView(present, earlier, self._polygons, self._scan)

    def warm_up(self) -> None:
        """Detect and track with copies in scans that are made up: a body before a wall."""
        detector, tracker = deepcopy((self._detector, self._tracker))
        bearings = np.linspace(-np.pi, np.pi, 360, endpoint=False)
        ranges = np.where(np.abs(bearings) < 0.1, 2.0, 5.0)
        for tick in range(3):
            times = np.full(len(bearings), 0.1 * tick)
            scan = Scan("", times, bearings, ranges, self._settings.deviation)
            sightings = detector.detect(scan, np.zeros((len(bearings), 3)))
            tracker.update(sightings)
            walls_behind(sightings.segments, np.zeros(2), self._gap)
        self._handover.detections(tracker.at(0.2), 0.2)

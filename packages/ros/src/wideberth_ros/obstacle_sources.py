"""Where a node gets its obstacles from: messages that hold them, or scans of a LiDAR."""

from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from copy import deepcopy
from dataclasses import dataclass, field, replace
from functools import partial
from math import inf
from typing import Any, Literal, Protocol, final

import numpy as np

from wideberth.framework.plugins.config import build
from wideberth.framework.plugins.registry import unknown
from wideberth.framework.values.arrays import LATEST, Array, positive
from wideberth.framework.values.errors import WideberthError
from wideberth.framework.values.motion import Detection
from wideberth.framework.values.polygon import Polygon
from wideberth.framework.values.sensing import PlacedScan, Scan
from wideberth.simulation.sensing.perceived import Sightings
from wideberth_perception.detector import Detector
from wideberth_perception.handover import Batch, Handover
from wideberth_perception.tracker import Tracker
from wideberth_perception.walls import walls_behind

from .decoding import OBSTACLES, DecodedMessage, ObstacleMessage, ObstaclesMessage, mounted
from .frames import composed
from .naming import ObstacleNames
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
    topic : of the messages. kind : their type, one of `wideberth_ros.decoding.OBSTACLES`.
    radius : m, of obstacles whose size is not stated.
    deviation : m per axis, of obstacles whose covariance is not stated; 0 where places are exact.
    own_clock : whether the sender stamps by a clock of its own. Messages count as measured when
        they come then; else those that are late by their stamps are not used.

    Raises
    ------
    WideberthError : no topic, a type that is not known, a number that is out of range.
    """

    topic: str = "/obstacles"
    kind: str = "nav2_dynamic_msgs/msg/ObstacleArray"
    radius: float = 0.3
    deviation: float = 0.05
    own_clock: bool = False

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
        `wideberth_perception.handover.Handover`.
    deviation : m, standard deviation of a range, which the messages do not state.
    own_clock : as of `ObstacleTopic`.

    Raises
    ------
    WideberthError : no topic, another handover, a deviation that is not above zero.
    """

    topic: str = "/scan"
    detector: Detector = field(default_factory=partial(build, "detectors", "discs"))
    tracker: Tracker = field(default_factory=partial(build, "trackers", "nearest"))
    handover: Literal["measured", "filtered"] = "filtered"
    deviation: float = 0.01
    own_clock: bool = False

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

    @property
    def unnamed(self) -> int:
        """How many obstacles of the last message have no identity of their own."""
        ...

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
        self._names = ObstacleNames()
        self._waiting: ReceivedMessage | None = None
        self._named: ReceivedMessage | None = None
        """The last message of a known frame, however late, with a name for each obstacle."""
        self._refused: ReceivedMessage | None = None

    @property
    def unnamed(self) -> int:
        """How many obstacles of the last message that was placed have no identity of their own."""
        return self._names.count

    def receive(self, decoded: DecodedMessage, came: float) -> None:
        """Take a message; the one before is forgotten once this one is placed."""
        self.newest = self._waiting = ReceivedMessage(decoded, came)
        self._place()

    def process(self) -> None:
        """Place the newest message, if it is not yet; forget one whose place is lost."""
        with self._lock:
            self._place()

    def _place(self) -> None:
        """Place and name what waits; `placed` and `unplaced` say how that has ended."""
        if self._own.newest is None:
            return
        if self.placed is not None and (
            reason := self._lost(self.placed) or self._late(self.placed)
        ):
            self.placed, self.unplaced = None, reason
        received = self._waiting
        if received is None:
            return
        self.unplaced = self._lost(received)
        if not self.unplaced:
            self._named, self._waiting = self._with_names(received), None
            self.unplaced = self._late(received)
            self.placed = self.placed if self.unplaced else self._named
        if self.unplaced and received is not self._refused:
            self._refused = received
            self._refuse(self.unplaced)

    def _lost(self, received: ReceivedMessage) -> str:
        """Return why a message cannot be placed; "" where it can be."""
        frame = received.decoded.frame
        if self._own.placed(frame) is not None:
            return ""
        return self._own.flaw(frame) or f"no motion connects {frame!r} with odometry"

    def _late(self, received: ReceivedMessage) -> str:
        """Return why a message is not of now; "" where it is."""
        return self._own.untimely(self._own.instant(received, self._settings.own_clock))

    def _with_names(self, received: ReceivedMessage) -> ReceivedMessage:
        """Return a message with the nearest of its obstacles, each with a name of its own."""
        content, frame = received.decoded.content, self._own.placed(received.decoded.frame)
        assert isinstance(content, ObstaclesMessage) and frame is not None
        places = _places(frame, content.seen)
        away = np.hypot(*(places - self._own.poses(np.array([self._own.now]))[0, :2]).T)
        nearest = np.argsort(np.where(np.isfinite(away), away, -1.0), kind="stable")
        rows = np.sort(nearest[:MOST_SEEN])
        if len(rows) < len(places):
            self._refuse(f"{len(places) - len(rows)} obstacles beyond the nearest {len(rows)}")
        seen = [content.seen[i] for i in rows]
        instant = self._own.instant(received, self._settings.own_clock)
        names = self._names.named(instant, [one.ident for one in seen], places[rows])
        named = tuple(replace(one, ident=name) for one, name in zip(seen, names, strict=True))
        decoded = replace(received.decoded, content=ObstaclesMessage(named))
        return ReceivedMessage(decoded, received.time)

    def view(self, own: OwnMotion, now: float | None = None) -> ScanView:
        """Return the obstacles of the last message of a known frame, in the odometry's."""
        received = self._named
        if received is None or (frame := own.placed(received.decoded.frame)) is None:
            return ScanView()
        assert isinstance(received.decoded.content, ObstaclesMessage)
        seen, instant = (
            received.decoded.content.seen,
            own.instant(received, self._settings.own_clock),
        )
        age = max((own.now if now is None else now) - instant, 0.0)
        cosine, sine = np.cos(frame[2]), np.sin(frame[2])
        turn, found = np.array([[cosine, -sine], [sine, cosine]]), []
        with np.errstate(over="ignore", invalid="ignore"):  # controllers leave out what is absurd
            for one, place in zip(seen, _places(frame, seen), strict=True):
                spread = one.covariance
                if spread is None:
                    spread = self._settings.deviation**2 * np.eye(2)
                radius = self._settings.radius if one.radius is None else one.radius
                found.append(Detection(one.ident, place, turn @ spread @ turn.T, radius, age))
        return ScanView(tuple(found))

    def warm_up(self) -> None:
        """Do nothing: other software has detected and tracked."""


def _places(frame: Array, seen: Sequence[ObstacleMessage]) -> Array:
    """Return the places of obstacles of a frame with a pose (3,), (K, 2) m."""
    poses = np.array([one.pose for one in seen]).reshape(-1, 3)
    with np.errstate(over="ignore", invalid="ignore"):  # controllers leave out what is absurd
        return np.asarray(composed(frame, poses)[:, :2])


@final
class ScanSource:
    """Obstacles that a detector and a tracker find in scans.

    The tracker lives on the clock of the odometry's stamps. Each beam is placed by the pose of
    its own instant.

    Parameters
    ----------
    settings : the topic, the detector, the tracker; copies of both are used.
    own : poses of the robot. gap : m, as of `wideberth_perception.walls.walls_behind`.
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
        self.unnamed: int = 0
        """0: the tracker names all."""
        self._settings, self._own, self._gap, self._walls = settings, own, gap, walls
        self._lock, self._refuse = lock, refuse
        self._detector, self._tracker = deepcopy((settings.detector, settings.tracker))
        self._detector.reset()
        self._tracker.reset()
        self._handover = Handover(settings.handover)
        self._waiting: list[tuple[ReceivedMessage, str]] = []
        """Scans, and why each of them was of no use as it came."""
        self._polygons: tuple[Polygon, ...] = ()
        self._scan: PlacedScan | None = None
        self._met: tuple[ReceivedMessage | None, Array, float] = None, np.zeros((0, 2)), -np.inf

    def receive(self, decoded: DecodedMessage, came: float) -> None:
        """Take a scan; it waits until it is processed."""
        self.newest = ReceivedMessage(decoded, came)
        untimely = self._own.untimely(self._own.instant(self.newest, self._settings.own_clock))
        self._waiting.append((self.newest, untimely))
        if len(self._waiting) > WAITING:
            self._waiting.pop(0)
            self._refuse("scans come faster than they are processed")

    def process(self) -> None:
        """Detect and track in the scans that have come."""
        with self._lock:
            waiting, self._waiting = self._waiting, []
        for received, untimely in waiting:
            with self._lock:
                found = untimely or self._placed_scan(received)
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
                scan, poses = found
                ends = scan.beams(poses).ends
                instant = float(scan.times[-1])
                self._met = newest, ends[np.isfinite(ends).all(axis=1)], instant
        return self._met[1:]

    def _placed_scan(self, received: ReceivedMessage) -> tuple[Scan, Array] | str:
        """Return a scan on our clock, with the robot's pose of each beam, or why not."""
        scan, frame = received.decoded.content, received.decoded.frame
        assert isinstance(scan, Scan)
        mount = self._own.sensor(frame)
        if mount is None:
            flaw = self._own.flaw(frame)
            return flaw or f"no motion connects the scan's frame {frame!r} with the robot"
        if not len(scan.times):
            return "a scan has no beams"
        length, own_clock = float(scan.times[-1]), self._settings.own_clock
        times = self._own.instant(received, own_clock, length) + scan.times
        poses = self._own.poses(times)
        if not np.isfinite(poses).any() or not (np.abs(times) <= LATEST).all():
            return UNKNOWN_POSE
        deviation = self._settings.deviation
        return replace(mounted(scan, *mount), times=times, deviation=deviation), poses

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

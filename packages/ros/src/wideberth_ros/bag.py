"""Recordings of ROS 2 (rosbag2, as MCAP or SQLite): topics, clocks, frames, and contents."""

from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple, final

import numpy as np

from wideberth.framework.values.arrays import Array, positive
from wideberth.framework.values.errors import WideberthError, nearest
from wideberth.framework.values.forecast import Forecast
from wideberth.framework.values.occupancy_grid import OccupancyGrid
from wideberth.framework.values.path import Path as Route
from wideberth.framework.values.sensing import Scan

from .bag_file import RawBag, read_raw
from .clocks import stamps
from .decoding import (
    READ,
    Clock,
    DecodedMessage,
    Goal,
    Mixture,
    ObstaclesMessage,
    OdometryMessage,
    PathMessage,
    Transforms,
    decode_message,
    mounted,
)
from .frames import FrameTree
from .messages import Messages, messages

FIXED = ("map", "odom", "world")
"""Frames that stand still, the first that a recording has is taken."""
NANO = 1e-9


@final
@dataclass(frozen=True)
class Topic:
    """One topic of a recording.

    Attributes
    ----------
    name : with its slash. kind : type of its messages.
    count : of the messages. publishers : number of them, as far as the recording states it.
    """

    name: str
    kind: str
    count: int
    publishers: int


class Timed(NamedTuple):
    """A decoded message, its time, and which publisher of its topic sent it (0 is the first)."""

    time: float
    decoded: DecodedMessage
    source: int


class RecordedForecast(NamedTuple):
    """The forecast in one message of a recording: its time, s, and its obstacles."""

    time: float
    names: tuple[str, ...]
    forecast: Forecast


@final
@dataclass(frozen=True, eq=False)
class Bag:
    """What a recording holds, as far as it can be read.

    Times are in s from `epoch`, on the clock of the stamps: of the simulation where there was
    one.

    Attributes
    ----------
    path : of the recording.
    epoch : ns, the time that is 0 here.
    topics : all topics by name, the unreadable ones too.
    timed : name -> its decoded messages, sorted by time.
    frames : all motions between frames.
    notes : what was noticed, a sentence each.
    """

    path: Path
    epoch: int
    topics: Mapping[str, Topic]
    timed: Mapping[str, tuple[Timed, ...]]
    frames: FrameTree
    notes: tuple[str, ...]

    def named(self, *kinds: str) -> tuple[str, ...]:
        """Return the topics of these types that hold something, the longest first."""
        found = [name for name, rows in self.timed.items() if rows]
        found = [name for name in found if self.topics[name].kind in kinds]
        return tuple(sorted(found, key=lambda name: (-len(self.timed[name]), name)))

    def rows(self, topic: str) -> tuple[Timed, ...]:
        """Return the decoded messages of a topic.

        Raises
        ------
        WideberthError : no such topic, or none that can be read.
        """
        if topic in self.timed:
            return self.timed[topic]
        if topic in self.topics:
            raise WideberthError(f"{self.path}: {topic} holds {self.topics[topic].kind}; not read")
        raise WideberthError(f"{self.path} has no topic {topic!r}{nearest(topic, self.topics)}")

    def fixed_frame(self, topics: Iterable[str]) -> str:
        """Return the frame that stands still for what topics say.

        It is map, odom or world, the first that is connected with most of their messages; else
        the top of their tree.
        """
        frames = Counter(row.decoded.frame for topic in topics for row in self.rows(topic))
        if not frames:
            return ""
        top = self.frames.root(frames.most_common(1)[0][0])
        return next((one for one in FIXED if self.frames.root(one) == top), top)

    def scans(self, topic: str, base: str) -> tuple[Scan, ...]:
        """Return the scans of a topic, mounted in the robot's frame.

        Parameters
        ----------
        topic : of a LiDAR. base : the robot's frame.

        Raises
        ------
        WideberthError : no such topic, or no transform from its frame to the robot's, or it tilts.
        """
        found = []
        for time, decoded, _ in self.rows(topic):
            if isinstance(decoded.content, Scan):
                scan = decoded.content
                mounts, mirrored = self.frames.placement(base, decoded.frame, [time])
                if np.isfinite(mounts[0]).all():
                    scan = replace(scan, sensor=topic, times=time + scan.times)
                    found.append(mounted(scan, mounts[0], mirrored))
        return tuple(found)

    def motions(self, topic: str) -> tuple[Array, Array, Array]:
        """Return the odometry of a topic: times (T,), poses (T, 3) and twists (T, 3)."""
        rows = [
            row for row in self.rows(topic) if isinstance(row.decoded.content, OdometryMessage)
        ]
        contents = [row.decoded.content for row in rows]
        poses = [one.pose for one in contents if isinstance(one, OdometryMessage)]
        twists = [one.twist for one in contents if isinstance(one, OdometryMessage)]
        times = np.array([row.time for row in rows])
        return times, np.reshape(poses, (-1, 3)), np.reshape(twists, (-1, 3))

    def routes(self, topic: str) -> tuple[tuple[float, Route], ...]:
        """Return when paths of a topic came, and each in its own frame."""
        found = []
        for time, decoded, _ in self.rows(topic):
            if isinstance(decoded.content, PathMessage) and len(decoded.content.points) >= 2:
                found.append((time, Route(decoded.content.points)))
        return tuple(found)

    def forecasts(self, topic: str, dt: float) -> tuple[RecordedForecast, ...]:
        """Return the forecasts that messages of a topic hold, in its fixed frame.

        Modes that an obstacle has less than another of its message have the weight 0; all have
        the steps of the shortest. Obstacles without a forecast that is of use are left out.

        Parameters
        ----------
        topic : of `mpc_planner_msgs/msg/ObstacleArray`.
        dt : s between two steps, which the messages do not state.

        Raises
        ------
        WideberthError : no such topic, a dt that is not above zero, or no transform from its frame
            to the fixed one.
        """
        positive("dt", dt)
        fixed = self.fixed_frame([topic])
        found = []
        for time, decoded, _ in self.rows(topic):
            if not isinstance(decoded.content, ObstaclesMessage):
                continue
            pose = self.frames.motion(fixed, decoded.frame, [time])[0]
            predicted = [(one.ident, one.forecast) for one in decoded.content.seen if one.forecast]
            if predicted and np.isfinite(pose).all():
                mixtures = [mixture for _, mixture in predicted]
                names = tuple(name for name, _ in predicted)
                found.append(RecordedForecast(time, names, _forecast(mixtures, pose, dt)))
        return tuple(found)

    def maps(self, topic: str) -> tuple[OccupancyGrid, ...]:
        """Return the maps of a topic, each in its own frame."""
        contents = [decoded.content for _, decoded, _ in self.rows(topic)]
        return tuple(one for one in contents if isinstance(one, OccupancyGrid))


def _forecast(mixtures: list[Mixture], pose: Array, dt: float) -> Forecast:
    """Put mixtures of one message together, in the frame in which theirs has a pose."""
    most = max(len(one.weight) for one in mixtures)
    steps = min(one.mean.shape[1] for one in mixtures)
    turn = np.array([[np.cos(pose[2]), -np.sin(pose[2])], [np.sin(pose[2]), np.cos(pose[2])]])
    # An empty mode repeats the first one: a forecast has no modes without a place.
    rows = [
        np.concatenate([np.arange(len(one.weight)), np.zeros(most - len(one.weight), int)])
        for one in mixtures
    ]
    pairs = list(zip(mixtures, rows, strict=True))
    weight = [np.where(np.arange(most) < len(one.weight), one.weight[i], 0.0) for one, i in pairs]
    mean = np.array([one.mean[i, :steps] for one, i in pairs]) @ turn.T + pose[:2]
    covariance = turn @ np.array([one.covariance[i, :steps] for one, i in pairs]) @ turn.T
    return Forecast(mean, covariance, np.array(weight), dt, (None,) * len(mixtures))


def read_bag(path: str | Path) -> Bag:
    """Read a recording of ROS 2 (rosbag2, MCAP or SQLite) as far as it can be read.

    Definitions that the recording holds are used, for those that it lacks ours. What cannot be
    read is named in the notes and left out; the rest is kept.

    Parameters
    ----------
    path : a folder of rosbag2, or one of its files (.mcap, .db3).

    Raises
    ------
    WideberthError : no such recording, or nothing in it that can be read.
    """
    file = Path(path)
    raw = read_raw(file, READ)
    messages_of, flaws = _decoded_topics(raw)
    epoch = _epoch(messages_of)
    topics: dict[str, Topic] = {}
    for i, one in enumerate(raw.topics):
        known = topics.get(one.name)
        if known is not None and known.kind != one.kind:
            flaws.setdefault(i, Counter())[f"the topic holds {known.kind} as well"] += one.size
        topics[one.name] = Topic(
            *(one.name, known.kind if known else one.kind),
            one.size + (known.count if known else 0),
            one.publishers + (known.publishers if known else 0),
        )
    timed, notes = _timed(raw, messages_of, epoch)
    for i, counted in flaws.items():
        reason, total = counted.most_common(1)[0][0], counted.total()
        notes.append(f"{raw.topics[i].name}: {total} messages left out: {reason}")
    notes += [
        f"{one.name} has {one.publishers} publishers"
        for one in topics.values()
        if one.publishers > 1 and one.kind in READ - {"tf2_msgs/msg/TFMessage"}
    ]
    frames = _frames(timed)
    notes += [f"frames: {text} ({count} times)" for text, count in frames.notes.items()]
    return Bag(file, epoch, topics, timed, frames, (*raw.notes, *notes))


_Topics = dict[int, list[tuple[int, DecodedMessage]]]
"""Number of a raw topic -> when each of its messages was received, ns, and its content."""


def _decoded_topics(raw: RawBag) -> tuple[_Topics, dict[int, Counter[str]]]:
    """Decode all messages; return them, and why others could not be read."""
    types: dict[tuple[str, str], Messages | str] = {}
    topics: _Topics = {}
    flaws: dict[int, Counter[str]] = {}
    for one in raw.messages:
        kind = raw.topics[one.source].kind
        key = (kind, one.definition)
        if key not in types:
            types[key] = _types(*key)
        try:
            known = types[key]
            if isinstance(known, str):
                raise WideberthError(known)
            decoded = decode_message(kind, known.read(kind, one.data))
            topics.setdefault(one.source, []).append((one.received, decoded))
        except WideberthError as error:
            flaws.setdefault(one.source, Counter())[str(error)] += 1
    return topics, flaws


def _types(kind: str, definition: str) -> Messages | str:
    """Return the types that a definition holds, or why it cannot be read."""
    try:
        return Messages.of_text(kind, definition) if definition else messages()
    except WideberthError as error:
        return str(error)


def _epoch(topics: _Topics) -> int:
    """Return the earliest stamp of what moves, ns; else the earliest receipt."""
    lasting = (Transforms, OccupancyGrid, Clock, PathMessage, Goal)
    rows = [row for rows in topics.values() for row in rows]
    moving = [one.stamp for _, one in rows if one.stamp and not isinstance(one.content, lasting)]
    return min(moving or [received for received, _ in rows], default=0)


def _timed(
    raw: RawBag, topics: _Topics, epoch: int
) -> tuple[dict[str, tuple[Timed, ...]], list[str]]:
    """Put all messages on one clock; return what was noticed, too."""
    first = min((rows[0][0] for rows in topics.values()), default=0)
    clocks = [row for rows in topics.values() for row in rows if isinstance(row[1].content, Clock)]
    found: dict[str, list[Timed]] = {}
    notes = []
    for source, rows in topics.items():
        name = raw.topics[source].name
        received = NANO * np.array([at - first for at, _ in rows], dtype=np.float64)
        stamped = np.array(
            [NANO * (one.stamp - epoch) if one.stamp else np.nan for _, one in rows]
        )
        if clocks and np.isnan(stamped).all():
            ours = [NANO * (at - first) for at, _ in clocks]
            stamped = np.interp(received, ours, [NANO * (one.stamp - epoch) for _, one in clocks])
        lasting = isinstance(rows[0][1].content, OccupancyGrid | PathMessage | Goal)
        when = stamps(stamped, received)
        notes += [] if lasting else [f"{name}: {text}" for text in when.notes]
        number = len({row.source for row in found.get(name, [])})
        found.setdefault(name, []).extend(
            Timed(float(time), one, number)
            for time, (_, one) in zip(when.times, rows, strict=True)
        )
    ordered = {name: tuple(sorted(rows, key=lambda row: row.time)) for name, rows in found.items()}
    return ordered, notes


def _frames(timed: Mapping[str, tuple[Timed, ...]]) -> FrameTree:
    """Collect the motions between frames, on the same clock."""
    tree = FrameTree()
    for name, rows in timed.items():
        for time, decoded, _ in rows:
            if isinstance(decoded.content, Transforms):
                for parent, child, stamp, pose, tilt in decoded.content.rows:
                    own = time + NANO * (stamp - decoded.stamp)
                    tree.add(parent, child, own, pose, name.endswith("tf_static"), tilt)
    known = {*tree.names, ""}
    for rows in timed.values():
        for time, decoded, _ in rows:
            moved = decoded.content
            if isinstance(moved, OdometryMessage) and moved.child not in known:
                tree.add(decoded.frame, moved.child, time, moved.pose)
    return tree

"""Tracks of the obstacles, or of the robots, in a recording of ROS 2."""

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import final

import numpy as np

from wideberth.framework.values.arrays import Array, positive
from wideberth.framework.values.errors import WideberthError
from wideberth.predictors.data.recordings import Recording, gridded

from .bag import Bag, Timed, read_bag
from .decoding import OBSTACLES, ObstaclesMessage, OdometryMessage
from .frames import composed
from .naming import ObstacleNames

ODOMETRY = "nav_msgs/msg/Odometry"


@final
@dataclass(frozen=True, eq=False)
class _Samples:
    """When and where each identity was, in the fixed frame; what was left out, and why."""

    times: dict[str, list[float]]
    places: dict[str, list[Array]]
    radii: list[float]
    notes: tuple[str, ...]


def read_bag_tracks(
    path: str | Path,
    dt: float,
    *,
    topic: str | None = None,
    frame: str | None = None,
    bridge: float = 1.0,
    minimum_samples: int = 8,
    longest_gap: float = 1.0,
) -> Recording:
    """Read who moved where in a recording of ROS 2, and resample it to ``dt``.

    The positions are taken to the fixed frame by the motions between frames of the same instant.

    Parameters
    ----------
    path : a folder of rosbag2, or one of its files (.mcap, .db3).
    dt : s, of the grid, which starts at the first sample.
    topic : of obstacles or odometry; by default the one of obstacles with the most messages, else
        all odometry, each robot under the name of its topic.
    frame : in which positions are wanted; by default `Bag.fixed_frame`.
    bridge : s; positions are interpolated linearly across gaps up to this long.
    minimum_samples, longest_gap : as in `wideberth.predictors.data.recordings.read_tracks`.

    The notes name the topics that were used, and those that could be.

    Raises
    ------
    WideberthError : no such recording, topic or frame, or no tracks in it.
    """
    positive("dt", dt)
    bag = read_bag(path)
    chosen, others = _chosen(bag, topic)
    fixed = bag.fixed_frame(chosen) if frame is None else frame
    found = _samples(bag, chosen, fixed)
    if not found.times:
        reasons = "; ".join((*found.notes, *bag.notes)) or "their messages are empty"
        raise WideberthError(f"{path}: no tracks in {', '.join(chosen)}: {reasons}")
    notes = [f"topics used: {', '.join(chosen)}, in the frame {fixed!r}"]
    notes += [f"topics that could be used instead: {', '.join(others)}"] if others else []
    sizes = sorted(found.radii)
    notes += [f"radii in it: {sizes[0]:.3g} to {sizes[-1]:.3g} m"] if sizes else []
    return gridded(
        found.times,
        found.places,
        dt,
        bridge=bridge,
        minimum_samples=minimum_samples,
        longest_gap=longest_gap,
        notes=(*notes, *bag.notes, *found.notes),
    )


def _chosen(bag: Bag, topic: str | None) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return the topics to use, and those that could be used."""
    obstacles, robots = bag.named(*OBSTACLES), bag.named(ODOMETRY)
    if topic is not None:
        bag.rows(topic)
        if topic not in obstacles + robots:
            wanted = ", ".join(sorted({*OBSTACLES, ODOMETRY}))
            raise WideberthError(
                f"{bag.path}: {topic} holds {bag.topics[topic].kind}; tracks come from {wanted}; "
                f"it has {', '.join(obstacles + robots) or 'none of them'}"
            )
        chosen: tuple[str, ...] = (topic,)
    else:
        chosen = obstacles[:1] or robots
    if not chosen:
        kinds = sorted({f"{one.name} ({one.kind})" for one in bag.topics.values()})
        raise WideberthError(
            f"{bag.path} holds neither obstacles nor odometry; its topics are {', '.join(kinds)}"
            + "".join(f"; {note}" for note in bag.notes)
        )
    return chosen, tuple(one for one in obstacles + robots if one not in chosen)


def _samples(bag: Bag, topics: Iterable[str], fixed: str) -> _Samples:
    """Collect positions by identity, in the fixed frame."""
    found = _Samples({}, {}, [], ())
    lost: dict[str, int] = {}
    nameless = 0
    for topic in topics:
        rows = bag.rows(topic)
        senders: dict[int, ObstacleNames] = {}
        for row, pose in zip(rows, _poses(bag, rows, fixed, lost), strict=True):
            if not np.isfinite(pose).all():
                continue
            names = senders.setdefault(row.source, ObstacleNames())
            for ident, place, radius in _who(topic, row, pose, names):
                if not np.isfinite(place).all():
                    reason = "obstacles that are not finite"
                    lost[reason] = lost.get(reason, 0) + 1
                    continue
                found.times.setdefault(ident, []).append(row.time)
                found.places.setdefault(ident, []).append(place)
                if radius is not None and np.isfinite(radius):
                    found.radii.append(radius)
            nameless += names.count
    notes = tuple(f"left out: {count} {what}" for what, count in sorted(lost.items()))
    if nameless:
        notes += (f"{nameless} obstacles without an identity of their own: named by place",)
    return _Samples(found.times, found.places, found.radii, notes)


def _who(
    topic: str, row: Timed, pose: Array, names: ObstacleNames
) -> list[tuple[str, Array, float | None]]:
    """Return identity, place and radius of each obstacle in a message, of a frame with a pose."""
    mark = f" ({row.source + 1})" if row.source else ""
    content = row.decoded.content
    if isinstance(content, OdometryMessage):
        return [(f"{topic}{mark}", composed(pose, content.pose)[:2], None)]
    if not isinstance(content, ObstaclesMessage):
        return []
    places = composed(pose, np.array([one.pose for one in content.seen]).reshape(-1, 3))[:, :2]
    idents = names.named(row.time, [one.ident for one in content.seen], places)
    return [
        (ident + mark, place, one.radius)
        for ident, place, one in zip(idents, places, content.seen, strict=True)
    ]


def _poses(bag: Bag, rows: tuple[Timed, ...], fixed: str, lost: dict[str, int]) -> Array:
    """Return the pose of each message's frame in the fixed one, (T, 3); NaN where unknown."""
    found = np.full((len(rows), 3), np.nan)
    names = np.array([row.decoded.frame for row in rows], dtype=object)
    times = np.array([row.time for row in rows])
    for name in sorted(set(names)):
        here = names == name
        try:
            found[here] = bag.frames.motion(fixed, name, times[here])
        except WideberthError as error:
            lost[f"messages: {error}"] = int(here.sum())
            continue
        unknown = int(np.isnan(found[here]).any(axis=1).sum())
        if unknown:
            what = f"messages at times at which no motion from {name!r} to {fixed!r} is known"
            lost[what] = lost.get(what, 0) + unknown
    return found

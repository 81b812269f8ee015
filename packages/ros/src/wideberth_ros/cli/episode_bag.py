"""An episode as a recording of ROS 2, which RViz and Foxglove show."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from wideberth.experiments.engine.result import read_episode
from wideberth.framework.values.arrays import Array
from wideberth.framework.values.motion import Command
from wideberth.simulation.log.episode_log import AgentLog, Episode

from ..bag_writer import BagWriter
from ..encoding import MessageEncoder
from ..messages import messages

EPOCH = 1_000_000_000_000_000_000
"""ns, what is time 0 of every episode: a stamp of 0 would be none."""

Row = tuple[str, float, Any, bool]
"""(topic, time in s, message, whether those who join later are given it)."""


def write_episode_bag(
    episode: Path, out: Path, *, distribution: str = "jazzy", storage: str = "mcap"
) -> dict[str, int]:
    """Write an episode as a recording of ROS 2; return topic -> number of messages.

    Of each robot, under its name: ``odom``, ``cmd_vel``, ``reference``, ``plan``, ``forecast``,
    ``regions`` and ``obstacles`` (where the others truly are); ``points`` where it has a LiDAR,
    and ``trajectory`` from Lyrical on. ``/walls`` and ``/tf`` are common. The frame is ``map``.

    Parameters
    ----------
    episode : its file. out : folder, which must not exist.
    distribution : of ROS 2. storage : "mcap" or "sqlite3".

    Of an episode in space all messages have heights; our own reader takes the plane out of them.

    Raises
    ------
    WideberthError : no episode, a folder that exists, or the extra ``ros`` is not
        installed.
    """
    log = read_episode(episode)
    known = messages(distribution)
    wording = MessageEncoder(EPOCH, "map", known)
    counted: dict[str, int] = {}
    rows = sorted(_rows(log, wording), key=lambda row: row[1])
    with BagWriter(out, known, storage) as bag:
        for topic, time, message, kept in rows:
            bag.write(topic, EPOCH + round(1e9 * time), message, kept=kept)
            counted[topic] = counted.get(topic, 0) + 1
    return counted


def _rows(log: Episode, wording: MessageEncoder) -> Iterator[Row]:
    start = float(log.times[0])
    if log.polygons:
        yield "/walls", start, wording.walls(start, log.polygons), True
    for agent in log.robots:
        yield from _motion(log, agent, wording)
        yield from _plans(agent, wording)
        yield from _seen(log, agent, wording)


def topic_of(agent: AgentLog, name: str) -> str:
    """Return a topic of an agent; its own name becomes one of ROS, as in ``/robot_1/odom``."""
    own = "".join(one if one.isascii() and one.isalnum() else "_" for one in agent.name)
    return f"/{'r' * own[:1].isdigit()}{own}/{name}"


def _frame(agent: AgentLog) -> str:
    return topic_of(agent, "base_link")[1:]


def _motion(log: Episode, agent: AgentLog, wording: MessageEncoder) -> Iterator[Row]:
    """Yield where a robot was, and its commands."""
    frame = _frame(agent)
    speeds = _speeds(agent.positions, log.times)
    for i, time in enumerate(log.times.tolist()):
        if not np.isfinite(agent.positions[i]).all():
            continue
        heading, rate = float(agent.headings[i]), float(agent.yaw_rates[i])
        headed = np.isfinite(heading)
        x, y, height = (*agent.positions[i].tolist(), 0.0)[:3]
        east, north, climb = (*speeds[i].tolist(), 0.0)[:3]
        twist = (float(agent.speeds[i]), 0.0, rate) if headed else (east, north, 0.0)
        pose = (x, y, heading if headed else 0.0)
        odometry = wording.odometry(time, pose, twist, frame, height=height, climb=climb)
        yield topic_of(agent, "odom"), time, odometry, False
        yield "/tf", time, wording.transform(time, frame, pose, height), False
    orders = agent.commands
    for i, time in enumerate(orders.effect.tolist()):
        command = Command(tuple(orders.linear[i]), float(orders.omega[i]))
        yield topic_of(agent, "cmd_vel"), time, wording.command(time, command, frame), False


def _plans(agent: AgentLog, wording: MessageEncoder) -> Iterator[Row]:
    """Yield what a robot planned, when each plan took effect."""
    for time, path in agent.paths:
        points = path.points
        yield topic_of(agent, "reference"), time, wording.path(time, points), True
    for time, plan in zip(agent.commands.effect.tolist(), agent.plans, strict=False):
        yield topic_of(agent, "plan"), time, wording.plan(plan), False
        yield topic_of(agent, "forecast"), time, wording.forecast(plan), False
        yield topic_of(agent, "regions"), time, wording.regions(plan), False
        if "nav_msgs/msg/Trajectory" in wording.known:
            yield topic_of(agent, "trajectory"), time, wording.trajectory(plan), False


def _seen(log: Episode, agent: AgentLog, wording: MessageEncoder) -> Iterator[Row]:
    """Yield where all others are, and what a robot's LiDAR met."""
    others = [one for one in log.agents if one.name != agent.name]
    shape = len(others), len(log.times), agent.positions.shape[1]
    places = np.array([one.positions for one in others]).reshape(shape)
    speeds = _speeds(places, log.times)
    for i, time in enumerate(log.times.tolist()):
        here = np.flatnonzero(np.isfinite(places[:, i]).all(axis=1))
        message = wording.obstacles(
            time, [others[k].name for k in here], places[here, i],
            speeds[here, i], [others[k].radius for k in here],
        )  # fmt: skip
        yield topic_of(agent, "obstacles"), time, message, False
    perceived = log.perception.get(agent.name)
    for glance in perceived.glances if perceived else ():
        time = glance.truth.time
        points = glance.to_world.points(glance.points)
        yield topic_of(agent, "points"), time, wording.points(time, points), False


def _speeds(places: Array, times: Array) -> Array:
    """Return velocities from places (..., T, 2), m/s; 0 where nothing is known."""
    if len(times) < 2:
        return np.zeros_like(places)
    return np.nan_to_num(np.gradient(places, times, axis=-2))

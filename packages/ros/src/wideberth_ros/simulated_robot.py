"""The topics and services of a robot that is simulated: what it senses goes, velocities come."""

import json
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from math import atan2, isfinite
from typing import Any, final

import numpy as np

from wideberth.framework.values.arrays import Array
from wideberth.framework.values.motion import Command, Detection
from wideberth.framework.values.occupancy_grid import OccupancyGrid
from wideberth.framework.values.sensing import Scan

from .command_topic import PLAIN, STAMPED
from .encoding import MessageEncoder
from .link import Publisher, RosLink, RosProcess, message_class, ros, ros_process

NAME = "world"
"""Of the node, where ``-r __node:=NAME`` states no other."""
MAP, ODOM, BASE, LASER = "map", "odom", "base_link", "laser"
"""Frames: each is placed in the one before."""
LOOK = 0.5
"""s, after which it is looked anew who sends velocities, and path and goal are sent again."""
SECOND = 10**9
"""ns."""
_TRIGGER = "std_srvs/srv/Trigger"
_TOPICS = {
    "clock": ("/clock", "rosgraph_msgs/msg/Clock", False),
    "tf": ("/tf", "tf2_msgs/msg/TFMessage", False),
    "tf_static": ("/tf_static", "tf2_msgs/msg/TFMessage", True),
    "odometry": ("/odom", "nav_msgs/msg/Odometry", False),
    "people": ("/obstacles", "nav2_dynamic_msgs/msg/ObstacleArray", False),
    "scan": ("/scan", "sensor_msgs/msg/LaserScan", False),
    "map": ("/map", "nav_msgs/msg/OccupancyGrid", True),
    "goal": ("/goal_pose", "geometry_msgs/msg/PoseStamped", True),
    "reference": ("/reference", "nav_msgs/msg/Path", True),
}
"""Topic, type, and whether it is kept for those who join later."""


class Restart(Exception):
    """The next episode is asked for."""


@final
@dataclass(frozen=True)
class ReceivedVelocity:
    """A velocity that has come.

    Attributes
    ----------
    command : the velocity. stamp : ns, as its sender states it; None of a `Twist`.
    came : s of the episode, when it came.
    """

    command: Command
    stamp: int | None
    came: float


@final
class SimulatedRobot:
    """Shows an episode on the topics of a robot, and keeps the newest velocity that comes.

    Times are s of an episode, the first instant of which is at ``epoch``. Velocities may come as
    `Twist` or `TwistStamped`, whichever is sent. All calls are made by one thread; messages are
    taken, and services answered, while it is in `wait`.

    Parameters
    ----------
    node : of rclpy. process : in which the node works.
    """

    def __init__(self, node: Any, process: RosProcess) -> None:
        self.newest: ReceivedVelocity | None = None
        self.outcome: Callable[[], Mapping[str, Any]] = dict
        """Returns what the service ``outcome`` answers."""
        self._node, self._process = node, process
        self._executor = ros("rclpy.executors").SingleThreadedExecutor()
        self._executor.add_node(node)
        self._link, self._orders = RosLink(node), RosLink(node)
        self._known = self._link.known
        self._to: dict[str, Publisher] = {
            name: self._link.publisher(topic, kind, kept=kept)
            for name, (topic, kind, kept) in _TOPICS.items()
        }
        self._time, self._epoch, self._looked = 0.0, 0, -np.inf
        self._kind, self._goal, self._restart = "", np.zeros(3), False
        self._aims: dict[str, Any] = {}
        self._listen(STAMPED)
        for name, answer in (("reset", self._answer_reset), ("outcome", self._answer_outcome)):
            node.create_service(message_class(_TRIGGER), f"~/{name}", answer)

    @property
    def now(self) -> int:
        """Time of the clock, ns."""
        return self._epoch + round(self._time * SECOND)

    def begin(self) -> None:
        """Begin an episode: its first instant is a second after the last one of before."""
        self._epoch, self._time = self.now + SECOND, 0.0
        self.newest, self._restart = None, False

    def hold(self, seconds: float) -> None:
        """Let the clock go on while the episode stands still."""
        self._epoch += round(seconds * SECOND)

    def place(self, points: Array, grid: OccupancyGrid, mount: Array | None) -> None:
        """Show the path (P, 2), whose end is the goal, the map, and where the LiDAR is, (3,)."""
        encoder, ahead = self._encoder(MAP), points[-1] - points[-2]
        self._goal = np.array([*points[-1], atan2(ahead[1], ahead[0])])
        self._aims = {
            "reference": encoder.path(self._time, points),
            "goal": encoder.goal(self._time, self._goal.tolist()),
        }
        self._to["map"].send(encoder.grid(self._time, grid))
        self._looked = -np.inf
        if mount is not None:
            self._to["tf_static"].send(
                self._encoder(BASE).transform(self._time, LASER, mount.tolist())
            )

    def show(self, time: float, pose: Array, twist: Array) -> None:
        """Show the time, s, and where the robot believes it is and how it moves, (3,) each."""
        self._time = time
        encoder = self._encoder(ODOM)
        clock = self._known.make("rosgraph_msgs/msg/Clock", clock=encoder.stamp(time))
        moved = encoder.transform(time, BASE, pose.tolist())
        begun = self._encoder(MAP).transform(time, ODOM, (0.0, 0.0, 0.0))
        moved.transforms = [*begun.transforms, *moved.transforms]
        self._to["clock"].send(clock)
        self._to["tf"].send(moved)
        self._to["odometry"].send(encoder.odometry(time, pose.tolist(), twist.tolist(), BASE))

    def show_people(self, time: float, seen: Sequence[Detection], velocities: Array) -> None:
        """Show whom the robot sees, and their velocities (O, 2), m/s."""
        places = np.array([one.position for one in seen]).reshape(len(seen), 2)
        covariances = [one.covariance for one in seen]
        radii, names = [one.radius for one in seen], [one.ident for one in seen]
        encoder = self._encoder(ODOM)
        shown = encoder.obstacles(time, names, places, velocities, radii, covariances)
        self._to["people"].send(shown)

    def show_scan(self, scan: Scan) -> None:
        """Show a turn of the LiDAR."""
        self._to["scan"].send(self._encoder(ODOM).scan(scan, LASER))

    def wait(self, seconds: float) -> None:
        """Take what comes for some time; return early when a velocity comes.

        Raises
        ------
        Restart : the next episode is asked for.
        KeyboardInterrupt : the program shall end.
        """
        now, before = time.monotonic(), self.newest
        if now - self._looked > LOOK:
            self._looked = now
            self._look_around()
        goes_on = self._process.spin(
            self._executor, seconds, lambda: self._restart or self.newest is not before
        )
        if not goes_on:
            raise KeyboardInterrupt
        if self._restart:
            raise Restart

    def _look_around(self) -> None:
        """Listen to the kind of velocities that is sent; send path and goal until one has come.

        Who subscribes without asking for what is kept would not know them otherwise.
        """
        topic = self._node.resolve_topic_name("/cmd_vel")
        sent = {one.topic_type for one in self._node.get_publishers_info_by_topic(topic)}
        if self._kind not in sent and sent & {PLAIN, STAMPED}:
            self._listen(PLAIN if self._kind == STAMPED else STAMPED)
        for name, message in self._aims.items() if self.newest is None else ():
            self._to[name].send(message)

    def _listen(self, kind: str) -> None:
        self._orders.close()
        self._kind = kind
        self._orders.subscriber("/cmd_vel", kind, partial(self._take, kind), reliable=False)

    def _take(self, kind: str, message: Any) -> None:
        twist, stamp = (message, None) if kind == PLAIN else (message.twist, message.header.stamp)
        numbers = (twist.linear.x, twist.linear.y, twist.angular.z)
        if all(map(isfinite, numbers)):
            command = Command((numbers[0], numbers[1]), numbers[2])
            stated = None if stamp is None else stamp.sec * SECOND + stamp.nanosec
            self.newest = ReceivedVelocity(command, stated, self._time)

    def _answer_reset(self, request: Any, response: Any) -> Any:
        self._restart = True
        response.success, response.message = True, "the next episode begins"
        return response

    def _answer_outcome(self, request: Any, response: Any) -> Any:
        found = {name: _plain(value) for name, value in self.outcome().items()}
        goal = dict(zip(("x", "y", "yaw"), self._goal.tolist(), strict=True))
        response.success = True
        response.message = json.dumps({**found, "goal": goal}, allow_nan=False)
        return response

    def _encoder(self, frame: str) -> MessageEncoder:
        return MessageEncoder(self._epoch, frame, self._known)


def _plain(value: Any) -> Any:
    """Return a number, word or flag as JSON has it; null for what is not finite."""
    value = value.item() if isinstance(value, np.generic) else value
    return None if isinstance(value, float) and not isfinite(value) else value


@contextmanager
def simulated_robot(arguments: Sequence[str]) -> Iterator[SimulatedRobot]:
    """Join the network as a simulated robot, for as long as a block lasts.

    Parameters
    ----------
    arguments : for ROS, as in ``["--ros-args", "-r", "/odom:=/robot/odom"]``.

    Raises
    ------
    WideberthError : ROS 2 is not found.
    """
    with ros_process(arguments) as process:
        node = ros("rclpy").create_node(NAME)
        try:
            yield SimulatedRobot(node, process)
        finally:
            node.destroy_node()

"""A robot on DDS that shares no code with the node: Cyclone DDS' own types, plain numbers.

It follows `/cmd_vel`, brakes when commands stop for 0.5 s, and sends odometry, people and a path.
With ``scans`` it sends scans of a hall with a door and walkers, tf, a map and a goal instead.
Run as a program it writes what it heard to a file:
``ros_robot.py DOMAIN SECONDS OUT [scans [METRES]]``.
"""

import json
import math
import sys
import time
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np

try:
    from rays import ranges  # as a program
except ImportError:
    from .rays import ranges

LO = (
    '<CycloneDDS><Domain id="any"><General><Interfaces><NetworkInterface name="lo" '
    'multicast="false"/></Interfaces><AllowMulticast>false</AllowMulticast></General><Discovery>'
    '<Peers><Peer address="127.0.0.1"/></Peers><ParticipantIndex>auto</ParticipantIndex>'
    "<MaxAutoParticipantIndex>30</MaxAutoParticipantIndex></Discovery></Domain></CycloneDDS>"
)
PATIENCE = 0.5
"""s without commands, after which it brakes."""
PEOPLE = 20
START, GOAL = (1.0, 1.0), (11.0, 1.0)
"""m, in the frame of the map."""
HALL = ((0.0, 0.0), (12.0, 0.0), (12.0, 5.0), (0.0, 5.0), (0.0, 0.0))
WALL = ((5.0, 0.0), (5.0, 2.6))
"""m, corners of the hall, and the wall in it, which leaves a door of 2.4 m."""
MOUNT, BEAMS, LONGEST = 0.2, 360, 12.0
"""m, of the LiDAR before the robot's centre; beams of a turn; m."""
WIDE = 0.3
"""m, radius of the robot and of everybody."""


def types() -> dict[str, type]:
    """Return types of ROS 2, written by hand."""
    from cyclonedds.idl import IdlStruct
    from cyclonedds.idl import types as t

    def made(name: str, **fields: object) -> type:
        package, _, own = name.rpartition("/")
        space = {"__annotations__": fields, "__module__": __name__}
        kind = type(IdlStruct)(own, (IdlStruct,), space, typename=f"{package}.msg.dds_.{own}_")
        return dataclass(kind)

    f8 = t.float64
    stamp = made("builtin_interfaces/Time", sec=t.int32, nanosec=t.uint32)
    header = made("std_msgs/Header", stamp=stamp, frame_id=str)
    point = made("geometry_msgs/Point", x=f8, y=f8, z=f8)
    vector = made("geometry_msgs/Vector3", x=f8, y=f8, z=f8)
    turn = made("geometry_msgs/Quaternion", x=f8, y=f8, z=f8, w=f8)
    pose = made("geometry_msgs/Pose", position=point, orientation=turn)
    twist = made("geometry_msgs/Twist", linear=vector, angular=vector)
    wide = t.array[f8, 36]
    poses = made("geometry_msgs/PoseWithCovariance", pose=pose, covariance=wide)
    twists = made("geometry_msgs/TwistWithCovariance", twist=twist, covariance=wide)
    stamped = made("geometry_msgs/PoseStamped", header=header, pose=pose)
    uuid = made("unique_identifier_msgs/UUID", uuid=t.array[t.uint8, 16])
    nine = t.array[f8, 9]
    seen = made(
        "nav2_dynamic_msgs/Obstacle", uuid=uuid, score=t.float32, position=point, velocity=vector,
        size=vector, position_covariance=nine, velocity_covariance=nine,
    )  # fmt: skip
    place = made("geometry_msgs/Transform", translation=vector, rotation=turn)
    moved = made(
        "geometry_msgs/TransformStamped", header=header, child_frame_id=str, transform=place
    )
    f4, u4 = t.float32, t.uint32
    about = made(
        "nav_msgs/MapMetaData", map_load_time=stamp, resolution=f4, width=u4, height=u4,
        origin=pose,
    )  # fmt: skip
    scan = made(
        "sensor_msgs/LaserScan", header=header, angle_min=f4, angle_max=f4, angle_increment=f4,
        time_increment=f4, scan_time=f4, range_min=f4, range_max=f4, ranges=t.sequence[f4],
        intensities=t.sequence[f4],
    )  # fmt: skip
    return {
        "Transform": place, "TransformStamped": moved, "MapMetaData": about, "LaserScan": scan,
        "TFMessage": made("tf2_msgs/TFMessage", transforms=t.sequence[moved]),
        "OccupancyGrid": made("nav_msgs/OccupancyGrid", header=header, info=about,
                              data=t.sequence[t.int8]),
        "Time": stamp, "Header": header, "Point": point, "Vector3": vector, "Quaternion": turn,
        "Pose": pose, "Twist": twist, "PoseWithCovariance": poses, "TwistWithCovariance": twists,
        "PoseStamped": stamped, "UUID": uuid, "Obstacle": seen,
        "Odometry": made("nav_msgs/Odometry", header=header, child_frame_id=str, pose=poses,
                         twist=twists),
        "Path": made("nav_msgs/Path", header=header, poses=t.sequence[stamped]),
        "ObstacleArray": made("nav2_dynamic_msgs/ObstacleArray", header=header,
                              obstacles=t.sequence[seen]),
        "TwistStamped": made("geometry_msgs/TwistStamped", header=header, twist=twist),
    }  # fmt: skip


def graph_type(length: int) -> type:
    """Return the message in which a participant names its nodes, with identities so long."""
    from cyclonedds.idl import IdlStruct
    from cyclonedds.idl import types as t

    def made(name: str, **fields: object) -> type:
        space = {"__annotations__": fields, "__module__": __name__}
        typename = f"rmw_dds_common.msg.dds_.{name}_"
        return dataclass(type(IdlStruct)(name, (IdlStruct,), space, typename=typename))

    gid = made("Gid", data=t.array[t.uint8, length])
    node = made(
        "NodeEntitiesInfo", node_namespace=t.bounded_str[256], node_name=t.bounded_str[256],
        reader_gid_seq=t.sequence[gid], writer_gid_seq=t.sequence[gid],
    )  # fmt: skip
    return made("ParticipantEntitiesInfo", gid=gid, node_entities_info_seq=t.sequence[node])


class Robot:
    """A unicycle of at most 0.7 m/s, among people who walk beside its way."""

    def __init__(self, domain: int, people: int = PEOPLE) -> None:
        from cyclonedds.domain import Domain, DomainParticipant
        from cyclonedds.pub import DataWriter
        from cyclonedds.qos import Policy, Qos
        from cyclonedds.sub import DataReader
        from cyclonedds.topic import Topic
        from cyclonedds.util import duration

        self.kind = types()
        self._domain = Domain(domain, LO)
        self._node = DomainParticipant(domain)
        quality = Qos(
            Policy.Reliability.Reliable(duration(milliseconds=100)), Policy.History.KeepLast(10),
            Policy.DataRepresentation(use_cdrv0_representation=True),
        )  # fmt: skip

        kept = Qos(
            Policy.Reliability.Reliable(duration(milliseconds=100)), Policy.History.KeepLast(1),
            Policy.DataRepresentation(use_cdrv0_representation=True),
            Policy.Durability.TransientLocal,
        )  # fmt: skip

        def topic(name: str, kind: str) -> Topic:
            return Topic(self._node, f"rt/{name}", self.kind[kind])

        self._scans = DataWriter(self._node, topic("scan", "LaserScan"), quality)
        self._goals = DataWriter(self._node, topic("goal_pose", "PoseStamped"), quality)
        self._static = DataWriter(self._node, topic("tf_static", "TFMessage"), kept)
        self._map = DataWriter(self._node, topic("map", "OccupancyGrid"), kept)
        self._odometry = DataWriter(self._node, topic("odom", "Odometry"), quality)
        self._people = DataWriter(self._node, topic("obstacles", "ObstacleArray"), quality)
        self._path = DataWriter(self._node, topic("plan", "Path"), quality)
        self._orders = DataReader(self._node, topic("cmd_vel", "TwistStamped"), quality)
        self.pose, self.speed, self.rate = [0.0, 0.0, 0.0], 0.0, 0.0
        self.heard: list[tuple[float, float, float, float, float]] = []
        """(s, m/s, rad/s) of each command, and the speeds that the robot had before."""
        self.count = people
        self.nearest = [math.inf, math.inf]
        """m, least gap to a walker and to a wall."""

    def step(self, now: float, dt: float) -> None:
        """Listen, drive for dt, and say where it is."""
        from cyclonedds.internal import InvalidSample

        for one in self._orders.take(20):
            if not isinstance(one, InvalidSample):
                told = one.twist.linear.x, one.twist.angular.z
                self.heard.append((now, *told, self.speed, self.rate))
                self.speed, self.rate = told
        if not self.heard or now - self.heard[-1][0] > PATIENCE:
            self.speed, self.rate = max(self.speed - 1.0 * dt, 0.0), 0.0
        x, y, yaw = self.pose
        middle = yaw + 0.5 * dt * self.rate
        way = dt * self.speed
        self.pose = [
            x + way * math.cos(middle), y + way * math.sin(middle), yaw + dt * self.rate
        ]  # fmt: skip
        self._odometry.write(self._said())

    def _header(self, frame: str = "odom") -> object:
        now = time.time_ns()
        return self.kind["Header"](self.kind["Time"](now // 10**9, now % 10**9), frame)

    def _at(self, x: float, y: float, yaw: float) -> object:
        turn = self.kind["Quaternion"](0.0, 0.0, math.sin(yaw / 2), math.cos(yaw / 2))
        return self.kind["Pose"](self.kind["Point"](x, y, 0.0), turn)

    def _said(self) -> object:
        k, none = self.kind, [0.0] * 36
        twist = k["Twist"](k["Vector3"](self.speed, 0.0, 0.0), k["Vector3"](0.0, 0.0, self.rate))
        return k["Odometry"](
            self._header(), "base_link", k["PoseWithCovariance"](self._at(*self.pose), none),
            k["TwistWithCovariance"](twist, none),
        )  # fmt: skip

    def say_people(self, now: float) -> None:
        """Say where everybody is."""
        k = self.kind
        found = []
        for i in range(self.count):
            side = 1.0 if i % 2 else -1.0
            uuid = k["UUID"]([i + 1] * 16)
            place = k["Point"](3.0 + 1.5 * i - 0.3 * now, side * (4.0 + 0.1 * i), 0.0)
            size, none = k["Vector3"](0.6, 0.6, 1.7), [0.0] * 9
            speed = k["Vector3"](-0.3, 0.0, 0.0)
            found.append(k["Obstacle"](uuid, 1.0, place, speed, size, none, none))
        self._people.write(k["ObstacleArray"](self._header(), found))

    def say_path(self, length: float = 100.0) -> None:
        """Ask for a straight way."""
        header = self._header()
        poses = [
            self.kind["PoseStamped"](header, self._at(0.5 * i, 0.0, 0.0))
            for i in range(int(2 * length) + 1)
        ]
        self._path.write(self.kind["Path"](header, poses))

    def place(self) -> np.ndarray:
        """Where it is on the map."""
        return np.array(self.pose[:2]) + START

    def say_tf_and_map(self) -> None:
        """Say where the LiDAR is, where the odometry began, and what the hall looks like."""
        k = self.kind
        found = []
        for above, below, (x, y) in (("map", "odom", START), ("base_link", "laser", (MOUNT, 0))):
            motion = k["Transform"](k["Vector3"](x, y, 0.0), k["Quaternion"](0.0, 0.0, 0.0, 1.0))
            found.append(k["TransformStamped"](self._header(above), below, motion))
        self._static.write(k["TFMessage"](found))
        cells = np.zeros((50, 120), int)
        cells[:, [0, -1]] = 100
        cells[[0, -1]] = 100
        cells[:26, 50] = 100
        about = k["MapMetaData"](k["Time"](0, 0), 0.1, 120, 50, self._at(0.0, 0.0, 0.0))
        self._map.write(k["OccupancyGrid"](self._header("map"), about, cells.ravel().tolist()))

    def say_goal(self) -> None:
        """Ask for the far end of the hall."""
        pose = self._at(*GOAL, 0.0)
        self._goals.write(self.kind["PoseStamped"](self._header("map"), pose))

    def say_scan(self, now: float) -> None:
        """Say what stands around."""
        x, y, yaw = (*self.place(), self.pose[2])
        origin = np.array([x + MOUNT * math.cos(yaw), y + MOUNT * math.sin(yaw)])
        step = 2.0 * math.pi / BEAMS
        found = ranges(
            origin, yaw - math.pi + step * np.arange(BEAMS), walkers(now), WIDE, walls()
        )
        found = np.where(found > LONGEST, np.inf, found).astype(np.float32)
        ends = -math.pi, math.pi - step, step
        self._scans.write(
            self.kind["LaserScan"](
                self._header("laser"), *ends, 0.0, 0.1, 0.05, LONGEST, found.tolist(), []
            )
        )

    def look(self, now: float) -> None:
        """Note how near everything is."""
        away = np.linalg.norm(walkers(now) - self.place(), axis=1).min() - 2 * WIDE
        begin, edge = walls()[:, 0], np.diff(walls(), axis=1)[:, 0]
        share = ((self.place() - begin) * edge).sum(axis=1) / (edge**2).sum(axis=1)
        foot = begin + np.clip(share, 0.0, 1.0)[:, None] * edge
        wall = np.linalg.norm(foot - self.place(), axis=1).min() - WIDE
        self.nearest = [min(self.nearest[0], float(away)), min(self.nearest[1], float(wall))]


def walls() -> np.ndarray:
    """Ends of all walls, (W, 2, 2), m."""
    return np.array([*pairwise(HALL), WALL], float)


def walkers(now: float) -> np.ndarray:
    """Two who walk to and fro across the hall at 0.3 m/s, (2, 2), m."""
    column, begin = np.array([3.0, 8.5]), np.array([1.5, 5.0])
    along = (0.3 * now + begin) % 7.0
    return np.stack([column, 1.0 + np.minimum(along, 7.0 - along)], axis=-1)


def drive_to_goal(domain: int, seconds: float, out: Path, way: float = math.inf) -> None:
    """Drive through the hall to the goal, or for a way in m; odometry at 50 Hz, scans at 10 Hz."""
    robot = Robot(domain)
    robot.say_tf_and_map()
    begin = time.monotonic()
    count, away = 0, math.inf
    while (now := time.monotonic() - begin) < seconds and (away > 0.3 or robot.speed > 0.05):
        if math.hypot(*robot.pose[:2]) > way:
            break
        robot.step(time.time(), 0.02)
        robot.look(now)
        if count % 5 == 0:
            robot.say_scan(now)
        if count % 50 == 0:
            robot.say_goal()
        count += 1
        away = float(np.linalg.norm(robot.place() - GOAL))
        time.sleep(max(begin + 0.02 * count - time.monotonic(), 0.0))
    found = {"heard": robot.heard, "pose": robot.pose, "nearest": robot.nearest, "away": away,
             "seconds": now}  # fmt: skip
    out.write_text(json.dumps(found))


def drive(domain: int, seconds: float, out: Path) -> None:
    """Drive for some time, at 50 Hz; people at 10 Hz, the path once a second."""
    robot = Robot(domain)
    begin = time.monotonic()
    count = 0
    while (now := time.monotonic() - begin) < seconds:
        robot.step(time.time(), 0.02)
        if count % 5 == 0:
            robot.say_people(now)
        if count % 50 == 0:
            robot.say_path()
        count += 1
        time.sleep(max(begin + 0.02 * count - time.monotonic(), 0.0))
        if count % 25 == 0:
            found = {"heard": robot.heard, "pose": robot.pose}
            partial = out.with_suffix(".part")
            partial.write_text(json.dumps(found))
            partial.replace(out)


if __name__ == "__main__":
    told = int(sys.argv[1]), float(sys.argv[2]), Path(sys.argv[3])
    if sys.argv[4:5] == ["scans"]:
        drive_to_goal(*told, *map(float, sys.argv[5:]))
    else:
        drive(*told)

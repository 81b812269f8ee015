"""Recordings of ROS 2 for tests, written by rosbags alone."""

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

from wideberth_ros.messages import messages

ARRAY = "nav2_dynamic_msgs/msg/ObstacleArray"


def header(time: float, frame: str) -> Any:
    """Return a header with its stamp."""
    known, whole = messages(), round(time * 1e9)
    stamp = known.make("builtin_interfaces/msg/Time", sec=whole // 10**9, nanosec=whole % 10**9)
    return known.make("std_msgs/msg/Header", stamp=stamp, frame_id=frame)


def vector(kind: str, *values: float) -> Any:
    """Return a message with the fields x, y, z."""
    return messages().make(f"geometry_msgs/msg/{kind}", **dict(zip("xyz", values, strict=False)))


def quaternion(yaw: float, roll: float = 0.0) -> Any:
    """Return a turn about the vertical, after one about the x axis."""
    cosine, sine = np.cos(yaw / 2), np.sin(yaw / 2)
    across, along = np.cos(roll / 2), np.sin(roll / 2)
    return messages().make(
        "geometry_msgs/msg/Quaternion",
        x=cosine * along, y=sine * along, z=sine * across, w=cosine * across,
    )  # fmt: skip


def obstacle(ident: int, x: float, y: float, radius: float = 0.3) -> Any:
    """Return one of Nav2's dynamic obstacles."""
    known = messages()
    uuid = known.make("unique_identifier_msgs/msg/UUID", uuid=np.full(16, ident, np.uint8))
    return known.make(
        "nav2_dynamic_msgs/msg/Obstacle", uuid=uuid, position=vector("Point", x, y),
        velocity=vector("Vector3", 1.0, 0.0), size=vector("Vector3", 2 * radius, 2 * radius),
    )  # fmt: skip


def obstacles(time: float, places: Iterable[tuple[float, float]], frame: str = "map") -> Any:
    """Return an array of obstacles, numbered from 1: an identity of zeros is none."""
    found = [obstacle(i + 1, *place) for i, place in enumerate(places)]
    return messages().make(ARRAY, header=header(time, frame), obstacles=found)


def transform(time: float, parent: str, child: str, pose: Any, roll: float = 0.0) -> Any:
    """Return a message of tf with one motion."""
    known, (x, y, yaw) = messages(), pose
    motion = known.make(
        "geometry_msgs/msg/Transform",
        translation=vector("Vector3", x, y), rotation=quaternion(yaw, roll),
    )  # fmt: skip
    one = known.make(
        "geometry_msgs/msg/TransformStamped",
        header=header(time, parent), child_frame_id=child, transform=motion,
    )  # fmt: skip
    return known.make("tf2_msgs/msg/TFMessage", transforms=[one])


def odometry(
    time: float, pose: Any, twist: Any, frame: str = "odom", child: str = "base_link"
) -> Any:
    """Return odometry in the plane."""
    known, (x, y, yaw), (forward, aside, rate) = messages(), pose, twist
    place = known.make(
        "geometry_msgs/msg/Pose", position=vector("Point", x, y), orientation=quaternion(yaw)
    )
    speed = known.make(
        "geometry_msgs/msg/Twist",
        linear=vector("Vector3", forward, aside), angular=vector("Vector3", 0.0, 0.0, rate),
    )  # fmt: skip
    return known.make(
        "nav_msgs/msg/Odometry", header=header(time, frame), child_frame_id=child,
        pose=known.make("geometry_msgs/msg/PoseWithCovariance", pose=place),
        twist=known.make("geometry_msgs/msg/TwistWithCovariance", twist=speed),
    )  # fmt: skip


def write_bag(folder: Path, rows: Iterable[tuple[str, float, Any]], storage: str = "MCAP") -> Path:
    """Write rows of (topic, time of receipt in s, message); a name with "#" is a second publisher.

    "/obstacles#2" goes to "/obstacles" by a connection of its own.
    """
    from rosbags import interfaces as its
    from rosbags.rosbag2 import StoragePlugin, Writer

    known = messages()
    open_: dict[tuple[str, str], Any] = {}
    forever = its.QosTime(0, 0)
    with Writer(folder, version=9, storage_plugin=StoragePlugin[storage]) as bag:
        for topic, time, message in rows:
            kind = message.__msgtype__
            if (topic, kind) not in open_:
                name, _, number = topic.partition("#")
                qos = its.Qos(
                    its.QosHistory.KEEP_LAST, int(number or 10), its.QosReliability.RELIABLE,
                    its.QosDurability.VOLATILE, forever, forever, its.QosLiveliness.AUTOMATIC,
                    forever, False,
                )  # fmt: skip
                open_[topic, kind] = bag.add_connection(
                    name, kind, typestore=known.store, offered_qos_profiles=[qos]
                )
            bag.write(open_[topic, kind], round(time * 1e9), known.to_bytes(message))
    return folder

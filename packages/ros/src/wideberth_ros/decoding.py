"""Messages of ROS 2 as values of ours, in the frame of the message."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, TypeAlias, final

import numpy as np

from wideberth.framework.values.arrays import Array
from wideberth.framework.values.errors import WideberthError
from wideberth.framework.values.occupancy_grid import OccupancyGrid
from wideberth.framework.values.sensing import Scan

from .frames import tilt_of, yaw_of


@final
@dataclass(frozen=True, eq=False)
class Mixture:
    """Gaussians over the places where an obstacle will be, one per mode and step.

    Attributes
    ----------
    weight : (M,), sums to 1.
    mean : (M, N, 2), m. covariance : (M, N, 2, 2), m^2.
    """

    weight: Array
    mean: Array
    covariance: Array


@final
@dataclass(frozen=True, eq=False)
class ObstacleMessage:
    """An obstacle in a message.

    Attributes
    ----------
    ident : identity; "" where the message states none.
    pose : (3,), x, y in m and heading in rad.
    radius : m, of the disc around it; None where its size is not stated.
    velocity : (2,), m/s, or None.
    covariance : (2, 2), m^2, of the position, or None where the message holds zeros.
    velocity_covariance : (2, 2), (m/s)^2, or None.
    forecast : of its places, where the message holds one that is of use; else None.
    """

    ident: str
    pose: Array
    radius: float | None
    velocity: Array | None = None
    covariance: Array | None = None
    velocity_covariance: Array | None = None
    forecast: Mixture | None = None


@final
@dataclass(frozen=True, eq=False)
class ObstaclesMessage:
    """All obstacles of one message."""

    seen: tuple[ObstacleMessage, ...]


@final
@dataclass(frozen=True, eq=False)
class OdometryMessage:
    """A pose with its motion, from odometry.

    Attributes
    ----------
    child : frame whose pose it is.
    pose : (3,), x, y in m and heading in rad.
    twist : (3,), forward and lateral speed in m/s, yaw rate in rad/s.
    covariance : (3, 3), of the pose; None where the message holds zeros.
    """

    child: str
    pose: Array
    twist: Array
    covariance: Array | None = None


@final
@dataclass(frozen=True, eq=False)
class Transforms:
    """Poses of frames in their parents: (parent, child, ns, pose, tilt in rad) each."""

    rows: tuple[tuple[str, str, int, tuple[float, float, float], float], ...]


@final
@dataclass(frozen=True, eq=False)
class PathMessage:
    """A path.

    Attributes
    ----------
    points : (P, 2), m.
    heading : rad, wanted at its end; NaN where the message states none.
    """

    points: Array
    heading: float = float("nan")


@final
@dataclass(frozen=True, eq=False)
class Goal:
    """Where a robot should go.

    Attributes
    ----------
    place : (2,), m.
    heading : rad, that it should have there; NaN where the message states none.
    """

    place: Array
    heading: float = float("nan")


@final
@dataclass(frozen=True)
class Clock:
    """Simulated time, ns."""

    now: int


Content: TypeAlias = (
    ObstaclesMessage
    | OdometryMessage
    | Transforms
    | PathMessage
    | Goal
    | Clock
    | Scan
    | OccupancyGrid
)


@final
@dataclass(frozen=True, eq=False)
class DecodedMessage:
    """The content of one message.

    Attributes
    ----------
    stamp : ns, from its header; 0 where it has none.
    frame : of its header.
    content : in that frame.
    """

    stamp: int
    frame: str
    content: Content


def nanoseconds(stamp: Any) -> int:
    """Return a stamp of ROS 2, ns."""
    return int(stamp.sec) * 1_000_000_000 + int(stamp.nanosec)


def pose_of(pose: Any) -> Array:
    """Return x, y in m and the yaw in rad of a pose of ROS 2."""
    turn = pose.orientation
    yaw = yaw_of(turn.x, turn.y, turn.z, turn.w)
    return np.array([pose.position.x, pose.position.y, float(yaw)], dtype=np.float64)


def heading_of(pose: Any) -> float:
    """Return the yaw of a pose of ROS 2, rad; NaN where its quaternion is none, all zeros say."""
    turn = pose.orientation
    parts = np.array([turn.x, turn.y, turn.z, turn.w], dtype=np.float64)
    length = float(np.linalg.norm(parts))
    return float(yaw_of(*(parts / length))) if 0.5 < length < 2.0 else float("nan")


def _stated(matrix: Array) -> Array | None:
    """Return a covariance, or None for the zeros of a sender that does not know it."""
    return None if not np.any(matrix) else np.asarray(matrix)


def _plane(numbers: Any, size: int) -> Array | None:
    """Return the (2, 2) part for x and y of a covariance that is written row by row."""
    return _stated(np.asarray(numbers, dtype=np.float64).reshape(size, size)[:2, :2])


def _size(radius: float) -> float | None:
    """Return a radius, or None for the zero of a sender that does not know it."""
    return float(radius) if radius else None


def _name(uuid: bytes) -> str:
    """Return the name that an identity of ours holds, see `encoding.identity`; else its digits.

    All zeros are none.
    """
    if not any(uuid):
        return ""
    text = uuid.rstrip(b"\0").decode("latin-1")
    return text if text and text.isascii() and text.isprintable() else uuid.hex()


def _obstacle_array(message: Any) -> ObstaclesMessage:
    return ObstaclesMessage(
        tuple(
            ObstacleMessage(
                _name(bytes(np.asarray(one.uuid.uuid, np.uint8))),
                np.array([one.position.x, one.position.y, 0.0]),
                _size(0.5 * float(np.max([one.size.x, one.size.y]))),
                np.array([one.velocity.x, one.velocity.y]),
                _plane(one.position_covariance, 3),
                _plane(one.velocity_covariance, 3),
            )
            for one in message.obstacles
        )
    )


def _costmap_obstacles(message: Any) -> ObstaclesMessage:
    seen = []
    for one in message.obstacles:
        corners = np.array([(point.x, point.y) for point in one.polygon.points], dtype=np.float64)
        centre = corners.mean(axis=0) if len(corners) else np.full(2, np.nan)  # it has no place
        away = np.linalg.norm(corners.reshape(-1, 2) - centre, axis=1)
        reach = float(away.max(initial=0.0)) + float(one.radius)
        turn, speed = one.orientation, one.velocities.twist.linear
        heading = float(yaw_of(turn.x, turn.y, turn.z, turn.w))
        seen.append(
            ObstacleMessage(
                str(one.id) if one.id >= 0 else "",
                np.array([*centre, heading]),
                _size(reach),
                np.array([speed.x, speed.y]),
                None,
                _plane(one.velocities.covariance, 6),
            )
        )
    return ObstaclesMessage(tuple(seen))


def _mixture(message: Any) -> Mixture | None:
    """Return the forecast of one obstacle of mpc_planner_msgs; None if its numbers do not fit.

    The semi-axes a, b of a step are the deviations along and across the heading phi of its pose::

        C = Rot(phi) diag(a^2, b^2) Rot(phi)^T
    """
    weight = np.asarray(message.probabilities, dtype=np.float64)
    modes = message.gaussians
    steps = min((len(one.mean.poses) for one in modes), default=0)
    sizes = [(len(one.major_semiaxis), len(one.minor_semiaxis)) for one in modes]
    whole = all(min(size) >= steps for size in sizes) and steps and len(weight) == len(modes)
    if not whole or not (weight >= 0.0).all() or not 0.0 < weight.sum() < np.inf:
        return None
    poses = np.array([[pose_of(pose.pose) for pose in one.mean.poses[:steps]] for one in modes])
    long, wide = (
        np.array([np.asarray(getattr(one, name), np.float64)[:steps] ** 2 for one in modes])
        for name in ("major_semiaxis", "minor_semiaxis")
    )
    cosine, sine = np.cos(poses[..., 2]), np.sin(poses[..., 2])
    turn = np.stack([np.stack([cosine, -sine], -1), np.stack([sine, cosine], -1)], -2)
    spread = turn * np.stack([long, wide], -1)[..., None, :] @ np.swapaxes(turn, -1, -2)
    if not (np.isfinite(poses).all() and np.isfinite(spread).all()):
        return None
    return Mixture(weight / weight.sum(), poses[..., :2], spread)


def _gaussian_obstacles(message: Any) -> ObstaclesMessage:
    return ObstaclesMessage(
        tuple(
            ObstacleMessage(
                *(str(one.id) if one.id >= 0 else "", pose_of(one.pose), None),
                forecast=_mixture(one),
            )
            for one in message.obstacles
        )
    )


def _boxes(message: Any) -> ObstaclesMessage:
    return ObstaclesMessage(
        tuple(
            ObstacleMessage(
                one.id,
                pose_of(one.bbox.center),
                _size(0.5 * float(np.hypot(one.bbox.size.x, one.bbox.size.y))),
                None,
                _plane(one.results[0].pose.covariance, 6) if one.results else None,
            )
            for one in message.detections
        )
    )


def _odometry(message: Any) -> OdometryMessage:
    twist = message.twist.twist
    rows = np.asarray(message.pose.covariance, dtype=np.float64).reshape(6, 6)
    plane = rows[np.ix_([0, 1, 5], [0, 1, 5])]
    pose = pose_of(message.pose.pose)
    speeds = np.array([twist.linear.x, twist.linear.y, twist.angular.z])
    return OdometryMessage(message.child_frame_id, pose, speeds, _stated(plane))


def _transforms(message: Any) -> Transforms:
    rows = []
    for one in message.transforms:
        place, turn = one.transform.translation, one.transform.rotation
        yaw = float(yaw_of(turn.x, turn.y, turn.z, turn.w))
        names = one.header.frame_id.lstrip("/"), one.child_frame_id.lstrip("/")
        pose = (float(place.x), float(place.y), yaw)
        rows.append((*names, nanoseconds(one.header.stamp), pose, tilt_of(turn.x, turn.y)))
    return Transforms(tuple(rows))


def scan_of(message: Any) -> Scan:
    """Return a scan; times are from its first beam.

    A beam at the longest range, or beyond it, has met nothing: many drivers say so.
    """
    ranges = np.array(message.ranges, dtype=np.float64)
    count = np.arange(len(ranges), dtype=np.float64)
    least, most = float(message.range_min), float(message.range_max)
    ranges = np.where(ranges < least, np.nan, np.where(ranges >= most, np.inf, ranges))
    return Scan(
        message.header.frame_id,
        np.asarray(float(message.time_increment) * count),
        np.asarray(float(message.angle_min) + float(message.angle_increment) * count),
        ranges,
        longest=most,
    )


def mounted(scan: Scan, mount: Array, mirrored: bool) -> Scan:
    """Return a scan of a sensor with a pose on the robot, (3,), upside down if ``mirrored``."""
    bearings = -scan.bearings if mirrored else scan.bearings
    return replace(scan, bearings=np.asarray(bearings), mount=mount)


def distinct(points: Array) -> Array:
    """Return points (P, 2) without those that repeat the one before."""
    new = np.ones(len(points), dtype=bool)
    new[1:] = (np.diff(points, axis=0) != 0.0).any(axis=1)
    return np.asarray(points[new])


def _path(message: Any) -> PathMessage:
    places = [(one.pose.position.x, one.pose.position.y) for one in message.poses]
    points = distinct(np.array(places, dtype=np.float64).reshape(-1, 2))
    turns = [one.pose.orientation for one in message.poses]
    if all((one.x, one.y, one.z, one.w) == (0.0, 0.0, 0.0, 1.0) for one in turns):
        return PathMessage(points)  # as quaternions begin: the sender left them so
    return PathMessage(points, heading_of(message.poses[-1].pose))


def _goal(message: Any) -> Goal:
    place = np.array([message.pose.position.x, message.pose.position.y], dtype=np.float64)
    if not np.isfinite(place).all():
        raise ValueError(f"the goal is at {place.tolist()}")
    return Goal(place, heading_of(message.pose))


def grid_of(message: Any) -> OccupancyGrid:
    """Return a map.

    Raises
    ------
    WideberthError : its axes are turned, or its numbers are no map.
    """
    info, origin = message.info, pose_of(message.info.origin)
    if abs(origin[2]) > 1e-6:
        raise WideberthError(f"the map is turned by {origin[2]:.3g} rad; wanted 0: turn its image")
    cells = np.asarray(message.data, dtype=np.int8).reshape(int(info.height), int(info.width))
    return OccupancyGrid(cells, float(info.resolution), (float(origin[0]), float(origin[1])))


_DECODERS: dict[str, Callable[[Any], Content]] = {
    "nav2_dynamic_msgs/msg/ObstacleArray": _obstacle_array,
    "costmap_converter_msgs/msg/ObstacleArrayMsg": _costmap_obstacles,
    "mpc_planner_msgs/msg/ObstacleArray": _gaussian_obstacles,
    "vision_msgs/msg/Detection3DArray": _boxes,
    "nav_msgs/msg/Odometry": _odometry,
    "tf2_msgs/msg/TFMessage": _transforms,
    "sensor_msgs/msg/LaserScan": scan_of,
    "nav_msgs/msg/Path": _path,
    "geometry_msgs/msg/PoseStamped": _goal,
    "nav_msgs/msg/OccupancyGrid": grid_of,
    "rosgraph_msgs/msg/Clock": lambda message: Clock(nanoseconds(message.clock)),
}
OBSTACLES: frozenset[str] = frozenset(list(_DECODERS)[:4])
"""Types of messages that hold obstacles."""
READ: frozenset[str] = frozenset(_DECODERS)
"""Types of messages that are read."""


def decode_message(kind: str, message: Any) -> DecodedMessage:
    """Return the content of a message.

    Parameters
    ----------
    kind : one of `READ`. message : as `Messages.read` gives it.

    Raises
    ------
    WideberthError : its fields are not those of our definition, or its numbers are of no use.
    """
    try:
        with np.errstate(over="ignore", invalid="ignore"):  # its numbers are judged below
            content = _DECODERS[kind](message)
        if isinstance(content, Clock):
            return DecodedMessage(content.now, "", content)
        if isinstance(content, Transforms):
            return DecodedMessage(content.rows[0][2] if content.rows else 0, "", content)
        frame = str(message.header.frame_id).lstrip("/")
        return DecodedMessage(nanoseconds(message.header.stamp), frame, content)
    except AttributeError as error:
        raise WideberthError(f"it is of another definition: {error}") from None
    except (IndexError, OverflowError, TypeError, ValueError) as error:
        raise WideberthError(f"its numbers are of no use: {error}") from None

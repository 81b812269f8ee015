"""Our values as messages of ROS 2."""

import hashlib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol, final
from zlib import crc32

import numpy as np
from numpy.typing import NDArray

from wideberth.draw.plans import kept_out
from wideberth.draw.style import chosen_steps
from wideberth.framework.numerics.chi_square import content_bound
from wideberth.framework.robot import Robot
from wideberth.framework.values.arrays import Array
from wideberth.framework.values.forecast import LIGHT, Forecast
from wideberth.framework.values.motion import Command, Twist
from wideberth.framework.values.occupancy_grid import OccupancyGrid
from wideberth.framework.values.plan import Plan
from wideberth.framework.values.polygon import Polygon
from wideberth.framework.values.sensing import Scan
from wideberth_nav2.overlap_tables import ellipses_of

from .frames import quaternion_of
from .messages import messages

LONGEST_NAME = 16
"""Bytes of a name that fits into an identity of ROS 2; of a longer one it is a hash."""
MOST_STEPS = 8
"""Steps of a plan that have markers."""
TALL = 0.05
"""m, height of flat markers."""
_SPHERE, _CYLINDER, _STRIP, _DELETE_ALL = 2, 3, 4, 3
_GREY, _BLUE, _ORANGE = (0.5, 0.5, 0.5), (0.0, 0.45, 0.7), (0.9, 0.6, 0.0)


def identity(name: str) -> NDArray[np.uint8]:
    """Return the 16 bytes of an identity: the name where it fits, else a hash of it.

    Examples
    --------
    >>> bytes(identity("eve")).rstrip(bytes(1))
    b'eve'
    """
    data = name.encode()
    if not name.isascii() or not name.isprintable() or not 0 < len(data) <= LONGEST_NAME:
        data = hashlib.sha256(data).digest()[:LONGEST_NAME]
    return np.frombuffer(data.ljust(LONGEST_NAME, b"\0"), np.uint8).astype(np.uint8)


class MessageTypes(Protocol):
    """Makes messages.

    `wideberth_ros.link.RosMessages` makes those of an installation of ROS 2,
    `wideberth_ros.messages.Messages` those of recordings.
    """

    def make(self, name: str, /, **given: Any) -> Any:
        """Return a message; what is not given is zero, empty or False."""
        ...

    def __contains__(self, name: str) -> bool:
        """Whether there is a type of this name, as in ``"nav_msgs/msg/Path"``."""
        ...


def number_of(name: str) -> int:
    """Return the id of a name: the number that it is, else a hash of it, 0 to 2^31 - 1.

    Examples
    --------
    >>> number_of("12"), number_of("eve")
    (12, 2062568895)
    """
    if name.isascii() and name.isdecimal() and int(name) < 2**31:
        return int(name)
    return crc32(name.encode()) >> 1


@final
@dataclass(frozen=True)
class MessageEncoder:
    """Makes messages of one distribution, in one frame that stands still.

    Parameters
    ----------
    epoch : ns, what is added to times.
    frame : that stands still.
    known : the message types.
    """

    epoch: int = 0
    frame: str = "map"
    known: MessageTypes = field(default_factory=messages)

    def stamp(self, time: float) -> Any:
        """Return an instant, from s."""
        whole = self.epoch + round(time * 1e9)
        kind = "builtin_interfaces/msg/Time"
        return self.known.make(kind, sec=whole // 10**9, nanosec=whole % 10**9)

    def header(self, time: float, frame: str | None = None) -> Any:
        """Return a header, of the frame that stands still where none is stated."""
        name = self.frame if frame is None else frame
        return self.known.make("std_msgs/msg/Header", stamp=self.stamp(time), frame_id=name)

    def pose(self, x: float, y: float, yaw: float = 0.0, z: float = 0.0) -> Any:
        """Return an upright pose, m and rad."""
        return self.known.make(
            "geometry_msgs/msg/Pose", position=self._point(x, y, z), orientation=self._turn(yaw)
        )

    def odometry(
        self,
        time: float,
        pose: Sequence[float],
        twist: Sequence[float],
        child: str,
        *,
        height: float = 0.0,
        climb: float = 0.0,
    ) -> Any:
        """Return pose (x, y in m, yaw in rad) and twist (forward, lateral in m/s, yaw rate).

        A robot that flies has a height in m, and climbs in m/s.
        """
        make = self.known.make
        (x, y, yaw), (forward, aside, rate) = pose, twist
        moving = self._twist(forward, aside, rate, climb)
        return make(
            "nav_msgs/msg/Odometry",
            header=self.header(time),
            child_frame_id=child,
            pose=make("geometry_msgs/msg/PoseWithCovariance", pose=self.pose(x, y, yaw, height)),
            twist=make("geometry_msgs/msg/TwistWithCovariance", twist=moving),
        )

    def transform(
        self, time: float, child: str, pose: Sequence[float], height: float = 0.0
    ) -> Any:
        """Return the upright pose of a frame in the one that stands still."""
        x, y, yaw = pose
        motion = self.known.make(
            "geometry_msgs/msg/Transform",
            translation=self._vector(x, y, height),
            rotation=self._turn(yaw),
        )
        one = self.known.make(
            "geometry_msgs/msg/TransformStamped",
            header=self.header(time),
            child_frame_id=child,
            transform=motion,
        )
        return self.known.make("tf2_msgs/msg/TFMessage", transforms=[one])

    def command(self, time: float, command: Command, frame: str) -> Any:
        """Return a velocity for the robot of that frame."""
        forward, aside, up = _three(command.linear)
        return self.known.make(
            "geometry_msgs/msg/TwistStamped",
            header=self.header(time, frame),
            twist=self._twist(forward, aside, command.omega, up),
        )

    def path(
        self, time: float, points: Array, headings: Array | None = None, dt: float = 0.0
    ) -> Any:
        """Return points (P, D) in m as a path; ``dt`` s lie between the stamps of two poses.

        Without headings each pose looks at the next point.
        """
        if headings is None:
            step = np.diff(points, axis=0)
            headings = np.arctan2(step[:, 1], step[:, 0])
            headings = np.concatenate([headings, headings[-1:]])
        poses = [
            self.known.make(
                "geometry_msgs/msg/PoseStamped",
                header=self.header(time + dt * k),
                pose=self._placed(place, float(yaw)),
            )
            for k, (place, yaw) in enumerate(zip(points.tolist(), headings, strict=True))
        ]
        return self.known.make("nav_msgs/msg/Path", header=self.header(time), poses=poses)

    def goal(self, time: float, pose: Sequence[float]) -> Any:
        """Return a pose (x, y in m, yaw in rad) to go to."""
        kind = "geometry_msgs/msg/PoseStamped"
        return self.known.make(kind, header=self.header(time), pose=self.pose(*pose))

    def plan(self, plan: Plan) -> Any:
        """Return a plan's positions as a path, with the instants at which it is there."""
        return self.path(plan.stamp, plan.positions, dt=plan.dt)

    def trajectory(self, plan: Plan, robot: Robot | None = None) -> Any:
        """Return a plan as ``nav_msgs/msg/Trajectory``, which ROS 2 has from Lyrical on.

        With the robot's model each point has heading, velocity and acceleration of its state and
        input; the last state has no input, and no acceleration. Without, the heading looks at the
        next point, and there is a speed along it alone.

        Raises
        ------
        WideberthError : an older distribution.
        """
        path, make = self.plan(plan), self.known.make
        flow: Array = np.gradient(plan.positions, plan.dt, axis=0)
        points = []
        for k, one in enumerate(path.poses):
            climb = float(flow[k, 2]) if flow.shape[1] == 3 else 0.0
            moving = Twist((float(np.linalg.norm(flow[k, :2])), 0.0, climb))
            given, pose = {}, one.pose
            if robot is not None:
                state = plan.states[k]
                control = plan.inputs[min(k, len(plan.inputs) - 1)]
                at, moving = robot.pose(state), robot.twist(state, control)
                yaw = 0.0 if at.heading is None else float(at.heading)
                place = [float(number) for number in at.position]
                pose = self._placed(place, yaw)
                if k < len(plan.inputs):
                    given["acceleration"] = self._accel(robot.acceleration(state, control))
            twist = self._twist_of(moving)
            kind = "nav_msgs/msg/TrajectoryPoint"
            points.append(make(kind, header=one.header, pose=pose, velocity=twist, **given))
        return make("nav_msgs/msg/Trajectory", header=path.header, points=points)

    def _twist_of(self, twist: Twist) -> Any:
        forward, aside, up = _three(twist.linear)
        return self._twist(forward, aside, float(twist.angular), up)

    def _placed(self, place: Sequence[float], yaw: float) -> Any:
        x, y, z = _three(place)
        return self.pose(x, y, yaw, z)

    def _accel(self, change: Twist) -> Any:
        made = self._twist_of(change)
        kind = "geometry_msgs/msg/Accel"
        return self.known.make(kind, linear=made.linear, angular=made.angular)

    def obstacles(
        self,
        time: float,
        names: Sequence[str],
        positions: Array,
        velocities: Array,
        radii: Sequence[float],
        covariances: Sequence[Array | None] | None = None,
    ) -> Any:
        """Return Nav2's dynamic obstacles: positions and velocities (O, D), radii in m.

        Covariances, (D, D) in m^2, are of the positions; zeros stand where none is stated.
        """
        make = self.known.make
        stated = covariances or [None] * len(names)
        found = [
            make(
                "nav2_dynamic_msgs/msg/Obstacle",
                uuid=make("unique_identifier_msgs/msg/UUID", uuid=identity(name)),
                score=1.0,
                position=self._point(*place),
                velocity=self._vector(*speed),
                size=self._vector(*(2.0 * radius,) * len(place)),
                position_covariance=_in_space(spread),
            )
            for name, place, speed, radius, spread in zip(
                names, positions.tolist(), velocities.tolist(), radii, stated, strict=True
            )
        ]
        kind = "nav2_dynamic_msgs/msg/ObstacleArray"
        return make(kind, header=self.header(time), obstacles=found)

    def scan(self, scan: Scan, frame: str) -> Any:
        """Return a scan, whose beams have to be evenly spaced; ranges as float32."""
        count, make = len(scan.ranges), self.known.make
        turn = float(scan.bearings[-1] - scan.bearings[0]) / max(count - 1, 1)
        pause = float(scan.times[-1] - scan.times[0]) / max(count - 1, 1)
        return make(
            "sensor_msgs/msg/LaserScan",
            header=self.header(float(scan.times[0]), frame),
            angle_min=float(scan.bearings[0]),
            angle_max=float(scan.bearings[-1]),
            angle_increment=turn,
            time_increment=pause,
            range_max=scan.longest,
            ranges=np.asarray(scan.ranges, np.float32),
        )

    def points(self, time: float, points: Array, frame: str | None = None) -> Any:
        """Return points (P, D) in m, as a cloud of float32."""
        make = self.known.make
        fields = [
            make("sensor_msgs/msg/PointField", name=name, offset=4 * i, datatype=7, count=1)
            for i, name in enumerate("xyz")
        ]
        rows = np.zeros((len(points), 3), "<f4")
        rows[:, : points.shape[1]] = points
        return make(
            "sensor_msgs/msg/PointCloud2",
            header=self.header(time, frame),
            height=1,
            width=len(rows),
            fields=fields,
            point_step=12,
            row_step=12 * len(rows),
            data=np.frombuffer(rows.tobytes(), np.uint8),
            is_dense=True,
        )

    def grid(self, time: float, grid: OccupancyGrid) -> Any:
        """Return a grid as a map."""
        make = self.known.make
        info = make(
            "nav_msgs/msg/MapMetaData",
            map_load_time=self.stamp(time),
            resolution=grid.resolution,
            width=grid.width,
            height=grid.height,
            origin=self.pose(*grid.origin),
        )
        return make(
            "nav_msgs/msg/OccupancyGrid",
            header=self.header(time),
            info=info,
            data=grid.cells.ravel(),
        )

    def gaussians(self, time: float, names: Sequence[str], forecast: Forecast) -> Any:
        """Return a forecast as ``mpc_planner_msgs/msg/ObstacleArray``.

        A name that is a whole number is the id, of another one it is a hash. The pose is where the
        likeliest mode is at the first instant; each Gaussian has the mean and, along the heading
        of its pose and across it, the deviations at the others: what `decode_message` takes.

        Parameters
        ----------
        time : s, of the first instant. names : (O,). forecast : in the plane, of two instants or
            more, ``forecast.dt`` s apart.
        """
        make = self.known.make
        deviations, turns = ellipses_of(forecast.covariance, 0.0)
        headings = np.arctan2(turns[..., 0], -turns[..., 1])
        found = []
        for o, name in enumerate(names):
            modes = [
                make(
                    "mpc_planner_msgs/msg/Gaussian",
                    mean=self.path(
                        time + forecast.dt,
                        forecast.mean[o, m, 1:],
                        headings[o, m, 1:],
                        forecast.dt,
                    ),
                    major_semiaxis=deviations[o, m, 1:, 1].copy(),
                    minor_semiaxis=deviations[o, m, 1:, 0].copy(),
                )
                for m in range(forecast.mean.shape[1])
            ]
            x, y = forecast.mean[o, int(np.argmax(forecast.weight[o])), 0].tolist()
            found.append(
                make(
                    "mpc_planner_msgs/msg/ObstacleGMM",
                    id=number_of(name),
                    pose=self.pose(x, y),
                    gaussians=modes,
                    probabilities=forecast.weight[o].copy(),
                )
            )
        kind = "mpc_planner_msgs/msg/ObstacleArray"
        return make(kind, header=self.header(time), obstacles=found)

    def walls(self, time: float, polygons: Iterable[Polygon]) -> Any:
        """Return the outlines of what stands still, as markers."""
        return self._array(
            [
                self._strip(time, f"wall {one.name}", i, np.asarray(one.points), _GREY, 0.05)
                for i, one in enumerate(polygons)
            ]
        )

    def forecast(self, plan: Plan, tail: float = 0.05) -> Any:
        """Return the forecast of a plan as markers, a flat cylinder per step that is shown.

        Each is the ellipse that holds the content 1 - tail, the paler the less its mode weighs;
        in space it is the ellipsoid.
        """
        return self.spread(plan.stamp, plan.tracked, plan.forecast, tail)

    def spread(
        self, time: float, names: Sequence[str], forecast: Forecast | None, tail: float = 0.05
    ) -> Any:
        """Return a forecast of those of these names as markers, see `forecast`."""
        found: list[Any] = []
        if forecast is not None:
            found = self._ellipses(time, names, forecast, tail)
        return self._array(found)

    def _ellipses(
        self, time: float, names: Sequence[str], forecast: Forecast, tail: float
    ) -> list[Any]:
        found = []
        size = forecast.mean.shape[-1]
        scale = float(np.sqrt(content_bound(size, tail)))
        for owner, mode in zip(*np.nonzero(forecast.weight >= LIGHT), strict=True):
            for step in chosen_steps(forecast.steps, MOST_STEPS):
                place = forecast.mean[owner, mode, step].tolist()
                values, vectors = np.linalg.eigh(forecast.covariance[owner, mode, step])
                axes = (2.0 * scale * np.sqrt(np.clip(values, 0.0, None))).tolist()[::-1]
                yaw = float(np.arctan2(vectors[1, -1], vectors[0, -1]))
                pose = self._placed(place, yaw)
                if size == 3:
                    pose = self._turned(place, vectors[:, ::-1])
                found.append(
                    self.known.make(
                        "visualization_msgs/msg/Marker",
                        header=self.header(time),
                        ns=f"forecast of {names[owner]}",
                        id=step * forecast.weight.shape[1] + int(mode),
                        type=_CYLINDER if size == 2 else _SPHERE,
                        pose=pose,
                        scale=self._vector(*(*axes, TALL)[:3]),
                        color=self._colour(_ORANGE, 0.5 * float(forecast.weight[owner, mode])),
                    )
                )
        return found

    def _turned(self, place: Sequence[float], axes: Array) -> Any:
        """Return the pose whose axes are the columns (3, 3); one is turned round if need be."""
        right = axes * np.array([1.0, 1.0, np.sign(np.linalg.det(axes))])
        x, y, z, w = quaternion_of(right)
        turn = self.known.make("geometry_msgs/msg/Quaternion", x=x, y=y, z=z, w=w)
        kind = "geometry_msgs/msg/Pose"
        return self.known.make(kind, position=self._point(*place), orientation=turn)

    def regions(self, plan: Plan) -> Any:
        """Return what a plan keeps the robot's centre out of, as markers: outlines by step.

        A surface in space is drawn as lines across it.
        """
        steps = shown_steps(plan)
        found = []
        for (owner, mode), rims in kept_out(plan, plan.situation, steps).items():
            for step, rim in zip(steps, rims, strict=True):
                name = f"region of {plan.tracked[owner]}, mode {mode}"
                line = rim.reshape(-1, rim.shape[-1])
                found.append(self._strip(plan.stamp, name, step, line, _BLUE, 0.02))
        return self._array(found)

    def diagnostics(self, time: float, name: str, level: int, text: str,
                    values: Mapping[str, str]) -> Any:  # fmt: skip
        """Return the state of a node: level 0 is well, 1 a warning, 2 an error, 3 stale."""
        make = self.known.make
        pairs = [
            make("diagnostic_msgs/msg/KeyValue", key=key, value=value)
            for key, value in values.items()
        ]
        one = make(
            "diagnostic_msgs/msg/DiagnosticStatus",
            level=level, name=name, message=text, hardware_id="wideberth", values=pairs,
        )  # fmt: skip
        kind = "diagnostic_msgs/msg/DiagnosticArray"
        return make(kind, header=self.header(time, ""), status=[one])

    def _array(self, markers: list[Any]) -> Any:
        """Return markers that replace all those before them."""
        make = self.known.make
        clear = make(
            "visualization_msgs/msg/Marker",
            header=self.header(0.0),
            action=_DELETE_ALL,
            pose=self.pose(0.0, 0.0),
        )
        return make("visualization_msgs/msg/MarkerArray", markers=[clear, *markers])

    def _strip(
        self, time: float, name: str, ident: int, points: Array, colour: Any, width: float
    ) -> Any:
        rim = [self._point(*place) for place in (*points.tolist(), points[0].tolist())]
        return self.known.make(
            "visualization_msgs/msg/Marker",
            header=self.header(time),
            ns=name,
            id=ident,
            type=_STRIP,
            pose=self.pose(0.0, 0.0),
            scale=self._vector(width, 0.0),
            color=self._colour(colour, 1.0),
            points=rim,
        )

    def _colour(self, colour: tuple[float, float, float], opacity: float) -> Any:
        red, green, blue = colour
        return self.known.make("std_msgs/msg/ColorRGBA", r=red, g=green, b=blue, a=opacity)

    def _point(self, x: float, y: float, z: float = 0.0) -> Any:
        return self.known.make("geometry_msgs/msg/Point", x=x, y=y, z=z)

    def _vector(self, x: float, y: float, z: float = 0.0) -> Any:
        return self.known.make("geometry_msgs/msg/Vector3", x=x, y=y, z=z)

    def _turn(self, yaw: float) -> Any:
        kind = "geometry_msgs/msg/Quaternion"
        return self.known.make(kind, z=float(np.sin(yaw / 2)), w=float(np.cos(yaw / 2)))

    def _twist(self, forward: float, aside: float, rate: float, up: float = 0.0) -> Any:
        return self.known.make(
            "geometry_msgs/msg/Twist",
            linear=self._vector(float(forward), float(aside), float(up)),
            angular=self._vector(0.0, 0.0, float(rate)),
        )


def _three(parts: Sequence[Any]) -> tuple[float, float, float]:
    """Return two or three components as three."""
    return float(parts[0]), float(parts[1]), float(parts[2]) if len(parts) == 3 else 0.0


def _in_space(covariance: Array | None) -> Array:
    """Return a covariance of two or three coordinates as one of three, row by row."""
    found = np.zeros((3, 3))
    if covariance is not None:
        found[: len(covariance), : len(covariance)] = covariance
    return found.ravel()


def shown_steps(plan: Plan) -> list[int]:
    """Return the steps of a plan, from 0, that have markers."""
    return chosen_steps(len(plan.inputs), MOST_STEPS)

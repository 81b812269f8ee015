"""Our values as messages of ROS 2."""

import hashlib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from ..framework.drawing.style import chosen_steps
from ..framework.values.arrays import Array
from ..framework.values.forecast import LIGHT, Forecast, content_bound
from ..framework.values.motion import Command
from ..framework.values.plan import Plan, kept_out
from ..framework.values.polygon import Polygon
from ..framework.values.sensing import Scan
from .messages import Messages, messages

LONGEST_NAME = 16
"""Bytes of a name that fits into an identity of ROS 2; of a longer one it is a hash."""
MOST_STEPS = 8
"""Steps of a plan that have markers."""
TALL = 0.05
"""m, height of flat markers."""
_CYLINDER, _STRIP, _DELETE_ALL = 3, 4, 3
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


@final
@dataclass(frozen=True)
class Wording:
    """Makes messages of one distribution, in one frame that stands still.

    Parameters
    ----------
    epoch : ns, what is added to times.
    frame : that stands still.
    known : the message types.
    """

    epoch: int = 0
    frame: str = "map"
    known: Messages = field(default_factory=messages)

    def stamp(self, time: float) -> Any:
        """Return an instant, from s."""
        whole = self.epoch + round(time * 1e9)
        kind = "builtin_interfaces/msg/Time"
        return self.known.make(kind, sec=whole // 10**9, nanosec=whole % 10**9)

    def header(self, time: float, frame: str | None = None) -> Any:
        """Return a header, of the frame that stands still where none is stated."""
        name = self.frame if frame is None else frame
        return self.known.make("std_msgs/msg/Header", stamp=self.stamp(time), frame_id=name)

    def pose(self, x: float, y: float, yaw: float = 0.0) -> Any:
        """Return a pose in the plane, m and rad."""
        return self.known.make(
            "geometry_msgs/msg/Pose",
            position=self._point(x, y),
            orientation=self._turn(yaw),
        )

    def odometry(
        self, time: float, pose: Sequence[float], twist: Sequence[float], child: str
    ) -> Any:
        """Return pose (x, y in m, yaw in rad) and twist (forward, lateral in m/s, yaw rate)."""
        make = self.known.make
        return make(
            "nav_msgs/msg/Odometry",
            header=self.header(time),
            child_frame_id=child,
            pose=make("geometry_msgs/msg/PoseWithCovariance", pose=self.pose(*pose)),
            twist=make("geometry_msgs/msg/TwistWithCovariance", twist=self._twist(*twist)),
        )

    def transform(self, time: float, child: str, pose: Sequence[float]) -> Any:
        """Return the pose of a frame in the one that stands still."""
        x, y, yaw = pose
        motion = self.known.make(
            "geometry_msgs/msg/Transform",
            translation=self._vector(x, y),
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
        forward, aside = (*command.linear, 0.0)[:2]
        return self.known.make(
            "geometry_msgs/msg/TwistStamped",
            header=self.header(time, frame),
            twist=self._twist(forward, aside, command.omega),
        )

    def path(
        self, time: float, points: Array, headings: Array | None = None, dt: float = 0.0
    ) -> Any:
        """Return points (P, 2) in m as a path; ``dt`` s lie between the stamps of two poses.

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
                pose=self.pose(float(x), float(y), float(yaw)),
            )
            for k, ((x, y), yaw) in enumerate(zip(points, headings, strict=True))
        ]
        return self.known.make("nav_msgs/msg/Path", header=self.header(time), poses=poses)

    def plan(self, plan: Plan) -> Any:
        """Return a plan's positions as a path, with the instants at which it is there."""
        return self.path(plan.stamp, plan.positions, dt=plan.dt)

    def trajectory(self, plan: Plan) -> Any:
        """Return a plan as ``nav_msgs/msg/Trajectory``, which ROS 2 has from Lyrical on.

        Raises
        ------
        WideberthError : an older distribution.
        """
        path, make = self.plan(plan), self.known.make
        speed = np.gradient(plan.positions, plan.dt, axis=0)
        along = np.linalg.norm(speed, axis=1)
        points = [
            make(
                "nav_msgs/msg/TrajectoryPoint",
                header=one.header,
                pose=one.pose,
                velocity=self._twist(float(fast), 0.0, 0.0),
            )
            for one, fast in zip(path.poses, along, strict=True)
        ]
        return make("nav_msgs/msg/Trajectory", header=path.header, points=points)

    def obstacles(
        self,
        time: float,
        names: Sequence[str],
        positions: Array,
        velocities: Array,
        radii: Sequence[float],
    ) -> Any:
        """Return Nav2's dynamic obstacles: positions and velocities (O, 2), radii in m."""
        make = self.known.make
        found = [
            make(
                "nav2_dynamic_msgs/msg/Obstacle",
                uuid=make("unique_identifier_msgs/msg/UUID", uuid=identity(name)),
                score=1.0,
                position=self._point(*place),
                velocity=self._vector(*speed),
                size=self._vector(2.0 * radius, 2.0 * radius),
            )
            for name, place, speed, radius in zip(
                names, positions.tolist(), velocities.tolist(), radii, strict=True
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
        """Return points (P, 2) in m, as a cloud of float32."""
        make = self.known.make
        fields = [
            make("sensor_msgs/msg/PointField", name=name, offset=4 * i, datatype=7, count=1)
            for i, name in enumerate("xyz")
        ]
        rows = np.zeros((len(points), 3), "<f4")
        rows[:, :2] = points
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

        Each is the ellipse that holds the content 1 - tail, the paler the less its mode weighs.
        """
        found: list[Any] = []
        if plan.forecast is not None:
            found = self._spread(plan, plan.forecast, tail)
        return self._array(found)

    def _spread(self, plan: Plan, forecast: Forecast, tail: float) -> list[Any]:
        found = []
        scale = float(np.sqrt(content_bound(2, tail)))
        for owner, mode in zip(*np.nonzero(forecast.weight >= LIGHT), strict=True):
            for step in shown_steps(plan):
                x, y = forecast.mean[owner, mode, step].tolist()
                values, vectors = np.linalg.eigh(forecast.covariance[owner, mode, step])
                yaw = float(np.arctan2(vectors[1, 1], vectors[0, 1]))
                short, long = 2.0 * scale * np.sqrt(np.clip(values, 0.0, None))
                found.append(
                    self.known.make(
                        "visualization_msgs/msg/Marker",
                        header=self.header(plan.stamp),
                        ns=f"forecast of {plan.tracked[owner]}",
                        id=step * forecast.weight.shape[1] + int(mode),
                        type=_CYLINDER,
                        pose=self.pose(x, y, yaw),
                        scale=self._vector(float(long), float(short), TALL),
                        color=self._colour(_ORANGE, 0.5 * float(forecast.weight[owner, mode])),
                    )
                )
        return found

    def regions(self, plan: Plan) -> Any:
        """Return what a plan keeps the robot's centre out of, as markers: outlines by step."""
        steps = shown_steps(plan)
        found = []
        for (owner, mode), rims in kept_out(plan, plan.situation, steps).items():
            for step, rim in zip(steps, rims, strict=True):
                name = f"region of {plan.tracked[owner]}, mode {mode}"
                found.append(self._strip(plan.stamp, name, step, rim, _BLUE, 0.02))
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
        rim = [self._point(float(x), float(y)) for x, y in (*points, points[0])]
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

    def _point(self, x: float, y: float) -> Any:
        return self.known.make("geometry_msgs/msg/Point", x=x, y=y)

    def _vector(self, x: float, y: float, z: float = 0.0) -> Any:
        return self.known.make("geometry_msgs/msg/Vector3", x=x, y=y, z=z)

    def _turn(self, yaw: float) -> Any:
        kind = "geometry_msgs/msg/Quaternion"
        return self.known.make(kind, z=float(np.sin(yaw / 2)), w=float(np.cos(yaw / 2)))

    def _twist(self, forward: float, aside: float, rate: float) -> Any:
        return self.known.make(
            "geometry_msgs/msg/Twist",
            linear=self._vector(float(forward), float(aside)),
            angular=self._vector(0.0, 0.0, float(rate)),
        )


def shown_steps(plan: Plan) -> list[int]:
    """Return the steps of a plan, from 0, that have markers."""
    return chosen_steps(len(plan.inputs), MOST_STEPS)

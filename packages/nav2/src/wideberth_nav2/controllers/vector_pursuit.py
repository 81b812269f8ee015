"""Vector pursuit: an arc that respects the heading at the point ahead, by screw theory."""

from dataclasses import dataclass
from math import atan2, hypot, inf, log, pi, sqrt
from sys import float_info
from typing import Annotated, final

import numpy as np

from wideberth.framework.values.arrays import Array
from wideberth.framework.values.costmap import Costmap
from wideberth.framework.values.motion import Twist

from ..costs import MAX_NON_OBSTACLE
from ..parameters import Limited, NonNegative, Positive, check_parameters
from ..path_handler import closest_pose, half_side
from ..poses import in_base_frame, normalized, normalized_positive
from .local_controller import CONTROLLER_EXCEPTION, INVALID_PATH, Answer, Tick
from .pursuit import Pursuit, collision_arc

_STRAIGHT = float_info.max
"""m, radius of a straight line."""


@final
@dataclass(eq=False)
class VectorPursuit(Pursuit):
    """The vector pursuit controller, a plug-in of Nav2 by Black Coffee Robotics.

    With (x, y, theta) the point ahead in the robot's frame, d its distance, t = d^2 / (2 y),

        phi = atan2(2 y^2 - d^2, 2 x y) - atan2(t, 0)  in [0, 2 pi),
        R = |k phi / ((k - 1) phi + theta) t|,    omega = v / R  towards the point,

    R no smaller than `min_turning_radius`. It prunes the path on its own, starts from the velocity
    that it commanded last, not from a measured one, and averages headings as plain numbers, which
    is wrong across +-pi; all as in the original. The original throws an exception that Nav2's
    server does not forgive; here a blocked arc is "NoValidControl" as with the others.

    Parameters are those of `Pursuit`, and

    Parameters
    ----------
    k : weight of the translation, as against the turn.
    desired_linear_vel : m/s.
    min_turning_radius : m; 0 makes it turn on the spot, whatever `use_rotate_to_heading` says.
    rotate_to_heading_angular_vel : rad/s.
    max_angular_accel : rad/s^2, for turns on the spot.
    max_linear_accel : m/s^2.
    max_lateral_accel : m/s^2, in curves.
    min_linear_velocity : m/s.
    max_allowed_time_to_collision_up_to_target : s.
    use_interpolation : take a point between two poses of the plan.
    use_heading_from_path : its heading is that of the plan; else that of the step that ends there,
        and at the first pose that of the step that begins there.
    max_robot_pose_search_dist : m; negative: the whole path; None: half the larger side of the
        costmap.

    Raises
    ------
    WideberthError : a time, distance or rate that must be above zero and is not; no number where
        one is wanted.

    References
    ----------
    J. Wit, C. D. Crane and D. Armstrong, Autonomous ground vehicle path tracking, Journal of
    Robotic Systems 21 (2004); vector_pursuit_controller of Black Coffee Robotics (Apache-2.0), of
    which this is an own implementation, equal within 1e-9.
    """

    approach_velocity_scaling_dist: Positive = 1.0
    k: Positive = 8.0
    desired_linear_vel: Annotated[Positive, Limited("speed")] = 0.5
    min_turning_radius: NonNegative = 1.0
    rotate_to_heading_angular_vel: Annotated[float, Limited("yaw_rate")] = 1.8
    max_angular_accel: Annotated[float, Limited("yaw_acceleration")] = 3.2
    max_linear_accel: Annotated[float, Limited("acceleration")] = 2.0
    max_lateral_accel: Positive = 0.5
    min_linear_velocity: float = 0.05
    max_allowed_time_to_collision_up_to_target: float = 1.0
    use_interpolation: bool = True
    use_heading_from_path: bool = True
    max_robot_pose_search_dist: float | None = None

    def __post_init__(self) -> None:
        check_parameters(self, "vector_pursuit")
        self._rotates = self.use_rotate_to_heading or self.min_turning_radius == 0.0
        self._fastest = self.desired_linear_vel
        self._last = (0.0, 0.0)
        self._left = np.zeros((0, 3))

    def reset(self) -> None:
        """Do nothing: the original has no reset, and its last command stays."""

    def new_path(self, path: Array) -> None:
        """Follow a path (N, 3) from now on."""
        self._left = np.array(path, dtype=np.float64).reshape(-1, 3)

    def limit_speed(self, value: float, percentage: bool) -> None:
        """Limit the linear speed, see `LocalController.limit_speed`."""
        base = self.desired_linear_vel
        self._fastest = (base * value / 100.0 if percentage else value) if value else base

    def velocity(self, tick: Tick) -> Answer:
        """Return the velocity for now, or the reason why there is none."""
        plan = self.pruned(tick.costmap, tick.pose)
        if not len(plan):
            return Answer.refusal("no pose of the path is near the robot", INVALID_PATH)
        target = self.target(plan)
        sign = self.sign(target)
        reach = hypot(float(target[0]), float(target[1]))
        turn = self._turn(target, plan, sign, reach < tick.checker.xy_goal_tolerance)
        if turn is not None:
            speed, turning = 0.0, self._rotation(turn)
        else:
            cost = int(tick.costmap.at(tick.pose[:2], outside=-1))
            if cost < 0:
                return Answer.refusal("the robot is off its costmap", CONTROLLER_EXCEPTION)
            radius = self.turning_radius(target)
            if not radius:
                return Answer.refusal("the point ahead is behind, and the turning radius zero")
            speed = sign * self._speed(plan, radius, cost, tick.footprint.inscribed)
            turning = speed / radius if target[1] >= 0.0 else -speed / radius
        arc = None
        if self.use_collision_detection:
            time = self.max_allowed_time_to_collision_up_to_target
            arc, hit = collision_arc(tick, speed, turning, time, reach)
            if hit:
                return Answer.refusal("the arc to the point ahead hits an obstacle")
        self._last = (speed, turning)
        return Answer(Twist((speed, 0.0), turning), expected=arc)

    def pruned(self, costmap: Costmap, pose: Array) -> Array:
        """Return the path (N, 3) near the robot, in its frame, and forget what it has passed.

        Parameters
        ----------
        costmap : half its larger side is how far the plan may reach from the robot.
        pose : (3,), of the robot.
        """
        if not len(self._left):
            return self._left
        closest = closest_pose(self._left, pose, costmap, self.max_robot_pose_search_dist)
        self._left = self._left[closest:]
        apart = np.hypot(*(self._left[:, :2] - pose[:2]).T)
        beyond = np.flatnonzero(apart > half_side(costmap))
        ahead = self._left[: beyond[0]] if len(beyond) else self._left
        return in_base_frame(ahead, pose)

    def target(self, plan: Array) -> Array:
        """Return the point (3,) of a plan (N, 3), both in the robot's frame, that is aimed at."""
        reach = min(self.look_ahead_distance(self._last[0]), _cusp_distance(plan))
        far = np.flatnonzero(np.hypot(plan[:, 0], plan[:, 1]) >= reach)
        place = int(far[0]) if len(far) else len(plan) - 1
        if self.use_interpolation and len(far) and place:
            return self._between(plan[place - 1], plan[place], reach)
        point: Array = plan[place].copy()
        if not self.use_heading_from_path and len(plan) > 1:
            point[2] = _heading(plan[max(place - 1, 0)], plan[max(place, 1)])
        return point

    def _between(self, begin: Array, end: Array, reach: float) -> Array:
        """Return the pose on a step that is ``reach`` (m) away from the robot."""
        x, y = _on_circle(begin, end, reach)
        if not self.use_heading_from_path:
            return np.array([x, y, _heading(begin, end)])
        both = [float(yaw) + 2.0 * pi if yaw < 0.0 else float(yaw) for yaw in (begin[2], end[2])]
        return np.array([x, y, normalized(0.5 * (both[0] + both[1]))])

    def _turn(self, target: Array, plan: Array, sign: float, arrived: bool) -> float | None:
        """Angle to turn by on the spot, rad; None where it drives."""
        if not self._rotates:
            return None
        if arrived:
            return float(plan[-1, 2])
        return self.turn_towards(target, sign)

    def _rotation(self, angle: float) -> float:
        """Yaw rate for a turn by an angle, rad/s, from the one commanded last."""
        change = self.max_angular_accel / self.controller_frequency
        wanted = self.rotate_to_heading_angular_vel * (1.0 if angle > 0.0 else -1.0)
        return min(max(wanted, self._last[1] - change), self._last[1] + change)

    def turning_radius(self, target: Array) -> float:
        """Radius of the arc towards a pose (3,) in the robot's frame, m."""
        x, y, theta = (float(value) for value in target)
        if x < 0.0 and not self.allow_reversing:
            return self.min_turning_radius
        if abs(y) <= 1e-6:
            return _STRAIGHT
        square = x * x + y * y
        t = square / (2.0 * y)
        apart = atan2(2.0 * y * y - square, 2.0 * x * y) - atan2(t, 0.0)
        phi = max(normalized_positive(apart), 1e-9)
        below = (self.k - 1.0) * phi + normalized(theta)
        radius = abs(self.k * phi / below * t) if below else _STRAIGHT
        return max(radius, self.min_turning_radius)

    def _speed(self, plan: Array, radius: float, cost: int, inscribed: float) -> float:
        """Speed, m/s, without its sign."""
        fastest = self._fastest
        speed = min(fastest, sqrt(self.max_lateral_accel * radius))
        if self.cost_regulated(cost):
            factor = self.inflation_cost_scaling_factor
            apart = inscribed - log(cost / MAX_NON_OBSTACLE) / factor
            speed = min(speed, fastest * self.share_near(apart))
        speed = min(speed, abs(self._last[0]) + self.max_linear_accel / self.controller_frequency)
        return max(self.approaching(speed, fastest, plan), self.min_linear_velocity)


def _heading(begin: Array, end: Array) -> float:
    """Direction of a step, rad."""
    return atan2(float(end[1] - begin[1]), float(end[0] - begin[0]))


def _cusp_distance(plan: Array) -> float:
    """Distance of the robot from the first pose where a plan turns back or on the spot, m."""
    for i in range(1, len(plan) - 1):
        came, goes = plan[i, :2] - plan[i - 1, :2], plan[i + 1, :2] - plan[i, :2]
        turned = (not came.any() and plan[i - 1, 2] != plan[i, 2]) or (
            not goes.any() and plan[i, 2] != plan[i + 1, 2]
        )
        if turned or float(came[0] * goes[0] + came[1] * goes[1]) < 0.0:
            return hypot(float(plan[i, 0]), float(plan[i, 1]))
    return inf


def _on_circle(begin: Array, end: Array, reach: float) -> tuple[float, float]:
    """Return where a step that starts within a circle about the robot leaves it, m."""
    x1, y1, x2, y2 = float(begin[0]), float(begin[1]), float(end[0]), float(end[1])
    dx, dy = x2 - x1, y2 - y1
    square, area = dx * dx + dy * dy, x1 * y2 - x2 * y1
    root = sqrt(max(reach * reach * square - area * area, 0.0))
    sign = -1.0 if x2 * x2 + y2 * y2 < x1 * x1 + y1 * y1 else 1.0
    x = (area * dy + sign * dx * root) / square
    return x, (-area * dx + sign * dy * root) / square

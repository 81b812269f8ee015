"""Regulated pure pursuit: an arc to a point ahead, slower in curves and near obstacles."""

from dataclasses import dataclass
from math import hypot, inf, log
from typing import Annotated, final

import numpy as np

from wideberth.framework.values.arrays import Array
from wideberth.framework.values.motion import Twist

from ..costs import INSCRIBED
from ..parameters import Limited, Named, Positive, check_parameters
from ..poses import in_base_frame, length, look_ahead, rotation_rate
from .local_controller import CONTROLLER_EXCEPTION, Answer, Tick
from .pursuit import Pursuit, collision_arc

_LOG_INSCRIBED = float(np.float32(log(INSCRIBED)))
"""Nav2 takes this logarithm in single precision."""
_CLOSE = 0.001
"""m^2: a point nearer than its root has no curvature."""
Bounds = tuple[float, float]
"""Least and largest value."""

_STILL = 1e-3
"""m/s or rad/s; also 1/m of a straight line, and the distance of equally near corners."""


@final
@dataclass(eq=False)
class RegulatedPurePursuit(Pursuit):
    """Nav2's regulated pure pursuit, with Dynamic Window Pure Pursuit as an option.

    With (x, y) the point of the plan at the arc length `lookahead_dist`, in the robot's frame,

        kappa = 2 y / (x^2 + y^2),    omega = v kappa.

    v is `max_linear_vel`, less in curves tighter than `regulated_linear_scaling_min_radius`, near
    obstacles (by the cost where the robot stands) and near the goal. Where that point is far off
    the robot's heading, and at the goal, the robot turns on the spot. It never drives round
    anything: where its arc hits something within a second, there is no valid control.

    The bounds on velocity and acceleration bind only with `use_dynamic_window`: without it, the
    yaw rate has no bound. Parameters are those of `Pursuit`, and

    Parameters
    ----------
    max_linear_vel, min_linear_vel : m/s.
    max_angular_vel, min_angular_vel : rad/s.
    max_linear_accel, max_linear_decel : m/s^2, the latter negative.
    max_angular_accel, max_angular_decel : rad/s^2, the latter negative.
    rotate_to_heading_angular_vel : rad/s.
    max_allowed_time_to_collision_up_to_carrot : s.
    min_distance_to_obstacle : m that have to be free ahead; negative: time alone counts.
    use_regulated_linear_velocity_scaling : slow in curves.
    regulated_linear_scaling_min_radius : m, tighter curves slow.
    regulated_linear_scaling_min_speed : m/s, below which curves and costs do not slow.
    use_fixed_curvature_lookahead : take the curvature at `curvature_lookahead_dist` instead.
    curvature_lookahead_dist : m.
    interpolate_curvature_after_goal : that point may lie beyond the goal.
    use_dynamic_window : choose v and omega among those that the accelerations allow.
    allow_obstacle_checking_beyond_goal : test the arc past the end of the plan.

    Raises
    ------
    WideberthError : a time, distance or rate that must be above zero and is not; no number where
        one is wanted.

    References
    ----------
    S. Macenski, S. Singh, F. Martin and J. Gines, Regulated pure pursuit for robot path tracking,
    Autonomous Robots 47 (2023); Nav2, nav2_regulated_pure_pursuit_controller (Apache-2.0), of
    which this is an own implementation, equal within 1e-9.
    """

    max_linear_vel: Annotated[Positive, Limited("speed"), Named("desired_linear_vel")] = 0.5
    min_linear_vel: Annotated[float, Limited("backwards", -1)] = -0.5
    max_angular_vel: Annotated[float, Limited("yaw_rate")] = 2.5
    min_angular_vel: Annotated[float, Limited("yaw_rate", -1)] = -2.5
    max_linear_accel: Annotated[float, Limited("acceleration")] = 2.5
    max_linear_decel: Annotated[float, Limited("acceleration", -1)] = -2.5
    max_angular_accel: Annotated[Positive, Limited("yaw_acceleration")] = 3.2
    max_angular_decel: Annotated[float, Limited("yaw_acceleration", -1)] = -3.2
    rotate_to_heading_angular_vel: Annotated[float, Limited("yaw_rate")] = 1.8
    max_allowed_time_to_collision_up_to_carrot: float = 1.0
    min_distance_to_obstacle: float = -1.0
    use_regulated_linear_velocity_scaling: bool = True
    regulated_linear_scaling_min_radius: Positive = 0.90
    regulated_linear_scaling_min_speed: float = 0.25
    use_fixed_curvature_lookahead: bool = False
    curvature_lookahead_dist: Positive = 0.6
    interpolate_curvature_after_goal: bool = False
    use_dynamic_window: bool = False
    allow_obstacle_checking_beyond_goal: bool = False

    def __post_init__(self) -> None:
        check_parameters(self, "regulated_pure_pursuit")
        self._fastest = self.max_linear_vel
        self._last = (0.0, 0.0)

    def reset(self) -> None:
        """Forget the last command, which the dynamic window starts from."""
        self._last = (0.0, 0.0)

    def new_path(self, path: Array) -> None:
        """Do nothing: each tick brings its plan."""

    def limit_speed(self, value: float, percentage: bool) -> None:
        """Limit the linear speed, see `LocalController.limit_speed`."""
        base = self.max_linear_vel
        self._fastest = (base * value / 100.0 if percentage else value) if value else base

    def velocity(self, tick: Tick) -> Answer:
        """Return the velocity for now, or the reason why there is none."""
        plan = in_base_frame(tick.plan, tick.pose)
        carrot, _ = look_ahead(plan, self.look_ahead_distance(float(tick.speed[0])))
        ahead = self.curvature_carrot(plan, carrot)
        sign = self.sign(carrot)
        turn = self.turn(tick, plan, ahead, sign)
        if turn is not None:
            speed, turning = 0.0, rotation_rate(
                turn, float(tick.speed[2]), self.rotate_to_heading_angular_vel,
                self.max_angular_accel, 1.0 / self.controller_frequency,
            )  # fmt: skip
        else:
            regulated = self._regulated(tick, plan, _curvature(ahead), sign)
            if regulated is None:
                reason = "the robot is off its costmap"
                return Answer.refusal(reason, CONTROLLER_EXCEPTION)
            speed, turning = self._along(regulated, _curvature(ahead), sign)
        arc = None
        if self.use_collision_detection:
            time, reach = self._tested(speed, carrot, plan)
            arc, hit = collision_arc(tick, speed, turning, time, reach)
            if hit:
                return Answer.refusal("the arc to the point ahead hits an obstacle")
        self._last = (speed, turning)
        return Answer(Twist((speed, 0.0), turning), expected=arc)

    def curvature_carrot(self, plan: Array, carrot: Array) -> Array:
        """Point that gives the curvature: the carrot, or one at a fixed arc length."""
        if not self.use_fixed_curvature_lookahead:
            return carrot
        beyond = self.interpolate_curvature_after_goal
        return look_ahead(plan, self.curvature_lookahead_dist, beyond)[0]

    def turn(self, tick: Tick, plan: Array, ahead: Array, sign: float) -> float | None:
        """Angle to turn by on the spot, rad; None where it drives."""
        if not self.use_rotate_to_heading:
            return None
        if tick.checker.xy_reached(tick.pose, tick.goal, tick.plan):
            return float(plan[-1, 2])
        return self.turn_towards(ahead, sign)

    def _regulated(self, tick: Tick, plan: Array, curvature: float, sign: float) -> float | None:
        """Speed, m/s, less in curves, near obstacles and near the goal; None off the costmap."""
        cost = int(tick.costmap.at(tick.pose[:2], outside=-1))
        if cost < 0:
            return None
        fastest = self._fastest
        slowest = fastest
        if self.use_regulated_linear_velocity_scaling:
            radius = abs(1.0 / curvature) if curvature else inf
            tight = self.regulated_linear_scaling_min_radius
            if radius < tight:
                slowest = fastest * (1.0 - abs(radius - tight) / tight)
        if self.cost_regulated(cost):
            factor = self.inflation_cost_scaling_factor
            apart = (factor * tick.footprint.inscribed - log(cost) + _LOG_INSCRIBED) / factor
            slowest = min(slowest, fastest * self.share_near(apart))
        speed = max(slowest, self.regulated_linear_scaling_min_speed)
        speed = self.approaching(speed, speed, plan)
        return sign * min(abs(speed), fastest)

    def _along(self, speed: float, curvature: float, sign: float) -> tuple[float, float]:
        """Speed and yaw rate on an arc."""
        if not self.use_dynamic_window:
            return speed, speed * curvature
        linear = window(
            self._last[0], self.max_linear_accel, self.max_linear_decel,
            (self.min_linear_vel, min(self.max_linear_vel, self._fastest)),
            1.0 / self.controller_frequency,
        )  # fmt: skip
        angular = window(
            self._last[1], self.max_angular_accel, self.max_angular_decel,
            (self.min_angular_vel, self.max_angular_vel), 1.0 / self.controller_frequency,
        )  # fmt: skip
        return nearest_to_curvature(linear, angular, speed, curvature, sign)

    def _tested(self, speed: float, carrot: Array, plan: Array) -> tuple[float, float]:
        """Time, s, and distance, m, over which the arc has to be free."""
        time = self.max_allowed_time_to_collision_up_to_carrot
        reach = hypot(float(carrot[0]), float(carrot[1]))
        free = self.min_distance_to_obstacle
        if free <= 0.0:
            return time, reach
        slow = max(abs(speed), self.min_approach_linear_velocity)
        time = max(time, free / slow) if slow > 0.0 else inf
        if self.use_velocity_scaled_lookahead_dist:
            wanted = free if self.allow_obstacle_checking_beyond_goal else min(free, length(plan))
            reach = min(max(reach, wanted), self.max_lookahead_dist)
        return time, reach


def _curvature(point: Array) -> float:
    """Curvature of the arc from the robot to a point in its frame, 1/m."""
    square = float(point[0] ** 2 + point[1] ** 2)
    return 2.0 * float(point[1]) / square if square > _CLOSE else 0.0


def window(last: float, accel: float, decel: float, limits: Bounds, period: float) -> Bounds:
    """Return the velocities that an axis can have after a period.

    Parameters
    ----------
    last : velocity that was commanded last.
    accel, decel : how fast its magnitude rises, and falls (negative).
    limits : of the velocity.
    period : s.
    """
    if last > _STILL:
        low, high = last + decel * period, last + accel * period
    elif last < -_STILL:
        low, high = last - accel * period, last - decel * period
    else:
        low, high = last - accel * period, last + accel * period
    return max(low, limits[0]), min(high, limits[1])


def nearest_to_curvature(
    linear: Bounds, angular: Bounds, speed: float, curvature: float, sign: float
) -> tuple[float, float]:
    """Return the velocity in a window that follows an arc fastest, or comes nearest to it.

    Parameters
    ----------
    linear, angular : the window, m/s and rad/s.
    speed : m/s, regulated one, which is not exceeded.
    curvature : 1/m.
    sign : 1 forwards, -1 backwards.
    """
    slow, fast = _narrowed(linear, speed)
    low, high = angular
    if abs(curvature) < _STILL:
        straight = 0.0 if low <= 0.0 <= high else min(low, high, key=abs)
        return (fast if sign > 0.0 else slow), straight
    best: tuple[float, float] | None = None
    for v, w in (
        (slow, curvature * slow), (fast, curvature * fast), (low / curvature, low),
        (high / curvature, high),
    ):  # fmt: skip
        inside = slow <= v <= fast and low <= w <= high
        if inside and (best is None or v * sign > best[0] * sign):
            best = (v, w)
    return best or _nearest_corner((slow, fast), angular, curvature, sign)


def _narrowed(linear: Bounds, speed: float) -> Bounds:
    """Return the part of a window between 0 and a speed, or its bound that is nearest to it."""
    least, most = min(0.0, speed), max(0.0, speed)
    low, high = max(linear[0], least), min(linear[1], most)
    if low > high:
        return (low, low) if low > most else (high, high)
    return low, high


def _nearest_corner(
    linear: Bounds, angular: Bounds, curvature: float, sign: float
) -> tuple[float, float]:
    """Return the corner of a window that is nearest to the line w = curvature v."""
    best, nearest = (linear[0], angular[0]), float("inf")
    for v in linear:
        for w in angular:
            apart = abs(curvature * v - w) / hypot(curvature, 1.0)
            tie = abs(apart - nearest) <= _STILL and v * sign > best[0] * sign
            if apart < nearest or tie:
                best, nearest = (v, w), apart
    return best

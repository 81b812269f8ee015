"""Regulated pure pursuit: an arc to a point ahead, slower in curves and near obstacles."""

from dataclasses import dataclass
from math import atan2, hypot, inf, log, pi
from typing import final

import numpy as np

from ...framework.values.arrays import Array
from ...framework.values.costmap import FREE_SPACE, INSCRIBED, NO_INFORMATION
from ...framework.values.motion import Twist
from ..parameters.parameters import check_parameters
from ..poses import in_base_frame, length, look_ahead, normalized, rotation_rate
from .collision_arc import collision_arc
from .dynamic_window import nearest_to_curvature, window
from .local_controller import CONTROLLER_EXCEPTION, Answer, LocalController, Tick

_LOG_INSCRIBED = float(np.float32(log(INSCRIBED)))
"""Nav2 takes this logarithm in single precision."""
_CLOSE = 0.001
"""m^2: a point nearer than its root has no curvature."""


@final
@dataclass(eq=False)
class RegulatedPurePursuit(LocalController):
    """Nav2's regulated pure pursuit, with Dynamic Window Pure Pursuit as an option.

    With (x, y) the point of the plan at the arc length `lookahead_dist`, in the robot's frame,

        kappa = 2 y / (x^2 + y^2),    omega = v kappa.

    v is `max_linear_vel`, less in curves tighter than `regulated_linear_scaling_min_radius`, near
    obstacles (by the cost where the robot stands) and near the goal. Where that point is far off
    the robot's heading, and at the goal, the robot turns on the spot. It never drives round
    anything: where its arc hits something within a second, there is no valid control.

    The bounds on velocity and acceleration bind only with `use_dynamic_window`: without it, the
    yaw rate has no bound.

    Parameters
    ----------
    max_linear_vel, min_linear_vel : m/s.
    max_angular_vel, min_angular_vel : rad/s.
    max_linear_accel, max_linear_decel : m/s^2, the latter negative.
    max_angular_accel, max_angular_decel : rad/s^2, the latter negative.
    lookahead_dist, min_lookahead_dist, max_lookahead_dist : m.
    lookahead_time : s.
    use_velocity_scaled_lookahead_dist : look ahead by speed times `lookahead_time`.
    rotate_to_heading_angular_vel : rad/s.
    use_rotate_to_heading : turn on the spot.
    rotate_to_heading_min_angle : rad, from which on it does.
    min_approach_linear_velocity : m/s, least speed near the goal.
    approach_velocity_scaling_dist : m, from which on it slows for the goal.
    max_allowed_time_to_collision_up_to_carrot : s.
    min_distance_to_obstacle : m that have to be free ahead; negative: time alone counts.
    use_regulated_linear_velocity_scaling : slow in curves.
    regulated_linear_scaling_min_radius : m, tighter curves slow.
    regulated_linear_scaling_min_speed : m/s, below which curves and costs do not slow.
    use_cost_regulated_linear_velocity_scaling : slow near obstacles.
    cost_scaling_dist : m, from an obstacle, from which on it slows.
    cost_scaling_gain : of that.
    inflation_cost_scaling_factor : 1/m, of the costmap's inflation.
    use_fixed_curvature_lookahead : take the curvature at `curvature_lookahead_dist` instead.
    curvature_lookahead_dist : m.
    interpolate_curvature_after_goal : that point may lie beyond the goal.
    use_collision_detection : test the arc.
    allow_reversing : drive backwards to a point behind.
    use_dynamic_window : choose v and omega among those that the accelerations allow.
    allow_obstacle_checking_beyond_goal : test the arc past the end of the plan.
    controller_frequency : Hz, of ticks.

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

    max_linear_vel: float = 0.5
    min_linear_vel: float = -0.5
    max_angular_vel: float = 2.5
    min_angular_vel: float = -2.5
    max_linear_accel: float = 2.5
    max_linear_decel: float = -2.5
    max_angular_accel: float = 3.2
    max_angular_decel: float = -3.2
    lookahead_dist: float = 0.6
    min_lookahead_dist: float = 0.3
    max_lookahead_dist: float = 0.9
    lookahead_time: float = 1.5
    use_velocity_scaled_lookahead_dist: bool = False
    rotate_to_heading_angular_vel: float = 1.8
    use_rotate_to_heading: bool = True
    rotate_to_heading_min_angle: float = 0.785
    min_approach_linear_velocity: float = 0.05
    approach_velocity_scaling_dist: float = 0.6
    max_allowed_time_to_collision_up_to_carrot: float = 1.0
    min_distance_to_obstacle: float = -1.0
    use_regulated_linear_velocity_scaling: bool = True
    regulated_linear_scaling_min_radius: float = 0.90
    regulated_linear_scaling_min_speed: float = 0.25
    use_cost_regulated_linear_velocity_scaling: bool = True
    cost_scaling_dist: float = 0.6
    cost_scaling_gain: float = 1.0
    inflation_cost_scaling_factor: float = 3.0
    use_fixed_curvature_lookahead: bool = False
    curvature_lookahead_dist: float = 0.6
    interpolate_curvature_after_goal: bool = False
    use_collision_detection: bool = True
    allow_reversing: bool = False
    use_dynamic_window: bool = False
    allow_obstacle_checking_beyond_goal: bool = False
    controller_frequency: float = 20.0

    def __post_init__(self) -> None:
        above = (
            "max_linear_vel", "lookahead_dist", "approach_velocity_scaling_dist",
            "regulated_linear_scaling_min_radius", "cost_scaling_dist",
            "inflation_cost_scaling_factor", "curvature_lookahead_dist", "max_angular_accel",
            "controller_frequency",
        )  # fmt: skip
        check_parameters(self, "regulated_pure_pursuit", above)
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
        sign = -1.0 if self.allow_reversing and carrot[0] < 0.0 else 1.0
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

    def look_ahead_distance(self, speed: float) -> float:
        """How far ahead the point is that it follows, m."""
        if not self.use_velocity_scaled_lookahead_dist:
            return self.lookahead_dist
        wanted = abs(speed) * self.lookahead_time
        return min(max(wanted, self.min_lookahead_dist), self.max_lookahead_dist)

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
        angle = atan2(float(ahead[1]), float(ahead[0]))
        if sign < 0.0:
            angle = normalized(angle + pi)
        return angle if abs(angle) > self.rotate_to_heading_min_angle else None

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
        if self.use_cost_regulated_linear_velocity_scaling:
            slowest = min(slowest, fastest * self._cost_share(cost, tick.footprint.inscribed))
        speed = max(slowest, self.regulated_linear_scaling_min_speed)
        if length(plan) < self.approach_velocity_scaling_dist:
            apart = hypot(float(plan[-1, 0]), float(plan[-1, 1]))
            slow = speed * apart / self.approach_velocity_scaling_dist
            speed = min(speed, max(slow, self.min_approach_linear_velocity))
        return sign * min(max(abs(speed), 0.0), fastest)

    def _cost_share(self, cost: int, inscribed: float) -> float:
        """Share of the speed that the cost at the robot leaves."""
        if cost in (FREE_SPACE, NO_INFORMATION):
            return 1.0
        factor = self.inflation_cost_scaling_factor
        apart = (factor * inscribed - log(cost) + _LOG_INSCRIBED) / factor
        if apart >= self.cost_scaling_dist:
            return 1.0
        return self.cost_scaling_gain * apart / self.cost_scaling_dist

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

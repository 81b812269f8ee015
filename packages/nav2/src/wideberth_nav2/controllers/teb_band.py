"""The timed elastic band: its parameters, poses, and the time from each to the next."""

from dataclasses import dataclass
from itertools import pairwise
from math import atan2, cos, hypot, inf, pi, sin
from typing import Annotated, final

import numpy as np
from annotated_types import Ge

from wideberth.framework.values.arrays import Array

from ..parameters import Count, Limited, Named, NonNegative, Positive, check_parameters, check_work
from ._teb_kernel import wrapped

Pose = tuple[float, float, float]
_SWEEPS, _PASSED = 100, 10
"""Times that a band is gone through when it is resized; poses that it may lose at once."""
_MOST = 1e7
"""Poses that a tick may solve for; the defaults allow 5e4."""


@dataclass(eq=False)
class TebParameters:
    """What the timed elastic band weighs and keeps, by the original's names and defaults.

    Attributes
    ----------
    robot_radius : m, of the disc that the band keeps clear of obstacles (footprint_model.radius).
    dt_ref, dt_hysteresis : s, wanted interval between two poses, and how far it may be off.
    min_samples, max_samples : least poses of a band and most intervals.
    global_plan_overwrite_orientation : headings follow the plan's direction, not its yaws.
    allow_init_with_backwards_motion : a new band towards a goal behind the robot goes backwards.
    max_global_plan_lookahead_dist : m, of the plan that a band covers; 0: as far as the map.
    force_reinit_new_goal_dist, force_reinit_new_goal_angular : m, rad; a goal that has moved so
        far begins a new band.
    control_look_ahead_poses : intervals that the command is averaged over.
    feasibility_check_no_poses : poses whose outline must be free; -1: all.
    min_resolution_collision_check_angular : rad, of that test between poses.
    max_vel_x, max_vel_x_backwards, max_vel_theta : m/s, m/s, rad/s.
    acc_lim_x, acc_lim_theta : m/s^2, rad/s^2.
    use_proportional_saturation : a command beyond the limits keeps its curvature.
    free_goal_vel : the band need not stop at its end.
    min_obstacle_dist : m, that the band keeps from obstacles.
    inflation_dist, dynamic_obstacle_inflation_dist : m, beyond it a nearness costs little.
    include_dynamic_obstacles : moving obstacles are predicted at constant velocity.
    include_costmap_obstacles : every lethal cell is an obstacle.
    costmap_obstacles_behind_robot_dist : m, cells behind the robot are left out beyond it.
    obstacle_association_force_inclusion_factor, obstacle_association_cutoff_factor : in units of
        ``min_obstacle_dist``: a pose takes every obstacle nearer than the first, none farther
        than the second, and of the rest the nearest at each side.
    no_inner_iterations, no_outer_iterations : of the solver, and of resizing and solving.
    penalty_epsilon : margin of every limit.
    weight_max_vel_x ... weight_prefer_rotdir : of the squared errors.
    weight_adapt_factor : by which the obstacles' weight grows with each outer iteration.
    enable_homotopy_class_planning : bands that pass obstacles at other sides compete.
    max_number_classes : such bands at most.
    selection_cost_hysteresis, selection_prefer_initial_plan : factors on the cost of the last
        best band and of the plan's own.
    selection_obst_cost_scale : factor on the cost of obstacles when bands compete.
    roadmap_graph_samples, roadmap_graph_area_width : points, and m, of the graph whose paths
        begin new bands.
    obstacle_heading_threshold : least cosine between an edge of that graph and the direction to
        the goal.
    h_signature_threshold : an obstacle with less is too far to distinguish bands.
    max_ratio_detours_duration_best_duration : a band that lasts so much longer than the best is
        dropped.
    detours_orientation_tolerance, length_start_orientation_vector : rad, m; so is a band whose
        first direction, over that length, is off the best one's by more.
    oscillation_recovery : a robot that turns to and fro is made to keep one sense.
    oscillation_v_eps, oscillation_omega_eps : of the greatest speeds; a lower mean is standing.
    oscillation_recovery_min_duration, oscillation_filter_duration : s.
    controller_frequency : Hz.

    Raises
    ------
    WideberthError : a number that is negative or not finite, a speed of zero, or too few samples.
    """

    robot_radius: Annotated[NonNegative, Named("footprint_model.radius")] = 0.0
    dt_ref: NonNegative = 0.3
    dt_hysteresis: NonNegative = 0.1
    min_samples: Annotated[int, Ge(3)] = 3
    max_samples: Count = 500
    global_plan_overwrite_orientation: bool = True
    allow_init_with_backwards_motion: bool = False
    max_global_plan_lookahead_dist: NonNegative = 1.0
    force_reinit_new_goal_dist: NonNegative = 1.0
    force_reinit_new_goal_angular: NonNegative = 0.5 * pi
    control_look_ahead_poses: Count = 1
    feasibility_check_no_poses: int = 5
    min_resolution_collision_check_angular: Positive = pi
    max_vel_x: Annotated[Positive, Limited("speed")] = 0.4
    max_vel_x_backwards: Annotated[NonNegative, Limited("backwards", 0)] = 0.2
    max_vel_theta: Annotated[Positive, Limited("yaw_rate")] = 0.3
    acc_lim_x: Annotated[NonNegative, Limited("acceleration")] = 0.5
    acc_lim_theta: Annotated[NonNegative, Limited("yaw_acceleration")] = 0.5
    use_proportional_saturation: bool = False
    free_goal_vel: bool = False
    min_obstacle_dist: NonNegative = 0.5
    inflation_dist: NonNegative = 0.6
    dynamic_obstacle_inflation_dist: NonNegative = 0.6
    include_dynamic_obstacles: bool = True
    include_costmap_obstacles: bool = True
    costmap_obstacles_behind_robot_dist: NonNegative = 1.5
    obstacle_association_force_inclusion_factor: NonNegative = 1.5
    obstacle_association_cutoff_factor: NonNegative = 5.0
    no_inner_iterations: Count = 5
    no_outer_iterations: Count = 4
    penalty_epsilon: NonNegative = 0.05
    weight_max_vel_x: NonNegative = 2.0
    weight_max_vel_theta: NonNegative = 1.0
    weight_acc_lim_x: NonNegative = 1.0
    weight_acc_lim_theta: NonNegative = 1.0
    weight_kinematics_nh: NonNegative = 1000.0
    weight_kinematics_forward_drive: NonNegative = 1.0
    weight_optimaltime: NonNegative = 1.0
    weight_shortest_path: NonNegative = 0.0
    weight_obstacle: NonNegative = 50.0
    weight_inflation: NonNegative = 0.1
    weight_dynamic_obstacle: NonNegative = 50.0
    weight_dynamic_obstacle_inflation: NonNegative = 0.1
    weight_prefer_rotdir: NonNegative = 50.0
    weight_adapt_factor: NonNegative = 2.0
    enable_homotopy_class_planning: bool = True
    max_number_classes: Count = 5
    selection_cost_hysteresis: NonNegative = 1.0
    selection_prefer_initial_plan: NonNegative = 0.95
    selection_obst_cost_scale: NonNegative = 100.0
    roadmap_graph_samples: Count = 15
    roadmap_graph_area_width: NonNegative = 6.0
    obstacle_heading_threshold: NonNegative = 0.45
    h_signature_threshold: NonNegative = 0.1
    max_ratio_detours_duration_best_duration: NonNegative = 3.0
    detours_orientation_tolerance: NonNegative = 0.5 * pi
    length_start_orientation_vector: NonNegative = 0.4
    oscillation_recovery: bool = True
    oscillation_v_eps: NonNegative = 0.1
    oscillation_omega_eps: NonNegative = 0.1
    oscillation_recovery_min_duration: NonNegative = 10.0
    oscillation_filter_duration: NonNegative = 10.0
    controller_frequency: NonNegative = 20.0

    def __post_init__(self) -> None:
        check_parameters(self, "teb")
        bands = self.max_number_classes if self.enable_homotopy_class_planning else 1
        solved = self.no_inner_iterations * self.no_outer_iterations * self.max_samples * bands
        names = "no_inner_iterations, no_outer_iterations, max_samples and max_number_classes"
        check_work("teb", names, solved, _MOST)


@final
@dataclass(frozen=True, eq=False)
class Band:
    """A trajectory of n poses with n - 1 intervals.

    Attributes
    ----------
    poses : (n, 3), x, y (m) and yaw (rad).
    intervals : (n - 1,), s.
    """

    poses: Array
    intervals: Array

    @classmethod
    def from_plan(cls, plan: Array, settings: TebParameters) -> "Band":
        """Return the band with which the search begins: the plan's poses at greatest speed.

        A pose between the ends faces the next one, or keeps the plan's yaw, and an interval is

            dt = max(|dp| / max_vel_x, |dyaw| / max_vel_theta).

        Where the poses are too few, the middle between the last but one and the goal is added
        again and again.
        """
        start, goal = _pose(plan[0]), _pose(plan[-1])
        poses = [start]
        backwards = settings.allow_init_with_backwards_motion and (
            (goal[0] - start[0]) * cos(start[2]) + (goal[1] - start[1]) * sin(start[2]) < 0.0
        )
        for here, after in pairwise(plan[1:]):
            yaw = float(here[2])
            if settings.global_plan_overwrite_orientation:
                yaw = atan2(after[1] - here[1], after[0] - here[0])
                yaw = wrapped(yaw + pi) if backwards else yaw
            poses.append((float(here[0]), float(here[1]), yaw))
        while len(poses) < settings.min_samples - 1:
            poses.append(_middle(poses[-1], goal))
        poses.append(goal)
        return cls(
            np.array(poses), np.array([_shortest(*two, settings) for two in pairwise(poses)])
        )

    @classmethod
    def unpacked(cls, z: Array) -> "Band":
        """Return the band that is stored as one vector, see `_teb_kernel`."""
        table = np.append(z, 0.0).reshape(-1, 4)
        return cls(table[:, :3].copy(), table[:-1, 3].copy())

    def packed(self) -> Array:
        """Return all as one vector (4 n - 1,): x, y, yaw, interval, x, y ..."""
        return np.column_stack([self.poses, np.append(self.intervals, 0.0)]).ravel()[:-1]

    @property
    def duration(self) -> float:
        """Sum of the intervals, s."""
        return float(self.intervals.sum())

    def resized(self, settings: TebParameters) -> "Band":
        """Halve intervals that are too long and merge those that are too short.

        With `include_dynamic_obstacles` this is repeated until none is; else it is done once.
        """
        poses = [_pose(pose) for pose in self.poses]
        times = self.intervals.tolist()
        for _ in range(_SWEEPS if settings.include_dynamic_obstacles else 1):
            if not _sweep(poses, times, settings):
                break
        return Band(np.array(poses), np.array(times))

    def fits(self, goal: Array, settings: TebParameters) -> bool:
        """Return whether the band leads near enough to a goal (3,) to go on from it."""
        last = self.poses[-1]
        return (
            hypot(goal[0] - last[0], goal[1] - last[1]) < settings.force_reinit_new_goal_dist
            and abs(wrapped(float(goal[2] - last[2]))) < settings.force_reinit_new_goal_angular
        )

    def moved(self, start: Array, goal: Array, settings: TebParameters) -> "Band":
        """Drop the poses that the robot has passed, and set both ends.

        Poses are passed as long as each of the first ten is nearer to the new start.
        """
        poses, passed = self.poses.copy(), 0
        most = min(len(poses) - settings.min_samples, _PASSED)
        nearest = hypot(*(start - poses[0])[:2])
        for i in range(1, most + 1):
            distance = hypot(*(start - poses[i])[:2])
            if distance >= nearest:
                break
            nearest, passed = distance, i
        poses = np.delete(poses, slice(1, passed + 1), axis=0)
        poses[0], poses[-1] = start, goal
        return Band(poses, np.delete(self.intervals, slice(1, passed + 1)))

    def velocity(self, settings: TebParameters) -> tuple[float, float] | None:
        """Return speed (m/s) and yaw rate (rad/s) at the start; None without a positive time.

        They are means over `control_look_ahead_poses` intervals, or as many as last so many
        reference intervals; the speed is negative where the band leads backwards.
        """
        most = max(1, min(settings.control_look_ahead_poses, len(self.intervals)))
        time, last = 0.0, most
        for i in range(most):
            time += float(self.intervals[i])
            if time >= settings.dt_ref * most:
                last = i + 1
                break
        if not 0.0 < time < inf:
            return None
        x, y, turn = (float(value) for value in self.poses[last] - self.poses[0])
        yaw = float(self.poses[0, 2])
        ahead = x * cos(yaw) + y * sin(yaw)
        return float(np.sign(ahead)) * hypot(x, y) / time, float(wrapped(turn)) / time


def _pose(row: Array) -> Pose:
    return float(row[0]), float(row[1]), wrapped(float(row[2]))


def _middle(first: Pose, second: Pose) -> Pose:
    """Return the pose between two: half the way, and the direction of the sum of headings."""
    x, y = cos(first[2]) + cos(second[2]), sin(first[2]) + sin(second[2])
    yaw = atan2(y, x) if x != 0.0 or y != 0.0 else 0.0
    return (first[0] + second[0]) / 2.0, (first[1] + second[1]) / 2.0, yaw


def _shortest(begin: Pose, end: Pose, settings: TebParameters) -> float:
    """Return the least time from one pose to another, s."""
    return max(
        hypot(end[0] - begin[0], end[1] - begin[1]) / settings.max_vel_x,
        abs(wrapped(end[2] - begin[2])) / settings.max_vel_theta,
    )


def _sweep(poses: list[Pose], times: list[float], settings: TebParameters) -> bool:
    """Go through a band once, which grows and shrinks meanwhile; return whether it has changed."""
    low = settings.dt_ref - settings.dt_hysteresis
    high = settings.dt_ref + settings.dt_hysteresis
    changed, i = False, 0
    while i < len(times):
        if times[i] > high and len(times) < settings.max_samples:
            times[i] *= 0.5
            times.insert(i + 1, times[i])
            poses.insert(i + 1, _middle(poses[i], poses[i + 1]))
            changed = True
        elif times[i] < low and len(times) > settings.min_samples:
            last = i == len(times) - 1
            times[i - 1 if last else i + 1] += times[i]
            del times[i], poses[i if last else i + 1]
            changed = True
        i += 1
    return changed

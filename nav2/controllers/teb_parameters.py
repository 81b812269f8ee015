"""Parameters of the timed elastic band."""

from dataclasses import dataclass
from math import pi
from typing import Annotated

from annotated_types import Ge

from ..parameters import Count, Limited, Named, NonNegative, Positive, check_parameters, check_work

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
    max_vel_x_backwards: Annotated[NonNegative, Limited("speed", 0)] = 0.2
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

"""The graceful controller: a feedback law on pose, towards the farthest pose that is free."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache
from math import atan2, hypot, pi
from typing import Annotated, Any, NamedTuple, final

import numpy as np

from wideberth.framework.plugins.njit import cached_njit
from wideberth.framework.values.arrays import Array
from wideberth.framework.values.motion import Twist

from ..costmap.footprint import line_cost, outline_cost
from ..parameters import Limited, Named, Positive, check_parameters, check_work
from ..poses import in_base_frame, length, lengths, look_ahead, normalized, shortest_angle
from . import _graceful_rollout as rollout
from .local_controller import Answer, LocalController, Tick
from .smooth_control_law import LawParameters, Pose, egocentric, next_pose, regular_velocity, wound

_MOST = 5000
"""Trajectories to one target that a tick may try: speeds times headings."""


class SimulatedTrajectory(NamedTuple):
    """A simulated trajectory to a target that hits nothing."""

    target: Pose
    poses: Array  # (T, 3), in the robot's frame
    v: float
    w: float
    backward: bool
    law: LawParameters
    highest: int


@final
@dataclass(eq=False)
class Graceful(LocalController):
    """Nav2's graceful controller.

    It aims at the point at the arc length `max_lookahead` of the plan, else at nearer and nearer
    poses of it, until the trajectory of the law of `smooth_control_law` there hits nothing; the
    command is its first step. Close to the goal it may aim along the line of sight
    rather than at the plan's heading and turn at the end. A turn on the spot has no upper bound
    on its yaw rate. In front of an obstacle it creeps towards ever nearer poses.

    Nav2 leaves the values undefined that a lifted or relative speed limit starts from; here they
    are the configured limits.

    Parameters
    ----------
    max_lookahead : m, along the plan.
    k_phi, k_delta, beta, lambda_, slowdown_radius, deceleration_max : of the law; Nav2 calls
        ``lambda_`` lambda, which Python does not let one write.
    v_linear_min, v_linear_max : m/s.
    v_angular_max : rad/s.
    v_angular_min_in_place : rad/s.
    initial_rotation : turn on the spot towards the target at the start of a path.
    initial_rotation_tolerance : rad, within which it does not.
    prefer_final_rotation : near the goal, drive straight to it and turn there.
    rotation_scaling_factor : of the yaw rate of a turn on the spot.
    allow_backward : drive backwards to a target behind; `initial_rotation` forces it to false, as
        in the original.
    in_place_collision_resolution : rad, between poses of a turn that are tested.
    use_collision_detection : test the trajectory.
    footprint_scaling_linear_vel : m/s, above which the outline grows.
    footprint_scaling_factor : share by which it has grown at `v_linear_max`.
    footprint_scaling_step : m/s, between speeds that are tried when a trajectory is not free.
    obstacle_cost_margin : cost, so near to that of an obstacle that another approach is sought.
    final_rotation_search_step : rad, between headings of such an approach.

    Raises
    ------
    WideberthError : a number that must be above zero and is not, no number where one is wanted, or
        steps so small that a tick would try more than 5000 trajectories to a target.

    References
    ----------
    J. J. Park and B. Kuipers, A smooth control law for graceful motion of differential wheeled
    mobile robots in 2D environment, ICRA 2011; Nav2, nav2_graceful_controller (Apache-2.0), of
    which this is an own implementation, equal within 1e-9.
    """

    max_lookahead: Positive = 1.0
    k_phi: float = 2.0
    k_delta: float = 1.0
    beta: float = 0.4
    lambda_: Annotated[float, Named("lambda")] = 2.0
    v_linear_min: float = 0.1
    v_linear_max: Annotated[Positive, Limited("speed")] = 0.5
    v_angular_max: Annotated[Positive, Limited("yaw_rate")] = 1.0
    v_angular_min_in_place: float = 0.25
    slowdown_radius: Positive = 1.5
    deceleration_max: Annotated[Positive, Limited("acceleration")] = 2.5
    initial_rotation: bool = True
    initial_rotation_tolerance: float = 0.75
    prefer_final_rotation: bool = True
    rotation_scaling_factor: float = 0.5
    allow_backward: bool = False
    in_place_collision_resolution: Positive = 0.1
    use_collision_detection: bool = True
    footprint_scaling_linear_vel: float = 0.5
    footprint_scaling_factor: float = 0.25
    footprint_scaling_step: Positive = 0.1
    obstacle_cost_margin: int = 1
    final_rotation_search_step: Positive = 0.1

    def __post_init__(self) -> None:
        check_parameters(self, "graceful")
        self.allow_backward = self.allow_backward and not self.initial_rotation
        span = max(self.v_linear_max - self.footprint_scaling_linear_vel, 0.0)
        speeds = 1.0 + span / self.footprint_scaling_step
        turns = 2.0 * pi / self.final_rotation_search_step
        names = "footprint_scaling_step and final_rotation_search_step"
        check_work("graceful", names, speeds * turns, _MOST)
        fine = pi / self.in_place_collision_resolution
        check_work("graceful", "in_place_collision_resolution alone", fine, _MOST)
        self._limits = (self.v_linear_max, self.v_angular_max)
        self.new_path(np.zeros((0, 3)))

    def reset(self) -> None:
        """Do nothing: a new path resets it."""

    def new_path(self, path: Array) -> None:
        """Turn towards the path first, and forget the approach to the former goal."""
        self._turns_first = True
        self._approach: float | None = None  # heading at the goal that was free before, rad

    def limit_speed(self, value: float, percentage: bool) -> None:
        """Limit the speed, see `LocalController.limit_speed`, and the yaw rate by the same share.

        No recorded case has a limit; the share for a limit in m/s is that of Nav2's source as it
        can be read at other commits.
        """
        linear, angular = self.v_linear_max, self.v_angular_max
        if value and percentage:
            linear, angular = linear * value / 100.0, angular * value / 100.0
        elif value:
            linear, angular = value, angular * value / linear
        self._limits = (max(linear, self.v_linear_min) if value else linear, angular)

    def velocity(self, tick: Tick) -> Answer:
        """Return the velocity for now, or the reason why there is none."""
        ground, plan = self.seen(tick)
        if tick.checker.xy_reached(tick.pose, tick.goal, tick.plan):
            angle = float(plan[-1, 2])
            if self._can_turn(ground, angle):
                rate = compiled().turning_rate(self._turning, angle)
                return Answer(Twist((0.0, 0.0), rate))
        trajectory = self.trajectory(ground, plan)
        if trajectory is None:
            return Answer.refusal("every way to a pose of the plan hits an obstacle")
        x, y, yaw = trajectory.poses.T
        expected = np.stack(rollout.placed(ground, (x, y, yaw)), axis=1)
        return Answer(Twist((trajectory.v, 0.0), trajectory.w), expected=expected)

    def trajectory(self, ground: rollout.Ground, plan: Array) -> SimulatedTrajectory | None:
        """Return the free trajectory to the farthest pose of a plan, in the robot's frame."""
        near = length(plan) < self.max_lookahead and self.prefer_final_rotation
        for target, apart in self._targets(plan):
            if apart > self.max_lookahead:
                continue
            if near:
                target = (target[0], target[1], atan2(target[1], target[0]))
                trajectory = self._validated(ground, target)
                if trajectory is not None:
                    limit = self._limit(ground) - self.obstacle_cost_margin
                    close = trajectory.highest >= limit
                    return self._approached(ground, trajectory, target) if close else trajectory
                target = self._faced(target)[0]  # turned round twice, as in the original
            trajectory = self._validated(ground, target)
            if trajectory is not None:
                return trajectory
        return None

    def _targets(self, plan: Array) -> Iterator[tuple[Pose, float]]:
        """Yield poses to aim at and how far they are, m: the point ahead, then nearer ones."""
        point, apart = look_ahead(plan, self.max_lookahead)
        yield (float(point[0]), float(point[1]), float(point[2])), apart
        first = hypot(float(plan[0, 0]), float(plan[0, 1]))
        arc = first + np.concatenate([[0.0], np.cumsum(lengths(plan))])
        for i in range(len(plan) - 2, -1, -1):
            yield (float(plan[i, 0]), float(plan[i, 1]), float(plan[i, 2])), float(arc[i])

    def _faced(self, target: Pose) -> tuple[Pose, bool]:
        """Turn a target behind the robot round where it may drive backwards; say whether so."""
        backward = self.allow_backward and target[0] < 0.0
        if backward:
            target = (target[0], target[1], normalized(target[2] + pi))
        return target, backward

    def _validated(self, ground: rollout.Ground, target: Pose) -> SimulatedTrajectory | None:
        """Return the trajectory to a target, slower where the grown outline hits something."""
        target, backward = self._faced(target)
        turns = self._turns_first and self.initial_rotation
        if abs(atan2(target[1], target[0])) < self.initial_rotation_tolerance:
            turns = self._turns_first = False
        speed = self._limits[0]
        growth = rollout.RolloutGrowth(
            self.footprint_scaling_linear_vel, self.footprint_scaling_factor, speed
        )
        while True:
            law = self._law(speed)
            free, poses, v, w = compiled().rolled_out(
                ground, law, self._turning, growth, target, backward, turns,
                self.use_collision_detection,
            )  # fmt: skip
            if free:
                highest = compiled().highest_cost(ground, poses)
                return SimulatedTrajectory(target, poses, v, w, backward, law, highest)
            speed -= self.footprint_scaling_step
            if speed < self.footprint_scaling_linear_vel:
                return None

    def _approached(
        self, ground: rollout.Ground, trajectory: SimulatedTrajectory, target: Pose
    ) -> SimulatedTrajectory:
        """Return the quickest trajectory to a target that keeps off obstacles, of all headings."""
        best, step = np.inf, self.final_rotation_search_step
        for i in range(int(np.ceil(2.0 * pi / step))):
            angle = i * step + (self._approach or 0.0)
            found = self._validated(ground, (target[0], target[1], angle))
            if found is None:
                continue
            time = compiled().duration(found.law, found.target, found.backward, found.poses)
            if time >= best:
                continue
            best = time
            if found.highest < self._limit(ground):
                trajectory = found
                if angle == self._approach:
                    break
                self._approach = angle
        return trajectory

    def _can_turn(self, ground: rollout.Ground, angle: float) -> bool:
        """Return whether the robot can turn on the spot by an angle."""
        if not self.use_collision_detection:
            return True
        count = max(1, int(abs(angle) / self.in_place_collision_resolution))
        turns = [i * angle / count for i in range(1, count + 1)]
        return not any(compiled().hits(ground, (0.0, 0.0, turn), 1.0) for turn in turns)

    @staticmethod
    def _limit(ground: rollout.Ground) -> int:
        """Cost from which on a trajectory comes too near to an obstacle."""
        return 252 if ground.use_radius else 253

    @staticmethod
    def seen(tick: Tick) -> tuple[rollout.Ground, Array]:
        """Return the ground, and the plan (N, 3) in the robot's frame with all its headings."""
        x, y, yaw = (float(value) for value in tick.pose)
        costmap, robot = tick.costmap, tick.footprint
        ground = rollout.Ground(
            costmap.cells, *costmap.origin, costmap.resolution, (x, y, yaw), robot.vertices,
            robot.use_radius, tick.track_unknown,
        )  # fmt: skip
        return ground, _with_headings(in_base_frame(tick.plan, tick.pose))

    @property
    def _turning(self) -> rollout.Turning:
        return rollout.Turning(
            self.rotation_scaling_factor, self._limits[1], self.v_angular_min_in_place,
            self.initial_rotation_tolerance,
        )  # fmt: skip

    def _law(self, speed: float) -> LawParameters:
        """Return the law with a greatest speed, m/s."""
        return LawParameters(
            self.k_phi, self.k_delta, self.beta, self.lambda_, self.slowdown_radius,
            self.deceleration_max, self.v_linear_min, speed, self._limits[1],
        )  # fmt: skip


def _with_headings(plan: Array) -> Array:
    """Give each pose but the last the direction of its step, where a plan has no headings."""
    count = len(plan)
    if count < 3:
        return plan
    first = float(plan[1, 2])
    if any(shortest_angle(float(plan[i, 2]), first) > 1e-6 for i in range(2, count - 1)):
        return plan
    step = np.diff(plan[:, :2], axis=0)
    filled = plan.copy()
    filled[:-1, 2] = np.arctan2(step[:, 1], step[:, 0])
    return filled


class _Compiled(NamedTuple):
    """The functions that Numba compiles."""

    rolled_out: Callable[..., Any]
    highest_cost: Callable[..., Any]
    duration: Callable[..., Any]
    hits: Callable[..., Any]
    turning_rate: Callable[..., Any]


@cache
def compiled() -> _Compiled:
    """Return the functions of the rollout as Numba compiles them."""
    inner = (
        line_cost, outline_cost, wound, egocentric, regular_velocity, next_pose,
        rollout.cell_cost, rollout.placed, rollout.hits, rollout.turning_rate,
    )  # fmt: skip
    return _Compiled(*cached_njit([getattr(rollout, name) for name in _Compiled._fields], inner))

"""Twists that DWB samples, and the trajectories that they lead to."""

from dataclasses import dataclass
from typing import Annotated, Literal, final, get_args

import numpy as np
from numpy.typing import NDArray

from wideberth.framework.values.arrays import Array, BoolArray
from wideberth.framework.values.costmap import Costmap

from ..parameters import Count, Limited, Natural, Positive

Generator = Literal[
    "dwb_plugins::StandardTrajectoryGenerator", "dwb_plugins::LimitedAccelGenerator"
]
GENERATORS: tuple[Generator, ...] = get_args(Generator)
"""Generators of trajectories: one that accelerates along them, one for what a period allows."""
_NARROW = 1e-5
"""m/s or rad/s. A window that is narrower has one sample; a sample may exceed it by as much."""
_ROUNDING = float(np.finfo(np.float32).eps)


@final
@dataclass(frozen=True, eq=False)
class Trajectories:
    """Where each of K twists leads, from the robot's pose on.

    Rows of ``poses`` are as long as that of the longest trajectory; behind the end of a shorter
    one its last pose is repeated.

    Attributes
    ----------
    twists : (K, 3), forward and lateral speed, m/s, and yaw rate, rad/s.
    poses : (K, P, 3), x, y, m, and yaw, rad.
    counts : (K,), number of poses of each.
    steps : (K,), s between two poses.
    cells : (K, P), index of the cell that holds a pose, row by row; -1 off the map.
    """

    twists: Array
    poses: Array
    counts: NDArray[np.int64]
    steps: Array
    cells: NDArray[np.int64]

    def __len__(self) -> int:
        """Return K."""
        return len(self.twists)

    @property
    def last(self) -> Array:
        """Pose at the end of each, (K, 3)."""
        return np.asarray(self.poses[:, -1])

    @property
    def there(self) -> BoolArray:
        """Return which poses are not repetitions of the last, (K, P)."""
        return np.asarray(np.arange(self.poses.shape[1]) < self.counts[:, None])

    def only(self, kept: BoolArray) -> "Trajectories":
        """Leave out those that ``kept``, (K,), does not mark."""
        if kept.all():
            return self
        return Trajectories(
            self.twists[kept], self.poses[kept], self.counts[kept], self.steps[kept],
            self.cells[kept],
        )  # fmt: skip

    def at(self, time: float) -> Array:
        """Return the poses at a time, s, (K, 3), between two of them on the straight line."""
        ahead = np.minimum(time / self.steps, self.counts - 1.0)
        before, rows = np.floor(ahead).astype(np.int64), np.arange(len(self))
        first = self.poses[rows, before]
        second = self.poses[rows, np.minimum(before + 1, self.counts - 1)]
        return np.asarray(first + (ahead - before)[:, None] * (second - first))


def cells_of(costmap: Costmap, points: Array) -> NDArray[np.int64]:
    """Return the index of the cell that holds each point, (..., 2) m; -1 off the map."""
    x = np.floor((points[..., 0] - costmap.origin[0]) / costmap.resolution)
    y = np.floor((points[..., 1] - costmap.origin[1]) / costmap.resolution)
    inside = (x >= 0) & (y >= 0) & (x < costmap.width) & (y < costmap.height)
    return np.where(inside, y * costmap.width + x, -1.0).astype(np.int64)


@dataclass(eq=False)
class DwbParameters:
    """How DWB samples twists and rolls them out, by Nav2's names and defaults.

    Attributes
    ----------
    trajectory_generator_name : one of `GENERATORS`.
    min_vel_x, min_vel_y, max_vel_x, max_vel_y, max_vel_theta : m/s and rad/s.
    min_speed_xy, max_speed_xy, min_speed_theta : m/s, m/s, rad/s; a negative one sets no limit.
    acc_lim_x, acc_lim_y, acc_lim_theta : m/s^2 and rad/s^2.
    decel_lim_x, decel_lim_y, decel_lim_theta : m/s^2 and rad/s^2, at most 0.
    vx_samples, vy_samples, vtheta_samples : of twists per axis, less than 2 count as 2; that
        of y may be 0, as robots have it that cannot drive sideways.
    sim_time : s, of a trajectory.
    linear_granularity, angular_granularity : m and rad, longest step of a trajectory.
    time_granularity : s, its longest step where ``discretize_by_time``.
    include_last_point : let the last pose of a trajectory stand in it twice.
    limit_vel_cmd_in_traj : send the velocity that can be had after the first step.
    sim_period, controller_frequency : s and 1/s; a period, for the second generator.
    """

    trajectory_generator_name: Generator = GENERATORS[0]
    min_vel_x: Annotated[float, Limited("backwards", 0)] = 0.0
    min_vel_y: float = 0.0
    max_vel_x: Annotated[float, Limited("speed")] = 0.0
    max_vel_y: float = 0.0
    max_vel_theta: Annotated[float, Limited("yaw_rate")] = 0.0
    min_speed_xy: float = 0.0
    max_speed_xy: Annotated[float, Limited("speed")] = 0.0
    min_speed_theta: float = 0.0
    acc_lim_x: Annotated[float, Limited("acceleration")] = 0.0
    acc_lim_y: float = 0.0
    acc_lim_theta: Annotated[float, Limited("yaw_acceleration")] = 0.0
    decel_lim_x: Annotated[float, Limited("acceleration", -1)] = 0.0
    decel_lim_y: float = 0.0
    decel_lim_theta: Annotated[float, Limited("yaw_acceleration", -1)] = 0.0
    vx_samples: Count = 20
    vy_samples: Natural = 5
    vtheta_samples: Count = 20
    sim_time: Positive = 1.7
    linear_granularity: Positive = 0.5
    angular_granularity: Positive = 0.025
    time_granularity: Positive = 0.5
    discretize_by_time: bool = False
    include_last_point: bool = True
    limit_vel_cmd_in_traj: bool = False
    sim_period: float | None = None
    controller_frequency: Positive = 20.0


@final
class Sampling:
    """Samples twists and rolls them out.

    Parameters
    ----------
    settings : see the class.
    share : of the largest velocities that a limit of speed leaves.

    Attributes
    ----------
    low, high : least and largest vx, vy, omega, (3,), m/s and rad/s.
    gain, loss : acceleration, and deceleration (below zero), per axis, (3,), m/s^2 and rad/s^2.
    fastest : m/s, of the speed; a negative one sets no limit.
    instant : whether a trajectory has the sampled twist from the start on.
    window : s, for which the robot may accelerate to a sample.
    """

    def __init__(self, settings: DwbParameters, share: float) -> None:
        self.settings: DwbParameters = settings
        of = settings
        self.low: Array = np.array([of.min_vel_x, of.min_vel_y, -of.max_vel_theta * share])
        self.high: Array = np.array([of.max_vel_x, of.max_vel_y, of.max_vel_theta]) * share
        self.gain: Array = np.array([of.acc_lim_x, of.acc_lim_y, of.acc_lim_theta])
        self.loss: Array = np.array([of.decel_lim_x, of.decel_lim_y, of.decel_lim_theta])
        self.fastest: float = of.max_speed_xy * share
        self.instant: bool = of.trajectory_generator_name == GENERATORS[1]
        period = 1.0 / of.controller_frequency if of.sim_period is None else of.sim_period
        self.window: float = period if self.instant else of.sim_time

    def twists(self, speed: Array) -> Array:
        """Return the twists within reach of a speed (3,): (K, 3), never the standstill.

        The yaw rate changes first, then vy, then vx.
        """
        values = [self._values(i, float(speed[i])) for i in range(3)]
        x, y, turn = (grid.ravel() for grid in np.meshgrid(*values, indexing="ij"))
        return np.stack([x, y, turn], axis=1)[self._allowed(x, y, turn)]

    def _values(self, axis: int, now: float) -> list[float]:
        """Return the samples of an axis, with a zero where they change their sign.

        They are added up step by step, so that rounding is that of the original.
        """
        low, high = float(self.low[axis]), float(self.high[axis])
        now = min(max(now, low), high)
        gain, loss = self.gain[axis] * self.window, self.loss[axis] * self.window
        of = self.settings
        top, bottom = (float(reach(now, end, gain, loss)) for end in (high, low))
        if abs(top - bottom) < _NARROW:
            return [bottom]
        step = (top - bottom) / (
            max(2, (of.vx_samples, of.vy_samples, of.vtheta_samples)[axis]) - 1
        )
        found: list[float] = []
        value = bottom
        while value <= top + _NARROW:
            if found and found[-1] < 0.0 < value:
                found.append(0.0)
            found.append(value)
            value += step
        return found

    def _allowed(self, x: Array, y: Array, turn: Array) -> BoolArray:
        slowest, slowest_turn = self.settings.min_speed_xy, self.settings.min_speed_theta
        square = x * x + y * y
        fast = (self.fastest >= 0.0) & (square > self.fastest**2 + _ROUNDING)
        slow = (square + _ROUNDING < slowest**2) & (np.abs(turn) + _ROUNDING < slowest_turn)
        slow &= (slowest >= 0.0) and (slowest_turn >= 0.0)
        return np.asarray(~fast & ~slow & ((square != 0.0) | (turn != 0.0)))

    def trajectories(
        self, pose: Array, speed: Array, twists: Array, costmap: Costmap
    ) -> Trajectories:
        """Roll twists (K, 3) out from a pose (3,) and a speed (3,).

        In each step dt the velocity goes towards the sample as fast as the robot can, then

            x += (vx cos yaw + vy cos(yaw + pi/2)) dt,    yaw += omega dt

        with the yaw from before the step.
        """
        number, repeated = self._numbers(twists), self.settings.include_last_point
        steps = self.settings.sim_time / number
        longest = int(number.max(initial=1))
        poses = np.empty((longest + 1 + repeated, 3, len(twists)))
        now, velocity = np.tile(pose[:, None], len(twists)), np.tile(speed[:, None], len(twists))
        wanted = np.ascontiguousarray(twists.T)
        gain, loss = self.gain[:, None] * steps, self.loss[:, None] * steps
        sent, poses[0] = twists, now
        for i in range(longest):
            if i < 1 or not self.instant:
                velocity = wanted if self.instant else reach(velocity, wanted, gain, loss)
            if i == 0 and self.settings.limit_vel_cmd_in_traj:
                sent = velocity.T.copy()
            now = moved(now, velocity, np.where(i < number, steps, 0.0))
            poses[i + 1] = now
        poses[longest + 1 :] = now
        found = np.ascontiguousarray(poses.transpose(2, 0, 1))
        counts = number.astype(np.int64) + 1 + repeated
        return Trajectories(sent, found, counts, steps, cells_of(costmap, found))

    def _numbers(self, twists: Array) -> Array:
        """Return the number of steps of each trajectory, (K,)."""
        of = self.settings
        if of.discretize_by_time:
            return np.full(len(twists), max(1.0, np.ceil(of.sim_time / of.time_granularity)))
        far = np.hypot(twists[:, 0], twists[:, 1]) * of.sim_time / of.linear_granularity
        turn = np.abs(twists[:, 2]) * of.sim_time / of.angular_granularity
        return np.asarray(np.maximum(1.0, np.ceil(np.maximum(far, turn))))


def reach(
    now: Array | float, wanted: Array | float, gain: Array | float, loss: Array | float
) -> Array:
    """Return the velocity nearest to ``wanted`` within a change of ``gain`` up, ``loss`` down."""
    up = np.minimum(wanted, now + gain)
    return np.where(now < wanted, up, np.maximum(wanted, now + loss))


def moved(pose: Array, velocity: Array, step: Array) -> Array:
    """Return the poses (3, K) after a step of (K,) s at velocities (3, K) in the body's frame."""
    x, y, yaw = pose
    forward, lateral, turn = velocity
    aside = yaw + 0.5 * np.pi
    return np.stack(
        [
            x + (forward * np.cos(yaw) + lateral * np.cos(aside)) * step,
            y + (forward * np.sin(yaw) + lateral * np.sin(aside)) * step,
            yaw + turn * step,
        ]
    )

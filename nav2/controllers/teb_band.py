"""The timed elastic band: poses, and the time from each to the next."""

from dataclasses import dataclass
from itertools import pairwise
from math import atan2, cos, hypot, inf, pi, sin
from typing import final

import numpy as np

from ...framework.values.arrays import Array
from ._teb_kernel import wrapped
from .teb_parameters import TebParameters

Pose = tuple[float, float, float]
_SWEEPS, _PASSED = 100, 10
"""Times that a band is gone through when it is resized; poses that it may lose at once."""


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

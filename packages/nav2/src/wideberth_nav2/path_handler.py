"""Which part of a path a local controller sees: Nav2's FeasiblePathHandler."""

from dataclasses import dataclass
from typing import final

import numpy as np

from wideberth.framework.values.arrays import Array
from wideberth.framework.values.costmap import Costmap

from .parameters import NonNegative, check_parameters
from .poses import distance, lengths, shortest_angle, wrapped

_STILL = 1e-4
"""m, below which two poses of a path stand at the same place."""


@final
@dataclass(eq=False)
class PathHandler:
    """Cuts a path down to what lies ahead of the robot and within its costmap.

    The nearest pose is sought from the start of what is left over `max_robot_pose_search_dist`,
    so that a path which crosses itself is not cut short; everything before it is forgotten. The
    local plan goes on for `prune_distance`, and ends where the path leaves the costmap. All
    distances run along the path.

    Where the path turns back (a cusp) or turns on the spot, the robot can be made to get there
    before it is shown what follows.

    Parameters
    ----------
    prune_distance : m.
    max_robot_pose_search_dist : m; negative: the whole path; None: half the larger side of the
        costmap.
    reject_unit_path : refuse a path of a single pose.
    enforce_path_inversion : stop at cusps.
    enforce_path_rotation : stop at turns on the spot.
    inversion_xy_tolerance : m, how near such a place has to be reached.
    inversion_yaw_tolerance : rad, likewise.
    minimum_rotation_angle : rad, of a turn on the spot.

    Raises
    ------
    WideberthError : a number that is negative or not finite.
    """

    prune_distance: NonNegative = 2.0
    max_robot_pose_search_dist: float | None = None
    reject_unit_path: bool = False
    enforce_path_inversion: bool = False
    enforce_path_rotation: bool = False
    inversion_xy_tolerance: NonNegative = 0.2
    inversion_yaw_tolerance: NonNegative = 0.4
    minimum_rotation_angle: NonNegative = 0.785

    def __post_init__(self) -> None:
        check_parameters(self, "path_handler")
        self._whole = self._left = np.zeros((0, 3))
        self._cut = 0

    @property
    def rest(self) -> Array:
        """All poses (N, 3) that have not been passed."""
        return np.concatenate([self._left, self._whole[self._cut :]]) if self._cut else self._left

    def set_plan(self, path: Array) -> None:
        """Follow a path (N, 3) from now on."""
        self._whole = np.array(path, dtype=np.float64).reshape(-1, 3)
        self._whole[:, 2] = wrapped(self._whole[:, 2])
        self._stop_at_constraint()

    def local_plan(self, costmap: Costmap, pose: Array) -> tuple[Array | None, str]:
        """Return the poses (M, 3) ahead of the robot, or None and the reason.

        Parameters
        ----------
        costmap : its extent bounds the plan.
        pose : (3,), of the robot.
        """
        if not len(self._left):
            return None, "the path holds no pose"
        if self.reject_unit_path and len(self._left) == 1:
            return None, "the path holds a single pose"
        closest = self._closest(costmap, pose)
        ahead = self._left[closest:]
        ahead = ahead[: within(ahead, self.prune_distance)]
        outside = np.flatnonzero(~costmap.inside(ahead[:, :2]))
        if len(outside):
            ahead = ahead[: outside[0]]
        self._left = self._left[closest:]
        if self._cut and self._arrived(pose):
            self._whole = self._whole[self._cut :]
            self._stop_at_constraint()
        if not len(ahead):
            return None, "no pose of the path ahead of the robot lies in its costmap"
        return ahead, ""

    def _closest(self, costmap: Costmap, pose: Array) -> int:
        """Return the index of the nearest pose, the last of equal ones."""
        nearest = closest_pose(self._left, pose, costmap, self.max_robot_pose_search_dist)
        return nearest - 1 if len(self._left) > 1 and nearest == len(self._left) - 1 else nearest

    def _arrived(self, pose: Array) -> bool:
        """Return whether the robot stands where it had to get to."""
        last = self._left[-1]
        return (
            distance(pose, last) <= self.inversion_xy_tolerance
            and abs(shortest_angle(float(pose[2]), float(last[2]))) <= self.inversion_yaw_tolerance
        )

    def _stop_at_constraint(self) -> None:
        """Show the path up to the first place that has to be reached."""
        count = len(self._whole)
        found = count
        if self.enforce_path_inversion:
            found = min(found, first_inversion(self._whole))
        if self.enforce_path_rotation:
            found = min(found, first_rotation(self._whole, self.minimum_rotation_angle))
        self._cut = 0 if found == count else found
        self._left = self._whole[:found]


def half_side(costmap: Costmap) -> float:
    """Return half the larger side of a costmap, m."""
    return 0.5 * max(costmap.width, costmap.height) * costmap.resolution


def closest_pose(path: Array, pose: Array, costmap: Costmap, reach: float | None) -> int:
    """Return the index of the pose of a path (N, 3) that is nearest, the last of equal ones.

    Parameters
    ----------
    reach : m, of the path that is looked at; negative: all of it; None: half the larger side of
        the costmap.
    """
    if reach is None:
        reach = half_side(costmap)
    bound = within(path, reach) if reach >= 0.0 else len(path)
    apart = np.hypot(*(path[:bound, :2] - pose[:2]).T)
    return bound - 1 - int(np.argmin(apart[::-1]))


def within(poses: Array, reach: float) -> int:
    """Return how many poses (N, 3) come before the one where the path first exceeds ``reach``."""
    beyond = np.flatnonzero(np.cumsum(lengths(poses)) > reach)
    return int(beyond[0]) + 1 if len(beyond) else len(poses)


def first_inversion(path: Array) -> int:
    """Return the index after the first pose where a path (N, 3) turns back; N where none does."""
    if len(path) < 3:
        return len(path)
    steps = np.diff(path[:, :2], axis=0).astype(np.float32)
    before = steps[0]
    for i, step in enumerate(steps[1:], start=1):
        if np.hypot(*step) <= _STILL:
            continue
        if (
            np.hypot(*before) > _STILL
            and np.float32(before[0] * step[0] + before[1] * step[1]) < 0
        ):
            return i + 1
        before = step
    return len(path)


def first_rotation(path: Array, least: float) -> int:
    """Return the index where a path (N, 3) has turned by ``least`` on the spot; N where none."""
    if len(path) < 3:
        return len(path)
    turned = 0.0
    for i, step in enumerate(lengths(path).tolist()):
        if step >= _STILL:
            turned = 0.0
            continue
        turned += abs(shortest_angle(float(path[i, 2]), float(path[i + 1, 2])))
        if turned > least:
            return i + 1
    return len(path)

"""Critics of DWB: each gives every trajectory a score, or forbids it."""

from abc import ABC, abstractmethod
from dataclasses import dataclass, field
from itertools import pairwise
from math import atan2, cos, hypot, sin, trunc
from typing import ClassVar, Literal, final

import numpy as np
from numpy.typing import NDArray

from wideberth.framework.values.arrays import Array
from wideberth.framework.values.costmap import Costmap

from ..costmap.footprint import outline_costs
from ..costs import INSCRIBED, LETHAL, NO_INFORMATION
from ..parameters import check_parameters
from ..poses import length, normalized, shortest_angle
from .dwb_trajectories import Trajectories, cells_of
from .local_controller import Tick

Aggregation = Literal["last", "sum", "product"]


@dataclass(eq=False)
class DwbCritic(ABC):
    """Judges trajectories; the total of a trajectory is the sum of scale times score.

    A critic may remember what was chosen before. Its fields have Nav2's names and defaults.

    Attributes
    ----------
    scale : weight; a critic of effective weight 0 is not asked.

    Raises
    ------
    WideberthError : no number where one is wanted, or a choice that is not known.
    """

    scale: float = 1.0

    def __post_init__(self) -> None:
        check_parameters(self, type(self).__name__)

    def reset(self) -> None:
        """Forget what was chosen before; called with every new path."""
        return

    def prepare(self, tick: Tick) -> None:
        """Get ready for the trajectories of a tick."""
        return

    def weight(self, resolution: float) -> float:
        """Return what scores are multiplied by, on a costmap with cells of ``resolution`` m."""
        return self.scale

    @abstractmethod
    def scores(self, trajectories: Trajectories) -> Array:
        """Return the score of each trajectory, (K,); NaN for one that is not allowed."""

    def debrief(self, twist: Array) -> None:
        """Take note of the twist, (3,), that was chosen; zero where none was allowed."""
        return


@final
@dataclass(eq=False)
class RotateToGoal(DwbCritic):
    """Lets the robot brake at the goal, then turn on the spot towards the goal's heading.

    Within the tolerance and slower than ``trans_stopped_velocity`` the robot only turns. Both
    conditions stay once they are met, until the next path. Before that the score is 0; while it
    brakes it is

        slowing_factor v^2 + |yaw error|,    and v^2 must be below that of now

    and then |yaw error| alone. The error is that of the last pose.

    Attributes
    ----------
    xy_goal_tolerance : m.
    path_length_tolerance : m, of the path ahead, beyond which the goal is not near.
    trans_stopped_velocity : m/s.
    lookahead_time : s; from 0 on the error is that of the pose at this time.
    """

    xy_goal_tolerance: float = 0.25
    path_length_tolerance: float = 1.0
    trans_stopped_velocity: float = 0.25
    slowing_factor: float = 5.0
    lookahead_time: float = -1.0

    _near: bool = field(default=False, init=False, repr=False)
    _turning: bool = field(default=False, init=False, repr=False)
    _square: float = field(default=0.0, init=False, repr=False)
    _yaw: float = field(default=0.0, init=False, repr=False)

    def reset(self) -> None:
        """Take the robot to be away from the goal."""
        self._near = self._turning = False

    def prepare(self, tick: Tick) -> None:
        """Find out whether the robot is at the goal, and whether it stands."""
        dx, dy = tick.pose[:2] - tick.goal[:2]
        here = dx * dx + dy * dy <= self.xy_goal_tolerance**2
        self._near = self._near or bool(here and length(tick.plan) <= self.path_length_tolerance)
        self._square = float(tick.speed[0] ** 2 + tick.speed[1] ** 2)
        slow = self._square <= self.trans_stopped_velocity**2
        self._turning = self._turning or (self._near and slow)
        self._yaw = float(tick.goal[2])

    def scores(self, trajectories: Trajectories) -> Array:
        """Score how fast the robot still is near the goal, then how far off its heading."""
        if not self._near:
            return np.zeros(len(trajectories))
        late = self.lookahead_time >= 0.0
        end = trajectories.at(self.lookahead_time) if late else trajectories.last
        error = np.abs([shortest_angle(yaw, self._yaw) for yaw in end[:, 2].tolist()])
        x, y, _ = trajectories.twists.T
        if self._turning:
            return np.where((x != 0.0) | (y != 0.0), np.nan, error)
        square = x * x + y * y
        return np.where(square >= self._square, np.nan, square * self.slowing_factor + error)


@final
@dataclass(eq=False)
class Oscillation(DwbCritic):
    """Forbids to turn back soon after the robot has turned back, on each axis.

    Once the chosen twists changed their sign on an axis, only the new sign is allowed there,
    until the robot has moved or turned far enough from where that happened. Headings within
    (-pi, pi] are subtracted as plain numbers, so that a small turn across pi is far enough; no
    recorded case has this, it follows Nav2's source at other commits.

    Attributes
    ----------
    oscillation_reset_dist : m.
    oscillation_reset_angle : rad.
    oscillation_reset_time : s; a negative one (here as for the other two) is never reached.
    x_only_threshold : m/s, above which only the sign of vx is watched.
    """

    oscillation_reset_dist: float = 0.05
    oscillation_reset_angle: float = 0.2
    oscillation_reset_time: float = -1.0
    x_only_threshold: float = 0.05

    _signs: Array = field(default_factory=lambda: np.zeros(3), init=False, repr=False)
    _only: Array = field(default_factory=lambda: np.zeros(3), init=False, repr=False)
    _here: tuple[float, Array] = field(default=(0.0, np.zeros(3)), init=False, repr=False)
    _since: tuple[float, Array] = field(default=(0.0, np.zeros(3)), init=False, repr=False)

    def reset(self) -> None:
        """Allow every sign."""
        self._signs, self._only = np.zeros(3), np.zeros(3)

    def prepare(self, tick: Tick) -> None:
        """Take note of time and place."""
        self._here = (tick.time, tick.pose)

    def scores(self, trajectories: Trajectories) -> Array:
        """0, or forbidden."""
        against = (np.sign(trajectories.twists) * self._only < 0.0).any(axis=1)
        return np.where(against, np.nan, 0.0)

    def debrief(self, twist: Array) -> None:
        """Watch the signs."""
        watched = [0]
        if self.x_only_threshold < 0.0 or abs(twist[0]) <= self.x_only_threshold:
            watched = [0, 1, 2]
        turned = False
        for axis in watched:
            sign = np.sign(twist[axis])
            if sign * self._signs[axis] < 0.0:
                self._only[axis], turned = sign, True
            self._signs[axis] = sign or self._signs[axis]
        if turned:
            self._since = self._here
        if self._only.any() and self._far():
            self.reset()

    def _far(self) -> bool:
        """Return whether the robot has left the place where it last turned back."""
        (now, pose), (then, place) = self._here, self._since
        far = hypot(*(pose - place)[:2])
        turn = abs(normalized(float(pose[2])) - normalized(float(place[2])))
        return (
            (self.oscillation_reset_dist >= 0.0 and far > self.oscillation_reset_dist)
            or (self.oscillation_reset_angle >= 0.0 and turn > self.oscillation_reset_angle)
            or (self.oscillation_reset_time >= 0.0 and now - then > self.oscillation_reset_time)
        )


@final
@dataclass(eq=False)
class BaseObstacle(DwbCritic):
    """Scores with the costmap's cost under the robot's centre, at the last pose.

    A trajectory that touches a cell of cost 253 or more (unknown cells too) or leaves the map is
    not allowed.

    Attributes
    ----------
    sum_scores : add the costs of all poses up instead.
    """

    sum_scores: bool = False

    _costs: NDArray[np.uint8] = field(
        default_factory=lambda: np.zeros(1, np.uint8), init=False, repr=False
    )

    def prepare(self, tick: Tick) -> None:
        """Take the costmap; a last entry stands for what is off it."""
        self._costs = np.append(tick.costmap.cells.ravel(), np.uint8(NO_INFORMATION))

    def scores(self, trajectories: Trajectories) -> Array:
        """Score the cost under the robot's centre, or forbid."""
        costs = self._costs[trajectories.cells]
        total = np.where(trajectories.there, costs, 0).sum(axis=1, dtype=np.float64)
        found = total if self.sum_scores else costs[:, -1].astype(np.float64)
        return np.where((costs >= INSCRIBED).any(axis=1), np.nan, found)


@final
@dataclass(eq=False)
class ObstacleFootprint(DwbCritic):
    """Scores with the largest cost under the edges of the robot's footprint, at the last pose.

    A trajectory that touches a lethal or unknown cell, or leaves the map, is not allowed.

    Attributes
    ----------
    sum_scores : add the costs of all poses up instead.
    """

    sum_scores: bool = False

    _tick: Tick | None = field(default=None, init=False, repr=False)

    def prepare(self, tick: Tick) -> None:
        """Take costmap and footprint."""
        self._tick = tick

    def weight(self, resolution: float) -> float:
        """As `DwbCritic.weight`, proportional to the cells' side."""
        return resolution * self.scale

    def scores(self, trajectories: Trajectories) -> Array:
        """Score the largest cost under the footprint's edges, or forbid."""
        assert self._tick is not None  # `prepare` comes first
        costmap, there = self._tick.costmap, trajectories.there
        under = np.zeros(there.shape)
        vertices = self._tick.footprint.vertices
        under[there] = outline_costs(costmap, vertices, trajectories.poses[there], back=True)
        under[trajectories.cells < 0] = LETHAL
        last = under[np.arange(len(under)), trajectories.counts - 1]
        found = under.sum(axis=1) if self.sum_scores else last
        return np.where((under >= LETHAL).any(axis=1), np.nan, found)


@dataclass(eq=False)
class MapGrid(DwbCritic):
    """Scores with the distance, in cells and along the axes, from the last pose to some cells.

    The weight is scale * resolution / 2. A trajectory that leaves the map is not allowed.

    Attributes
    ----------
    aggregation_type : of the scores of the poses: the last, their sum, or their product.
    """

    aggregation_type: Aggregation = "last"

    strict: ClassVar[bool] = True
    """Whether no pose may be where no distance is known."""
    forward: ClassVar[bool] = False
    """Whether not the pose itself counts but a point ahead of it."""

    grid: NDArray[np.int64] = field(
        default_factory=lambda: np.zeros((1, 1), np.int64), init=False, repr=False
    )
    """(height, width), of the last tick."""
    _costmap: Costmap | None = field(default=None, init=False, repr=False)

    def weight(self, resolution: float) -> float:
        """As `DwbCritic.weight`, proportional to half the cells' side."""
        return resolution * 0.5 * self.scale

    def prepare(self, tick: Tick) -> None:
        """Find the distances to the cells of this tick."""
        self._costmap = tick.costmap
        self.grid = distances(tick.costmap, self.sources(tick))

    @abstractmethod
    def sources(self, tick: Tick) -> NDArray[np.int64]:
        """Return the indices of the cells that distances are measured from."""

    def ahead(self) -> float:
        """Return the distance from a pose to the point that counts, m."""
        return 0.0

    def scores(self, trajectories: Trajectories) -> Array:
        """Score the distance of the last pose from the cells, or forbid."""
        last = self.aggregation_type == "last"
        poses, cells, there = trajectories.poses, trajectories.cells, trajectories.there
        if last and not self.strict:
            poses, cells, there = poses[:, -1:], cells[:, -1:], there[:, :1]
        if self.forward:
            assert self._costmap is not None  # `prepare` comes first
            direction = np.stack([np.cos(poses[..., 2]), np.sin(poses[..., 2])], axis=-1)
            cells = cells_of(self._costmap, poses[..., :2] + self.ahead() * direction)
        values = self.grid.ravel()[cells]
        wrong = cells < 0
        if self.strict:
            wrong |= values >= self.grid.size
        return np.where(wrong.any(axis=1), np.nan, self._aggregated(values, there))

    def _aggregated(self, values: NDArray[np.int64], there: NDArray[np.bool_]) -> Array:
        if self.aggregation_type == "last":
            return values[:, -1].astype(np.float64)
        if self.aggregation_type == "sum":
            return np.asarray(np.where(there, values, 0).sum(axis=1), dtype=np.float64)
        return np.asarray(np.where(there, values, 1).prod(axis=1, dtype=np.float64))


@dataclass(eq=False)
class _Aligned(MapGrid):
    """A critic of a point ahead of the robot."""

    forward_point_distance: float = 0.325

    strict: ClassVar[bool] = False
    forward: ClassVar[bool] = True

    def ahead(self) -> float:
        """Return the distance from a pose to the point that counts, m."""
        return self.forward_point_distance


@final
@dataclass(eq=False)
class PathDist(MapGrid):
    """Scores with the distance from the path."""

    def sources(self, tick: Tick) -> NDArray[np.int64]:
        """Cells of the path."""
        return path_cells(tick.costmap, tick.plan)


@final
@dataclass(eq=False)
class GoalDist(MapGrid):
    """Scores with the distance from the last cell of the path on the map."""

    def sources(self, tick: Tick) -> NDArray[np.int64]:
        """Last cell of the path."""
        return path_cells(tick.costmap, tick.plan)[-1:]


@final
@dataclass(eq=False)
class PathAlign(_Aligned):
    """Scores with the distance of a point ahead of the robot from the path.

    Nearer to the goal than this point it is not asked.

    Attributes
    ----------
    forward_point_distance : m, to the point ahead.
    """

    _off: bool = field(default=False, init=False, repr=False)

    def prepare(self, tick: Tick) -> None:
        """As `MapGrid.prepare`."""
        self._off = bool(
            ((tick.pose[:2] - tick.goal[:2]) ** 2).sum() <= self.forward_point_distance**2
        )
        MapGrid.prepare(self, tick)

    def weight(self, resolution: float) -> float:
        """As `MapGrid.weight`; 0 near the goal."""
        return 0.0 if self._off else MapGrid.weight(self, resolution)

    def sources(self, tick: Tick) -> NDArray[np.int64]:
        """Cells of the path."""
        return path_cells(tick.costmap, tick.plan)


@final
@dataclass(eq=False)
class GoalAlign(_Aligned):
    """Scores with the distance of a point ahead of the robot from one ahead of the path's end.

    The end is moved in the direction from the robot to the goal.

    Attributes
    ----------
    forward_point_distance : m, to both points.
    """

    def sources(self, tick: Tick) -> NDArray[np.int64]:
        """Last cell of the path with its end moved."""
        dx, dy = (tick.goal - tick.pose)[:2]
        bearing, plan = atan2(dy, dx), tick.plan.copy()
        plan[-1, 0] += self.forward_point_distance * cos(bearing)
        plan[-1, 1] += self.forward_point_distance * sin(bearing)
        return path_cells(tick.costmap, plan)[-1:]


def path_cells(costmap: Costmap, plan: Array) -> NDArray[np.int64]:
    """Return the indices of the cells along a path (N, 3), from the first on the map to the last.

    Unknown cells count as off the map. Gaps of more than two cells are filled with points; where
    the path leaves the map it ends.
    """
    points = dense(plan[:, :2], costmap.resolution)
    cells = cells_of(costmap, points)
    known = (cells >= 0) & (costmap.cells.ravel()[cells] != NO_INFORMATION)
    if not known.any():
        return cells[:0]
    first = int(known.argmax())
    until = known[first:].argmin() if not known[first:].all() else len(known) - first
    return cells[first : first + int(until)]


def dense(points: Array, resolution: float) -> Array:
    """Fill gaps between points (N, 2), m, that are longer than two cells.

    A gap of g metres gets m - 1 points that divide it by m = trunc(g / resolution - 2) - 1.
    """
    found = [points[:1]]
    for start, end in pairwise(points):
        gap = hypot(*(end - start))
        if gap > 2.0 * resolution:
            parts = trunc((gap - 2.0 * resolution) / resolution) - 1
            share = np.arange(1, parts)[:, None] / max(parts, 1)
            found.append(start + share * (end - start))
        found.append(end[None])
    return np.concatenate(found)


def distances(costmap: Costmap, sources: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return |dx| + |dy| from each cell to the nearest source, in cells, (height, width).

    Without any source it is the number of cells plus one. Obstacles do not matter.
    """
    far = costmap.width * costmap.height + 1
    found = np.full((costmap.height, costmap.width), far, np.int64)
    if not len(sources):
        return found
    found.ravel()[sources] = 0
    for axis, size in enumerate(found.shape):
        place = np.expand_dims(np.arange(size), 1 - axis)
        before = np.minimum.accumulate(found - place, axis=axis) + place
        back = np.flip(np.minimum.accumulate(np.flip(found + place, axis), axis=axis), axis)
        found = np.minimum(before, back - place)
    return found


@final
@dataclass(eq=False)
class Twirling(DwbCritic):
    """Scores with the yaw rate, |omega|."""

    scale: float = 0.0

    def scores(self, trajectories: Trajectories) -> Array:
        """Score the yaw rate."""
        return np.abs(trajectories.twists[:, 2])


@final
@dataclass(eq=False)
class PreferForward(DwbCritic):
    """Scores with theta_scale |omega|; ``penalty`` for moving back, or ahead too slowly.

    Attributes
    ----------
    strafe_x, strafe_theta : m/s and rad/s, below which both the motion is too slow.
    """

    penalty: float = 1.0
    strafe_x: float = 0.1
    strafe_theta: float = 0.2
    theta_scale: float = 10.0

    def scores(self, trajectories: Trajectories) -> Array:
        """Score the yaw rate, or the penalty."""
        x, turn = trajectories.twists[:, 0], np.abs(trajectories.twists[:, 2])
        slow = (x < 0.0) | ((x < self.strafe_x) & (turn < self.strafe_theta))
        return np.where(slow, self.penalty, turn * self.theta_scale)


CRITICS: dict[str, type[DwbCritic]] = {
    kind.__name__: kind
    for kind in (
        RotateToGoal, Oscillation, BaseObstacle, ObstacleFootprint, PathDist, GoalDist, PathAlign,
        GoalAlign, Twirling, PreferForward,
    )
}  # fmt: skip
"""Name in a parameter file -> class."""


def usual_critics() -> tuple[DwbCritic, ...]:
    """Return new critics, those of DWB by default."""
    return (
        RotateToGoal(), Oscillation(), BaseObstacle(), GoalAlign(), PathAlign(), PathDist(),
        GoalDist(),
    )  # fmt: skip

"""Critics of MPPI: each adds a cost to every sampled trajectory. Numbers are float32."""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from math import atan2, exp
from typing import Literal, final

import numpy as np
from numpy.typing import NDArray

from wideberth.framework.values.arrays import BoolArray
from wideberth.framework.values.costmap import Costmap

from ..costmap.footprint import RobotFootprint, outline_costs
from ..costs import INSCRIBED, LETHAL, NO_INFORMATION
from ..parameters import Count, Natural, NonNegative, Triple, check_parameters
from .local_controller import Tick
from .mppi_rollouts import MppiTick, Rollouts, Single, wrapped

_HALF = np.float32(0.5 * np.pi)
_NO_REVERSE = 1e-6
"""m/s: a robot with a lower speed backwards does not reverse."""


@dataclass(frozen=True)
class MppiCritic(ABC):
    """Adds (weight * value)^power to the cost of each trajectory.

    The fields of the critics have Nav2's names and defaults.

    Attributes
    ----------
    enabled : whether it is asked.
    cost_power : the exponent; 0 counts as 1.

    Raises
    ------
    WideberthError : no number where one is wanted, or one that is out of range.
    """

    enabled: bool = True
    cost_power: Natural = 1

    def __post_init__(self) -> None:
        check_parameters(self, type(self).__name__)

    def cost(self, rollouts: Rollouts, situation: MppiTick) -> Single | None:
        """Return the cost of each trajectory, (B,); None where the critic does not apply."""
        found = self.weighted(rollouts, situation) if self.enabled else None
        if found is None or self.cost_power <= 1:
            return found
        return np.asarray(found**self.cost_power, np.float32)

    @abstractmethod
    def weighted(self, rollouts: Rollouts, situation: MppiTick) -> Single | None:
        """Return the cost before the power is taken, (B,), or None."""


@final
@dataclass(frozen=True)
class ConstraintCritic(MppiCritic):
    """Keeps the speed within its limits, and a robot with a turning radius above it.

    weight sum_t (max(v - v_max, 0) + max(v_min - v, 0) + max(r_min - |v / omega|, 0)) dt
    """

    cost_weight: float = 4.0

    def weighted(self, rollouts: Rollouts, situation: MppiTick) -> Single | None:
        """Price speeds beyond their limits and turns that are too tight."""
        limits, vx = situation.limits, rollouts.vx
        out = np.maximum(vx - np.float32(limits.vx_max), 0.0)
        out += np.maximum(np.float32(limits.vx_min) - vx, 0.0)
        if limits.turning_radius:
            radius = np.abs(vx) / np.maximum(np.abs(rollouts.wz), np.float32(1e-6))
            out += np.maximum(np.float32(limits.turning_radius) - radius, 0.0)
        total = (out * np.float32(situation.dt)).sum(axis=0)
        return np.asarray(total * np.float32(self.cost_weight))


@final
@dataclass(frozen=True)
class CostCritic(MppiCritic):
    """Adds the costmap's costs along the trajectory up; a collision costs far more.

    The mean over every ``trajectory_point_step``-th point, times weight / 254. Costs of
    ``near_collision_cost`` and more count as ``critical_cost``; near the goal only these count. A
    trajectory collides in a cell of cost 253 or more, or with its footprint in a lethal one;
    off the map and in unknown cells unless these are tracked. Where all collide the tick fails.

    Attributes
    ----------
    consider_footprint : test the footprint, not only its centre, where the centre's cost says
        that it may touch an obstacle, see `touching_cost`.
    cost_scaling_factor : 1/m, of the costmap's inflation, for that test.
    collision_cost : sum of costs of a trajectory that collides.
    near_goal_distance : m, of path ahead.
    """

    cost_weight: float = 3.81
    consider_footprint: bool = False
    near_collision_cost: int = 253
    critical_cost: float = 300.0
    collision_cost: float = 1_000_000.0
    near_goal_distance: float = 0.5
    trajectory_point_step: Count = 2
    cost_scaling_factor: NonNegative = 10.0

    def weighted(self, rollouts: Rollouts, situation: MppiTick) -> Single | None:
        """Price the costmap's costs along each trajectory."""
        every = self.trajectory_point_step
        x, y, yaw = rollouts.x[::every], rollouts.y[::every], rollouts.yaw[::every]
        tick, whole = situation.tick, self.consider_footprint
        costs = tested = costs_of(tick.costmap, cells_at(tick.costmap, x, y))
        if whole:
            least = max(touching_cost(tick.footprint, self.cost_scaling_factor), 1)
            tested = outlined(tick, costs, (x, y, yaw), costs >= least)
        hits = collides(situation, tested, whole).any(axis=0)
        situation.all_collide = bool(hits.all())
        near = situation.length < self.near_goal_distance
        plain = np.float32(0.0) if near else costs
        costs = np.where(costs >= self.near_collision_cost, np.float32(self.critical_cost), plain)
        total = np.where(hits, np.float32(self.collision_cost), costs.sum(axis=0))
        return np.asarray(total * np.float32(self.cost_weight / 254.0 / len(x)))


@final
@dataclass(frozen=True)
class ObstaclesCritic(MppiCritic):
    """Keeps a distance from obstacles, which it infers from the inflated costs.

    A cost c means a distance D = (k r - ln c + ln 253) / k - r, with the inscribed radius r and
    the inflation's k. The cost is

        critical_weight sum_t max(margin - D, 0)
            + repulsion_weight / T (sum_t (inflation_radius - D) - its least value of all)

    over the points of a cost of at least 1. Near the goal the second term is 0; a trajectory that
    collides has ``collision_cost`` in place of the first sum, and its second one ends there.

    With ``consider_footprint`` c is the highest cost under the footprint's edges, wherever the
    centre's cost says that it may touch an obstacle, see `touching_cost`; such a D is measured
    from the edges, so that r is not taken off. No recorded case has this: it follows Nav2's
    source as it can be read at other commits.

    Attributes
    ----------
    inflation_radius, cost_scaling_factor : m and k, 1/m, of the costmap's inflation; where one
        is 0 nothing is said of distances.
    consider_footprint : look at the footprint, not only at its centre.
    collision_margin_distance : m.
    near_goal_distance : m, of path ahead.
    """

    consider_footprint: bool = False
    critical_weight: float = 20.0
    repulsion_weight: float = 1.5
    collision_cost: float = 100_000.0
    collision_margin_distance: float = 0.10
    near_goal_distance: float = 0.5
    inflation_radius: NonNegative = 0.55
    cost_scaling_factor: NonNegative = 10.0

    def weighted(self, rollouts: Rollouts, situation: MppiTick) -> Single | None:
        """Price collisions and small distances from obstacles."""
        tick, size = situation.tick, np.float32(situation.tick.footprint.inscribed)
        cells = cells_at(tick.costmap, rollouts.x, rollouts.y, np.float64)
        costs = costs_of(tick.costmap, cells)
        centre: Single | np.float32 = size
        if self.consider_footprint:
            least = touching_cost(tick.footprint, self.cost_scaling_factor)
            near = (cells >= 0) & (costs >= least)
            costs = outlined(tick, costs, (rollouts.x, rollouts.y, rollouts.yaw), near)
            centre = np.where(near, np.float32(0.0), size)
        hits = collides(situation, costs, self.consider_footprint)
        before = ~np.logical_or.accumulate(hits, axis=0) & (costs >= 1.0)
        before &= self.inflation_radius > 0.0 and self.cost_scaling_factor > 0.0
        distance = self._distance(costs, size) - centre
        lack = np.maximum(np.float32(self.collision_margin_distance) - distance, 0.0)
        collided = hits.any(axis=0)
        situation.all_collide = bool(collided.all())
        raw = np.where(before, lack, 0.0).sum(axis=0, dtype=np.float32)
        raw = np.where(collided, np.float32(self.collision_cost), raw)
        found = np.float32(self.critical_weight) * raw
        if situation.length >= self.near_goal_distance:
            gap = np.where(before, np.float32(self.inflation_radius) - distance, 0.0)
            repulsion = gap.sum(axis=0, dtype=np.float32)
            share = (repulsion - repulsion.min()) / np.float32(len(costs))
            found += np.float32(self.repulsion_weight) * share
        return found

    def _distance(self, costs: Single, size: np.float32) -> Single:
        """Return the distance from a point to an obstacle, m, that costs mean."""
        k = np.float32(self.cost_scaling_factor or 1.0)
        table = np.log(np.maximum(np.arange(256, dtype=np.float32), 1.0))
        ahead = k * size - table[costs.astype(np.uint8)] + np.log(np.float32(253.0))
        return np.asarray(ahead / k)


def cells_at(
    costmap: Costmap, x: Single, y: Single, width: type[np.floating] = np.float32
) -> NDArray[np.int32]:
    """Return the indices of the cells that hold points, m; -1 off the map.

    Parameters
    ----------
    width : type of number in which the cells are found.
    """
    left, low = (width(value) for value in costmap.origin)
    side = width(costmap.resolution)
    mx, my = (x.astype(width) - left) / side, (y.astype(width) - low) / side
    inside = (mx >= 0.0) & (my >= 0.0) & (mx < costmap.width) & (my < costmap.height)
    row, column = (np.where(inside, at, 0.0).astype(np.int32) for at in (my, mx))
    return np.where(inside, row * costmap.width + column, np.int32(-1))


def costs_of(costmap: Costmap, cells: NDArray[np.int32]) -> Single:
    """Return the costs of cells by their indices; 255 off the map, where an index is -1."""
    table = np.append(costmap.cells.ravel(), np.uint8(NO_INFORMATION)).astype(np.float32)
    return table[cells]


def touching_cost(footprint: RobotFootprint, cost_scaling_factor: float) -> int:
    """Return the least cost under the centre with which an outline may touch an obstacle.

    It is the cost that the inflation gives to the circumscribed radius R,
    trunc(252 exp(-k (R - r))), with the inscribed radius r.
    """
    apart = footprint.circumscribed - footprint.inscribed
    return int(252.0 * exp(-cost_scaling_factor * apart)) if apart > 0.0 else INSCRIBED


def outlined(
    tick: Tick, costs: Single, poses: tuple[Single, Single, Single], near: BoolArray
) -> Single:
    """Return costs, with the highest ones under the footprint's edges at some poses.

    Parameters
    ----------
    costs : (T, B), under the centre.
    poses : x, y and yaw.
    near : (T, B), which poses.
    """
    found = costs.copy()
    some = np.stack([axis[near] for axis in poses], axis=-1).astype(np.float64)
    found[near] = outline_costs(tick.costmap, tick.footprint.vertices, some)
    return found


def collides(situation: MppiTick, costs: Single, outline: bool) -> BoolArray:
    """Return at which poses, (T, B), the robot collides.

    Parameters
    ----------
    costs : under its centre, or under its footprint's edges.
    outline : the latter.
    """
    inner, known = LETHAL if outline else INSCRIBED, costs != NO_INFORMATION
    return np.asarray((costs >= inner) & (known | (not situation.tick.track_unknown)))


@final
@dataclass(frozen=True)
class GoalCritic(MppiCritic):
    """Draws towards the end of the path once little of it is left.

    weight * mean over t of the distance to the last point of the path

    Attributes
    ----------
    threshold_to_consider : m, of path ahead, beyond which it does not apply.
    """

    cost_weight: float = 5.0
    threshold_to_consider: float = 1.4

    def weighted(self, rollouts: Rollouts, situation: MppiTick) -> Single | None:
        """Price the mean distance from the path's end."""
        if situation.length > self.threshold_to_consider:
            return None
        end = situation.path[:, -1]
        far = np.sqrt((rollouts.x - end[0]) ** 2 + (rollouts.y - end[1]) ** 2)
        mean = far.mean(axis=0, dtype=np.float32)
        return np.asarray(mean * np.float32(self.cost_weight))


@final
@dataclass(frozen=True)
class GoalAngleCritic(MppiCritic):
    """Turns towards the heading at the end of the path.

    weight * mean over t of |yaw - yaw of the last point of the path|

    Attributes
    ----------
    threshold_to_consider : m, of path ahead, beyond which it does not apply.
    """

    cost_weight: float = 3.0
    threshold_to_consider: float = 0.5

    def weighted(self, rollouts: Rollouts, situation: MppiTick) -> Single | None:
        """Price the mean angle to the heading at the path's end."""
        if situation.length > self.threshold_to_consider:
            return None
        error = np.abs(wrapped(situation.path[2, -1] - rollouts.yaw))
        mean = error.mean(axis=0, dtype=np.float32)
        return np.asarray(mean * np.float32(self.cost_weight))


@final
@dataclass(frozen=True)
class PathAlignCritic(MppiCritic):
    """Keeps trajectories on the path, point by point at equal lengths along both.

    weight * mean over the points of the distance to the point of the path as far along it

    Points beside blocked ones of the path are left out. It does not apply near the goal, or while
    the trajectories reach less than ``offset_from_furthest`` points of the path, or where more
    than two and more than a share of the reached ones are blocked.

    Attributes
    ----------
    max_path_occupancy_ratio : that share.
    trajectory_point_step : every so many points of a trajectory are compared.
    threshold_to_consider : m, of path ahead, below which it does not apply.
    use_path_orientations : add the difference of the headings, 1 m per rad.
    """

    cost_weight: float = 10.0
    max_path_occupancy_ratio: float = 0.07
    offset_from_furthest: Natural = 20
    trajectory_point_step: Count = 4
    threshold_to_consider: float = 0.5
    use_path_orientations: bool = False

    def weighted(self, rollouts: Rollouts, situation: MppiTick) -> Single | None:
        """Price the mean distance from the path."""
        if situation.length < self.threshold_to_consider:
            return None
        far = situation.furthest(rollouts)
        blocked = int((~situation.valid[:far]).sum())
        crowded = blocked > 2 and blocked / far > self.max_path_occupancy_ratio
        if far < max(self.offset_from_furthest, 1) or crowded:
            return None
        return self._mean(rollouts, situation, far) * np.float32(self.cost_weight)

    def _mean(self, rollouts: Rollouts, situation: MppiTick, far: int) -> Single:
        """Return the mean distance from the first ``far`` points of the path, (B,)."""
        every, arc = self.trajectory_point_step, situation.arc[:far]
        x, y, yaw = rollouts.x[::every], rollouts.y[::every], rollouts.yaw[::every]
        path, valid = situation.path, situation.valid
        travelled = np.cumsum(np.sqrt(np.diff(x, axis=0) ** 2 + np.diff(y, axis=0) ** 2), axis=0)
        beyond = np.searchsorted(arc, travelled, side="right")
        at = np.zeros(x.shape[1], np.int64)
        total, count = np.zeros(x.shape[1], np.float32), np.zeros(x.shape[1], np.float32)
        for p in range(1, len(x)):
            after = np.maximum(beyond[p - 1], at + 1)
            known = np.minimum(after, far - 1)
            nearer = (
                travelled[p - 1] - arc[np.minimum(after, far) - 1] < arc[known] - travelled[p - 1]
            )
            at = np.where(after >= far, far - 1, np.where(nearer, after - 1, after))
            square = (path[0, at] - x[p]) ** 2 + (path[1, at] - y[p]) ** 2
            if self.use_path_orientations:
                square += wrapped(path[2, at] - yaw[p]) ** 2
            free = valid[at]
            total += np.where(free, np.sqrt(square), np.float32(0.0))
            count += free
        return np.asarray(total / np.maximum(count, np.float32(1.0)), np.float32)


@final
@dataclass(frozen=True)
class PathFollowCritic(MppiCritic):
    """Draws the end of trajectories towards a point of the path ahead of what they reach.

    weight * distance of the last point from path[furthest + offset_from_furthest]

    or from the next point of the path that is free.

    Attributes
    ----------
    threshold_to_consider : m, of path ahead, below which it does not apply.
    """

    cost_weight: float = 5.0
    offset_from_furthest: Natural = 6
    threshold_to_consider: float = 1.4

    def weighted(self, rollouts: Rollouts, situation: MppiTick) -> Single | None:
        """Price the distance of the last point from the point ahead."""
        last = situation.path.shape[1] - 1
        if last < 1 or situation.length < self.threshold_to_consider:
            return None
        ahead = min(situation.furthest(rollouts) + self.offset_from_furthest, last)
        while ahead < last - 1 and not situation.valid[ahead]:
            ahead += 1
        dx, dy = situation.path[:2, ahead, None] - np.stack([rollouts.x[-1], rollouts.y[-1]])
        far = np.sqrt(dx * dx + dy * dy)
        return np.asarray(far * np.float32(self.cost_weight))


@final
@dataclass(frozen=True)
class PathAngleCritic(MppiCritic):
    """Turns the end of trajectories towards a point of the path, where the robot faces elsewhere.

    weight * |yaw at the end - direction from the end to path[furthest + offset_from_furthest]|

    It does not apply while the robot faces this point within ``max_angle_to_furthest``.

    Attributes
    ----------
    threshold_to_consider : m, of path ahead, below which it does not apply.
    max_angle_to_furthest : rad.
    mode : 0, the robot is to face the point; 1, or to turn its back to it; 2, whichever of both
        the heading of the path at that point asks for. Where ``vx_min`` is 0 (less than 1e-6) 1
        counts as 0; no recorded case has this, it follows Nav2's source at other commits.
    """

    cost_weight: float = 2.2
    offset_from_furthest: Natural = 4
    threshold_to_consider: float = 0.5
    max_angle_to_furthest: float = 0.785398
    mode: Literal[0, 1, 2] = 0

    def weighted(self, rollouts: Rollouts, situation: MppiTick) -> Single | None:
        """Price the angle to the point ahead, at the end."""
        if situation.length < self.threshold_to_consider:
            return None
        ahead = situation.furthest(rollouts) + self.offset_from_furthest
        target = situation.path[:, min(ahead, situation.path.shape[1] - 1)]
        pose = situation.tick.pose
        bearing = np.array([atan2(target[1] - pose[1], target[0] - pose[0])], np.float32)
        here = np.array([pose[2]], np.float32)
        forward = self.mode == 1 and abs(situation.limits.vx_min) < _NO_REVERSE
        mode = 0 if forward else self.mode
        if np.abs(_off(mode, bearing, here, target[2]))[0] < self.max_angle_to_furthest:
            return None
        bearings = np.arctan2(target[1] - rollouts.y[-1], target[0] - rollouts.x[-1])
        error = np.abs(_off(mode, bearings, rollouts.yaw[-1], target[2]))
        return np.asarray(error * np.float32(self.cost_weight))


def _off(mode: int, bearing: Single, yaw: Single, wanted: np.float32) -> Single:
    """Return the angles from headings to directions or their opposites, see `PathAngleCritic`."""
    if mode:
        against = np.abs(wrapped(bearing - (yaw if mode == 1 else wanted))) > _HALF
        bearing = np.where(against, wrapped(bearing + np.float32(np.pi)), bearing)
    return wrapped(bearing - yaw)


@final
@dataclass(frozen=True)
class PreferForwardCritic(MppiCritic):
    """Keeps the robot from driving backwards, weight sum_t max(-v, 0) dt.

    Attributes
    ----------
    threshold_to_consider : m, of path ahead, below which it does not apply.
    """

    cost_weight: float = 5.0
    threshold_to_consider: float = 0.5

    def weighted(self, rollouts: Rollouts, situation: MppiTick) -> Single | None:
        """Price driving backwards."""
        if situation.length < self.threshold_to_consider:
            return None
        back = np.maximum(-rollouts.vx, 0.0).sum(axis=0) * np.float32(situation.dt)
        return np.asarray(back * np.float32(self.cost_weight))


@final
@dataclass(frozen=True)
class TwirlingCritic(MppiCritic):
    """Keeps the robot from turning, weight * mean over t of |omega|.

    It does not apply where less path is left than the goal checker's tolerance of the position.
    """

    cost_weight: float = 10.0

    def weighted(self, rollouts: Rollouts, situation: MppiTick) -> Single | None:
        """Price the mean yaw rate."""
        if situation.length < situation.tick.checker.xy_goal_tolerance:
            return None
        turning = np.abs(rollouts.wz).mean(axis=0, dtype=np.float32)
        return np.asarray(turning * np.float32(self.cost_weight))


@final
@dataclass(frozen=True)
class VelocityDeadbandCritic(MppiCritic):
    """Avoids velocities that are too small for the drive to follow.

    weight sum_t (max(d_v - |v|, 0) + max(d_omega - |omega|, 0)) dt

    Attributes
    ----------
    deadband_velocities : d_v forward, d_v to the side, of no account here, and d_omega.
    """

    cost_weight: float = 35.0
    deadband_velocities: Triple = (0.0, 0.0, 0.0)

    def weighted(self, rollouts: Rollouts, situation: MppiTick) -> Single | None:
        """Price velocities within the drive's deadband."""
        slow, _, still = (np.float32(abs(value)) for value in self.deadband_velocities)
        lack = np.maximum(slow - np.abs(rollouts.vx), 0.0)
        lack += np.maximum(still - np.abs(rollouts.wz), 0.0)
        total = (lack * np.float32(situation.dt)).sum(axis=0)
        return np.asarray(total * np.float32(self.cost_weight))


NAV2: dict[str, type[MppiCritic]] = {
    kind.__name__: kind
    for kind in (
        ConstraintCritic, CostCritic, ObstaclesCritic, GoalCritic, GoalAngleCritic,
        PathAlignCritic, PathFollowCritic, PathAngleCritic, PreferForwardCritic, TwirlingCritic,
        VelocityDeadbandCritic,
    )
}  # fmt: skip
"""Name in a parameter file -> class."""
USUAL: tuple[MppiCritic, ...] = (
    ConstraintCritic(), CostCritic(), GoalCritic(), GoalAngleCritic(), PathAlignCritic(),
    PathFollowCritic(), PathAngleCritic(), PreferForwardCritic(),
)  # fmt: skip
"""Critics of MPPI by default."""

"""What pulls at a timed elastic band: its edges, in the order in which they are created."""

from dataclasses import dataclass, replace
from typing import final

import numpy as np
from numpy.typing import NDArray

from wideberth.framework.values.arrays import Array

from . import _teb_kernel as kernel
from ._teb_kernel import Edges
from .teb_band import Band, TebParameters

STANDING = 1e-3
"""m/s, a slower obstacle counts as standing."""
_ROUNDING = 1e-6
"""m, so that a rounding error leaves no obstacle out."""


@final
@dataclass(frozen=True, eq=False)
class TebObstacles:
    """Discs that a band keeps clear of.

    Attributes
    ----------
    places : (M, 2), of their centres now, m.
    radii : (M,), m; 0 for a point.
    velocities : (M, 2), m/s; slower than 1 mm/s is standing.
    """

    places: Array
    radii: Array
    velocities: Array

    @property
    def moving(self) -> NDArray[np.bool_]:
        """Which of them move, (M,)."""
        return np.asarray(np.hypot(self.velocities[:, 0], self.velocities[:, 1]) >= STANDING)


@final
@dataclass(frozen=True, eq=False)
class Pull:
    """What pulls at a band apart from its settings.

    Attributes
    ----------
    obstacles : around the robot.
    start : speed (m/s) and yaw rate (rad/s) at the start; None where they are free.
    turn : 1 to prefer turning left, -1 to the right, 0 for neither.
    multiplier : of the standing obstacles' weight.
    """

    obstacles: TebObstacles
    start: tuple[float, float] | None = None
    turn: int = 0
    multiplier: float = 1.0


def edges_of(band: Band, pull: Pull, settings: TebParameters) -> Edges:
    """Return the edges of a band."""
    parts = [
        *_of_standing(band, pull, settings),
        *_of_moving(band, pull, settings),
        *_of_motion(len(band.poses), pull, settings),
    ]
    return Edges(*map(np.concatenate, zip(*parts, strict=True)))


def cost_of(edges: Edges, band: Band, settings: TebParameters) -> tuple[Array, float]:
    """Return the errors (E, 2), 0 where an edge has one alone, and the sum of w e^2."""
    found = np.zeros((len(edges.kind), 2))
    total = kernel.compiled()[0](edges, band.packed(), limits_of(settings), found)
    return found, float(total)


def minimised(edges: Edges, band: Band, settings: TebParameters) -> tuple[Band, float, int]:
    """Return the band after `no_inner_iterations`, its sum of w e^2, and the iterations."""
    z, most = band.packed(), settings.no_inner_iterations
    total, done = kernel.compiled()[1](edges, limits_of(settings), z, most)
    return Band.unpacked(z), float(total), int(done)


def limits_of(settings: TebParameters) -> Array:
    """Return speed backwards and forwards, yaw rate, both accelerations, and the margin."""
    return np.array([
        settings.max_vel_x_backwards, settings.max_vel_x, settings.max_vel_theta,
        settings.acc_lim_x, settings.acc_lim_theta, settings.penalty_epsilon,
    ])  # fmt: skip


def _part(
    kind: int, begin: NDArray[np.int64], weight: tuple[float, float], data: Array | None = None
) -> Edges:
    """Return edges of one kind that begin at these entries of the band's vector."""
    count = len(begin)
    return Edges(
        np.full(count, kind, np.int64), begin, np.zeros((count, 5)) if data is None else data,
        np.tile(np.array(weight), (count, 1)),
    )  # fmt: skip


def _near(places: Array, radii: Array, inflation: float, settings: TebParameters) -> Array:
    """Return the data (E, 5) of edges from obstacles, at places (E, 2) with radii (E,), m."""
    data = np.empty((len(places), 5))
    data[:, :2], data[:, 2] = places, radii + settings.robot_radius
    data[:, 3], data[:, 4] = settings.min_obstacle_dist, inflation
    return data


def _of_standing(band: Band, pull: Pull, settings: TebParameters) -> list[Edges]:
    """Return an edge for each pose and each obstacle that it takes, pose by pose."""
    obstacles = pull.obstacles
    taken = np.arange(len(obstacles.places))
    if settings.include_dynamic_obstacles:
        taken = taken[~obstacles.moving]
    if not len(taken) or settings.weight_obstacle == 0.0:
        return []
    reach = obstacles.radii[taken] + settings.robot_radius
    pose, which = associated(band.poses[1:-1], obstacles.places[taken], reach, settings)
    which = taken[which]
    inflation, weight = settings.inflation_dist, settings.weight_obstacle * pull.multiplier
    data = _near(obstacles.places[which], obstacles.radii[which], inflation, settings)
    if inflation > settings.min_obstacle_dist:
        kind, weights = kernel.INFLATED, (weight, settings.weight_inflation)
    else:
        kind, weights = kernel.OBSTACLE, (weight, 0.0)
    return [_part(kind, 4 * (pose + 1), weights, data)]


def _of_moving(band: Band, pull: Pull, settings: TebParameters) -> list[Edges]:
    """Return an edge for each moving obstacle and each pose, at that pose's time."""
    obstacles = pull.obstacles
    if not settings.include_dynamic_obstacles or settings.weight_dynamic_obstacle == 0.0:
        return []
    times = np.cumsum(band.intervals)[:-1]
    begin = 4 * np.arange(1, len(band.poses) - 1)
    weights = settings.weight_dynamic_obstacle, settings.weight_dynamic_obstacle_inflation
    parts = []
    for i in np.flatnonzero(obstacles.moving):
        places = obstacles.places[i] + times[:, None] * obstacles.velocities[i]
        inflation = settings.dynamic_obstacle_inflation_dist
        data = _near(places, obstacles.radii[i], inflation, settings)
        parts.append(_part(kernel.DYNAMIC, begin, weights, data))
    return parts


def _of_motion(count: int, pull: Pull, settings: TebParameters) -> list[Edges]:
    """Return the edges of limits, time, length, kinematics and sense of rotation."""
    steps = 4 * np.arange(count - 1)
    speeds = settings.weight_max_vel_x, settings.weight_max_vel_theta
    acceleration = settings.weight_acc_lim_x, settings.weight_acc_lim_theta
    parts = [_part(kernel.VELOCITY, steps, speeds)]
    if pull.start is not None:
        data = np.array([[*pull.start, 0.0, 0.0, 0.0]])
        parts.append(_part(kernel.ACCELERATION_START, steps[:1], acceleration, data))
    parts.append(_part(kernel.ACCELERATION, steps[:-1], acceleration))
    if not settings.free_goal_vel:
        parts.append(_part(kernel.ACCELERATION_GOAL, steps[-1:], acceleration))
    parts.append(_part(kernel.TIME, steps + 3, (settings.weight_optimaltime, 0.0)))
    if settings.weight_shortest_path > 0.0:
        parts.append(_part(kernel.SHORTEST, steps, (settings.weight_shortest_path, 0.0)))
    kinematics = settings.weight_kinematics_nh, settings.weight_kinematics_forward_drive
    parts.append(_part(kernel.KINEMATICS, steps, kinematics))
    if pull.turn:
        data = np.zeros((len(steps[:3]), 5))
        data[:, 0] = pull.turn
        parts.append(_part(kernel.TURN, steps[:3], (settings.weight_prefer_rotdir, 0.0), data))
    return parts


def associated(
    poses: Array, places: Array, reach: Array, settings: TebParameters
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return which pose takes which standing obstacle, in the order of the edges.

    A pose takes all that are nearer than the force_inclusion_factor times the least distance, and
    of those up to the cutoff_factor the nearest on the left and the nearest on the right. Left
    is where cross(heading, centre) > 0 with the centre in the coordinates of the map, as in the
    original, whose later branch corrects it to the place as seen from the pose.

    Parameters
    ----------
    poses : (K, 3).
    places, reach : (M, 2), and (M,) radii of obstacle and robot together, m.
    """
    least = settings.min_obstacle_dist
    there = _beside(poses, places, reach, settings)
    if not len(there):
        return there, there
    places, reach = places[there], reach[there]
    apart = np.hypot(
        poses[:, None, 0] - places[None, :, 0], poses[:, None, 1] - places[None, :, 1]
    )
    apart = apart - reach
    near = apart < least * settings.obstacle_association_force_inclusion_factor
    between = ~near & (apart <= least * settings.obstacle_association_cutoff_factor)
    cosine, sine = np.cos(poses[:, 2]), np.sin(poses[:, 2])
    left = cosine[:, None] * places[:, 1] - sine[:, None] * places[:, 0] > 0.0
    rows = np.arange(len(poses))
    pose, which = np.nonzero(near)
    order = np.zeros(len(pose))
    for rank, side in enumerate((left, ~left)):
        rest = np.where(between & side, apart, np.inf)
        nearest = np.argmin(rest, axis=1)
        found = np.isfinite(rest[rows, nearest])
        pose = np.append(pose, rows[found])
        which = np.append(which, nearest[found])
        order = np.append(order, np.full(int(found.sum()), rank + 1))
    sorting = np.lexsort((np.arange(len(pose)), order, pose))
    return pose[sorting], there[which[sorting]]


def _beside(
    poses: Array, places: Array, reach: Array, settings: TebParameters
) -> NDArray[np.int64]:
    """Return the indices of the obstacles that are not too far from a band for all its poses.

    They are within the box about the poses, grown by the distance beyond which no pose takes one.
    """
    if not len(poses):
        return np.zeros(0, np.int64)
    factors = (
        settings.obstacle_association_force_inclusion_factor,
        settings.obstacle_association_cutoff_factor,
    )
    margin = settings.min_obstacle_dist * max(factors) + reach[:, None] + _ROUNDING
    low, high = poses[:, :2].min(axis=0), poses[:, :2].max(axis=0)
    inside = (places >= low - margin) & (places <= high + margin)
    return np.flatnonzero(inside.all(axis=1))


@final
@dataclass(frozen=True, eq=False)
class Optimum:
    """A band after it has been resized and solved several times.

    Attributes
    ----------
    band : the result.
    cost : sum of w e^2 of the last edges.
    obstacle_cost : the obstacles' part of it.
    """

    band: Band
    cost: float
    obstacle_cost: float


def optimised(band: Band, pull: Pull, settings: TebParameters) -> Optimum | None:
    """Resize a band and lower its cost, `no_outer_iterations` times.

    Each time the weight of the standing obstacles grows by `weight_adapt_factor`.

    Returns
    -------
    optimum : None where the band is shorter than `min_samples` or is no number any more.
    """
    multiplier, edges = pull.multiplier, None
    for _ in range(settings.no_outer_iterations):
        band = band.resized(settings)
        if len(band.poses) < settings.min_samples:
            return None
        edges = edges_of(band, replace(pull, multiplier=multiplier), settings)
        band, _, _ = minimised(edges, band, settings)
        multiplier *= settings.weight_adapt_factor
    assert edges is not None  # there is one iteration at least
    errors, cost = cost_of(edges, band, settings)
    if not np.isfinite(cost):
        return None
    near = edges.kind <= kernel.DYNAMIC
    return Optimum(band, cost, float((edges.weight * errors**2)[near].sum()))

"""ORCA's programme as a lower level: half-planes and optimality conditions, in CasADi."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from wideberth.framework.numerics.symbolic import ca
from wideberth.framework.values.arrays import Array

SLACK_WEIGHT = 100.0
"""Of half a squared slack; SICNav's. A half-plane that holds a person back by 1 m/s is entered by
1 cm/s."""
TOUCHING = 1e-3
"""m, least gap to a wall: standing still then enters no half-plane of a wall."""
TINY = 1e-12
"""m^2 or m^2/s^2 below a root, so that it has a slope everywhere."""
HEAD_ON = 1e-9
"""Sine of the angle below which an encounter is head-on, and passed with the other on the left."""
MOST_STEPS, HALVINGS = 30, 30
"""Of Newton's method at each barrier, and of one of its steps."""
ENOUGH = 1e-12
"""m^2/s^2, of which the cost may still fall."""


def half_plane(
    apart: Any, relative: Any, own: Any, room: Any, horizon: float, dt: float
) -> tuple[Any, Any]:
    """Return n, (2,), and b of the half-plane n . v >= b that one neighbour leaves, ORCA's.

    As `wideberth.people.models.Reciprocal` has it, written as expressions without
    branches. Of two in one place that move alike n is zero.

    Parameters
    ----------
    apart : (2,), m, position of the neighbour minus the own.
    relative : (2,), m/s, own velocity minus the neighbour's.
    own : (2,), m/s.
    room : m, sum of the radii.
    horizon, dt : s; who overlaps already is to be apart after ``dt``.
    """
    square = ca.dot(apart, apart)
    overlap = square <= room * room
    inverse = ca.if_else(overlap, 1.0 / dt, 1.0 / horizon)
    w = relative - inverse * apart
    length, inward = ca.dot(w, w), ca.dot(w, apart)
    size = ca.sqrt(length + TINY)
    ahead = ca.logic_and(inward < 0.0, inward * inward > room * room * length)
    round_end = ca.logic_or(overlap, ahead)
    leg = ca.sqrt(ca.fmax(square - room * room, TINY))
    left = apart[0] * w[1] - apart[1] * w[0] > HEAD_ON * ca.sqrt(square * length + TINY**2)
    turn = ca.if_else(left, room, -room)
    cone = ca.vertcat(apart[0] * leg - apart[1] * turn, apart[1] * leg + apart[0] * turn)
    along = ca.if_else(left, 1.0, -1.0) * cone / ca.fmax(square, TINY)
    normal = ca.if_else(round_end, w / size, ca.vertcat(-along[1], along[0]))
    push = ca.if_else(
        round_end,
        (room * inverse - size) * w / size,
        ca.dot(relative, along) * along - relative,
    )
    return normal, ca.dot(normal, own + 0.5 * push)


def wanted_velocity(place: Any, goal: Any, fastest: Any) -> Any:
    """Return the way to a goal as a velocity, (2,), m/s: at most 0.999 ``fastest``."""
    way = goal - place
    length = ca.sqrt(ca.dot(way, way) + TINY)
    return way * ca.fmin(1.0, 0.999 * fastest / length)


def conditions(
    velocity: Any,
    slack: Any,
    multipliers: Sequence[Any],
    lines: Sequence[tuple[Any, Any]],
    hard: int,
    wanted: Any,
    fastest: Any,
    relaxation: float,
) -> list[Any]:
    """Return what is zero where a velocity solves ORCA's programme, relaxed.

    The programme of one person is ::

        min  |v - v*|^2 / 2 + W s^2 / 2
        n_j . v - b_j + s >= 0   (people),     n_w . v - b_w >= 0   (walls),
        (v_max^2 - |v|^2) / 2 >= 0,    s >= 0

    Its conditions are v - v* - sum lambda n + lambda_max v = 0, W s - sum_j lambda_j - lambda_s
    = 0, and of each constraint g with its multiplier ``lambda + g = sqrt(lambda^2 + g^2 + 2
    rho)``: both are positive, and their product is rho. That is the point of the central path
    with barrier rho: it is one, it is smooth in all data, and of m constraints it holds that
    |v - v_exact|^2 <= 2 m rho.

    Parameters
    ----------
    velocity, slack : v, (2,), and s, m/s.
    multipliers : lambda, one per line, then those of v_max and of s.
    lines : n and b of the half-planes; the last ``hard`` are those of walls.
    wanted, fastest : v*, (2,), and v_max, m/s.
    relaxation : rho, m^2/s^2.

    References
    ----------
    S. Samavi et al., SICNav, IEEE Transactions on Robotics (2024), for the conditions in place
    of the programme; A. Fischer, A special Newton-type optimization method, Optimization (1992),
    and C. Kanzow (1996) for the smooth form of complementarity.
    """
    soft = len(lines) - hard
    gaps = [
        ca.dot(normal, velocity) - bound + (slack if row < soft else 0.0)
        for row, (normal, bound) in enumerate(lines)
    ]
    gaps += [0.5 * (fastest * fastest - ca.dot(velocity, velocity)), slack]
    *each, limit, last = multipliers
    pairs = zip(each, lines, strict=True)
    force = sum((one * normal for one, (normal, _) in pairs), ca.SX(2, 1))
    return [
        velocity - wanted - force + limit * velocity,
        SLACK_WEIGHT * slack - sum(each[:soft], ca.SX(0)) - last,
        *[
            one + gap - ca.sqrt(one * one + gap * gap + 2.0 * relaxation)
            for one, gap in zip(multipliers, gaps, strict=True)
        ],
    ]


def on_the_central_path(
    normals: Array, bounds: Array, hard: int, wanted: Array, fastest: float, relaxation: float
) -> tuple[Array, Array, Array]:
    """Solve the relaxed programme of each of N people by Newton's method on its barrier.

    Parameters
    ----------
    normals, bounds : (N, L, 2) and (N, L), m/s, of the half-planes n . v >= b.
    hard : the last so many are those of walls; standing still keeps them.
    wanted, fastest, relaxation : (N, 2), m/s; m/s; rho, see `conditions`.

    Returns
    -------
    velocities : (N, 2), m/s.
    slacks : (N,), m/s.
    multipliers : (N, L + 2).
    """
    count, rows = bounds.shape
    entry = np.zeros((count, rows + 1, 3))
    entry[:, :rows, :2], entry[:, : rows - hard, 2], entry[:, rows, 2] = normals, 1.0, 1.0
    bound = np.concatenate([bounds, np.zeros((count, 1))], axis=1)
    aim = np.concatenate([wanted, np.zeros((count, 1))], axis=1)
    task = _Barrier(entry, bound, aim, fastest)
    point = np.zeros((count, 3))
    point[:, 2] = 0.1 + bounds[:, : rows - hard].max(axis=1, initial=0.0)
    barrier = 1.0
    while barrier > relaxation:
        point = task.least(point, barrier)
        barrier = max(0.1 * barrier, relaxation)
    point = task.least(point, barrier)
    multipliers = relaxation / task.gaps(point)
    order = [*range(rows), rows + 1, rows]
    return point[:, :2], point[:, 2], multipliers[:, order]


@dataclass(frozen=True, eq=False)
class _Barrier:
    """The programmes of N people, with a logarithmic barrier in place of R constraints.

    Attributes
    ----------
    entry, bound : (N, R - 1, 3) and (N, R - 1), of all but that on the speed: entry . z >= bound.
    aim : (N, 3), wanted velocity and slack.
    fastest : m/s.
    """

    entry: Array
    bound: Array
    aim: Array
    fastest: float

    def gaps(self, points: Array) -> Array:
        """Return how far within each constraint the points (N, 3) are, (N, R)."""
        straight = (self.entry @ points[:, :, None])[..., 0] - self.bound
        speed = 0.5 * (self.fastest**2 - (points[:, :2] ** 2).sum(axis=1))
        return np.concatenate([straight, speed[:, None]], axis=1)

    def value(self, points: Array, barrier: float) -> Array:
        """Return the cost with the barrier, (N,); infinite outside."""
        gaps = self.gaps(points)
        logs = np.log(np.where(gaps > 0.0, gaps, 1.0)).sum(axis=1)
        cost = 0.5 * (_weight() * (points - self.aim) ** 2).sum(axis=1) - barrier * logs
        return np.where((gaps > 0.0).all(axis=1), cost, np.inf)

    def least(self, points: Array, barrier: float) -> Array:
        """Go from points within all constraints to those of least cost, by Newton's method."""
        for _ in range(MOST_STEPS):
            gaps = self.gaps(points)
            slopes = np.concatenate([self.entry, np.zeros((len(points), 1, 3))], axis=1)
            slopes[:, -1, :2] = -points[:, :2]
            log = slopes / gaps[..., None]
            gradient = _weight() * (points - self.aim) - barrier * log.sum(axis=1)
            curve = barrier * np.swapaxes(log, 1, 2) @ log + np.diag(_weight())
            curve[:, [0, 1], [0, 1]] += (barrier / gaps[:, -1])[:, None]
            move = -np.linalg.solve(curve, gradient[..., None])[..., 0]
            fall = (gradient * move).sum(axis=1)
            share = self._length(points, move, fall, barrier)
            if not share[fall <= -ENOUGH].any():
                break
            points = points + share[:, None] * move
        return points

    def _length(self, points: Array, move: Array, fall: Array, barrier: float) -> Array:
        """Return how much of each move to make, (N,): halved until the cost falls; or none."""
        size, here = np.ones(len(points)), self.value(points, barrier)
        far = np.ones(len(points), dtype=bool)
        for _ in range(HALVINGS):
            ahead = self.value(points + size[:, None] * move, barrier)
            far = ~(ahead <= here + 0.1 * size * fall)
            if not far.any():
                return size
            size = np.where(far, 0.5 * size, size)
        return np.where(far, 0.0, size)


def _weight() -> Array:
    return np.array([1.0, 1.0, SLACK_WEIGHT])

"""Residuals of the timed elastic band and their minimisation, written for Numba.

Numba compiles these functions, see `compiled`; called as they are they compute the same, only
slowly. The band is one vector

    z = (x_0, y_0, yaw_0, dt_0, x_1, y_1, yaw_1, dt_1, ..., x_n, y_n, yaw_n),

so that each edge reads entries that stand side by side, and the normal equations have a band of
`HALF` entries beside the diagonal. The first and the last pose are fixed.
"""

from collections.abc import Callable
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from wideberth.framework.plugins.njit import cached_njit
from wideberth.framework.values.arrays import Array

(
    OBSTACLE, INFLATED, DYNAMIC, VELOCITY, ACCELERATION_START, ACCELERATION, ACCELERATION_GOAL,
    TIME, SHORTEST, KINEMATICS, TURN,
) = range(11)  # fmt: skip
"""Kinds of edges."""
WIDTH = (3, 3, 3, 7, 7, 11, 7, 1, 7, 7, 7)
"""Entries of the band that an edge of each kind reads."""
ROWS = (1, 2, 2, 2, 2, 2, 2, 1, 1, 2, 1)
"""Errors of an edge of each kind."""
HALF = 10
"""Entries beside the diagonal: an acceleration reads eleven."""
STEP = 1e-9
"""Of the central differences, as in g2o."""
TRIALS = 10
"""Steps that one iteration tries at most."""


class Edges(NamedTuple):
    """Edges of one band, ready for the solver.

    Attributes
    ----------
    kind : (E,), one of the constants.
    begin : (E,), first entry of the band's vector that an edge reads.
    data : (E, 5), see `errors_of`.
    weight : (E, 2), of the squared errors.
    """

    kind: NDArray[np.int64]
    begin: NDArray[np.int64]
    data: Array
    weight: Array


def wrapped(angle: float) -> float:
    """Return an angle in [-pi, pi), rad."""
    if -np.pi <= angle < np.pi:
        return angle
    rest: float = angle - 2.0 * np.pi * np.floor(angle / (2.0 * np.pi))
    if rest >= np.pi:
        rest -= 2.0 * np.pi
    if rest < -np.pi:
        rest += 2.0 * np.pi
    return rest


def within(value: float, low: float, high: float, margin: float) -> float:
    """Return by how much a value is outside an interval that is narrowed by a margin."""
    if value < low + margin:
        return low + margin - value
    if value <= high - margin:
        return 0.0
    return value - (high - margin)


def below(value: float, least: float, margin: float) -> float:
    """Return by how much a value is less than the least one with a margin."""
    return max(0.0, least + margin - value)


def speed_of(z: Array, o: int) -> tuple[float, float]:
    """Return the signed speed and the yaw rate between the poses at ``o`` and ``o + 4``.

    v = |dp| / dt  s(100 dp . e)    s(a) = a / (1 + |a|)    e: heading of the first pose
    """
    dx, dy = z[o + 4] - z[o], z[o + 5] - z[o + 1]
    ahead = 100.0 * (dx * np.cos(z[o + 2]) + dy * np.sin(z[o + 2]))
    v = np.sqrt(dx * dx + dy * dy) / z[o + 3] * (ahead / (1.0 + abs(ahead)))
    return v, wrapped(z[o + 6] - z[o + 2]) / z[o + 3]


def errors_of(kind: int, z: Array, o: int, data: Array, limits: Array, e: Array) -> None:
    """Compute the errors of one edge into ``e``.

    Parameters
    ----------
    kind : see the constants.
    z, o : the band, and where the edge's entries begin.
    data : (5,), of this edge: an obstacle's x, y, its radius and the robot's together, the least
        distance and the one of inflation; or the speed and yaw rate at an end; or the sense of
        rotation.
    limits : speed backwards and forwards, yaw rate, acceleration, yaw acceleration, margin.
    e : (2,), written.
    """
    margin = limits[5]
    e[1] = 0.0
    if kind <= DYNAMIC:
        dx, dy = z[o] - data[0], z[o + 1] - data[1]
        d = np.sqrt(dx * dx + dy * dy) - data[2]
        e[0] = below(d, data[3], margin)
        e[1] = below(d, data[4], 0.0)
    elif kind == TIME:
        e[0] = z[o]
    elif kind == VELOCITY:
        v, w = speed_of(z, o)
        e[0] = within(v, -limits[0], limits[1], margin)
        e[1] = within(w, -limits[2], limits[2], margin)
    elif kind <= ACCELERATION_GOAL:
        v, w = speed_of(z, o)
        if kind == ACCELERATION:
            v_next, w_next = speed_of(z, o + 4)
            per = 2.0 / (z[o + 3] + z[o + 7])
            a, b = (v_next - v) * per, (w_next - w) * per
        else:
            sign = 1.0 if kind == ACCELERATION_START else -1.0
            a, b = sign * (v - data[0]) / z[o + 3], sign * (w - data[1]) / z[o + 3]
        e[0] = within(a, -limits[3], limits[3], margin)
        e[1] = within(b, -limits[4], limits[4], margin)
    else:
        dx, dy = z[o + 4] - z[o], z[o + 5] - z[o + 1]
        if kind == SHORTEST:
            e[0] = np.sqrt(dx * dx + dy * dy)
        elif kind == TURN:
            e[0] = below(data[0] * wrapped(z[o + 6] - z[o + 2]), 0.0, 0.0)
        else:
            c, s = np.cos(z[o + 2]), np.sin(z[o + 2])
            e[0] = abs((c + np.cos(z[o + 6])) * dy - (s + np.sin(z[o + 6])) * dx)
            e[1] = below(dx * c + dy * s, 0.0, 0.0)


def all_errors(edges: Edges, z: Array, limits: Array, found: Array) -> float:
    """Compute the errors of all edges into ``found``, (E, 2), and return the sum of w e^2."""
    total = 0.0
    for i in range(len(edges.kind)):
        errors_of(edges.kind[i], z, edges.begin[i], edges.data[i], limits, found[i])
        w, e = edges.weight[i], found[i]
        total += w[0] * e[0] * e[0] + w[1] * e[1] * e[1]
    return total


def slopes_of(
    kind: int, z: Array, o: int, data: Array, limits: Array, free: tuple[int, int], slope: Array
) -> bool:
    """Compute the derivatives of an edge's errors, (2, 11); return whether any is not zero.

    Those of obstacles and of the kinematics are exact (and 0 or one-sided at a kink), the others
    central differences, as in the original.
    """
    slope[:] = 0.0
    if kind <= DYNAMIC:
        return slopes_near(z, o, data, limits[5], slope)
    if kind == KINEMATICS:
        slopes_of_kinematics(z, o, slope)
        return True
    ahead, back = np.empty(2), np.empty(2)
    for k in range(WIDTH[kind]):
        if not free[0] <= o + k < free[1]:
            continue
        kept = z[o + k]
        z[o + k] = kept + STEP
        errors_of(kind, z, o, data, limits, ahead)
        z[o + k] = kept - STEP
        errors_of(kind, z, o, data, limits, back)
        z[o + k] = kept
        slope[0, k] = (ahead[0] - back[0]) * (0.5 / STEP)
        slope[1, k] = (ahead[1] - back[1]) * (0.5 / STEP)
    return True


def slopes_near(z: Array, o: int, data: Array, margin: float, slope: Array) -> bool:
    """Compute the derivatives of an obstacle's edge; return whether any is not zero."""
    dx, dy = z[o] - data[0], z[o + 1] - data[1]
    apart = np.sqrt(dx * dx + dy * dy)
    d = apart - data[2]
    near, nearly = d < data[3] + margin, d < data[4]
    if apart == 0.0 or not (near or nearly):
        return False
    if near:
        slope[0, 0], slope[0, 1] = -dx / apart, -dy / apart
    if nearly:
        slope[1, 0], slope[1, 1] = -dx / apart, -dy / apart
    return True


def slopes_of_kinematics(z: Array, o: int, slope: Array) -> None:
    """Compute the derivatives of |c| and of max(0, -dp . e), with the first heading e.

    c = (cos yaw_0 + cos yaw_1) dy - (sin yaw_0 + sin yaw_1) dx
    """
    dx, dy = z[o + 4] - z[o], z[o + 5] - z[o + 1]
    c0, s0, c1, s1 = np.cos(z[o + 2]), np.sin(z[o + 2]), np.cos(z[o + 6]), np.sin(z[o + 6])
    sign = np.sign((c0 + c1) * dy - (s0 + s1) * dx)
    slope[0, 4], slope[0, 5] = -(s0 + s1) * sign, (c0 + c1) * sign
    slope[0, 0], slope[0, 1] = -slope[0, 4], -slope[0, 5]
    slope[0, 2] = -(s0 * dy + c0 * dx) * sign
    slope[0, 6] = -(s1 * dy + c1 * dx) * sign
    if dx * c0 + dy * s0 < 0.0:
        slope[1, 0], slope[1, 1], slope[1, 2] = c0, s0, s0 * dx - c0 * dy
        slope[1, 4], slope[1, 5] = -c0, -s0


def normal_equations(
    edges: Edges, z: Array, limits: Array, found: Array, matrix: Array, vector: Array
) -> None:
    """Add up J'WJ into ``matrix`` (N, HALF + 1), its upper band, and -J'We into ``vector``."""
    matrix[:] = 0.0
    vector[:] = 0.0
    free = (3, len(z) - 3)
    slope = np.empty((2, HALF + 1))
    for i in range(len(edges.kind)):
        o, kind = edges.begin[i], edges.kind[i]
        if not slopes_of(kind, z, o, edges.data[i], limits, free, slope):
            continue
        first, last = max(o, free[0]), min(o + WIDTH[kind], free[1])
        for r in range(ROWS[kind]):
            w, error = edges.weight[i, r], found[i, r]
            for k in range(first, last):
                part = w * slope[r, k - o]
                if part == 0.0:
                    continue
                vector[k - 3] -= part * error
                for m in range(k, last):
                    matrix[k - 3, m - k] += part * slope[r, m - o]


def solved(matrix: Array, damping: float, vector: Array, factor: Array, x: Array) -> bool:
    """Solve (H + damping I) x = b by Cholesky within the band; False where H is not definite."""
    size = len(vector)
    for j in range(size):
        first = max(0, j - HALF)
        for k in range(min(HALF + 1, size - j)):
            value = matrix[j, k] + (damping if k == 0 else 0.0)
            for m in range(max(first, j + k - HALF), j):
                value -= factor[m, j - m] * factor[m, j + k - m]
            if k > 0:
                factor[j, k] = value / factor[j, 0]
            elif value > 0.0:
                factor[j, 0] = np.sqrt(value)
            else:
                return False
    for j in range(size):
        value = vector[j]
        for m in range(max(0, j - HALF), j):
            value -= factor[m, j - m] * x[m]
        x[j] = value / factor[j, 0]
    for j in range(size - 1, -1, -1):
        value = x[j]
        for k in range(1, min(HALF + 1, size - j)):
            value -= factor[j, k] * x[j + k]
        x[j] = value / factor[j, 0]
    return True


def minimise(edges: Edges, limits: Array, z: Array, iterations: int) -> tuple[float, int]:
    """Lower the sum of w e^2 by Levenberg and Marquardt's method; ``z`` is changed.

    The damping begins at 1e-5 of the largest diagonal entry. A step that gains is kept, and the
    damping shrinks by max(1/3, min(2/3, 1 - (2 rho - 1)^3)), where rho is the gain over the one
    that the quadratic model foretells; else it grows by 2, 4, 8 ... and the step is undone.

    Returns
    -------
    cost : the sum at the end.
    done : iterations that were made.
    """
    size = len(z) - 6
    found = np.zeros((len(edges.kind), 2))
    matrix, factor = np.zeros((size, HALF + 1)), np.zeros((size, HALF + 1))
    vector, x, kept = np.zeros(size), np.zeros(size), z.copy()
    damping, growth = 0.0, 2.0
    cost = all_errors(edges, z, limits, found)
    for done in range(iterations):
        normal_equations(edges, z, limits, found, matrix, vector)
        if done == 0:
            damping, growth = 1e-5 * np.max(np.abs(matrix[:, 0])), 2.0
        rho, trials, trial = -1.0, 0, cost
        while rho < 0.0 and trials < TRIALS:
            trials += 1
            rho = -1.0
            if solved(matrix, damping, vector, factor, x):
                moved(z, kept, x)
                trial = all_errors(edges, z, limits, found)
                if np.isfinite(trial):
                    rho = (cost - trial) / (np.sum(x * (damping * x + vector)) + 1e-3)
            if rho > 0.0:
                damping *= max(1.0 / 3.0, min(2.0 / 3.0, 1.0 - (2.0 * rho - 1.0) ** 3))
                growth, cost = 2.0, trial
                kept[:] = z
            else:
                damping *= growth
                growth *= 2.0
                z[:] = kept
                if not np.isfinite(damping):
                    break
        if rho <= 0.0:
            return cost, done + 1
    return cost, iterations


def moved(z: Array, kept: Array, x: Array) -> None:
    """Write the band that is ``x`` away from the kept one into ``z``."""
    for k in range(len(x)):
        z[k + 3] = kept[k + 3] + x[k]
        if (k + 3) % 4 == 2:
            z[k + 3] = wrapped(z[k + 3])


@cache
def compiled() -> tuple[Callable[..., Any], ...]:
    """Return `all_errors` and `minimise` as Numba compiles them."""
    inner = (
        wrapped, within, below, speed_of, errors_of, slopes_near, slopes_of_kinematics, slopes_of,
        normal_equations, solved, moved, all_errors,
    )  # fmt: skip
    return cached_njit((all_errors, minimise), inner)

"""A critic of MPPI that knows where people will be, fed by our forecasts."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import Any, final

import numpy as np

from ...framework.jit.cached_njit import cached_njit
from ...framework.values.arrays import Array
from ...framework.values.forecast import LIGHT
from ..parameters import Count, NonNegative, Positive
from .mppi_critics import MppiCritic
from .mppi_rollouts import MppiTick, Rollouts, Single

NODES, PLACES = 32, 24
"""Nodes of the integrals, and places per axis of a table."""
REACH = 3.5
"""Deviations beyond which a person is not expected."""


@final
@dataclass(frozen=True)
class ExpectedPeopleCritic(MppiCritic):
    """Adds up how long the robot is expected to overlap with people, as they are forecast.

    With the Gaussian forecast N(mu_o, Sigma_o) of each person at the time of a point x_t of the
    trajectory, and both radii together R_o, the cost is

        weight sum_t sum_o Pr(|x_t - X_o| < R_o) dt,    X_o ~ N(mu_o, Sigma_o)

    that is the expected number of seconds in contact with people; of a mixture the modes are
    weighted. Nav2 has no such critic: its own see people where they are now, as lethal cells.
    People come with the tick, see `ExpectedPeople`; without any the critic
    does not apply. Probabilities are interpolated, see `risks`: where deviations are at least a
    fifth of R_o they are off by at most 0.01, at a tenth by 0.02.

    With the weight of 10, which is ours, a robot lets a person pass who would walk into it.

    Attributes
    ----------
    least_deviation : m, of a person in every direction; smaller ones count as this.
    trajectory_point_step : every so many points of a trajectory are looked at.

    Raises
    ------
    WideberthError : a number out of range.

    Examples
    --------
    >>> from wideberth.nav2.controllers.mppi import MPPI
    >>> MPPI.from_parameters({"critics": ["ExpectedPeopleCritic"]}).critics[0].cost_weight
    10.0
    """

    cost_weight: NonNegative = 10.0
    least_deviation: Positive = 0.05
    trajectory_point_step: Count = 2

    def weighted(self, rollouts: Rollouts, situation: MppiTick) -> Single | None:
        """Price the expected time of overlap with people."""
        every, people = self.trajectory_point_step, situation.tick.people
        if people is None or not len(people.radii):
            return None
        x, y = rollouts.x[::every], rollouts.y[::every]
        steps = situation.dt * (1.0 + every * np.arange(len(x)))
        mean, covariance = people.at(np.asarray(situation.tick.time + steps, np.float64))
        weights = np.where(people.forecast.weight < LIGHT, 0.0, people.forecast.weight)
        radius = situation.tick.footprint.circumscribed
        deviations, turns = ellipses_of(covariance, self.least_deviation)
        sizes = np.broadcast_to((people.radii + radius)[:, None, None], deviations.shape[:-1])
        scales = (PLACES - 1.0) / (sizes[..., None] + REACH * deviations)
        tables = overlap_tables(deviations, sizes).astype(np.float32)
        risk = compiled()(x, y, mean, turns, scales, weights, tables)
        total = risk.sum(axis=0) * (self.cost_weight * situation.dt * every)
        return np.asarray(total, np.float32)


def ellipses_of(covariance: Array, least: float) -> tuple[Array, Array]:
    """Return the deviations of covariances along their axes, and where these point.

    Parameters
    ----------
    covariance : (..., 2, 2), m^2.
    least : m, which smaller deviations are raised to.

    Returns
    -------
    deviations : (..., 2), m, the smaller one first.
    turns : (..., 2), unit vector along the axis of the smaller deviation.
    """
    a, b, c = covariance[..., 0, 0], covariance[..., 0, 1], covariance[..., 1, 1]
    middle, apart = 0.5 * (a + c), np.hypot(0.5 * (a - c), b)
    angle = 0.5 * np.arctan2(2.0 * b, a - c) + 0.5 * np.pi
    squares = np.maximum(np.stack([middle - apart, middle + apart], axis=-1), least**2)
    return np.sqrt(squares), np.stack([np.cos(angle), np.sin(angle)], axis=-1)


def overlap_tables(deviations: Array, radii: Array) -> Array:
    """Return probabilities that a Gaussian point is within a disc, by the disc's place.

    With the deviations s_1 <= s_2 along the axes and the centre at (d_1, d_2) from the mean

        int_{-R}^R phi((u - d_1) / s_1) / s_1
            (Phi((w - d_2) / s_2) - Phi((-w - d_2) / s_2)) du,    w^2 = R^2 - u^2

    by Gauss and Legendre's rule, whose nodes are the same for all places: the integrals of a table
    are one product of two matrices. `wideberth.framework.risk.collision_probability` is exact for
    any numbers, and far slower.

    Parameters
    ----------
    deviations : (..., 2), m.
    radii : (...), m, R.

    Returns
    -------
    tables : (..., PLACES, PLACES), for d_1 and d_2 from 0 to R + REACH s.
    """
    from scipy.special import ndtr

    nodes, weights = np.polynomial.legendre.leggauss(NODES)
    size = radii[..., None]
    u = size * nodes
    w = np.sqrt(size**2 - u**2)
    share = np.linspace(0.0, 1.0, PLACES)
    narrow, wide = deviations[..., 0, None], deviations[..., 1, None]
    first = ((size + REACH * narrow) * share / narrow)[..., :, None]
    second = ((size + REACH * wide) * share / wide)[..., None, :]
    density = np.exp(-0.5 * ((u / narrow)[..., None, :] - first) ** 2)
    density *= (size * weights / narrow / np.sqrt(2.0 * np.pi))[..., None, :]
    half = (w / wide)[..., :, None]
    return np.asarray(density @ (ndtr(half - second) - ndtr(-half - second)))


def risks(
    x: Single, y: Single, mean: Array, turns: Array, scales: Array, weights: Array, tables: Single
) -> Single:
    """Return the expected number of people that each position overlaps with, (T, B).

    Probabilities are interpolated between the places of the tables.

    Parameters
    ----------
    x, y : (T, B), m.
    mean, turns : (O, M, T, 2), see `ellipses_of`.
    scales : (O, M, T, 2), places of the tables per m.
    weights : (O, M), of the modes.
    tables : (O, M, T, PLACES, PLACES).
    """
    found = np.zeros(x.shape, np.float32)
    people, modes = weights.shape
    last = tables.shape[-1] - 1
    for o in range(people):
        for m in range(modes):
            for t in range(x.shape[0] if weights[o, m] > 0.0 else 0):
                px, py = np.float32(mean[o, m, t, 0]), np.float32(mean[o, m, t, 1])
                ax, ay = np.float32(turns[o, m, t, 0]), np.float32(turns[o, m, t, 1])
                one, two = np.float32(scales[o, m, t, 0]), np.float32(scales[o, m, t, 1])
                weight, table = np.float32(weights[o, m]), tables[o, m, t]
                for k in range(x.shape[1]):
                    dx, dy = x[t, k] - px, y[t, k] - py
                    p, q = abs(ax * dx + ay * dy) * one, abs(ax * dy - ay * dx) * two
                    if p < last and q < last:
                        i, j = int(p), int(q)
                        p, q = p - np.float32(i), q - np.float32(j)
                        near = table[i, j] + q * (table[i, j + 1] - table[i, j])
                        next_ = table[i + 1, j] + q * (table[i + 1, j + 1] - table[i + 1, j])
                        found[t, k] += weight * (near + p * (next_ - near))
    return found


@cache
def compiled() -> Callable[..., Any]:
    """Return `risks` as Numba compiles it."""
    return cached_njit([risks])[0]

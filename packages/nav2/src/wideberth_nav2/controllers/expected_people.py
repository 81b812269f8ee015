"""A critic of MPPI that knows where people will be, fed by our forecasts."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import Any, final

import numpy as np

from wideberth.framework.plugins.njit import cached_njit
from wideberth.framework.values.arrays import Array
from wideberth.framework.values.forecast import LIGHT

from ..overlap_tables import (
    bilinear,
    ellipses_of,
    overlap_tables,
    scales_of,
)
from ..parameters import Count, NonNegative, Positive
from .mppi_critics import MppiCritic
from .mppi_rollouts import MppiTick, Rollouts, Single


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
    >>> from wideberth_nav2.controllers.mppi import MPPI
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
        scales = scales_of(deviations, sizes)
        tables = overlap_tables(deviations, sizes).astype(np.float32)
        risk = compiled()(x, y, mean, turns, scales, weights, tables)
        total = risk.sum(axis=0) * (self.cost_weight * situation.dt * every)
        return np.asarray(total, np.float32)


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
                        found[t, k] += weight * bilinear(table, p, q)
    return found


@cache
def compiled() -> Callable[..., Any]:
    """Return `risks` as Numba compiles it."""
    return cached_njit([risks], inner=[bilinear])[0]

"""Cells that people may cover within a horizon, by the forecast of their places."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from math import ceil, floor, sqrt
from typing import Any, Literal, TypeAlias, final

import numpy as np

from wideberth.framework.numerics.chi_square import content_bound
from wideberth.framework.plugins.njit import cached_njit
from wideberth.framework.values.arrays import Array, checked_choice, positive, probability
from wideberth.framework.values.forecast import LIGHT, Forecast
from wideberth.framework.values.occupancy_grid import OCCUPIED_CELL, CellGrid, OccupancyGrid

from .overlap_tables import PLACES, bilinear, ellipses_of, overlap_tables, scales_of

Shown: TypeAlias = Literal["region", "probability"]
LEAST = 1e-3
"""m, of a deviation in every direction; smaller ones count as this."""
CLOSE = 1e-9
"""Relative distance to an ellipse's boundary that is none."""


@final
@dataclass(frozen=True)
class ForecastCells:
    """Cells of a grid that people may cover between now and the end of a horizon.

    A "region" shows 100 in every cell whose centre is, at one of the instants k dt up to the
    horizon, in the union over all people and modes of

        E_k + B,   E_k = {x : (x - mu_k)^T Sigma_k^-1 (x - mu_k) <= q},   B the disc of r + margin,

    where q is the bound that a share ``tail`` of the places exceeds; 0 elsewhere. A "probability"
    shows in percent

        1 - prod_o (1 - sum_m w_m max_k Pr(|c - X_omk| < r_o + margin)),

    at most the probability that someone covers the cell's centre c at one of the instants, if
    people walk independently of each other. Modes of less weight than `LIGHT` are left out.

    Parameters
    ----------
    horizon : s. step : s between two instants.
    tail : of the places, which a region leaves out.
    margin : m, added to the radius of each person.
    shows : "region" or "probability".

    Raises
    ------
    WideberthError : a number out of range, another word.

    Examples
    --------
    >>> still = Forecast.single(np.zeros((1, 1, 2)), 1e-6 * np.eye(2)[None, None], 0.2)
    >>> here = OccupancyGrid(np.zeros((3, 5)), 0.2, (-0.5, -0.3))
    >>> ForecastCells().on(here, still, np.array([0.3])).cells.tolist()
    [[0, 100, 100, 100, 0], [0, 100, 100, 100, 0], [0, 100, 100, 100, 0]]
    """

    horizon: float = 2.0
    step: float = 0.2
    tail: float = 0.05
    margin: float = 0.0
    shows: Shown = "region"

    def __post_init__(self) -> None:
        for name in ("horizon", "step"):
            positive(f"cells.{name}", getattr(self, name))
        probability("cells.tail", self.tail)
        positive("cells.margin", self.margin, zero=True)
        checked_choice("cells.shows", self.shows, Shown)

    @property
    def times(self) -> Array:
        """Instants at which people are looked at, s from now on, beginning with 0."""
        return self.step * np.arange(ceil(self.horizon / self.step - 1e-9) + 1, dtype=np.float64)

    def on(self, grid: CellGrid, forecast: Forecast, radii: Array) -> OccupancyGrid:
        """Return where people may be, on the cells of a grid.

        Parameters
        ----------
        grid : whose place, size and resolution are taken.
        forecast : of O people in the plane, at `times`.
        radii : (O,), m, of the people.
        """
        weight = np.where(forecast.weight < LIGHT, 0.0, forecast.weight)
        deviations, turns = ellipses_of(forecast.covariance, LEAST)
        sizes = np.broadcast_to((radii + self.margin)[:, None, None], deviations.shape[:-1])
        place = (*grid.origin, grid.resolution)
        if self.shows == "probability":
            tables = overlap_tables(deviations, sizes).astype(np.float32)
            scales = scales_of(deviations, sizes)
            free = np.ones((grid.height, grid.width))
            compiled()[1](free, *place, forecast.mean, turns, scales, weight, tables)
            percent = np.rint(OCCUPIED_CELL * (1.0 - free)).astype(np.int8)
            return OccupancyGrid(percent, grid.resolution, grid.origin)
        axes = sqrt(content_bound(2, self.tail)) * deviations
        kept = weight > 0.0
        shown = [value[kept].reshape(-1, 2) for value in (forecast.mean, turns, axes)]
        covered = np.zeros((grid.height, grid.width), np.int8)
        compiled()[0](covered, *place, *shown, sizes[kept].ravel(), OCCUPIED_CELL)
        return OccupancyGrid(covered, grid.resolution, grid.origin)


def cover(
    cells: Any, x: float, y: float, side: float,
    mean: Array, turns: Array, axes: Array, radii: Array, mark: int,
) -> None:  # fmt: skip
    """Mark the cells whose centres are within a distance of ellipses, in place.

    Parameters
    ----------
    cells : (height, width), whose corner is at x, y, m, and whose sides are ``side`` m.
    mean, turns, axes : (G, 2), m, see `ellipses_of`. radii : (G,), m. mark : of a cell.
    """
    height, width = cells.shape
    for g in range(len(mean)):
        a, b, r, u, v = axes[g, 0], axes[g, 1], radii[g], turns[g, 0], turns[g, 1]
        wide, high = sqrt((a * u) ** 2 + (b * v) ** 2) + r, sqrt((a * v) ** 2 + (b * u) ** 2) + r
        left, low = (mean[g, 0] - x) / side - 0.5, (mean[g, 1] - y) / side - 0.5
        columns = range(
            max(ceil(left - wide / side), 0), min(floor(left + wide / side) + 1, width)
        )
        for j in range(max(ceil(low - high / side), 0), min(floor(low + high / side) + 1, height)):
            dy = (j - low) * side
            for i in columns:
                if cells[j, i] != mark:
                    dx = (i - left) * side
                    if near_ellipse(abs(u * dx + v * dy), abs(u * dy - v * dx), a, b, r):
                        cells[j, i] = mark


def near_ellipse(p: float, q: float, a: float, b: float, r: float) -> bool:
    """Whether a point (p, q) >= 0 is at most r from the ellipse with semi-axes a <= b, or in it.

    The nearest point is (a^2 p / (t + a^2), b^2 q / (t + b^2)) for the root t of

        F(t) = (a p / (t + a^2))^2 + (b q / (t + b^2))^2 - 1,

    which falls and is convex: Newton's iteration from the left stays there, where the distance to
    the point that belongs to t is at most the one that is sought. `wideberth.framework.numerics`
    has the same for arrays, to all digits.
    """
    if p > a + r or q > b + r:
        return False
    if (p / (a + r)) ** 2 + (q / (b + r)) ** 2 <= 1.0:  # within the sum
        return True
    t = max(a * (p - a), b * (q - b), 0.0)
    for _ in range(100):
        m, n = p / (t + a * a), q / (t + b * b)
        if t * t * (m * m + n * n) > r * r:
            return False
        off = (a * m) ** 2 + (b * n) ** 2 - 1.0
        if off <= CLOSE:
            break
        t += 0.5 * off / ((a * m) ** 2 / (t + a * a) + (b * n) ** 2 / (t + b * b))
    return True


def thin_out(
    free: Array, x: float, y: float, side: float,
    mean: Array, turns: Array, scales: Array, weight: Array, tables: Any,
) -> None:  # fmt: skip
    """Multiply the probability that a cell is free by that of each person not to be there.

    Parameters
    ----------
    free : (height, width), is changed; its place as in `cover`.
    mean, turns, scales : (O, M, K, 2), see `scales_of`. weight : (O, M).
    tables : (O, M, K, PLACES, PLACES), see `overlap_tables`.
    """
    height, width = free.shape
    last = np.float32(PLACES - 1)
    for o in range(len(mean)):
        there = np.zeros(free.shape)
        for m in range(mean.shape[1]):
            if weight[o, m] == 0.0:
                continue
            most = np.zeros(free.shape, np.float32)
            for k in range(mean.shape[2]):
                u, v = turns[o, m, k, 0], turns[o, m, k, 1]
                one, two = scales[o, m, k, 0], scales[o, m, k, 1]
                wide = (abs(u) / one + abs(v) / two) * (PLACES - 1) / side
                high = (abs(v) / one + abs(u) / two) * (PLACES - 1) / side
                left, low = (
                    (mean[o, m, k, 0] - x) / side - 0.5,
                    (mean[o, m, k, 1] - y) / side - 0.5,
                )
                columns = range(max(ceil(left - wide), 0), min(floor(left + wide) + 1, width))
                for j in range(max(ceil(low - high), 0), min(floor(low + high) + 1, height)):
                    dy = (j - low) * side
                    for i in columns:
                        dx = (i - left) * side
                        p = np.float32(abs(u * dx + v * dy) * one)
                        q = np.float32(abs(u * dy - v * dx) * two)
                        if p < last and q < last:
                            most[j, i] = max(most[j, i], bilinear(tables[o, m, k], p, q))
            there += weight[o, m] * most
        free *= 1.0 - np.minimum(there, 1.0)


@cache
def compiled() -> tuple[Callable[..., Any], ...]:
    """Return `cover` and `thin_out` as Numba compiles them."""
    return cached_njit([cover, thin_out], inner=[near_ellipse, bilinear])

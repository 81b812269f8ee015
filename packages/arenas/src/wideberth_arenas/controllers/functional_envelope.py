"""The functional conformal envelope: how far predicted distances may exceed the true ones."""

import math
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np
from numpy.random import RandomState
from numpy.typing import NDArray

from wideberth.framework.calibration import ROUNDING, fewest_ranks, rank_quantile
from wideberth.framework.values.arrays import (
    Array,
    BoolArray,
    checked,
    positive,
    probability,
    whole,
)
from wideberth.framework.values.coverage import Coverage, Event
from wideberth.framework.values.errors import WideberthError

from .gaussian_mixture import GaussianMixture, fitted_mixture

OUTSIDE = 1.0
"""m, of the envelope outside of its grid, as published; nothing is promised there."""


@dataclass(frozen=True)
class FieldGrid:
    """A square of cells over which distance fields are known.

    Attributes
    ----------
    centre : (x, y), m.
    width : m, from the first cell's middle to the last one's.
    cells : along each side.

    Raises
    ------
    WideberthError : a width that is not above 0, or fewer than 2 cells.
    """

    centre: tuple[float, float]
    width: float
    cells: int = 128

    def __post_init__(self) -> None:
        positive("grid.width", self.width)
        whole("grid.cells", self.cells, least=2)

    @classmethod
    def around(cls, points: Array, margin: float = 2.0, cells: int = 128) -> "FieldGrid":
        """Return the grid of the square that holds points (n, 2) and a margin, m."""
        low, high = points.min(axis=0) - margin, points.max(axis=0) + margin
        middle = 0.5 * (low + high)
        return cls((float(middle[0]), float(middle[1])), float((high - low).max()), cells)

    def sides(self) -> tuple[Array, Array]:
        """Return x of the columns and y of the rows, (cells,) each, m."""
        side = np.linspace(-0.5, 0.5, self.cells) * self.width
        return side + self.centre[0], side + self.centre[1]

    def points(self) -> Array:
        """Middles of the cells, (cells^2, 2), m, row by row."""
        x, y = np.meshgrid(*self.sides())
        return np.stack([x.ravel(), y.ravel()], axis=1)

    def nearest(self, points: Array) -> tuple[NDArray[np.int64], BoolArray]:
        """Return the cell nearest to points (..., 2), m, and whether they are on the grid."""
        place = ((points - np.array(self.centre)) / self.width + 0.5) * (self.cells - 1)
        on_grid = (place >= 0.0) & (place <= self.cells - 1)
        inside: BoolArray = np.asarray(on_grid.all(axis=-1), dtype=np.bool_)
        column, row = np.moveaxis(np.rint(np.where(inside[..., None], place, 0.0)), -1, 0)
        return np.asarray(row * self.cells + column, dtype=np.int64), inside


@dataclass(frozen=True)
class FunctionalEnvelope:
    """Bounds how far the predicted distance field of each step lies above the true one.

    D_pred,h(x) - D_h(x) <= U_h(x) at all x of a grid: D_h(x) is the distance from x to the nearest
    person at step h, and D_pred,h(x) to the nearest prediction.

    Attributes
    ----------
    grid : of the fields.
    upper : (N, cells^2), m.
    dt : s between the steps.

    Raises
    ------
    WideberthError : no step, or another number of cells than the grid's.
    """

    grid: FieldGrid
    upper: tuple[tuple[float, ...], ...]
    dt: float

    def __post_init__(self) -> None:
        positive("envelope.dt", self.dt)
        checked("envelope.upper", self.upper, (len(self.upper), self.grid.cells**2))
        if not self.upper:
            raise WideberthError("envelope.upper holds no step; wanted one at least")

    @cached_property
    def _upper(self) -> Array:
        return np.array(self.upper)

    def at(self, points: Array, step: int) -> Array:
        """U of a step, 0 for the first, at points (..., 2), m; of the last step beyond it."""
        cell, inside = self.grid.nearest(points)
        known = self._upper[min(step, len(self.upper) - 1), cell]
        return np.asarray(np.where(inside, known, OUTSIDE))


def distance_field(grid: FieldGrid, places: Array) -> Array:
    """Distance from the cells of a grid to the nearest of places (K, 2), (cells^2,), m.

    Places that are NaN do not count; infinite without any.
    """
    places = places[np.isfinite(places).all(axis=1)]
    x, y = grid.sides()
    across, along = (x - places[:, :1]) ** 2, (y - places[:, 1:]) ** 2
    square = (along[:, :, None] + across[:, None, :]).min(axis=0, initial=np.inf)
    return np.asarray(np.sqrt(square).ravel())


@dataclass(frozen=True)
class EnvelopeFit:
    """How a functional envelope is calibrated.

    Of every row's field S_h = D_pred,h - D_h, P principal components are kept. A mixture of K
    Gaussians is fitted to the components' scores of one part of the rows; the other part gives
    the density that only ``tail`` of its rows fall below, and with it an ellipsoid of each
    component k, of radius r_k. The envelope is the largest field of the ellipsoids and a slack
    for what the components leave out,

        U(x) = mean(x) + max_k (mu_k . phi(x) + r_k sqrt(phi(x)^T Sigma_k phi(x))) + eps.

    Promise: at step h, S_h <= U_h at all points with probability 1 - tail, for rows that are
    exchangeable with those of calibration. Nothing is promised for all steps at once.

    Parameters
    ----------
    tail : of one step's field.
    components : P.
    mixture : K.
    held_out : share of the rows to calibrate with.
    seed : of the split and of the mixture's start.
    as_published : as in the published code, which differs from the above: the components are
        fitted to the rows of calibration, too; eps bounds how far the components lie *above* a
        field, while the envelope needs how far below; eps and the density take ``tail`` each,
        which promises 1 - 2 tail; and the quantiles are without the correction for a finite
        number of rows.

    Raises
    ------
    WideberthError : a number out of range.

    References
    ----------
    "From Prediction Uncertainty to Conformalized Distance Fields for Safe Motion Planning",
    arXiv 2607.00776, and its code (github.com/CORE-SNU/FCP-MPC). J. Lei, A. Rinaldo and L.
    Wasserman, A conformal prediction approach to explore functional data, 2015.
    """

    coverage: ClassVar[Coverage] = Coverage(
        Event.FIELD,
        "1 - tail at each step for itself",
        "rows are exchangeable with those of calibration",
        "shin2026prediction",
    )

    tail: float = 0.1
    components: int = 5
    mixture: int = 7
    held_out: float = 0.3
    seed: int = 0
    as_published: bool = False

    def __post_init__(self) -> None:
        probability("envelope.tail", self.tail)
        probability("envelope.held_out", self.held_out)
        for name in ("components", "mixture"):
            whole(f"envelope.{name}", getattr(self, name))

    @property
    def fewest(self) -> int:
        """Fewest rows of which an envelope is known."""
        return math.ceil(fewest_ranks(0.5 * self.tail) / self.held_out - ROUNDING)

    def envelope(
        self, grid: FieldGrid, predicted: Array, actual: Array, dt: float
    ) -> FunctionalEnvelope:
        """Calibrate on what was predicted and where people then were.

        Parameters
        ----------
        grid : of the envelope.
        predicted : (R, N, K, 2), m, of R rows; NaN where there is no one.
        actual : (R, N, J, 2), m, likewise.
        dt : s between the steps.

        Raises
        ------
        WideberthError : too few rows for the tail.
        """
        upper, fields = [], np.zeros((len(predicted), grid.cells**2))
        for step in range(predicted.shape[1]):
            known, found = residual_fields(grid, predicted[:, step], actual[:, step])
            fields[known] = found  # as published, others keep those of the step before
            used = fields if self.as_published else found
            upper.append(tuple(self.upper(used).tolist()))
        return FunctionalEnvelope(grid, tuple(upper), dt)

    def upper(self, fields: Array) -> Array:
        """U, (P,), m, of fields (R, P), m, dealt to two parts by chance.

        Raises
        ------
        WideberthError : too few rows for the tail.
        """
        held, learning = self.parts(len(fields))
        return self.bound(fields[learning], fields[held])

    def parts(self, rows: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Return which rows calibrate, and which components and mixture are fitted to."""
        order = RandomState(self.seed).permutation(rows)
        held = math.ceil(self.held_out * rows)
        return order[:held], order[held:]

    def bound(self, learning: Array, held: Array) -> Array:
        """U, (P,), m, of the fields (R, P), m, of both parts.

        Raises
        ------
        WideberthError : too few rows for the tail.
        """
        known = np.concatenate([learning, held]) if self.as_published else learning
        basis = _Basis.of(known, self.components)
        scores = basis.scores(held)
        left = held - basis.fields(scores)
        slack = (-left if self.as_published else left).max(axis=1, initial=0.0)
        draws = RandomState(self.seed)
        mixture = fitted_mixture(basis.scores(learning), self.mixture, draws)
        likely = mixture.log_densities(scores).max(axis=1)
        if self.as_published:
            level = float(np.quantile(likely, self.tail))
            epsilon = float(np.quantile(slack, 1.0 - self.tail))
        else:
            level = -_exceeded(-likely, 0.5 * self.tail)
            epsilon = _exceeded(slack, 0.5 * self.tail)
        return np.asarray(basis.mean + _support(mixture, level, basis.components) + epsilon)


def _exceeded(scores: Array, tail: float) -> float:
    """Return the score that a further exchangeable one exceeds with probability ``tail`` at most.

    Raises
    ------
    WideberthError : of so few scores no such bound is known.
    """
    bound = rank_quantile(scores, np.arange(len(scores)), tail)
    if math.isinf(bound):
        raise WideberthError(
            f"{len(scores)} rows to calibrate with; wanted at least {fewest_ranks(tail)} for a "
            f"tail of {tail:g}: give longer recordings"
        )
    return bound


def residual_fields(
    grid: FieldGrid, predicted: Array, actual: Array
) -> tuple[NDArray[np.int64], Array]:
    """D_pred - D of those rows of one step in which both are known: their indices, and fields.

    Parameters
    ----------
    grid : of the fields.
    predicted, actual : (R, K, 2) and (R, J, 2), m, NaN where there is no one.
    """
    present = [np.isfinite(places[..., 0]).any(axis=1) for places in (predicted, actual)]
    known = np.flatnonzero(present[0] & present[1])
    fields = [distance_field(grid, predicted[row]) - distance_field(grid, actual[row])
              for row in known]  # fmt: skip
    return known, np.array(fields).reshape(len(known), grid.cells**2)


@dataclass(frozen=True, eq=False)
class _Basis:
    """Mean field (P,) and principal components (C, P), orthonormal."""

    mean: Array
    components: Array

    @classmethod
    def of(cls, fields: Array, components: int) -> "_Basis":
        """Fit to fields (R, P): the eigenvectors of their inner products carry the components."""
        mean = fields.mean(axis=0)
        apart = fields - mean
        value, vector = np.linalg.eigh(apart @ apart.T)
        largest = vector[:, ::-1][:, :components]
        length = np.sqrt(np.maximum(value[::-1][:components], 1e-12))
        return cls(mean, largest.T @ apart / length[:, None])

    def scores(self, fields: Array) -> Array:
        """Scores (R, C) of fields (R, P)."""
        return np.asarray((fields - self.mean) @ self.components.T)

    def fields(self, scores: Array) -> Array:
        """Fields (R, P) of scores (R, C)."""
        return np.asarray(self.mean + scores @ self.components)


def _support(mixture: GaussianMixture, level: float, components: Array) -> Array:
    """Largest value of scores . phi(x) over the ellipsoids of a density level, (P,).

    r_k^2 = 2 (log w_k N(mu_k; mu_k, Sigma_k) - level), and 0 where a component stays below.

    Parameters
    ----------
    level : logarithm of the density.
    components : phi, (C, P).
    """
    radius = np.sqrt(2.0 * np.maximum(mixture.log_peaks() - level, 0.0))
    square = np.einsum("cp,kcd,dp->kp", components, mixture.covariance, components, optimize=True)
    return np.asarray((mixture.mean @ components + radius[:, None] * np.sqrt(square)).max(axis=0))

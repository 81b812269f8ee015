"""A disc of known radius through the visible part of a body, and how far it is off."""

from dataclasses import dataclass
from functools import lru_cache
from math import hypot, sqrt

import numpy as np

from wideberth.framework.values.arrays import Array

STEPS, SETTLED = 12, 1e-7
"""Most steps of Gauss-Newton, and the step, m, below which it has settled."""
RIDGE = 1e-6
"""Added to the normal equations: points in one direction alone leave the other one open."""
SURE = 2.33
"""Standard normal quantile of 0.99: residuals beyond it are no noise of the sensor alone."""
FAINT = 0.002
"""m; smaller residuals do not distinguish the shapes of bodies, however exact the sensor."""


@dataclass(frozen=True, eq=False)
class DiscFit:
    """A disc through points.

    Attributes
    ----------
    centre : (2,), m.
    covariance : (2, 2), m^2, of the centre.
    surprise : -2 ln of the likelihood of the residuals, but for a constant.
    """

    centre: Array
    covariance: Array
    surprise: float


def fit_disc(
    points: Array, origins: Array, radius: float, deviation: float, rough: float = 0.0
) -> DiscFit:
    """Fit the centre c of a disc of radius R to points on the side that faces the sensor.

    min_c  sum_i (|p_i - c| - R)^2

    by Gauss-Newton from the mean point, moved 0.8 R along the line of sight. The error of a
    range acts along its beam u_i: it moves the residual by its part along the normal n_i. So, with
    w the roughness of the body,

    C = H^-1 (sum_i (sigma^2 (u_i . n_i)^2 + w^2) n_i n_i') H^-1,   H = sum_i n_i n_i' + 1e-6 I

    Where the residuals are larger than this explains (at 99 %) the points lie on no such disc,
    say on two bodies that touch. That error is the same at all points, so that the mean square
    of the residuals is added to C on both axes.

    Parameters
    ----------
    points : (n, 2), m.
    origins : (n, 2), m, of their beams.
    radius : R, m.
    deviation : sigma, m, of a range.
    rough : w, m, root mean square by which the body differs from a disc.
    """
    middle = points.mean(axis=0)
    sight = middle - origins.mean(axis=0)
    centre = middle + 0.8 * radius * sight / max(hypot(*sight), 1e-9)
    for _ in range(STEPS):
        normal, residual = _normals(points, centre, radius)
        step = np.linalg.solve(normal.T @ normal + RIDGE * np.eye(2), normal.T @ residual)
        centre = centre + step
        if hypot(*step) < SETTLED:
            break
    normal, residual = _normals(points, centre, radius)
    beam = points - origins
    beam = beam / np.maximum(np.linalg.norm(beam, axis=1), 1e-9)[:, None]
    noise = deviation**2 * (beam * normal).sum(axis=1) ** 2 + rough**2
    inverse = np.linalg.inv(normal.T @ normal + RIDGE * np.eye(2))
    inverse = 0.5 * (inverse + inverse.T)
    spread = inverse @ (normal.T * noise) @ normal @ inverse
    spread = spread + _misfit(residual, noise) * np.eye(2)
    blurred = noise + FAINT**2
    surprise = float((residual**2 / blurred + np.log(blurred)).sum())
    return DiscFit(centre, 0.5 * (spread + spread.T), surprise)


def _normals(points: Array, centre: Array, radius: float) -> tuple[Array, Array]:
    """Outward normals at the points, (n, 2), and the distances from the disc, (n,), m."""
    away = points - centre
    distance = np.maximum(np.linalg.norm(away, axis=1), 1e-9)
    return away / distance[:, None], distance - radius


def _misfit(residual: Array, noise: Array) -> float:
    """Return the mean square of the residuals, m^2; 0 where the noise explains them.

    The threshold is Wilson's and Hilferty's approximation of a chi-square quantile.
    """
    free = len(residual) - 2
    if free < 1:
        return 0.0
    square = float(residual @ residual)
    likely = (1.0 - 2.0 / (9.0 * free) + SURE * (2.0 / (9.0 * free)) ** 0.5) ** 3
    explained = square <= likely * max(float(noise.mean()) * free, 1e-12)
    return 0.0 if explained else square / len(residual)


@dataclass(frozen=True)
class DiscShape:
    """What a detector takes a body for.

    Attributes
    ----------
    radius : m, of the disc that encloses it.
    fitted : m, of the disc whose centre comes out right on average.
    rough : m, root mean square distance of what is seen of it from that disc.
    along, across : m, standard deviations that the unknown heading adds to the centre, along
        the line of sight and across it.
    """

    radius: float
    fitted: float
    rough: float
    along: float
    across: float

    @property
    def lasting(self) -> float:
        """Standard deviation per axis of the error that stays with the heading, m."""
        return hypot(self.along, self.across) / sqrt(2.0)

    def spread(self, sight: Array) -> Array:
        """Return what the shape adds to the covariance of a centre, (2, 2), m^2.

        Parameters
        ----------
        sight : (2,), from the sensor to the body.
        """
        first = sight / max(hypot(*sight), 1e-9)
        second = np.array([-first[1], first[0]])
        return np.asarray(
            self.along**2 * np.outer(first, first) + self.across**2 * np.outer(second, second)
        )


def cylinder(radius: float) -> DiscShape:
    """Return the shape of a cylinder, which looks the same from all sides."""
    return DiscShape(radius, radius, 0.0, 0.0, 0.0)


@lru_cache(maxsize=16)
def box(half_length: float, half_width: float) -> DiscShape:
    """Return the shape of a box that may have any heading.

    The disc around a box touches it at the corners alone, so that a disc of that radius R
    through its visible sides lies too far away, on average over the headings by b. A disc of
    radius R - b does not; what is left by heading is taken as noise. Both come from fits to
    exact rays on the box at `HEADINGS` headings; the distance hardly matters.
    """
    radius = hypot(half_length, half_width)
    fitted, errors = radius, np.zeros((HEADINGS, 3))
    for _ in range(4):
        errors = np.array([
            _box_error(half_length, half_width, fitted, heading)
            for heading in np.pi * (np.arange(HEADINGS) + 0.5) / HEADINGS
        ])  # fmt: skip
        fitted -= float(errors[:, 0].mean())
    along, across, _ = errors.std(axis=0)
    rough = np.sqrt(errors[:, 2].mean())
    return DiscShape(radius, fitted, float(rough), float(along), float(across))


HEADINGS, AWAY, RAYS = 60, 8.0, 41
"""Headings of a box over half a turn, m to its centre, and rays over the width of its disc."""


def _box_error(half_length: float, half_width: float, radius: float, heading: float) -> Array:
    """Return how far a disc is off along and across, m, and its mean square residual, m^2."""
    reach = np.arcsin(hypot(half_length, half_width) / AWAY)
    angle = np.linspace(-reach, reach, RAYS)
    beams = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    turn = np.array([[np.cos(heading), np.sin(heading)], [-np.sin(heading), np.cos(heading)]])
    half = np.array([half_length, half_width])
    start, unit = turn @ np.array([-AWAY, 0.0]), beams @ turn.T
    with np.errstate(divide="ignore"):  # a ray along a side meets it at infinity
        ends = np.stack([(-half - start) / unit, (half - start) / unit])
    enter, leave = ends.min(axis=0).max(axis=1), ends.max(axis=0).min(axis=1)
    met = enter < leave
    points = enter[met, None] * beams[met]
    found = fit_disc(points, np.zeros_like(points), radius, 1e-3)
    _, residual = _normals(points, found.centre, radius)
    return np.append(found.centre - np.array([AWAY, 0.0]), (residual**2).mean())

"""Metrics of plans: promised content, coverage, changes. Functions of plain arrays.

A plan has N steps; forecasts are (O, M, N, D) with covariances (O, M, N, D, D) and weights
(O, M), of O obstacles and M modes. Distances are between centres; a touch is a distance of
centres below the sum of the radii.
"""

from math import gamma, pi

import numpy as np

from ..framework.risk.collision_probability import collision_probability
from ..framework.values.arrays import Array, BoolArray, checked_covariance
from .episode import content_bound, squared_mahalanobis

FAR = 8.0
"""Deviations (root of the covariance's trace) beyond which nothing is counted."""
NODES = 16
"""Of the integral for the risk."""


def plan_change(earlier_times: Array, earlier: Array, later_times: Array, later: Array) -> float:
    """Mean distance between two plans at the instants of the later one that both cover, m.

    Plan-to-plan consistency: 0 for a robot that does what it meant to. The earlier plan is
    interpolated linearly; NaN where they have no instant in common.

    Parameters
    ----------
    earlier_times, later_times : (N + 1,), s.
    earlier, later : (N + 1, D), m.
    """
    common = (later_times >= earlier_times[0] - 1e-9) & (later_times <= earlier_times[-1] + 1e-9)
    if not common.any():
        return float("nan")
    asked = later_times[common]
    meant = np.stack([np.interp(asked, earlier_times, column) for column in earlier.T], axis=-1)
    return float(np.linalg.norm(later[common] - meant, axis=1).mean())


def content_area(covariance: Array, tail: float) -> Array:
    """Area (3-D: volume) of the ellipse of content 1 - tail, (..., D, D) -> (...), m^2 (m^3).

    ::

        pi^(D / 2) / Gamma(D / 2 + 1) q^(D / 2) sqrt(det Sigma),    Pr(chi^2_D > q) = tail

    How sharp a forecast is; before anything is enlarged by radii.

    Raises
    ------
    WideberthError : what is no covariance, see `arrays.checked_covariance`.
    """
    size = covariance.shape[-1]
    covariance = checked_covariance("covariance", covariance, size)
    ball = pi ** (size / 2) / gamma(size / 2 + 1)
    scale = ball * content_bound(size, tail) ** (size / 2)
    return np.asarray(scale * np.sqrt(np.maximum(np.linalg.det(covariance), 0.0)))


def plan_risk(
    positions: Array, mean: Array, covariance: Array, weight: Array, radii: Array
) -> Array:
    """Probability by its own forecast that the plan touches each obstacle at each step, (N, O).

    Discs; over the modes the weighted sum of `framework.risk.collision_probability`, here to a
    relative 1e-5. It is 0 where the surfaces are more than `FAR` deviations apart: below 1e-13.

    Parameters
    ----------
    positions : (N, D), m, planned.
    mean, covariance, weight : of the forecast.
    radii : (O,), m, robot and obstacle together.

    Raises
    ------
    WideberthError : what is no covariance, see `arrays.checked_covariance`.
    """
    covariance = checked_covariance("covariance", covariance, mean.shape[-1])
    difference = mean - positions
    size = np.broadcast_to(radii[:, None, None], difference.shape[:-1])
    spread = np.sqrt(np.trace(covariance, axis1=-2, axis2=-1))
    near = np.linalg.norm(difference, axis=-1) - size <= FAR * spread
    chance = np.zeros(size.shape)
    chance[near] = collision_probability(difference[near], covariance[near], size[near], NODES)
    return np.asarray(np.einsum("om,omn->no", weight, chance))


def either(risk: Array, axis: int = -1) -> Array:
    """Probability of at least one of independent events, 1 - prod(1 - p), along an axis."""
    return np.asarray(-np.expm1(np.sum(np.log1p(-np.minimum(risk, 1.0 - 1e-16)), axis=axis)))


def touched(positions: Array, truth: Array, radii: Array) -> BoolArray:
    """Whether a robot that is where the plan puts it touches each obstacle, (N, O).

    Parameters
    ----------
    positions : (N, D), m, planned.
    truth : (O, N, D), m, where the obstacles then were; NaN where unknown, which is no touch.
    radii : (O,), m, robot and obstacle together.
    """
    apart = np.linalg.norm(truth - positions, axis=-1)
    return np.asarray((apart < radii[:, None]).T, dtype=np.bool_)


def outside_content(mean: Array, covariance: Array, truth: Array, content: Array) -> BoolArray:
    """Whether the truth is outside the forecast's ellipse of a content, (...), each its own.

    The chance of that is 1 - content where the forecast is right, whatever the region's form.

    Parameters
    ----------
    mean, covariance, truth : (..., D), (..., D, D), (..., D), m; the truth finite.
    content : (...), in [0, 1].
    """
    from scipy.special import chdtrc

    square = squared_mahalanobis(mean, covariance, truth)
    return np.asarray(chdtrc(mean.shape[-1], square) < 1.0 - content)

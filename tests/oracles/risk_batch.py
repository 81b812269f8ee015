"""The collision probability in JAX, its gradient, and its estimate from random draws."""

from collections.abc import Callable, Sequence
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from wideberth.framework.risk.collision_probability import scaled, split
from wideberth.framework.risk.inversion import _kinds, _masked, logarithm, probability
from wideberth.framework.values.arrays import Array, whole
from wideberth.framework.values.errors import WideberthError
from wideberth.tests.oracles.risk_bounds import eigenframe

_CHUNK = 16384
"""Pairs per call: 64 nodes of them are 8 MiB."""


def collision_probability_batch(
    difference: ArrayLike,
    covariance: ArrayLike,
    radius: ArrayLike,
    nodes: int = 64,
    chunk: int = _CHUNK,
) -> Array:
    """Pr(|X| < radius) for X ~ N(difference, covariance), (...), compiled.

    The same integral as `framework.risk.collision_probability` with the same accuracy: relative
    1e-9 above 1e-12. Eigenvectors are found in NumPy; the integrals run in double precision on
    whatever device JAX finds, whether or not the caller has set JAX to double precision. Pairs
    are padded to chunks of one size (a power of two for fewer), so that little is compiled.

    Parameters
    ----------
    difference : (..., D), m, mean position of the obstacle minus that of the robot.
    covariance : (..., D, D), m^2, of that difference; D is 2 or 3.
    radius : (...), m, both radii together.
    nodes : of the integral, see `inversion.rule`.
    chunk : pairs per call of the compiled function.

    Raises
    ------
    WideberthError : as `collision_probability`, or a count below 1.
    """
    shape, columns, _, _ = scaled(difference, covariance, radius)
    return np.asarray(_in_chunks("probability", columns, nodes, chunk)[0].reshape(shape))


def collision_probability_gradient_batch(
    difference: ArrayLike,
    covariance: ArrayLike,
    radius: ArrayLike,
    nodes: int = 64,
    chunk: int = _CHUNK,
) -> Array:
    """Gradient of the probability by the robot's position, 1/m, (..., D), compiled.

    Parameters
    ----------
    difference, covariance, radius, nodes, chunk : as in `collision_probability_batch`.

    Raises
    ------
    WideberthError : as `collision_probability_gradient`, or a count below 1.
    """
    shape, columns, vectors, slope = scaled(difference, covariance, radius)
    density = _in_chunks("slopes", columns, nodes, chunk)
    return turned_back(slope * density, vectors, shape)


def sampled_collision_probability(
    difference: ArrayLike,
    covariance: ArrayLike,
    radius: ArrayLike,
    rng: np.random.Generator,
    draws: int = 100_000,
) -> Array:
    """Share of random draws within the radius, (...): an estimate that shares no formula.

    Its standard error is sqrt(P (1 - P) / draws). The pairs draw one after the other, so they
    are independent of each other.

    Parameters
    ----------
    difference, covariance, radius : as in `collision_probability_batch`.
    rng : source of the draws.
    draws : per pair.

    Raises
    ------
    WideberthError : as `collision_probability_batch`.
    """
    draws = whole("draws", draws)
    local, deviations, size = eigenframe(difference, covariance, radius)
    share = np.zeros(size.shape)
    for index in np.ndindex(size.shape):
        normal = rng.standard_normal((draws, local.shape[-1]))
        places = local[index] + deviations[index] * normal
        share[index] = np.mean((places**2).sum(axis=1) < size[index] ** 2)
    return share


def _in_chunks(name: str, columns: Array, nodes: int, chunk: int) -> Array:
    """Rows of results for the columns of `scaled`, by calls of one width."""
    import jax

    nodes, chunk = whole("nodes", nodes), whole("chunk", chunk)
    count = columns.shape[1]
    width = min(chunk, 1 << max(count - 1, 0).bit_length())
    rows = 1 if name == "probability" else len(columns) // 2
    result = np.zeros((rows, count))
    with jax.enable_x64(True):
        evaluate = _compiled(name, nodes)
        for start in range(0, count, width):
            part = columns[:, start : start + width]
            filled = part.shape[1]
            given = np.ones((len(columns), width))
            given[:, :filled] = part
            result[:, start : start + filled] = np.asarray(evaluate(given))[:, :filled]
    return result


@cache
def _compiled(name: str, nodes: int) -> Callable[..., Any]:
    """Compile for one result and number of nodes; JAX adds one program per shape."""
    import jax
    import jax.numpy as jnp

    function = {"probability": probability, "slopes": slopes}[name]

    def evaluate(columns: Any) -> Any:
        return jnp.atleast_2d(function(*split(columns), nodes, jnp))

    compiled: Callable[..., Any] = jax.jit(evaluate)
    return compiled


def collision_probability_gradient(
    difference: ArrayLike, covariance: ArrayLike, radius: ArrayLike, nodes: int = 64
) -> Array:
    """Gradient of the probability by the robot's position, 1/m, (..., D).

    In the eigenframe, with x the obstacle's mean seen from the robot, 2 x_i / R^2 times the
    density at 1 of |X|^2 / R^2 with two more degrees of freedom along axis i
    (`slopes`): the sum of noncentral chi-square variables falls in a noncentrality by
    what it has there with two degrees more. It points towards the obstacle. Each coordinate in
    the eigenframe is known to 1e-9 of itself, also deep inside, where the probability is 1.
    Where all spread is along a line or a plane the gradient is that of the limit.

    Parameters
    ----------
    difference, covariance, radius, nodes : as in `collision_probability`.

    Raises
    ------
    WideberthError : as `collision_probability`; a singular covariance whose line or plane just
        touches the disc: there the probability has no gradient.
    """
    shape, columns, vectors, slope = scaled(difference, covariance, radius)
    return turned_back(slope * slopes(*split(columns), nodes, np), vectors, shape)


def turned_back(local: Array, vectors: Array, shape: tuple[int, ...]) -> Array:
    """Gradients in the eigenframe (D, n) in the frame of the input, (..., D).

    Raises
    ------
    WideberthError : one that is NaN.
    """
    if np.isnan(local).any():
        raise WideberthError(
            "a covariance is singular or too thin, and the line or plane on which the obstacle "
            "lies just touches the disc: the probability has no gradient there; move the "
            "obstacle or add a little to the covariance"
        )
    gradient = local.T.reshape(*shape, len(local))
    return np.asarray(np.einsum("...ij,...j->...i", vectors, gradient))


def slopes(ratios: Sequence[Any], squares: Sequence[Any], gap: Any, nodes: int, xp: Any) -> Any:
    """Return -dP / d delta_i, (D, ...), at least 0.

    Each is the density at 1 of |D|^2 / R^2 with two more degrees of freedom along axis i.
    The first ratio is the largest. NaN on the rim that coordinates without spread leave, where P
    jumps or is not smooth.
    """
    solid, reachable, rim = _kinds(ratios, squares, xp)
    # phi at -1 / (4 tau_1), tau_1 the largest, is at most -1000 there: no density in double
    # precision, and further left 1 + 2 tau w would lose its digits.
    pull = sum(t * d for t, d in zip(ratios, squares, strict=True))
    deep = (gap - pull / xp.where(solid, ratios[0], 1.0)) > 4000.0 * ratios[0]
    present = solid & reachable & ~deep
    form = _masked(ratios, squares, gap, present, xp)
    rim = rim | (~solid & (gap == 0.0))
    found = []
    for i in range(len(ratios)):
        counts = [3 if i == j else 1 for j in range(len(ratios))]
        density = xp.exp(logarithm((*form, counts, 0), nodes, xp))
        found.append(xp.where(rim, np.nan, xp.where(present, density, 0.0)))
    return xp.stack(found)

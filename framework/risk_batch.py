"""Collision probability of many pairs at once, in JAX, and its estimate from random draws."""

from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from .arrays import Array, whole
from .risk import REACH, SHARP, eigenframe, gauss_legendre

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

    The same rule as `framework.risk.collision_probability`, which it equals to a relative
    1e-9 above 1e-12. Eigenvectors are found in NumPy; the integrals run in double precision on
    whatever device JAX finds, whether or not the caller has set JAX to double precision. Pairs
    are padded to chunks of one size (a power of two for fewer), so that little is compiled.

    Parameters
    ----------
    difference : (..., D), m, mean position of the obstacle minus that of the robot.
    covariance : (..., D, D), m^2, of that difference; D is 2 or 3.
    radius : (...), m, both radii together.
    nodes : Gauss-Legendre nodes per integral.
    chunk : pairs per call of the compiled function; in 3-D it is divided by ``nodes``.

    Raises
    ------
    WideberthError : as `collision_probability`, or a count below 1.
    """
    import jax

    nodes, chunk = whole("nodes", nodes), whole("chunk", chunk)
    local, deviations, size = eigenframe(difference, covariance, radius)
    dimension, count = local.shape[-1], size.size
    d, s, r = local.reshape(-1, dimension), deviations.reshape(-1, dimension), size.reshape(-1)
    most = chunk if dimension == 2 else max(chunk // nodes, 1)
    width = min(most, 1 << max(count - 1, 0).bit_length())
    result = np.zeros(count)
    with jax.enable_x64(True):
        evaluate = _compiled(dimension, nodes)
        for start in range(0, count, width):
            part = slice(start, min(start + width, count))
            filled = part.stop - start
            rows = [np.ones((width, *value.shape[1:])) for value in (d, s, r)]
            for row, value in zip(rows, (d, s, r), strict=True):
                row[:filled] = value[part]
            result[part] = np.asarray(evaluate(*rows))[:filled]
    return np.clip(result, 0.0, 1.0).reshape(size.shape)


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


@cache
def _compiled(dimension: int, nodes: int) -> Callable[..., Any]:
    """Compile for one number of coordinates and nodes; JAX adds one program per width."""
    import jax

    rule = gauss_legendre(nodes)

    def evaluate(d: Any, s: Any, radius: Any) -> Any:
        columns = range(dimension)
        return _ball([d[:, i] for i in columns], [s[:, i] for i in columns], radius, rule)

    compiled: Callable[..., Any] = jax.jit(evaluate)
    return compiled


def _ball(d: list[Any], s: list[Any], radius: Any, rule: tuple[Array, Array]) -> Any:
    """Integrate the last coordinate, the rest recursively; entries of lists are coordinates."""
    import jax.numpy as jnp

    y, last = d[-1], s[-1]
    solid = jnp.where(last > 0, last, 1.0)
    if len(d) == 1:
        smooth = _normal((radius - y) / solid) - _normal((-radius - y) / solid)
        return jnp.where(last > 0, smooth, jnp.where(y < radius, 1.0, 0.0))
    size = jnp.where(radius > 0, radius, 1.0)
    half = solid * jnp.hypot(REACH, _nearest(d, s, radius))
    low = jnp.arcsin(jnp.clip((-y - half) / size, -1.0, 1.0))
    high = jnp.arcsin(jnp.clip((half - y) / size, -1.0, 1.0))
    points, weights = rule
    width = 0.5 * (high - low)
    angle = 0.5 * (high + low)[..., None] + width[..., None] * points
    chord = radius[..., None] * jnp.cos(angle)
    offset = (radius[..., None] * jnp.sin(angle) + y[..., None]) / solid[..., None]
    density = jnp.exp(-0.5 * offset**2) / (np.sqrt(2.0 * np.pi) * solid[..., None])
    lower, spread = ([value[..., None] for value in values[:-1]] for values in (d, s))
    total = (density * chord * _ball(lower, spread, chord, rule) * weights).sum(axis=-1) * width
    sliced = _ball(d[:-1], s[:-1], _chord(radius, y), rule)
    sliced = jnp.where(y < radius, sliced, 0.0)
    return jnp.where(last <= SHARP * radius, sliced, total)


def _normal(value: Any) -> Any:
    """Phi, by erfc alone: `jax.scipy.special.ndtr` computes erf too and takes twice as long."""
    from jax.scipy.special import erfc

    return 0.5 * erfc(-np.sqrt(0.5) * value)


def _nearest(d: list[Any], s: list[Any], radius: Any) -> Any:
    """Bound on the Mahalanobis distance of the ball, as in `framework.risk`."""
    import jax.numpy as jnp

    length = jnp.sqrt(sum(value**2 for value in d))
    beyond = jnp.clip(length - radius, 0.0, None)
    share = jnp.where(length > 0, beyond / jnp.where(length > 0, length, 1.0), 0.0)
    solid = [jnp.where(value > 0, value, 1.0) for value in s]
    radial = jnp.sqrt(sum((share * x / one) ** 2 for x, one in zip(d, solid, strict=True)))
    if len(d) == 1:
        return radial
    edge = jnp.minimum(d[-1], radius)
    rest = _nearest(d[:-1], s[:-1], _chord(radius, edge))
    return jnp.minimum(radial, jnp.hypot((d[-1] - edge) / solid[-1], rest))


def _chord(radius: Any, offset: Any) -> Any:
    """Half the length of the chord of a disc at an offset from its centre."""
    import jax.numpy as jnp

    return jnp.sqrt(jnp.clip((radius - offset) * (radius + offset), 0.0, None))

"""A vector autoregression of velocities: its expected path and the growth of its uncertainty.

One process per obstacle, all obstacles at once. Exact for known coefficients, to first order
for estimated ones; the paper's own recursions stand in `predictors.var`. Notation: dT is the
step, h counts steps ahead, D is the dimension of a position, p the order, N the number of
steps, O the number of obstacles.

Inside, the obstacle axis is the last one: sums over lags and axes are short, and thousands of
tiny matrix products cost more than the arithmetic in them.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Literal, TypeAlias

import numpy as np

from ...framework.values.arrays import Array, BoolArray
from .small_matrices import lower_root, spectral_radius

Integration: TypeAlias = Literal["trapezoid", "rectangle"]
"""How velocities are summed up to positions.

rectangle: p_{h} = p_{h-1} + dT v_{h}; exact where v_h = (p_h - p_{h-1}) / dT.
trapezoid: p_{h} = p_{h-1} + dT (v_{h} + v_{h-1}) / 2; the paper's.
"""

SETTLED = 0.999
"""A companion radius below this need not be computed: it is surely below 1."""


@dataclass(frozen=True, eq=False)
class VelocityProcess:
    """Vector autoregressions v_h = A_1 v_{h-1} + ... + A_p v_{h-p} + u_h.

    Attributes
    ----------
    coefficients : (O, p, D, D), the A_j.
    innovation : (O, D, D), (m/s)^2, covariance of u_h.
    """

    coefficients: Array
    innovation: Array

    @property
    def order(self) -> int:
        """Number of lags, p."""
        return int(self.coefficients.shape[1])

    def select(self, index: Any) -> "VelocityProcess":
        """Return the processes with these indices, or where this mask is True."""
        return VelocityProcess(self.coefficients[index], self.innovation[index])

    def finite(self) -> BoolArray:
        """Tell which processes contain only finite numbers, (O,)."""
        known = np.isfinite(self.innovation).all(axis=(1, 2))
        known &= np.isfinite(self.coefficients).all(axis=(1, 2, 3))
        return np.asarray(known, dtype=np.bool_)

    def companion(self) -> Array:
        """First-order form, (O, p*D, p*D): its eigenvalues show whether velocities explode."""
        count, order, size = self.coefficients.shape[:3]
        matrix = np.tile(np.eye(order * size, k=-size), (count, 1, 1))
        matrix[:, :size] = self.coefficients.swapaxes(1, 2).reshape(count, size, order * size)
        return matrix

    def radius(self, floor: float = 0.0) -> Array:
        """Spectral radius of the companion matrix, (O,); above 1 the forecast explodes.

        Where it is certainly below ``floor``, ``floor`` is returned: telling that much costs a
        tenth of the eigenvalues.
        """
        return spectral_radius(self.companion(), floor)

    def settled(self) -> "VelocityProcess":
        """Return the process with no radius above 1: A_j / r^j where the radius is r > 1.

        That divides every eigenvalue by r and turns with the world.
        """
        radius = np.maximum(self.radius(floor=SETTLED), 1.0)
        power = radius[:, None] ** np.arange(1, self.order + 1)
        lags = self.coefficients / power[:, :, None, None]
        return VelocityProcess(lags, self.innovation)


@dataclass(frozen=True, eq=False)
class Estimation:
    """Uncertainty of the estimated coefficients.

    With B = [A_1 ... A_p], Cov(vec B) = W W' kron Sigma_u.

    Attributes
    ----------
    path : (O, p + N, D), m/s, the expected velocities; see `velocity_path`.
    root : (O, K, K), W; for least squares W W' = (Z'Z)^-1. K is p*D.
    """

    path: Array
    root: Array


def velocity_path(process: VelocityProcess, recent: Array, steps: int) -> Array:
    """Return p measured and N expected velocities, oldest first, (O, p + N, D), m/s.

    ``recent`` holds the known ones newest first, (O, p, D).
    """
    lags, known = _last(process.coefficients), _last(recent)
    order = len(known)
    path = np.concatenate([known[::-1], np.zeros((steps, *known.shape[1:]))])
    for h in range(order, order + steps):
        path[h] = np.einsum("pijo,pjo->io", lags, path[h - order : h][::-1])
    return np.asarray(np.moveaxis(path, 2, 0))


def displacements(path: Array, order: int, dt: float, integration: Integration) -> Array:
    """Sum the expected velocities of a `velocity_path` up to displacements, (O, N, D), m."""
    ahead = path[:, order:]
    if integration == "rectangle":
        return np.asarray(dt * np.cumsum(ahead, axis=1))
    return np.asarray(0.5 * dt * np.cumsum(ahead + path[:, order - 1 : -1], axis=1))


def process_covariances(
    process: VelocityProcess,
    dt: float,
    steps: int,
    start: Array,
    integration: Integration,
    estimation: Estimation | None = None,
) -> Array:
    """Covariances of the positions, (O, N, D, D), m^2: the diagonal blocks of `process_joint`.

    Every position is linear in independent errors of unit variance: those of the start, of
    the coefficients, and one innovation a step. With X_h what the first two kinds do to the
    position at step h and W_i what an innovation does i steps after its own,

    Cov(p_j, p_h) = X_j X_h' + sum_{s <= min(j, h)} W_{j-s} W_{h-s}'

    which is the covariance F P F' + G Sigma_u G' of the joint state of position and
    velocities, PSD by construction. X of the coefficients is the delta method's Jacobian

    J_{h+1} = F J_h + G (z_h' kron I),   z_h = (v_h, ..., v_{h-p+1})

    times a root of Cov(vec B); it is applied to positions, not to velocities alone, where it
    would not mend the sum.

    Parameters
    ----------
    process, integration : of the forecast.
    dt : s.
    steps : N.
    start : (O, (p+1)*D, (p+1)*D), P_0 of (p_k, v_k, ..., v_{k-p+1}).
    estimation : None for known coefficients.
    """
    count, size = process.innovation.shape[:2]
    spread = np.zeros((steps, size, size, count))
    shocks = np.zeros((size, size, count))
    for h, effect in enumerate(_effects(process, dt, steps, start, integration, estimation)):
        own, carried = effect[:, :size], effect[:, size:]
        shocks += np.einsum("ico,jco->ijo", own, own)
        spread[h] = shocks + np.einsum("ico,jco->ijo", carried, carried)
    return np.ascontiguousarray(np.moveaxis(spread, 3, 0))


def process_joint(
    process: VelocityProcess,
    dt: float,
    steps: int,
    start: Array,
    integration: Integration,
    estimation: Estimation | None = None,
) -> Array:
    """Joint covariance of the positions, (O, N*D, N*D), m^2; see `process_covariances`."""
    count, size = process.innovation.shape[:2]
    if not steps:
        return np.zeros((count, 0, 0))
    sweep = _effects(process, dt, steps, start, integration, estimation)
    effects = np.moveaxis(np.stack([effect.copy() for effect in sweep]), 3, 0)
    shocks = np.zeros((count, steps, size, steps, size))
    for s in range(steps):
        shocks[:, s:, :, s] = effects[:, : steps - s, :, :size]
    roots = np.concatenate(
        [
            shocks.reshape(count, steps * size, steps * size),
            effects[..., size:].reshape(count, steps * size, effects.shape[3] - size),
        ],
        axis=2,
    )
    return np.asarray(roots @ roots.swapaxes(1, 2))


def differenced_noise(noise: Array, dt: float, order: int) -> Array:
    """P_0 of (p_k, v_k, ..., v_{k-p+1}) from independent position errors, (O, (p+1)*D, ...).

    v_{k-j} = (p_{k-j} - p_{k-j-1}) / dT shares the error of p_{k-j} with the position and
    with its neighbour: M (I kron R) M', M the matrix of differences, R of shape (O, D, D).
    """
    mixing = np.zeros((order + 1, order + 1))
    mixing[0, 0] = 1.0
    for lag in range(order):
        mixing[lag + 1, lag], mixing[lag + 1, lag + 1] = 1.0 / dt, -1.0 / dt
    flat = (order + 1) * noise.shape[-1]
    blocks = np.einsum("ab,oij->oaibj", mixing @ mixing.T, noise)
    return np.asarray(blocks.reshape(len(noise), flat, flat))


def _effects(
    process: VelocityProcess,
    dt: float,
    steps: int,
    start: Array,
    integration: Integration,
    estimation: Estimation | None,
) -> Iterator[Array]:
    """Yield for each step what errors of unit variance do to the position, (D, C, O), m.

    Columns: the innovation of the first step (D of them; a later one does the same later),
    then the errors of the start ((p+1)*D), then those of the coefficients (K*D). The array
    is reused: copy what is to stay.
    """
    lags, root = _last(process.coefficients), dt * lower_root(_last(process.innovation))
    order, size, _, count = lags.shape
    begin = lower_root(_last(start))
    pushes = np.zeros((steps, 0, count))
    if estimation is not None:
        regressors = _regressors(estimation, order, steps)
        pushes = np.einsum("klo,nko->nlo", _last(estimation.root), regressors)
    first, extra = size + len(begin), pushes.shape[1]
    columns = first + extra * size
    # Velocities, newest first, in m per step: what positions then sum up as they are.
    past = list(np.zeros((order, size, columns, count)))
    for lag, part in enumerate(np.split(dt * begin[size:], order)):
        past[lag][:, size:first] = part
    position = np.zeros((size, columns, count))
    position[:, size:first] = begin[:size]
    for h in range(steps):
        velocity = np.zeros_like(position)
        for matrix, known in zip(lags, past, strict=True):
            velocity += np.einsum("ijo,jco->ico", matrix, known)
        if h == 0:
            velocity[:, :size] += root
        pushed = velocity[:, first:].reshape(size, extra, size, count)
        pushed += pushes[h][None, :, None] * root[:, None]
        position += velocity if integration == "rectangle" else 0.5 * (velocity + past[0])
        past = [velocity, *past[:-1]]
        yield position


def _regressors(estimation: Estimation, order: int, steps: int) -> Array:
    """z_h before each step, (N, K, O): (v_h, ..., v_{h-p+1})."""
    path = np.ascontiguousarray(estimation.path.transpose(1, 2, 0))
    return np.concatenate([path[order - 1 - lag :][:steps] for lag in range(order)], axis=1)


def _last(array: Array) -> Array:
    """Put the obstacle axis, the first one, last."""
    return np.ascontiguousarray(np.moveaxis(array, 0, -1))

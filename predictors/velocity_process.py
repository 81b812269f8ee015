"""How uncertainty grows where velocities are a vector autoregression: pure functions.

Exact, and beside it the two recursions of the paper, which leave covariances out. Notation: dT
is the step, h counts steps ahead, D is the dimension of a position, p the order of the process,
N the number of steps.
"""

from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np

from ..framework.arrays import Array
from .propagation import joint_covariance

Integration: TypeAlias = Literal["trapezoid", "rectangle"]
"""How velocities are summed up to positions.

rectangle: p_{h} = p_{h-1} + dT v_{h}; exact where v_h = (p_h - p_{h-1}) / dT.
trapezoid: p_{h} = p_{h-1} + dT (v_{h} + v_{h-1}) / 2; the paper's.
"""


@dataclass(frozen=True, eq=False)
class VelocityProcess:
    """A vector autoregression v_h = c + A_1 v_{h-1} + ... + A_p v_{h-p} + u_h.

    Attributes
    ----------
    coefficients : (p, D, D), the A_j.
    innovation : (D, D), (m/s)^2, covariance of u_h.
    intercept : (D,), m/s, the c.
    """

    coefficients: Array
    innovation: Array
    intercept: Array

    def companion(self) -> Array:
        """First-order form, (p*D, p*D): its eigenvalues say whether velocities explode."""
        order, size = self.coefficients.shape[:2]
        matrix = np.eye(order * size, k=-size)
        matrix[:size] = np.concatenate(list(self.coefficients), axis=1)
        return matrix

    def radius(self) -> float:
        """Spectral radius of the companion matrix; above 1 the forecast explodes."""
        return float(np.abs(np.linalg.eigvals(self.companion())).max())


def state_model(
    velocity: VelocityProcess, dt: float, integration: Integration
) -> tuple[Array, Array]:
    """Transition F and noise input G of the state (p_h, v_h, ..., v_{h-p+1}).

    rectangle: F = [[I, dT A], [0, C]],           G = [dT I; I; 0]
    trapezoid: F = [[I, dT (A + E) / 2], [0, C]], G = [dT/2 I; I; 0]

    with A = [A_1 ... A_p], E = [I 0 ... 0] and C the companion matrix.
    """
    order, size = velocity.coefficients.shape[:2]
    companion = velocity.companion()
    total = (order + 1) * size
    transition, entry = np.zeros((total, total)), np.zeros((total, size))
    transition[:size, :size] = np.eye(size)
    transition[size:, size:] = companion
    newest = companion[:size]
    if integration == "rectangle":
        transition[:size, size:] = dt * newest
        entry[:size] = dt * np.eye(size)
    else:
        transition[:size, size:] = 0.5 * dt * (newest + np.eye(size, order * size))
        entry[:size] = 0.5 * dt * np.eye(size)
    entry[size : 2 * size] = np.eye(size)
    return transition, entry


def exact_joint(
    velocity: VelocityProcess, dt: float, steps: int, start: Array, integration: Integration
) -> Array:
    """Exact joint covariance of the positions, (N*D, N*D), m^2, for known coefficients.

    Equals the moving-average form dT^2 sum_i C_i Sigma_u C_i' with C_i the sum of the
    first impulse responses. ``start`` is P_0 of (p_k, v_k, ..., v_{k-p+1}).
    """
    transition, entry = state_model(velocity, dt, integration)
    process = entry @ velocity.innovation @ entry.T
    return joint_covariance(transition, process, start, len(entry[0]), steps)


def forecast_velocities(velocity: VelocityProcess, recent: Array, steps: int) -> Array:
    """Return expected velocities, (N, D), m/s; ``recent`` is (p, D), newest first."""
    past = recent
    means = np.zeros((steps, recent.shape[1]))
    for h in range(steps):
        means[h] = velocity.intercept + np.einsum("pij,pj->i", velocity.coefficients, past)
        past = np.concatenate([means[h : h + 1], past[:-1]])
    return means


def displacements(velocities: Array, newest: Array, dt: float, integration: Integration) -> Array:
    """Sum velocities (N, D) up to displacements (N, D), m; ``newest`` is v_k, (D,)."""
    if integration == "rectangle":
        return np.asarray(dt * np.cumsum(velocities, axis=0))
    before = np.concatenate([newest[None], velocities[:-1]])
    return np.asarray(0.5 * dt * np.cumsum(velocities + before, axis=0))


def velocity_covariances(velocity: VelocityProcess, steps: int) -> Array:
    """Sigma_v,h = sum over i < h of Phi_i Sigma_u Phi_i', (N, D, D), (m/s)^2."""
    companion = velocity.companion()
    size = len(velocity.innovation)
    response = np.eye(len(companion), size)
    total, covariances = np.zeros((size, size)), np.zeros((steps, size, size))
    for h in range(steps):
        newest = response[:size]
        total = total + newest @ velocity.innovation @ newest.T
        covariances[h] = total
        response = companion @ response
    return covariances


def paper_covariances(
    velocity: VelocityProcess,
    dt: float,
    steps: int,
    start: Array,
    integration: Integration = "trapezoid",
    *,
    literal: bool = False,
) -> Array:
    """Covariances as the paper sums them, (N, D, D), m^2; too small, see below.

    The paper: Sigma_{k+i} = Sigma_{k+i-1} + dT^2/4 (Sigma_{v,k} + Sigma_{v,k+i-1}),
    "neglecting the covariances between the summands". ``literal`` does just that, with
    Sigma_{v,k} = 0, as the velocity at k is known. Otherwise the index is mended so that it
    matches the paper's mean: Sigma_{v,k} becomes Sigma_{v,k+i}. With ``integration``
    "rectangle" (and not literal) the same neglect is made on the rectangle rule,
    Sigma_{k+i} = Sigma_{k+i-1} + dT^2 Sigma_{v,k+i}.

    Difference: a nominal 95 % ellipse covers 13 % at step 15 where velocities persist (6 %
    literally), because errors of successive velocities are nearly equal, not independent.

    Parameters
    ----------
    velocity, dt, steps, integration : as in `exact_joint`.
    start : (D, D), m^2, Sigma_k; the paper does not state it.
    literal : the printed formula, which is always the trapezoid's.
    """
    ahead = velocity_covariances(velocity, steps)
    before = np.concatenate([np.zeros_like(ahead[:1]), ahead[:-1]])
    if literal:
        growth = 0.25 * dt**2 * before
    elif integration == "trapezoid":
        growth = 0.25 * dt**2 * (ahead + before)
    else:
        growth = dt**2 * ahead
    return np.asarray(start + np.cumsum(growth, axis=0))


def estimation_joint(
    velocity: VelocityProcess,
    dt: float,
    recent: Array,
    steps: int,
    moment_inverse: Array,
    integration: Integration,
) -> Array:
    """Return what uncertain coefficients add to `exact_joint`, (N*D, N*D), m^2.

    Delta method: with B = [c A_1 ... A_p], z_h = (1, v_h, ..., v_{h-p+1}) and
    J_h = d s_h / d vec(B),

    J_{h+1} = F J_h + G (z_h' kron I),   Cov(vec B) = (Z'Z)^-1 kron Sigma_u

    so that J_p Cov(vec B) J_p' is the covariance of the mean positions. Applied to the
    positions, not to velocities alone: there it would not mend the sum.

    Parameters
    ----------
    recent : (p, D), m/s, newest first.
    moment_inverse : (Z'Z)^-1 of the regression, (K, K), with K = p*D, or p*D + 1 where an
        intercept was estimated (its row and column come first).
    """
    order, size = velocity.coefficients.shape[:2]
    transition, entry = state_model(velocity, dt, integration)
    count = len(moment_inverse)
    path = forecast_velocities(velocity, recent, steps)
    lags = np.concatenate([path[::-1], recent])
    jacobian = np.zeros((len(transition), count * size))
    rows = np.zeros((steps, size, count * size))
    for h in range(steps):
        known = lags[steps - h : steps - h + order].ravel()
        regressor = np.concatenate([np.ones(count - order * size), known])
        jacobian = transition @ jacobian + entry @ np.kron(regressor, np.eye(size))
        rows[h] = jacobian[:size]
    flat = rows.reshape(steps * size, count * size)
    return np.asarray(flat @ np.kron(moment_inverse, velocity.innovation) @ flat.T)


def differenced_noise(noise: Array, dt: float, order: int) -> Array:
    """P_0 of (p_k, v_k, ..., v_{k-p+1}) from independent position errors, ((p+1)*D,)*2.

    v_{k-j} = (p_{k-j} - p_{k-j-1}) / dT shares the error of p_{k-j} with the position and
    with its neighbour: M (I kron R) M', M the matrix of differences.
    """
    mixing = np.zeros((order + 1, order + 1))
    mixing[0, 0] = 1.0
    for lag in range(order):
        mixing[lag + 1, lag], mixing[lag + 1, lag + 1] = 1.0 / dt, -1.0 / dt
    return np.asarray(np.kron(mixing @ mixing.T, noise), dtype=np.float64)

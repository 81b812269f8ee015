"""Gaussian position forecasts from the velocity processes of all obstacles."""

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from ...framework.values.arrays import Array
from ...framework.values.tracks import Tracks
from .assembly import Gaussians
from .history import Histories, IntArray, measurement_noise
from .propagation import after, cut_steps
from .velocity_process import (
    Estimation,
    Integration,
    VelocityProcess,
    differenced_noise,
    displacements,
    process_covariances,
    process_joint,
)


def past_velocities(past: Histories, dt: float, order: int) -> tuple[Array, Array]:
    """Velocities of the histories, (O, T - 1, D), and the newest p of them, (O, p, D), m/s.

    v_k = (p_k - p_{k-1}) / dT; the newest come newest first, zeros where there are fewer.
    """
    velocities = np.diff(past.positions, axis=1) / dt
    recent = np.zeros((len(velocities), order, past.positions.shape[2]))
    known = velocities[:, ::-1][:, :order]
    recent[:, : known.shape[1]] = known
    return velocities, recent


def served(past: Histories, missing: Sequence[str | None]) -> Histories:
    """Set to 0 the extra steps of obstacles that a fallback predictor forecasts (with a reason).

    All are rolled out as far as the one that was last seen longest ago.
    """
    own = np.array([reason is None for reason in missing], dtype=np.bool_)
    return replace(past, late=np.where(own, past.late, 0))


def start_covariance(tracks: Tracks, noise_floor: float, order: int) -> Array:
    """P_0 of (p_k, v_k, ..., v_{k-p+1}), (O, (p+1)*D, (p+1)*D).

    From the measurement noise (`differenced_noise`), or from the tracker's own covariance
    where there is one, the error of v_{k-1} then being taken as that of v_k.
    """
    tracker = tracks.state_covariance
    if tracker is None:
        return differenced_noise(measurement_noise(tracks, noise_floor), tracks.dt, order)
    share = np.zeros((order + 1, 2))
    share[0, 0], share[1:, 1] = 1.0, 1.0
    spread = np.kron(share, np.eye(tracks.dimension))
    return np.asarray(spread @ tracker @ spread.T)


def process_means(
    past: Histories, path: Array, order: int, dt: float, steps: int, integration: Integration
) -> Array:
    """Return expected positions, (O, N, D), m, of the N steps after the newest row."""
    moved = displacements(path, order, dt, integration)
    return np.asarray(past.origin[:, None] + after(moved, steps, past.late))


def process_gaussians(
    process: VelocityProcess,
    past: Histories,
    path: Array,
    start: Array,
    dt: float,
    steps: int,
    integration: Integration = "rectangle",
    root: Array | None = None,
) -> Gaussians:
    """Gaussians of the positions of `process_means`, with their exact covariance.

    Parameters
    ----------
    process, past : of the same obstacles.
    path : `velocity_path` over the steps and those gone by.
    start : P_0; see `start_covariance`.
    dt : s.
    steps : N.
    integration : see `Integration`.
    root : of the coefficients' covariance, see `Estimation`; None where they are known.
    """
    order, ahead = process.order, path.shape[1] - process.order
    estimation = None if root is None else Estimation(path, root)
    mean = process_means(past, path, order, dt, steps, integration)
    spread = process_covariances(process, dt, ahead, start, integration, estimation)
    joint = partial(_joint, process, dt, steps, start, integration, estimation, past.late)
    return Gaussians(mean, after(spread, steps, past.late), (None,) * len(mean), joint)


def _joint(
    process: VelocityProcess,
    dt: float,
    steps: int,
    start: Array,
    integration: Integration,
    estimation: Estimation | None,
    late: IntArray,
) -> Array:
    """Joint covariance of the steps late + 1 to late + N, (O, N*D, N*D), m^2."""
    ahead = steps + int(late.max(initial=0))
    # What overflows belongs to obstacles that were left to another predictor.
    with np.errstate(all="ignore"):
        joint = process_joint(process, dt, ahead, start, integration, estimation)
    return cut_steps(joint, steps, process.innovation.shape[1], late)

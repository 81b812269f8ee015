"""The linear filter of `predictors.kalman`, one obstacle after the other, by filterpy."""

import numpy as np

from wideberth.framework.values.arrays import Array
from wideberth.framework.values.tracks import Tracks
from wideberth.predictors.core.propagation import white_acceleration


def filterpy_states(
    tracks: Tracks, density: float, speed: float, floor: float
) -> tuple[Array, Array]:
    """Return states (O, 2D) and covariances (O, 2D, 2D), with F and Q of each lag.

    Parameters
    ----------
    tracks : with measurements at any times; a pause of more than 6 steps begins anew.
    density : m^2/s^3, of white acceleration. speed : m/s, deviation of the first velocity.
    floor : m, added in quadrature to the measurement noise.
    """
    from filterpy.kalman import KalmanFilter

    size, states, covariances = tracks.dimension, [], []
    measured = tracks.measured
    for times, places, noise in zip(
        measured.times, measured.positions, measured.noise, strict=True
    ):
        engine, before = None, -np.inf
        for time, place, spread in zip(times, places, noise, strict=True):
            known = spread + floor**2 * np.eye(size)
            if time - before > 6.0 * tracks.dt * (1.0 + 1e-6):
                engine = KalmanFilter(dim_x=2 * size, dim_z=size)
                engine.H = np.eye(size, 2 * size)
                engine.x = np.concatenate([place, np.zeros(size)])
                engine.P = np.diag(np.full(2 * size, speed**2))
                engine.P[:size, :size] = known
            else:
                engine.F, engine.Q = white_acceleration(time - before, density, size)
                engine.predict()
                engine.update(place, R=known)
            before = time
        states.append(engine.x)
        covariances.append(engine.P)
    return np.array(states), np.array(covariances)

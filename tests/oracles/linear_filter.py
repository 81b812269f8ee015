"""Linear filters of `predictors.core.kalman_filter` by filterpy, one obstacle after the other."""

import numpy as np

from wideberth.framework.values.arrays import Array
from wideberth.framework.values.beliefs import Beliefs
from wideberth.framework.values.tracks import Tracks
from wideberth.predictors.core.history import floored
from wideberth.predictors.core.kalman_filter import PAUSE, Motion
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


def filter_one_by_one(tracks: Tracks, motion: Motion, floor: float) -> Beliefs:
    """Compute `filtered` of a motion of one mode with filterpy, one obstacle after the other."""
    from filterpy.kalman import KalmanFilter

    size, components = tracks.dimension, len(motion.start) + 1
    body, sightings = (components, size), tracks.measured
    state = np.zeros((*body, 1, len(tracks)))
    covariance = np.zeros((*body, *body, 1, len(tracks)))
    origin, count = np.zeros((size, len(tracks))), np.zeros(len(tracks), dtype=np.int64)
    for i in range(len(tracks)):
        times, places, noise = sightings.times[i], sightings.positions[i], sightings.noise[i]
        pauses = np.flatnonzero(np.diff(times) > PAUSE * tracks.dt)
        first = int(pauses[-1]) + 1 if pauses.size else 0
        count[i] = len(times) - first
        if not count[i]:
            continue
        origin[:, i] = places[first]
        engine = KalmanFilter(dim_x=components * size, dim_z=size)
        engine.H, engine.x = np.eye(size, components * size), np.zeros(components * size)
        engine.P = np.diag(np.repeat([0.0, *motion.start], size))
        engine.P[:size, :size] = floored(noise[first], floor)
        for k in range(first + 1, len(times)):
            step = motion.step(times[k : k + 1] - times[k - 1])
            engine.F, engine.Q = (
                np.kron(part[:, :, 0, 0], np.eye(size)).astype(np.float64) for part in step[:2]
            )
            engine.predict()
            engine.update(places[k] - places[first], R=floored(noise[k], floor))
        state[..., 0, i] = engine.x.reshape(body)
        covariance[..., 0, i] = (0.5 * (engine.P + engine.P.T)).reshape(*body, *body)
    values = np.ones((1, len(tracks))), state, covariance, origin
    return Beliefs(sightings.log, sightings.newest, count, values)

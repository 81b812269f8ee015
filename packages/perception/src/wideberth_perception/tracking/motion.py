"""Straight motion under random acceleration, in the plane, and the order of scans."""

from dataclasses import replace

import numpy as np

from wideberth.framework.values.arrays import LATEST, Array, number
from wideberth.framework.values.errors import WideberthError
from wideberth.simulation.sensing.perceived import Sightings

TIMELESS = "the scan has no instant"


def carried(state: Array, covariance: Array, dt: float, density: float) -> tuple[Array, Array]:
    """Carry states on by dt, which may be negative.

    x <- F x,   P <- F P F' + Q,   F = [[I, dt I], [0, I]],
    Q = q [[|dt|^3/3 I, dt |dt|/2 I], [dt |dt|/2 I, |dt| I]]

    Parameters
    ----------
    state : (4,), x, y in m and their rates in m/s.
    covariance : (4, 4), P.
    dt : s.
    density : q, m^2/s^3, of white acceleration.
    """
    from filterpy.kalman import predict

    moved = np.eye(4) + dt * np.eye(4, k=2)
    span = abs(dt)
    axis = np.array([[span**3 / 3.0, dt * span / 2.0], [dt * span / 2.0, span]])
    state, grown = predict(state, covariance, F=moved, Q=density * np.kron(axis, np.eye(2)))
    return state, 0.5 * (grown + grown.T)


def corrected(state: Array, covariance: Array, place: Array, noise: Array) -> tuple[Array, Array]:
    """Update a state by a measured position, (2,), with covariance R, (2, 2).

    K = P H' (H P H' + R)^-1,   P <- (I - K H) P (I - K H)' + K R K'   (Joseph's form, filterpy's)

    A measurement whose H P H' + R is singular or no number says nothing new: the state stays.
    """
    from filterpy.kalman import update

    (first, shared), (_, second) = covariance[:2, :2] + noise
    if not first * second > shared**2:  # filterpy would go on with NaN
        return state, covariance
    state, spread = update(state, covariance, place, noise, H=np.eye(2, 4))
    return state, 0.5 * (spread + spread.T)


def in_order(sightings: Sightings) -> Sightings:
    """Return the sightings sorted, so that their order in the scan does not matter."""
    x, y = sightings.positions.T
    order = np.lexsort((sightings.radius, y, x, sightings.times))
    return replace(
        sightings,
        positions=sightings.positions[order],
        covariance=sightings.covariance[order],
        radius=sightings.radius[order],
        times=sightings.times[order],
    )


def checked_instant(time: float) -> None:
    """Refuse an instant, s, to which no track can be carried.

    Raises
    ------
    WideberthError : it is no number, or beyond `LATEST`.
    """
    if not abs(number("time", time)) <= LATEST:  # NaN is not either
        raise WideberthError(f"time is {time}; wanted the instant that is asked for")


def out_of_order(now: float, before: float, memory: float) -> tuple[str, bool]:
    """Judge the instant of a scan, s, by that of the last one.

    Returns
    -------
    What is wrong, "" where nothing is; and whether the clock has been set back, by more than
    ``memory`` s: then a tracker starts anew, since nothing would ever be new again.
    """
    if not abs(now) <= LATEST:  # NaN is not either
        return TIMELESS, False
    if now > before:
        return "", False
    back = before - now
    if back <= memory:
        return f"sightings of {now:.3f} s came after those of {before:.3f} s", False
    return f"clock went back by {back:.3g} s: all tracks are dropped", True

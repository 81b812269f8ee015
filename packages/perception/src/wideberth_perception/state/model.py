"""The planar motion model that the filters share: state, prediction, measurements."""

from collections.abc import Sequence
from math import inf, remainder, tau

import numpy as np

from wideberth.framework.values.arrays import Array, Scalar

STATE = (
    *("x", "y", "heading", "forward speed", "lateral speed", "yaw rate"),
    *("forward acceleration", "lateral acceleration", "gyro bias"),
)
"""m, m, rad, m/s, m/s, rad/s, m/s^2, m/s^2, rad/s. All but the pose are in the body frame."""
SIZE = len(STATE)
SPEED, LATERAL, YAW_RATE, FORWARD, BIAS = (3,), (4,), (5, 8), (6,), (8,)
"""What is measured: the sum of these entries of the state. A gyro reads yaw rate plus bias."""
_EYE = np.eye(SIZE)


def moved(state: Sequence[Scalar], dt: float) -> tuple[Scalar, ...]:
    """Return the state after ``dt`` s, of floats or arrays alike.

    Accelerations, yaw rate and bias stay; with c, s = cos, sin(heading)::

        u = vx dt + ax dt^2 / 2        l = vy dt + ay dt^2 / 2
        x += c u - s l    y += s u + c l    heading += yaw rate dt
        vx += ax dt       vy += ay dt

    References
    ----------
    T. Moore and D. Stouch, A generalized extended Kalman filter implementation for the Robot
    Operating System (2014), whose model in space this is in the plane, with a bias added.
    """
    x, y, heading, vx, vy, rate, ax, ay, bias = state
    cosine, sine = np.cos(heading), np.sin(heading)
    half = 0.5 * dt * dt
    ahead, aside = vx * dt + ax * half, vy * dt + ay * half
    return (
        x + cosine * ahead - sine * aside,
        y + sine * ahead + cosine * aside,
        heading + rate * dt,
        vx + ax * dt,
        vy + ay * dt,
        rate,
        ax,
        ay,
        bias,
    )


def slope(state: Sequence[float], dt: float) -> Array:
    """Return the exact derivative of `moved` by the state, (9, 9)."""
    heading, vx, vy, ax, ay = state[2], state[3], state[4], state[6], state[7]
    cosine, sine = float(np.cos(heading)), float(np.sin(heading))
    half = 0.5 * dt * dt
    ahead, aside = vx * dt + ax * half, vy * dt + ay * half
    found = _EYE.copy()
    found[0, 2:8] = (
        *(-sine * ahead - cosine * aside, cosine * dt, -sine * dt, 0.0),
        *(cosine * half, -sine * half),
    )
    found[1, 2:8] = (
        *(cosine * ahead - sine * aside, sine * dt, cosine * dt, 0.0),
        *(sine * half, cosine * half),
    )
    found[2, 5] = found[3, 6] = found[4, 7] = dt
    return found


def wrapped(heading: float) -> float:
    """Return the same direction between -pi and pi, rad."""
    return remainder(heading, tau)


def corrected(
    mean: Array,
    covariance: Array,
    entries: tuple[int, ...],
    value: float,
    variance: float,
    farthest: float = inf,
    slack: float = 0.0,
) -> tuple[Array, Array, float, float]:
    """Return mean and covariance after a measurement, and how far that was from the expected.

    The measurement is z = h . x + noise of variance R, with h one at ``entries``::

        nu = z - h . x        S = h . P h + R        K = P h / S
        x += K nu             P <- (I - K h^T) P (I - K h^T)^T + K R K^T

    The covariance in Joseph's form stays positive semi-definite under rounding. The measurement is
    linear, so that the unscented transform says the same.

    Parameters
    ----------
    mean, covariance : (9,) and (9, 9), before.
    entries : of the state, whose sum is measured.
    value, variance : z and R.
    farthest : distance beyond which the measurement is left out: mean and covariance stay.
    slack : variance that is added for this test alone, of what the model knows nothing of.

    Returns
    -------
    mean, covariance : new arrays, or those before.
    surprise : nu.
    distance : nu^2 / (S + slack).
    """
    first, *others = entries
    across = covariance[:, first]
    predicted = float(mean[first])
    for entry in others:
        across = across + covariance[:, entry]
        predicted += float(mean[entry])
    spread = sum(float(across[entry]) for entry in entries) + variance
    surprise = value - predicted
    distance = surprise * surprise / (spread + slack)
    if distance > farthest:
        return mean, covariance, surprise, distance
    gain = across / spread
    kept = _EYE.copy()
    for entry in entries:
        kept[:, entry] -= gain
    after = kept @ covariance @ kept.T
    after += (variance * gain)[:, None] * gain
    return mean + gain * surprise, after, surprise, distance


def doubted(
    covariance: Array, before: Sequence[float], dt: float, entry: int, surprise: float
) -> Array:
    """Return the covariance if an entry of the state may have jumped ``dt`` s ago.

    A measurement that is left out is either wrong, or right because the robot was pushed. With f
    the derivative of the state by what that entry was ``dt`` s before, a jump by nu gives::

        P <- P + min(nu^2, 1) f f^T

    The next measurement settles which of both it was, and corrects all that moved with it.

    Parameters
    ----------
    covariance : (9, 9), now.
    before : the state ``dt`` s before.
    entry : of the state, which was measured.
    surprise : nu.
    """
    jump = min(abs(surprise), 1.0) * slope(before, dt)[:, entry]
    return covariance + jump[:, None] * jump

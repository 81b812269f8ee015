"""How a robot drives: speed, smoothness, effort, standing. Functions of plain arrays.

All are of one robot, sampled at K instants ``step`` seconds apart (`uniform_times`):
positions (K, D), m; headings (K,), rad; yaw rates (K,), rad/s. What is differenced depends on
the step, so that only values of one step are compared.
"""

import numpy as np

from ..framework.numerics.geometry import wrapped
from ..framework.values.arrays import Array, BoolArray

SAMPLE = 0.1
"""s between samples, unless the episode's own instants are further apart."""
STILL_SPEED, STILL_TURN = 0.01, 0.02
"""m/s and rad/s, below both of which a robot does not move (HuNavSim)."""
FREEZE_SPEED = 0.04
"""m/s, below which a robot away from its goal is frozen: 0.01 m in 0.25 s (CrowdSimPlus)."""
FREEZE_TIME = 5.0
"""s on end after which the episode counts as frozen."""


def uniform_times(times: Array, last: float) -> Array:
    """Instants from 0 to ``last`` at equal distance: `SAMPLE`, or the longest interval if longer.

    So a plant that moves in straight lines of 0.25 s is seen at its corners, not in between. The
    last instant is the last multiple of the step up to ``last``.
    """
    step = max(SAMPLE, float(np.diff(times).max(initial=0.0)))
    found = step * np.arange(int(last / step + 1e-6) + 1, dtype=np.float64)
    return np.asarray(np.minimum(found, times[-1]))  # a rounding beyond the end is no instant


def velocities(positions: Array, step: float) -> Array:
    """Mean velocity between two samples, (K - 1, D), m/s."""
    return np.asarray(np.diff(positions, axis=0) / step)


def accelerations(positions: Array, step: float) -> Array:
    """Second difference of the positions over step^2, (K - 2, D), m/s^2, in the world frame.

    One definition for every robot: turning at speed v with yaw rate omega counts as v omega,
    other than in the planner's cost, which weighs the body frame's components.
    """
    return np.asarray(np.diff(positions, n=2, axis=0) / step**2)


def jerk_rms(positions: Array, step: float) -> float:
    """Root mean square of the third difference over step^3, m/s^3; NaN below four samples."""
    return root_mean_square(np.linalg.norm(np.diff(positions, n=3, axis=0), axis=1) / step**3)


def root_mean_square(values: Array) -> float:
    """Root of the mean of squares; NaN of nothing."""
    return float(np.sqrt(np.mean(np.square(values)))) if np.size(values) else float("nan")


def effort(positions: Array, yaw_rates: Array, step: float) -> float:
    """Control effort, the sum of (|a|^2 + alpha^2) step, m^2/s^3 and rad^2/s^3 added up.

    a as in `accelerations`, alpha the difference of the yaw rates over the step.
    """
    linear = np.sum(accelerations(positions, step) ** 2) * step
    return float(linear + np.sum(np.diff(yaw_rates) ** 2) / step)


def heading_change(headings: Array) -> float:
    """Cumulative change of heading, the sum of |h_{k+1} - h_k| taken into [-pi, pi], rad."""
    return float(np.sum(np.abs(wrapped(np.diff(headings)))))


def course_change(positions: Array, least: float = 1e-3) -> float:
    """Cumulative angle between successive moves, rad, for robots without heading.

    Moves shorter than ``least`` m are passed over: they have no direction.
    """
    moves = np.diff(positions, axis=0)
    long = np.linalg.norm(moves, axis=1)
    units = moves[long >= least] / long[long >= least, None]
    # The half-angle form keeps small angles, where a cosine is all but 1.
    half = np.linalg.norm(np.diff(units, axis=0), axis=1) / 2.0
    return float(2.0 * np.sum(np.arcsin(np.minimum(half, 1.0))))


def irregularity(positions: Array, headings: Array, goal: Array) -> float:
    """Mean absolute angle between where the robot points and where its goal is, rad.

    SocNavBench's path irregularity: 0 on a straight way to the goal. A robot without heading
    (NaN) points where it moves; instants at which it stands, or is at the goal, do not count.
    """
    towards = goal - positions[:-1]
    pointing = np.diff(positions, axis=0)
    if positions.shape[1] == 2 and np.isfinite(headings).all():
        pointing = np.stack([np.cos(headings[:-1]), np.sin(headings[:-1])], axis=1)
    lengths = np.linalg.norm(towards, axis=1), np.linalg.norm(pointing, axis=1)
    known = (lengths[0] > 1e-9) & (lengths[1] > 1e-6)
    if not known.any():
        return float("nan")
    one, two = (
        v[known] / n[known, None] for v, n in zip((towards, pointing), lengths, strict=True)
    )
    half = np.linalg.norm(one - two, axis=1) / 2.0
    return float(np.mean(2.0 * np.arcsin(np.minimum(half, 1.0))))


def sign_changes(yaw_rates: Array, dead: float = STILL_TURN) -> int:
    """How often the yaw rate changes its sign; rates within ``dead`` rad/s have none."""
    signs = np.sign(yaw_rates[np.abs(yaw_rates) > dead])
    return int(np.sum(signs[1:] != signs[:-1]))


def not_moving(positions: Array, yaw_rates: Array, step: float) -> float:
    """Time in which speed and yaw rate are below `STILL_SPEED` and `STILL_TURN`, s."""
    speeds = np.linalg.norm(velocities(positions, step), axis=1)
    return step * float(np.sum((speeds < STILL_SPEED) & (np.abs(yaw_rates[:-1]) < STILL_TURN)))


def frozen_steps(positions: Array, goal: Array, tolerance: float, step: float) -> BoolArray:
    """Whether the robot freezes in each step, (K - 1,): slow, and not yet at its goal.

    Slow is below `FREEZE_SPEED`; at its goal is within ``tolerance`` m of it, centre to point.
    """
    speeds = np.linalg.norm(velocities(positions, step), axis=1)
    away = np.linalg.norm(positions[:-1] - goal, axis=1) > tolerance
    return np.asarray((speeds < FREEZE_SPEED) & away, dtype=np.bool_)


def longest_run(flags: BoolArray) -> int:
    """Return the length of the longest unbroken run of true entries."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], np.asarray(flags, dtype=int), [0]])))
    return int((edges[1::2] - edges[::2]).max(initial=0))


def spectral_arc_length(speeds: Array, step: float, threshold: float = 0.05) -> float:
    """SPARC, the negative arc length of the speed profile's normalised spectrum; unit-free.

    With the magnitude M(f) = |V(f)| / |V(0)| up to the cut-off f_c, the last frequency below
    10 Hz (or half the sampling rate) at which it is at least ``threshold``::

        SPARC = -sum_k sqrt((delta f / f_c)^2 + (M(f_{k+1}) - M(f_k))^2)

    Nearer to 0 is smoother; it knows neither the scale of the speed nor of time. The spectrum is
    taken at 16 times as many frequencies as samples, padded with zeros to a power of two.
    NaN of fewer than two samples, or where the robot never moved. (Balasubramanian et al. 2015.)
    """
    if len(speeds) < 2 or not np.any(speeds):
        return float("nan")
    count = 2 ** (int(np.ceil(np.log2(len(speeds)))) + 4)
    magnitude = np.abs(np.fft.rfft(speeds, count))
    frequencies = np.fft.rfftfreq(count, step)
    magnitude = magnitude[frequencies <= 10.0] / magnitude[0]
    last = int(np.flatnonzero(magnitude >= threshold)[-1])
    if last == 0:
        return float("nan")
    jumps = np.diff(magnitude[: last + 1])
    return -float(np.sum(np.hypot(1.0 / last, jumps)))

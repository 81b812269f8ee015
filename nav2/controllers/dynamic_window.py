"""Dynamic Window Pure Pursuit: of the velocities within reach, the one nearest to an arc."""

from math import hypot

Bounds = tuple[float, float]
"""Least and largest value."""

_STILL = 1e-3
"""m/s or rad/s; also 1/m of a straight line, and the distance of equally near corners."""


def window(last: float, accel: float, decel: float, limits: Bounds, period: float) -> Bounds:
    """Return the velocities that an axis can have after a period.

    Parameters
    ----------
    last : velocity that was commanded last.
    accel, decel : how fast its magnitude rises, and falls (negative).
    limits : of the velocity.
    period : s.
    """
    if last > _STILL:
        low, high = last + decel * period, last + accel * period
    elif last < -_STILL:
        low, high = last - accel * period, last - decel * period
    else:
        low, high = last - accel * period, last + accel * period
    return max(low, limits[0]), min(high, limits[1])


def nearest_to_curvature(
    linear: Bounds, angular: Bounds, speed: float, curvature: float, sign: float
) -> tuple[float, float]:
    """Return the velocity in a window that follows an arc fastest, or comes nearest to it.

    Parameters
    ----------
    linear, angular : the window, m/s and rad/s.
    speed : m/s, regulated one, which is not exceeded.
    curvature : 1/m.
    sign : 1 forwards, -1 backwards.
    """
    slow, fast = _narrowed(linear, speed)
    low, high = angular
    if abs(curvature) < _STILL:
        straight = 0.0 if low <= 0.0 <= high else min(low, high, key=abs)
        return (fast if sign > 0.0 else slow), straight
    best: tuple[float, float] | None = None
    for v, w in (
        (slow, curvature * slow), (fast, curvature * fast), (low / curvature, low),
        (high / curvature, high),
    ):  # fmt: skip
        inside = slow <= v <= fast and low <= w <= high
        if inside and (best is None or v * sign > best[0] * sign):
            best = (v, w)
    return best or _nearest_corner((slow, fast), angular, curvature, sign)


def _narrowed(linear: Bounds, speed: float) -> Bounds:
    """Return the part of a window between 0 and a speed, or its bound that is nearest to it."""
    least, most = min(0.0, speed), max(0.0, speed)
    low, high = max(linear[0], least), min(linear[1], most)
    if low > high:
        return (low, low) if low > most else (high, high)
    return low, high


def _nearest_corner(
    linear: Bounds, angular: Bounds, curvature: float, sign: float
) -> tuple[float, float]:
    """Return the corner of a window that is nearest to the line w = curvature v."""
    best, nearest = (linear[0], angular[0]), float("inf")
    for v in linear:
        for w in angular:
            apart = abs(curvature * v - w) / hypot(curvature, 1.0)
            tie = abs(apart - nearest) <= _STILL and v * sign > best[0] * sign
            if apart < nearest or tie:
                best, nearest = (v, w), apart
    return best

"""Clipping to a symmetric limit, in plain floats: the drives of robots call it all the time."""

from collections.abc import Sequence
from math import hypot


def within(value: float, limit: float) -> float:
    """Return the number nearest to ``value`` in [-limit, limit]."""
    return min(max(value, -limit), limit)


def within_norm(vector: Sequence[float], limit: float) -> tuple[float, ...]:
    """Return the vector, shortened to the length ``limit`` if it is longer."""
    norm = hypot(*vector)
    scale = limit / norm if norm > limit else 1.0
    return tuple(scale * value for value in vector)

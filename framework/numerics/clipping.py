"""Clipping of numbers and vectors to symmetric limits, in plain floats for speed."""

from collections.abc import Sequence
from math import hypot


def within(value: float, limit: float) -> float:
    """Clip a number to [-limit, limit]."""
    return min(max(value, -limit), limit)


def within_norm(vector: Sequence[float], limit: float) -> tuple[float, ...]:
    """Shorten a vector to the length ``limit`` where it is longer."""
    norm = hypot(*vector)
    scale = limit / norm if norm > limit else 1.0
    return tuple(scale * value for value in vector)

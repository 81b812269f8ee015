"""Clipping of numbers and vectors to limits, in plain floats for speed."""

from collections.abc import Sequence
from math import hypot

import numpy as np

from ..values.arrays import Scalar


def within(value: Scalar, limit: float) -> Scalar:
    """Clip a number, or a CasADi expression, to [-limit, limit]."""
    return between(value, -limit, limit)


def between(value: Scalar, lower: float, upper: float) -> Scalar:
    """Clip a number, or a CasADi expression, to [lower, upper]."""
    if isinstance(value, float):
        return min(max(value, lower), upper)
    return np.fmin(np.fmax(value, lower), upper)


def within_norm(vector: Sequence[float], limit: float) -> tuple[float, ...]:
    """Shorten a vector to the length ``limit`` where it is longer."""
    norm = hypot(*vector)
    scale = limit / norm if norm > limit else 1.0
    return tuple(scale * value for value in vector)

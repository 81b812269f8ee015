"""Distances, perimeters and gauges of ellipses; they stand in `framework.geometry`.

The risk meter needs them too, and the framework imports none of the rooms.
"""

from ..framework.numerics.geometry import (
    UNIT_BALL,
    closest_point,
    concave_maximiser,
    distance_to_ellipse,
    mean_cubed_support,
    mean_support,
    perimeter,
    sum_gauge,
    sum_volume,
    surface,
)

__all__ = [
    "UNIT_BALL",
    "closest_point",
    "concave_maximiser",
    "distance_to_ellipse",
    "mean_cubed_support",
    "mean_support",
    "perimeter",
    "sum_gauge",
    "sum_volume",
    "surface",
]

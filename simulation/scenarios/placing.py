"""Drawing of places with room for a body."""

from collections.abc import Callable, Iterable, Sequence

import numpy as np

from ...framework.values.arrays import Array
from ...framework.values.errors import WideberthError
from ...framework.values.polygon import Polygon, separation
from ...routes.walls import box

DRAWS = 1000
"""Tries to place one body before the ranges are said to leave no room."""


def draw_place(draw: Callable[[], Array], free: Callable[[Array], bool], what: str) -> Array:
    """Draw until a place is free.

    Parameters
    ----------
    draw : returns a place, (2,), m.
    free : whether it will do.
    what : "person 3: take fewer people or a larger square", for the message.

    Raises
    ------
    WideberthError : no place was free in `DRAWS` draws.
    """
    for _ in range(DRAWS):
        place = draw()
        if free(place):
            return place
    raise WideberthError(f"in {DRAWS} draws there was no room for {what}")


def apart(place: Array, radius: float, others: Iterable[tuple[Array, float]], room: float) -> bool:
    """Whether a disc leaves ``room`` m between its surface and those of other discs.

    Parameters
    ----------
    place : (2,), m. radius : m.
    others : (place, radius) of each.
    """
    return all(float(np.hypot(*(place - other))) >= radius + size + room for other, size in others)


def wall_distance(place: Array, polygons: Sequence[Polygon]) -> float:
    """Distance of a point from the nearest polygon, m; negative inside one, inf without any."""
    nearest = np.inf
    for polygon in polygons:
        for part in polygon.parts:
            nearest = min(nearest, float(separation(place[None], part)[0]))
    return nearest


def corridor_walls(
    width: float, start: float, end: float, thickness: float = 0.2
) -> tuple[Polygon, Polygon]:
    """Walls of a corridor about the x axis, from x = ``start`` to ``end``, m."""
    half = 0.5 * width
    return (
        box((start, half), (end, half + thickness), "wall left"),
        box((start, -half - thickness), (end, -half), "wall right"),
    )

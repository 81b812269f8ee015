"""How far apart bodies and polygons were: discs, several discs, and convex outlines."""

from dataclasses import dataclass, replace
from typing import Protocol, final

import numpy as np

from ..framework.values.arrays import Array, stacked
from ..framework.values.footprint import Discs, Footprint
from ..framework.values.motion import Pose
from ..framework.values.polygon import Polygon, separation
from .episode import approach


class Moving(Protocol):
    """A body over T instants: an `AgentLog`, or part of one."""

    @property
    def radius(self) -> float:
        """Of the enclosing disc, m."""
        ...

    @property
    def footprint(self) -> Footprint | None:
        """The shape within the disc; None for the whole disc."""
        ...

    @property
    def positions(self) -> Array:
        """(T, D), m, NaN where absent."""
        ...

    @property
    def headings(self) -> Array:
        """(T,), rad."""
        ...


@final
@dataclass(frozen=True, eq=False)
class BodyMotion:
    """A body over a few instants, see `Moving`."""

    radius: float
    positions: Array
    headings: Array
    footprint: Footprint | None = None


def gaps(first: Moving, second: Moving) -> Array:
    """Clearance of two bodies in each interval between two instants, (T - 1,), m; NaN if absent.

    Negative where they overlap. Discs move in a straight line between the instants, which is
    exact; bodies of another form are compared at the instants alone.
    """
    if first.footprint is None and second.footprint is None:
        return approach(first.positions, second.positions) - first.radius - second.radius
    least = np.full(len(first.positions), np.inf)
    for one, round_one in _pieces(first):
        for two, round_two in _pieces(second):
            least = np.minimum(least, _apart(one, two) - round_one - round_two)
    return np.asarray(np.minimum(least[:-1], least[1:]))


def wall_gaps(body: Moving, polygon: Polygon) -> Array:
    """Clearance of a body from a polygon in each interval, (T - 1,), m.

    Discs move in a straight line between the instants, outlines are compared at both ends.
    """
    least = np.full(len(body.positions) - 1, np.inf)
    for piece, rounding in _pieces(body):
        ways = [piece[:-1], piece[1:]]
        if piece.shape[1] == 1:
            ways = [np.concatenate(ways, axis=1)]  # a line of two vertices
        for part in polygon.parts:
            for way in ways:
                still = np.broadcast_to(part, (len(way), *part.shape))
                least = np.minimum(least, _apart(way, still) - rounding)
    return least


def _pieces(body: Moving) -> list[tuple[Array, float]]:
    """Convex pieces (T, W, 2), m, and the radius that each is enlarged by."""
    pose = Pose(tuple(body.positions.T), body.headings)
    if body.footprint is None:
        return [(body.positions[:, None], body.radius)]
    if isinstance(body.footprint, Discs):
        places, rounding = body.footprint.centres, body.footprint.radius
        return [(stacked([pose.offset(place)]), rounding) for place in places]
    return [(replace(pose, outline=body.footprint.vertices).corner_points(), 0.0)]


def _apart(first: Array, second: Array) -> Array:
    """Signed distance at each instant, (T,); NaN where a body is absent."""
    return separation(first, second)[0]

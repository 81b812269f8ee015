"""Walls of the hallways of CrowdSimPlus: as its line segments, and as polygons."""

from dataclasses import dataclass
from itertools import pairwise
from typing import Literal, TypeAlias, final

import numpy as np

from ...framework.values.arrays import Array
from ...framework.values.polygon import Polygon
from .placing import box

Layout: TypeAlias = Literal["open", "static", "static_with_back", "bottleneck", "squeeze"]
Corners: TypeAlias = list[tuple[float, float]]

OUTSIDE = 0.2
"""m of wall behind its surface."""
THIN = 0.02
"""m, thickness of the walls that have none there and are met from both sides."""
MIDDLE = 0.4, 0.6
"""Where a static door begins and ends to be at its narrowest, as shares of its length."""
SLANT = 0.75
"""Where its slanted sides begin, as a share of the way from its edge to the wall."""
SQUEEZE = 2.5
"""Half the length of the squeezing walls over the circle's radius."""


@final
@dataclass(frozen=True)
class Hall:
    """A hallway along the y axis, with its middle in the origin.

    open          two walls.
    static        and a block on either side of the middle, which leave a door with slanted
                  jambs from y = -length to y = length.
    static_with_back  and a wall across at either end, y = -height / 2 and y = height / 2.
    bottleneck    the two walls, and a thin one across with a door in it at y = 0.
    squeeze       two walls that come nearer up to a door at y = 0, and go apart again.

    Parameters
    ----------
    layout : which of them.
    width, height : m; the straight walls go from -height to height.
    door : m, width of the door.
    length : m, half the length of a static door.
    circle_radius : m, which the squeezing walls' length hangs on.
    """

    layout: Layout
    width: float
    height: float
    door: float
    length: float
    circle_radius: float

    def polygons(self) -> tuple[Polygon, ...]:
        """Return the walls as bodies."""
        side, end, edge = 0.5 * self.width, self.height, 0.5 * self.door
        out = side + OUTSIDE
        if self.layout == "squeeze":
            far = SQUEEZE * self.circle_radius
            return _both([(side, -far), (out, -far), (out, far), (side, far), (edge, 0.0)], "wall")
        walls = _both([(side, -end), (out, -end), (out, end), (side, end)], "wall")
        if self.layout == "bottleneck":
            half = 0.5 * THIN
            return walls + _both(
                [(edge, -half), (side, -half), (side, half), (edge, half)], "jamb"
            )
        if self.layout in ("static", "static_with_back"):
            walls += _both(self._block(), "block")
        if self.layout == "static_with_back":
            back = 0.5 * self.height
            walls += (
                box((-side, back), (side, back + THIN), "back above"),
                box((-side, -back - THIN), (side, -back), "back below"),
            )
        return walls

    def lines(self) -> Array:
        """Return the segments that CrowdSimPlus has, (L, 2, 2), m: where nobody may start."""
        side, end, edge = 0.5 * self.width, self.height, 0.5 * self.door
        if self.layout == "squeeze":
            far = SQUEEZE * self.circle_radius
            right: Corners = [(side, -far), (edge, 0.0), (side, far)]
            return _segments([right, _mirrored(right)])
        right = [(side, -end), (side, end)]
        chains = [right, _mirrored(right)]
        if self.layout == "bottleneck":
            chains += [[(edge, 0.0), (side, 0.0)], [(-side, 0.0), (-edge, 0.0)]]
        elif self.layout != "open":
            chains += [self._block(), _mirrored(self._block())]
        if self.layout == "static_with_back":
            back = 0.5 * self.height
            chains += [[(-side, y), (side, y)] for y in (-back, back)]
        return _segments(chains)

    def through(self, place: Array, goal: Array) -> bool:
        """Whether a person on the way to a goal heads for the middle of the door.

        There, those whose way leads through the door do, up to half its width from its
        middle; in the open and the squeezing hallway nobody does.
        """
        if self.layout in ("open", "squeeze"):
            return False
        narrow = self.length * (MIDDLE[1] - MIDDLE[0])
        below, above = sorted((float(place[1]), float(goal[1])))
        return below < -narrow and above > narrow and float(np.hypot(*place)) > 0.5 * self.door

    def _block(self) -> Corners:
        """Corners of the block on the right, from its lower end on the wall to its upper."""
        side, edge = 0.5 * self.width, 0.5 * self.door
        slant = edge + SLANT * (side - edge)
        narrow = self.length * (MIDDLE[1] - MIDDLE[0])
        return [
            (side, -self.length), (slant, -self.length), (edge, -narrow), (edge, narrow),
            (slant, self.length), (side, self.length),
        ]  # fmt: skip


def _mirrored(corners: Corners) -> Corners:
    return [(-x, y) for x, y in corners]


def _both(corners: Corners, name: str) -> tuple[Polygon, ...]:
    """Return a polygon on the right and its mirror image on the left."""
    return (
        Polygon(tuple(corners), f"{name} right"),
        Polygon(tuple(_mirrored(corners)), f"{name} left"),
    )


def _segments(chains: list[Corners]) -> Array:
    """Segments between neighbours of each chain, (L, 2, 2)."""
    return np.array([pair for chain in chains for pair in pairwise(chain)])

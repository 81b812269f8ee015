"""The outline of a robot as Nav2 has it, and what it costs to stand somewhere."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from math import cos, hypot, pi, sin
from typing import Any, final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from wideberth.framework.plugins.njit import cached_njit
from wideberth.framework.values.arrays import Array, checked, positive
from wideberth.framework.values.costmap import Costmap
from wideberth.framework.values.errors import WideberthError

from ..costs import LETHAL

CORNERS = 16
"""Corners of the polygon that stands for a round robot."""


@final
@dataclass(frozen=True, eq=False)
class RobotFootprint:
    """The outline of a robot in its own frame, and the circles within and about it.

    Attributes
    ----------
    vertices : (V, 2), m, in order.
    use_radius : whether the robot counts as round: its centre's cost decides, not its outline's.

    Raises
    ------
    WideberthError : fewer than three vertices, or numbers that are not finite.
    """

    vertices: Array
    use_radius: bool = False

    def __post_init__(self) -> None:
        vertices = checked("footprint.vertices", self.vertices, (None, 2))
        if len(vertices) < 3:
            raise WideberthError(
                f"footprint.vertices holds {len(vertices)} places; wanted at least three"
            )
        object.__setattr__(self, "vertices", vertices)
        near, far = _circles(vertices)
        self.__dict__["_radii"] = (near, far)

    @classmethod
    def round_of(cls, radius: float, padding: float = 0.0) -> "RobotFootprint":
        """Return the polygon of 16 corners that stands for a round robot.

        Parameters
        ----------
        radius : m.
        padding : m, see `padded`.
        """
        size = positive("footprint.radius", radius)
        angles = [i * 2.0 * pi / CORNERS for i in range(CORNERS)]
        corners = np.array([[size * cos(angle), size * sin(angle)] for angle in angles])
        return cls(corners, True).padded(padding)

    @classmethod
    def of(cls, vertices: ArrayLike, padding: float = 0.0) -> "RobotFootprint":
        """Return a polygon (V, 2), m, that is padded by so much, see `padded`."""
        return cls(np.asarray(vertices, dtype=np.float64)).padded(padding)

    @property
    def inscribed(self) -> float:
        """Smallest distance of an edge from the robot's position, m."""
        return float(self.__dict__["_radii"][0])

    @property
    def circumscribed(self) -> float:
        """Largest distance of a vertex from the robot's position, m."""
        return float(self.__dict__["_radii"][1])

    def padded(self, padding: float) -> "RobotFootprint":
        """Move each coordinate away from zero by ``padding``, m; one of exactly zero stays.

        The corners of a round robot that should lie on the axes lie a rounding error beside
        them, so that they move along both, as in Nav2.
        """
        moved = self.vertices + positive("footprint.padding", padding, zero=True) * np.sign(
            self.vertices
        )
        return RobotFootprint(moved, self.use_radius)

    def at(self, pose: Array) -> Array:
        """Vertices (V, 2), m, of the robot at a pose (3,)."""
        x, y, yaw = (float(value) for value in pose)
        cosine, sine = cos(yaw), sin(yaw)
        ahead, aside = self.vertices[:, 0], self.vertices[:, 1]
        return np.stack(
            [x + (ahead * cosine - aside * sine), y + (ahead * sine + aside * cosine)], axis=1
        )

    def cost(self, costmap: Costmap, pose: Array) -> int:
        """Highest cost on the edges of the outline at a pose (3,).

        254 where a vertex is off the map, or on the first lethal cell; else 255 counts as higher
        than 254.
        """
        left, low = costmap.origin
        return int(
            compiled()[0](
                costmap.cells, left, low, costmap.resolution, self.vertices, float(pose[0]),
                float(pose[1]), float(pose[2]),
            )
        )  # fmt: skip


def _circles(vertices: Array) -> tuple[float, float]:
    """Return the radii of the circles within and about a polygon, m."""
    nearest, farthest = np.inf, 0.0
    for begin, end in zip(vertices, np.roll(vertices, -1, axis=0), strict=True):
        nearest = min(nearest, hypot(*begin), _edge_distance(begin, end))
        farthest = max(farthest, hypot(*begin))
    return nearest, farthest


def _edge_distance(begin: Array, end: Array) -> float:
    """Distance of the origin from a straight edge, m."""
    step = end - begin
    square = float(step @ step)
    share = min(max(-float(begin @ step) / square, 0.0), 1.0) if square else 0.0
    return hypot(*(begin + share * step))


def line_cost(cells: NDArray[np.uint8], x0: int, y0: int, x1: int, y1: int) -> int:
    """Return the highest cost on the cells of a straight line, or the first lethal one."""
    dx, dy = abs(x1 - x0), abs(y1 - y0)
    right, up = 1 if x1 >= x0 else -1, 1 if y1 >= y0 else -1
    steep = dx < dy
    whole, part = (dy, dx) if steep else (dx, dy)
    share, x, y, highest = whole // 2, x0, y0, 0
    for _ in range(whole + 1):
        cost = int(cells[y, x])
        if cost == LETHAL:
            return cost
        highest = max(highest, cost)
        share += part
        aside = share >= whole
        if aside:
            share -= whole
        if steep or aside:
            y += up
        if not steep or aside:
            x += right
    return highest


def outline_cost(
    cells: NDArray[np.uint8], left: float, low: float, resolution: float,
    vertices: Array, x: float, y: float, yaw: float, back: bool = False,
) -> int:  # fmt: skip
    """Return the highest cost on the edges of a polygon; see `RobotFootprint.cost`.

    The last edge runs from the first vertex to the last one, or ``back`` from there to the first.
    """
    high, wide = cells.shape
    count = len(vertices)
    places = np.empty((count, 2), np.int64)
    cosine, sine = np.cos(yaw), np.sin(yaw)
    for i in range(count):
        px = x + (vertices[i, 0] * cosine - vertices[i, 1] * sine)
        py = y + (vertices[i, 0] * sine + vertices[i, 1] * cosine)
        if not (px >= left and py >= low):
            return LETHAL
        mx, my = int((px - left) / resolution), int((py - low) / resolution)
        if mx >= wide or my >= high:
            return LETHAL
        places[i, 0], places[i, 1] = mx, my
    highest = 0
    for i in range(count):
        begin, end = i, (i + 1) % count
        if end == 0 and not back:
            begin, end = end, begin
        cost = line_cost(cells, places[begin, 0], places[begin, 1], places[end, 0], places[end, 1])
        if cost == LETHAL:
            return LETHAL
        highest = max(highest, cost)
    return highest


def outline_costs(
    costmap: Costmap, vertices: Array, poses: Array, back: bool = False
) -> NDArray[np.int64]:
    """Return the highest cost on the edges of a polygon at each pose, (P,).

    See `RobotFootprint.cost`.

    Parameters
    ----------
    vertices : (V, 2), m, in the body's frame.
    poses : (P, 3), m and rad.
    back : draw the last edge from the last vertex to the first. The cells of a line depend on
        where it begins; the last edge of Nav2's own checks runs from the first to the last.
    """
    left, low = costmap.origin
    found = compiled()[1](costmap.cells, left, low, costmap.resolution, vertices, poses, back)
    return np.asarray(found)


def each_outline(
    cells: NDArray[np.uint8], left: float, low: float, resolution: float, vertices: Array,
    poses: Array, back: bool,
) -> NDArray[np.int64]:  # fmt: skip
    """Return the cost of every pose, see `outline_costs`."""
    found = np.empty(len(poses), np.int64)
    for k in range(len(poses)):
        x, y, yaw = poses[k]
        found[k] = outline_cost(cells, left, low, resolution, vertices, x, y, yaw, back)
    return found


@cache
def compiled() -> tuple[Callable[..., Any], ...]:
    """Return `outline_cost` and `each_outline` as Numba compiles them."""
    return cached_njit([outline_cost, each_outline], [line_cost, outline_cost])

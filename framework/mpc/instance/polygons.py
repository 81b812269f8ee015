"""From static polygons to the numbers of one MPC instance."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...static_region import StaticRegion
from ...values.arrays import Array
from ...values.errors import WideberthError
from ...values.polygon import MOST_CORNERS, Polygon, separation
from ..ocp.problem import Parameters
from .obstacles import CAPACITIES

CORNERS = (4, 6, 8, 12, MOST_CORNERS)
"""Vertices that problems are compiled for; a convex part with fewer repeats its last one."""


@dataclass(frozen=True, eq=False)
class Walls:
    """Convex polygons that the plan has to keep clear of.

    Attributes
    ----------
    parts : (S, V, 2), m, counter-clockwise, V one of `CORNERS`.
    names : of the polygons that they are parts of, S of them.
    known : (M, V', 2), m, all parts there are, and `known_names`, M of them.
    left_out : names of those with a part within reach that did not fit.
    """

    parts: Array
    names: tuple[str, ...]
    known: Array
    known_names: tuple[str, ...]
    left_out: tuple[str, ...] = ()

    def __len__(self) -> int:
        """Count the parts."""
        return len(self.names)


_EMPTY = np.zeros((0, CORNERS[0], 2))
NONE = Walls(_EMPTY, (), _EMPTY, ())
"""No polygon at all."""


def choose_walls(
    polygons: Sequence[Polygon],
    region: StaticRegion | None,
    route: Array,
    reach: float,
    most: int,
) -> Walls:
    """Keep the convex parts that come closest to the route, at most ``most`` of them.

    Parameters
    ----------
    polygons : cut into convex parts here.
    region : what keeps clear of them.
    route : (R, D), m, places where the robot is or may soon be.
    reach : m; what is farther from the route than this is not looked at: it comes into the
        problem once the robot, its reference or its last plan is nearer.
    most : how many parts the problem can hold.

    Raises
    ------
    WideberthError : there is no such region, or the robot does not move in the plane.
    """
    if not polygons:
        return NONE
    if region is None:
        raise WideberthError(
            f"{len(polygons)} static polygons are observed, and planner.static_region is not "
            "set; set it, for example to separating_line"
        )
    if route.shape[1] != 2:
        raise WideberthError(
            f"polygons lie in the plane; the robot moves in {route.shape[1]} dimensions"
        )
    cut = [part for polygon in polygons for part in polygon.parts]
    names = tuple(polygon.name for polygon in polygons for _ in polygon.parts)
    known = np.stack([padded(part, CORNERS[-1]) for part in cut])
    away = separation(route[:, None, None], known)[0].min(axis=0)
    near = [int(i) for i in np.argsort(away, kind="stable") if away[i] <= reach]
    kept = sorted(near[:most])
    largest = max((len(cut[i]) for i in kept), default=0)
    room = next(size for size in CORNERS if size >= largest)
    left_out = tuple(dict.fromkeys(names[i] for i in near[most:]))
    return Walls(known[kept][:, :room], tuple(names[i] for i in kept), known, names, left_out)


def padded(part: Array, room: int) -> Array:
    """Repeat the last vertex until there are ``room`` of them, (V, 2)."""
    return np.concatenate([part, np.repeat(part[-1:], room - len(part), axis=0)])


def fill_walls(
    parameters: Parameters,
    walls: Walls,
    region: StaticRegion,
    margin: float,
    spread: Array,
) -> Parameters:
    """Add polygons to an instance; there is room for as many as the next of `CAPACITIES`.

    Parameters
    ----------
    parameters : without polygons.
    walls, region : the polygons, and what keeps clear of them.
    margin : m, radius of the robot's bodies and what is added to it.
    spread : (N, 2, 2), m^2, the robot's own covariance times the squared level.
    """
    steps, used = len(parameters.level), len(walls)
    if not used:
        return parameters
    capacity = next(size for size in CAPACITIES if size >= used)
    # Empty slots hold a finite dummy, see `instance.fill`.
    dummy = padded(np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]), walls.parts.shape[1])
    parts = np.concatenate([walls.parts, np.repeat(dummy[None], capacity - used, axis=0)])
    shape = (steps, capacity)
    numbers = region.parameters(
        np.broadcast_to(parts, (*shape, *dummy.shape)),
        np.broadcast_to(margin, shape),
        np.broadcast_to(spread[:, None], (*shape, 2, 2)),
    )
    return replace(
        parameters, statics=numbers, static_active=(np.arange(capacity) < used).astype(np.float64)
    )

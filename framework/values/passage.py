"""Whether a disc finds a way along a path between discs and polygons that stand still."""

from collections.abc import Iterable, Sequence

import numpy as np

from .arrays import Array
from .path import Path
from .polygon import Polygon

BESIDE = 3.0
"""m beside the path, beyond which no way round is looked for."""


def passable(
    path: Path,
    begin: float,
    end: float,
    radius: float,
    discs: Sequence[tuple[Array, float]],
    polygons: Iterable[Polygon],
) -> bool:
    """Return whether a disc gets from one place of a path in the plane to a later one.

    The ground within `BESIDE` of that stretch of the path, less all obstacles grown by the
    disc's radius, has a connected part near both places.

    Parameters
    ----------
    path : in the plane. begin, end : m along it.
    radius : m, of the disc, with the distance that it keeps.
    discs : position, (2,), and radius, m, of each. polygons : that are obstacles as well.
    """
    import shapely

    inner = path.arc[(path.arc > begin) & (path.arc < end)]
    points = path.at(np.concatenate([[begin], inner, [end]]))
    ground = shapely.LineString(points).buffer(BESIDE + radius)
    solid = [shapely.Point(center).buffer(size + radius) for center, size in discs]
    solid += [shapely.Polygon(polygon.points).buffer(radius) for polygon in polygons]
    near = [obstacle for obstacle in solid if obstacle.intersects(ground)]
    free = shapely.get_parts(ground.difference(shapely.union_all(near)))
    both = [shapely.Point(place).buffer(radius) for place in (points[0], points[-1])]
    return any(all(part.intersects(place) for place in both) for part in free)

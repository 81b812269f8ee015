"""Beams that end on what a map shows are left out before anything is detected."""

from collections.abc import Iterable
from dataclasses import dataclass, field
from functools import partial
from typing import ClassVar, final

import numpy as np

from wideberth.framework.plugins.config import build
from wideberth.framework.values.arrays import Array
from wideberth.framework.values.errors import WideberthError
from wideberth.framework.values.polygon import Polygon
from wideberth.framework.values.sensing import Scan
from wideberth.simulation.sensing.perceived import Sightings

from ..detector import Detector
from .hits import without
from .segments import with_static

TOLERANCE = 0.2
"""m; more than the error of the pose in the map and of a range together."""


@final
@dataclass(eq=False)
class OutsideMap(Detector):
    """Detects what a map does not show.

    Points within `TOLERANCE` of a polygon are static: they take no part in the detection of
    ``detector``. A person within that distance of a wall is not detected.

    Parameters
    ----------
    detector : finds bodies in what is left.
    polygons : of the map, in the frame of the poses.

    Raises
    ------
    WideberthError : something else than polygons.
    """

    reference: ClassVar[str] = ""

    detector: Detector = field(default_factory=partial(build, "detectors", "discs"))
    polygons: tuple[Polygon, ...] = ()

    def __post_init__(self) -> None:
        self.polygons = _all_polygons(self.polygons)

    def reset(self) -> None:
        """Forget what the inner detector remembers."""
        self.detector.reset()

    def detect(self, scan: Scan, poses: Array) -> Sightings:
        """Find what the map does not show; see `Detector.detect`."""
        beams = scan.beams(poses)
        shown = beams.met
        if self.polygons:
            shown[shown] = _distance(beams.ends[shown], self.polygons) < TOLERANCE
        else:
            shown[:] = False
        found = self.detector.detect(without(scan, shown), poses)
        return with_static(found, scan, poses, shown)


def _all_polygons(values: Iterable[Polygon]) -> tuple[Polygon, ...]:
    found = tuple(values)
    for one in found:
        if not isinstance(one, Polygon):
            raise WideberthError(
                f"outside_map.polygons holds a {type(one).__name__}; wanted Polygon"
            )
    return found


def _distance(points: Array, polygons: Iterable[Polygon]) -> Array:
    """Distance of points from the nearest polygon, (n,), m; 0 inside one."""
    import shapely

    shapes = [shapely.Polygon(polygon.points) for polygon in polygons]
    places = np.asarray(shapely.points(points))[:, None]
    return np.asarray(shapely.distance(places, shapes).min(axis=1))

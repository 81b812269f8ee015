"""A route through waypoints, around walls, and around people who stand in its way."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import partial
from math import sqrt
from typing import NamedTuple, final

import numpy as np
from numpy.typing import ArrayLike

from ..framework.route_planner import Route, RoutePlanner
from ..framework.values.arrays import Array, checked, checked_rows, number, positive
from ..framework.values.costmap import INSCRIBED, LETHAL, Costmap
from ..framework.values.errors import WideberthError
from ..framework.values.motion import Detection
from ..framework.values.path import Path
from ..framework.values.polygon import Polygon
from .inflation import Inflation
from .polygons import grid_of_polygons
from .replanning import rest_of
from .smoothed import SmoothedRoutes

STILL = 0.3
"""m, within which a person has to stay to be one who stands."""
SLOPE, STEEPNESS = 1.0, 3.0
"""m beyond the clearance over which walls still cost, and 1/m, how fast that falls."""
BEYOND = 1.0
"""m, by which the map reaches beyond the robot at the outermost place."""

MOST = 2000
"""Cells along either side of the map, beside its margin; they are larger where walls reach far."""


class _Stay(NamedTuple):
    """A person in one place: where, (2,) m, of what radius, m, since when, s."""

    place: Array
    radius: float
    since: float

    def holds(self, position: Array) -> bool:
        """Tell whether a position, (2,) m, is still in that place."""
        return bool(np.hypot(*(position - self.place)) <= STILL)


@final
@dataclass(eq=False)
class Rerouting:
    """Keeps a route until people who stand block it, and then looks for another one.

    Each leg from waypoint to waypoint is planned on a map of cells with the first clearance of
    which there is a way, and keeps radius + clearance from walls. An end of a leg that is nearer
    to them is moved by up to the radius. Where there is no way with any clearance, the leg is
    straight, and the reason of the route says so.

    A route is planned anew for other waypoints, where a person who has stood for ``patience`` s
    leaves less than the radius beside the rest of the path, and where the robot has come farther
    than its radius from the path: a wall may be between. It then leads to the waypoints that lie
    ahead on the old one, so that a robot which was pushed past a waypoint does not turn back to
    it, and people who stand are obstacles like walls. If there is no other way, the old route
    stays; the next attempt follows after ``patience`` s.

    Parameters
    ----------
    walls : what stands still. radius : m, of the robot.
    clearances : m, beside the radius, in the order in which they are tried. Cells are coarse: with
        ``resolution`` of 0.1 m a way with a clearance of 0 is 0.28 m wider than the robot, and
        one of -0.1 m leaves it to the planner whether the robot fits.
    resolution : m, of the cells. patience : s.
    planner : finds the legs.

    Raises
    ------
    WideberthError : a number that is not above 0; no clearance, or one of -radius or less.

    Examples
    --------
    >>> from wideberth import walls_of_segments
    >>> rerouting = Rerouting(walls_of_segments([[3, -5, 3, 2], [6, -2, 6, 5]]), radius=0.4)
    >>> route = rerouting.update(0.0, (0.0, 0.0), [(4.5, 0.0), (9.0, 0.0)])
    >>> route.path.length > 10.0, rerouting.update(0.1, (0.1, 0.1), [(9.0, 0.0)]) is route
    (True, True)
    """

    walls: tuple[Polygon, ...]
    radius: float
    clearances: tuple[float, ...] = (0.35, 0.15, 0.0, -0.1)
    resolution: float = 0.1
    patience: float = 3.0
    planner: RoutePlanner = field(default_factory=partial(SmoothedRoutes, length=0.5))
    _bare: Costmap | None = field(default=None, init=False, repr=False)
    _maps: dict[float, Costmap] = field(default_factory=dict, init=False, repr=False)
    _stays: dict[str, _Stay] = field(default_factory=dict, init=False, repr=False)
    _route: Route | None = field(default=None, init=False, repr=False)
    _waypoints: Array = field(default_factory=lambda: np.empty((0, 2)), init=False, repr=False)
    _tried: float = field(default=0.0, init=False, repr=False)

    def __post_init__(self) -> None:
        for name in ("radius", "resolution", "patience"):
            positive(f"rerouting.{name}", getattr(self, name))
        if not self.clearances or not all(
            -self.radius < number("rerouting.clearances", one) < np.inf for one in self.clearances
        ):
            raise WideberthError(
                f"rerouting.clearances is {self.clearances}; wanted at least one, each finite and "
                f"above -radius = {-self.radius:g} m"
            )

    def update(
        self,
        time: float,
        position: ArrayLike,
        waypoints: ArrayLike,
        people: Sequence[Detection] = (),
    ) -> Route:
        """Return the route to follow from now on: the same object while it stays.

        Parameters
        ----------
        time : s.
        position : (2,), m, of the robot.
        waypoints : (W, 2), m, those that are still to be passed, in order; that some have been
            passed since the last call is no reason to plan anew.
        people : who is seen now, by identity.
        """
        here = checked("position", position, (2,), finite=False)
        targets = checked_rows("waypoints", waypoints, 2)
        standing = self._standing(time, people)
        if not np.isfinite(here).all():
            return self._route or Route(None, f"the robot's position is {here.tolist()}")
        rest = self._waypoints[max(len(self._waypoints) - len(targets), 0) :]
        known = self._route is not None and self._route.path is not None
        if self._route is None or not (known and np.array_equal(rest, targets)):
            self._route, self._waypoints = self._planned(here, targets, [])[0], targets
            self._tried = -np.inf
        since = time - self._tried
        if not 0.0 <= since < self.patience and self._left(self._route.path, here, standing):
            self._tried = time
            found, whole = self._planned(here, self._ahead(here, targets), standing)
            self._route = found if whole else self._route
        return self._route

    def _standing(self, time: float, people: Sequence[Detection]) -> list[_Stay]:
        """Return who has stood in one place for long enough."""
        stays = {}
        for one in people:
            if one.flaw:
                continue
            stay = self._stays.get(one.ident)
            if stay is None or time < stay.since or not stay.holds(one.position):
                stay = _Stay(one.position, one.radius, time)
            stays[one.ident] = stay
        self._stays = stays
        return [stay for stay in stays.values() if time - stay.since >= self.patience]

    def _ahead(self, here: Array, targets: Array) -> Array:
        """Return the waypoints that the rest of the path leads to; the last one always."""
        import shapely

        path = None if self._route is None else self._route.path
        rest = targets[:0] if path is None else rest_of(path, here)
        if len(rest) < 2:
            return targets[-1:]
        away = np.asarray(shapely.distance(shapely.LineString(rest), shapely.points(targets)))
        to_come = np.asarray(away <= self.radius)
        to_come[-1:] = True
        return targets[to_come]

    def _left(self, path: Path | None, here: Array, standing: list[_Stay]) -> bool:
        """Tell whether the robot has left a path, or the rest of it leads into people."""
        import shapely

        if path is None:
            return False
        ahead = rest_of(path, here)
        line = shapely.LineString(ahead) if len(ahead) > 1 else shapely.Point(*ahead)
        if shapely.distance(line, shapely.Point(here)) > self.radius:
            return True
        rooms = (self.radius + stay.radius for stay in standing)
        gaps = (shapely.distance(line, shapely.Point(stay.place)) for stay in standing)
        return any(gap < room for gap, room in zip(gaps, rooms, strict=True))

    def _planned(self, here: Array, targets: Array, standing: list[_Stay]) -> tuple[Route, bool]:
        """Return the route through waypoints, and whether there is a way on all of its legs."""
        self._cover(np.concatenate([here[None], targets]))
        maps = {} if standing else self._maps
        pieces, missing = [here[None]], []
        for i, target in enumerate(targets):
            leg = self._leg(pieces[-1][-1], target, standing, maps)
            missing += [i] * (leg is None)
            pieces.append(target[None] if leg is None else leg)
        points = np.concatenate(pieces)
        moved = np.diff(points, axis=0, prepend=np.nan).any(axis=1)  # NaN counts as moved
        if moved.sum() < 2:
            return Route(None, "the robot is at the last waypoint"), False
        words = f"no way leads to waypoint {missing[0]}: the path is straight" if missing else ""
        return Route(Path(points[moved]), words), not missing

    def _leg(
        self, start: Array, end: Array, standing: list[_Stay], maps: dict[float, Costmap]
    ) -> Array | None:
        """Return the points of a way from start to end, (P, 2) m, with the first clearance."""
        for clearance in self.clearances:
            if clearance not in maps:
                maps[clearance] = self._inflated(clearance, standing)
            costmap = maps[clearance]
            first, last = (_freed(costmap, place, self.radius) for place in (start, end))
            if first is None or last is None:
                continue
            if np.hypot(*(last - first)) <= costmap.resolution:
                return last[None]
            path = self.planner.plan(costmap, first, last).path
            if path is not None:
                return np.array(path.points)
        return None

    def _cover(self, places: Array) -> None:
        """Draw the map of the walls, where there is none that holds the places, (K, 2) m."""
        if self._bare is None or not self._bare.inside(places).all():
            beyond = self.radius + max(self.clearances) + BEYOND
            points = np.concatenate([places, *(wall.points for wall in self.walls)])
            side = max(self.resolution, float(np.ptp(points, axis=0).max()) / MOST)
            grid = grid_of_polygons(self.walls, places, beyond, side)
            self._bare, self._maps = Costmap.from_grid(grid), {}

    def _inflated(self, clearance: float, standing: list[_Stay]) -> Costmap:
        """Return the costs around walls and people who stand."""
        bare = self._bare
        assert bare is not None
        cells, corner = np.array(bare.cells), sqrt(0.5) * bare.resolution
        if standing:
            rows, columns = np.mgrid[: bare.height, : bare.width]
            centres = bare.map_to_world(np.stack([columns, rows], axis=-1))
            for stay in standing:
                away = np.linalg.norm(centres - stay.place, axis=-1)
                cells[away <= stay.radius + corner] = LETHAL
        inscribed = self.radius + clearance + 2.0 * corner
        layer = Inflation(inscribed, inscribed + SLOPE, STEEPNESS)
        return layer.inflated(Costmap(cells, bare.resolution, bare.origin))


def _freed(costmap: Costmap, place: Array, farthest: float) -> Array | None:
    """Return a place, (2,) m, or the nearest free cell's centre; None if that is too far away."""
    if costmap.at(place, outside=LETHAL) < INSCRIBED:
        return place
    free = costmap.map_to_world(np.argwhere(costmap.cells < INSCRIBED)[:, ::-1])
    away = np.linalg.norm(free - place, axis=1)
    return free[away.argmin()] if away.min(initial=np.inf) <= farthest else None

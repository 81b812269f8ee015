"""A wrapper: leads a robot around a crowd where the way through costs more than the way around."""

from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from math import ceil, hypot, pi, sqrt
from typing import Protocol, final, runtime_checkable

import numpy as np

from ..framework.control.command_limits import top_speed, within_bounds
from ..framework.controller import (
    Controller,
    DrivesRobot,
    checked_path,
    checked_ready,
    checked_use,
    noted,
    own_copy,
    usable,
)
from ..framework.robot import Robot
from ..framework.tracking.stand_ins import sound
from ..framework.values.arrays import Array, positive
from ..framework.values.costmap import MAX_NON_OBSTACLE, Costmap
from ..framework.values.errors import WideberthError
from ..framework.values.motion import Command, Observation
from ..framework.values.path import Path
from ..framework.values.path_progress import PathProgress
from ..framework.values.plan import Plan
from ..framework.values.polygon import Polygon
from ..people.convex_area import ConvexArea, Corners, checked_area
from .inflation import Inflation
from .navfn import NavFn
from .polygons import grid_of_polygons
from .smoothed import SmoothedRoutes

FEWEST = 3
"""People that make a crowd."""
FORGET = 5.0
"""s after which a crowd is forgotten of which too few are seen."""
LONGEST = 60.0
"""s of looks that a crowd is known by; those before count less and less."""
STRIDE = 1.0
"""s over which people's speed is measured."""
WALK = 1.3
"""m/s, people's speed before it is measured."""
SETTLING = 3.0
"""s that the first look counts for."""
BLUR = 0.5
"""m, least deviation of a crowd along any axis."""
WORTH = 0.3
"""s by which people have to make the path dearer for a way around them to be taken."""
EVERY = 1.0
"""s between two looks for a way."""
CELL = 0.25
"""m, of the map, or larger, so that there are at most `MOST` along a side."""
MOST = 200
AHEAD = 25.0
"""m of the path that a way may take the place of."""
GRID = 64
"""Places along either side by which a density is integrated."""
SMOOTH = 0.5
"""m over which ways are averaged."""
SLIVER = 1e-4
"""m^2, of a wall; what is less is no part of it."""


@final
@dataclass(frozen=True, eq=False)
class WatchedCrowd:
    """Where people are on average: a cloud, and how many and how fast they are.

    With mean mu and covariance S of the places of n people the density at a place p is::

        rho(p) = n / (3 pi sqrt(det S)) max(0, 1 - m(p) / 6)     m(p) = (p - mu)^T S^-1 (p - mu)

    which has this mean and this covariance and ends at an ellipse: people who walk from place to
    place in an area are rare at its border.

    Attributes
    ----------
    stamp : s, of the last look.
    span : s, for which it has been looked at.
    count : n, at the last look.
    mean, square : (2,) in m and (2, 2) in m^2, first and second moments about the origin.
    speed : m/s, of the people. radius : m, their mean radius at the last look.
    past : identity -> stamp and place of a look `STRIDE` s ago, by which speed is measured.
    area : in which they are known to walk; None where the cloud is all that is known.
    """

    stamp: float
    span: float
    count: int
    mean: Array
    square: Array
    speed: float
    radius: float
    past: dict[str, tuple[float, Array]]
    area: "AreaOfPeople | None" = None

    @classmethod
    def seen(
        cls, before: "WatchedCrowd | None", stamp: float, people: dict[str, Array], radius: float
    ) -> "WatchedCrowd | None":
        """Return the crowd after a look; the looks of the last `LONGEST` s count alike.

        Parameters
        ----------
        before : None where there was no crowd yet.
        people : identity -> place, (2,), m. radius : m, their mean radius.
        """
        if before is not None and not 0.0 <= stamp - before.stamp <= FORGET:
            before = None
        if len(people) < FEWEST:
            return before
        places = np.array(list(people.values()))
        mean, square = places.mean(axis=0), places.T @ places / len(places)
        if before is None:
            past = _marks({}, stamp, people)
            return cls(stamp, 0.0, len(places), mean, square, WALK, radius, past)
        span = min(before.span + stamp - before.stamp, LONGEST)
        share = (stamp - before.stamp) / (span + SETTLING)
        speed, walked = before.speed, _speed(before.past, stamp, people)
        if walked is not None:
            speed += min(0.1, share) * (walked - speed)
        return cls(
            stamp,
            span,
            len(places),
            before.mean + share * (mean - before.mean),
            before.square + share * (square - before.square),
            speed,
            radius,
            _marks(before.past, stamp, people),
        )

    @property
    def covariance(self) -> Array:
        """S, (2, 2), m^2, no smaller than `BLUR` along any axis."""
        spread = self.square - np.outer(self.mean, self.mean)
        return np.asarray(spread + BLUR**2 * np.eye(2))

    def density(self, places: Array) -> Array:
        """People per m^2 at places (..., 2), (...)."""
        if self.area is not None:
            return self.count * self.area.share(places)
        spread = self.covariance
        apart = places - self.mean
        inner = np.einsum("...i,ij,...j->...", apart, np.linalg.inv(spread), apart)
        peak = self.count / (3.0 * pi * sqrt(float(np.linalg.det(spread))))
        return np.asarray(peak * np.maximum(1.0 - inner / 6.0, 0.0))


@final
@dataclass(frozen=True, eq=False)
class AreaOfPeople:
    """A known convex area in which people walk from place to place.

    Their density rises from 0 at the border: 1 - (1 - depth / deepest)^2, over its integral.

    Attributes
    ----------
    area : its borders. deepest : m, greatest depth. integral : m^2.
    """

    area: ConvexArea
    deepest: float
    integral: float

    @classmethod
    def of(cls, corners: Array) -> "AreaOfPeople":
        """Return that of the corners (V, 2), m, of a convex outline."""
        low, size = corners.min(axis=0), np.ptp(corners, axis=0)
        shares = (np.arange(GRID) + 0.5) / GRID
        places = low + size * np.stack(np.meshgrid(shares, shares), axis=-1)
        area = ConvexArea.around(corners, 0.0)
        depth = area.depth(places)
        deepest = float(depth.max())
        return cls(area, deepest, float(_rise(depth / deepest).mean() * size.prod()))

    def share(self, places: Array) -> Array:
        """Share of the people per m^2 at places (..., 2), (...)."""
        return np.asarray(_rise(self.area.depth(places) / self.deepest) / self.integral)


def _rise(share: Array) -> Array:
    return np.asarray(1.0 - (1.0 - np.clip(share, 0.0, 1.0)) ** 2)


def _marks(
    past: dict[str, tuple[float, Array]], stamp: float, people: dict[str, Array]
) -> dict[str, tuple[float, Array]]:
    """Return by which places speed is measured from now on."""
    kept = {}
    for name, place in people.items():
        mark = past.get(name)
        old = mark is None or stamp - mark[0] >= STRIDE
        kept[name] = (stamp, place) if mark is None or old else mark
    return kept


def _speed(
    past: dict[str, tuple[float, Array]], stamp: float, people: dict[str, Array]
) -> float | None:
    """Return the mean speed of those who were seen `STRIDE` s ago, m/s; None for none."""
    speeds = [
        hypot(*(people[name] - place)) / (stamp - since)
        for name, (since, place) in past.items()
        if name in people and stamp - since >= STRIDE
    ]
    return sum(speeds) / len(speeds) if speeds else None


@runtime_checkable
class HasReferenceSpeed(Protocol):
    """A controller that states at which speed it follows its path."""

    @property
    @abstractmethod
    def reference_speed(self) -> float:
        """Speed along the path, m/s."""


@dataclass(eq=False)
class _Memory:
    """What the wrapper holds between two calls."""

    path: Path | None = None
    progress: PathProgress | None = None
    crowd: WatchedCrowd | None = None
    looked: float = -np.inf
    note: str = ""
    away: bool = False


@final
@dataclass(frozen=True, eq=False)
class AroundCrowds(Controller):
    """Lets another controller drive, on the way through or around a crowd that costs least.

    A metre at a place p costs, in s, with the robot's speed v, radius r, the people's speed w
    and their radius q, the mean of those seen::

        1 / v + price 2 (r + q) sqrt(1 + (w / v)^2) rho(p)

    where rho is the density of `WatchedCrowd`, learnt from the first decision on, or that of
    `AreaOfPeople`: the time, and the price of the encounters to expect on that metre. Every
    `EVERY` s the way of least cost from the robot to its goal, or to the place `AHEAD` m along its
    path, is sought on a map that holds the walls. The other controller follows it and then the
    rest of the path; but where people add less than `WORTH` s to the path, or no way costs
    less, it follows the path.

    Parameters
    ----------
    controller : of any kind that knows its robot, in the plane; the wrapper drives a copy.
    price : s that an encounter within a crowd is worth, since some end in a contact.
    area : corners of the convex area that people do not leave, m; none if it is to be learnt.

    Raises
    ------
    WideberthError : a controller that does not know its robot, a robot in space, or a number
        out of range.
    """

    controller: Controller
    price: float = 9.0
    area: Corners = ()
    _memory: _Memory = field(init=False, repr=False, default_factory=_Memory)

    def __post_init__(self) -> None:
        own = own_copy(self.controller, "around_crowds.controller")
        if self.robot.dimension != 2:
            raise WideberthError(
                f"around_crowds leads robots in the plane; {type(self.robot).__name__} moves in "
                f"{self.robot.dimension} dimensions: leave the wrapper out"
            )
        positive("around_crowds.price", self.price)
        checked_area("around_crowds.area", self.area)
        object.__setattr__(self, "controller", own)

    @property
    def robot(self) -> Robot:
        """The robot of the other controller."""
        assert isinstance(self.controller, DrivesRobot)
        return self.controller.robot

    @property
    def period(self) -> float:  # type: ignore[override]
        """Time between two calls, s, as of the other controller."""
        return self.controller.period

    def reset(self) -> None:
        """Forget everything but settings and path."""
        memory = self._memory
        memory.progress, memory.crowd, memory.looked, memory.note = None, None, -np.inf, ""
        self.controller.reset()
        if memory.path is not None:
            self.set_path(memory.path)

    def set_path(self, path: Path) -> None:
        """Follow this path from now on."""
        path, memory = checked_path(self.robot, path), self._memory
        memory.path, memory.progress = path, (memory.progress or PathProgress(path)).on(path)
        memory.looked, memory.away, memory.note = -np.inf, False, ""
        self.controller.set_path(path)

    def remember(self, observation: Observation) -> None:
        """Take note of what is seen without deciding."""
        self.controller.remember(observation)

    def command(self, observation: Observation) -> Command:
        """Decide as the other controller does, on the path or on the way around.

        Raises
        ------
        WideberthError : wrong use, see `Controller`.
        """
        checked_ready(self._memory.progress)
        checked_use(self.robot, observation)
        if usable(observation):
            try:
                self._look(observation)
            except Exception as error:
                self._memory.note = f"no way around the crowd was sought: {error}"
        return self.controller.command(observation)

    @property
    def last_plan(self) -> Plan | None:
        """The other controller's plan; its reason says where it goes around a crowd."""
        return noted(self.controller.last_plan, self._memory.note)

    def _look(self, observation: Observation) -> None:
        """Look at the crowd, and from time to time for a way."""
        memory, robot = self._memory, self.robot
        state = within_bounds(robot, observation.state)
        here = np.array(robot.pose(tuple(state)).position, dtype=np.float64)
        seen = sound(observation, 2, here=here).detections
        people = {one.ident: np.asarray(one.position) for one in seen}
        radius = float(np.mean([one.radius for one in seen])) if seen else 0.0
        memory.crowd = WatchedCrowd.seen(memory.crowd, observation.stamp, people, radius)
        memory.progress, arc = checked_ready(memory.progress).advanced(here)
        if 0.0 <= observation.stamp - memory.looked < EVERY - 1e-9:
            return
        memory.looked, memory.note = observation.stamp, ""
        rest = memory.progress.rest
        way = None
        if memory.crowd is not None and memory.progress.path.length - arc > 2.0 * robot.radius:
            crowd = replace(memory.crowd, area=self._area)
            prices = _Prices(crowd, self._dearer(crowd.radius), self._speed(observation))
            way = self._way(observation, here, rest, prices)
        if way is not None or memory.away:
            self.controller.set_path(rest if way is None else way)
        memory.away = way is not None

    @cached_property
    def _area(self) -> AreaOfPeople | None:
        corners = checked_area("around_crowds.area", self.area)
        return AreaOfPeople.of(corners) if len(corners) else None

    def _speed(self, observation: Observation) -> float:
        """Return the robot's speed along its path, m/s."""
        if isinstance(self.controller, HasReferenceSpeed):
            return self.controller.reference_speed
        return top_speed(self.robot, observation.state)

    def _dearer(self, radius: float) -> float:
        """Return the price of a metre over that of a free one, per person per m^2 at rest, m^2."""
        return self.price * 2.0 * (self.robot.radius + radius)

    def _way(
        self, observation: Observation, here: Array, rest: Path, prices: "_Prices"
    ) -> Path | None:
        """Return the way of least cost and what follows it; None where the path is as good."""
        ahead = min(AHEAD, rest.length)
        end = rest.at(np.array(ahead))
        until = np.concatenate(
            [here[None], rest.points[(rest.arc < ahead) & (rest.arc > 0.0)], end[None]]
        )
        dear = prices.of(until)
        length = float(np.hypot(*np.diff(until, axis=0).T).sum())
        if dear - length / prices.speed < WORTH:
            return None
        costmap = self._map(observation, until, prices)
        route = SmoothedRoutes(NavFn(tolerance=0.0), SMOOTH).plan(costmap, here, end)
        if route.path is None:
            self._memory.note = f"no way around the crowd: {route.reason}"
            return None
        found = prices.of(route.path.points)
        if found > dear:
            return None
        self._memory.note = f"a way around {prices.crowd.count} people saves {dear - found:.1f} s"
        points = np.concatenate([route.path.points, rest.points[rest.arc > ahead]])
        kept = np.concatenate([[True], (np.abs(np.diff(points, axis=0)) > 1e-9).any(axis=1)])
        return Path(points[kept])

    def _map(self, observation: Observation, places: Array, prices: "_Prices") -> Costmap:
        """Return a map of the walls and of what the crowd costs, `NavFn`'s largest at most."""
        corners = prices.crowd.mean + np.array([[1.0], [-1.0]]) * np.sqrt(
            6.0 * np.diag(prices.crowd.covariance)
        )
        shown = np.concatenate([places, corners])
        beyond = 2.0 + self.robot.radius
        side = float(np.ptp(shown, axis=0).max()) + 2.0 * beyond
        square = (shown.min(axis=0) + shown.max(axis=0)) / 2.0 + np.array([[-side], [side]])
        near = _inside(square, observation.polygons)
        if near:
            shown, beyond, side = square, 0.0, 2.0 * side
        grid = grid_of_polygons(near, shown, beyond, max(CELL, side / MOST))
        bare = Costmap.from_grid(grid)
        if near:
            inscribed = self.robot.radius + bare.resolution
            bare = Inflation(inscribed, inscribed, 1.0).inflated(bare)
        rows, columns = np.mgrid[: bare.height, : bare.width]
        centres = bare.map_to_world(np.stack([columns, rows], axis=-1))
        dearer = np.ceil((prices.ratio(centres) - 1.0) * 50.0 / 0.8)
        cells = np.maximum(bare.cells, np.minimum(dearer, MAX_NON_OBSTACLE))
        return Costmap(cells.astype(np.uint8), bare.resolution, bare.origin)


def _inside(square: Array, walls: Sequence[Polygon]) -> list[Polygon]:
    """Return the parts of walls in a square of these lowest and highest coordinates, (2, 2), m.

    So the map stays small beside a long wall, and no way leads around the end of a part.
    """
    import shapely

    shapes = [shapely.Polygon(wall.points) for wall in walls]
    (west, south), (east, north) = square.tolist()
    cut = shapely.intersection(shapes, shapely.box(west, south, east, north))
    parts = [one for one in shapely.get_parts(cut) if one.area > SLIVER]
    return [Polygon(tuple(map(tuple, shapely.get_coordinates(one)[:-1]))) for one in parts]


@final
@dataclass(frozen=True, eq=False)
class _Prices:
    """What a metre costs.

    Attributes
    ----------
    crowd : that makes it dearer. dearer : m^2, see `AroundCrowds`. speed : m/s, the robot's.
    """

    crowd: WatchedCrowd
    dearer: float
    speed: float

    def ratio(self, places: Array) -> Array:
        """Cost of a metre over that of a free one at places (..., 2), (...)."""
        relative = hypot(self.speed, self.crowd.speed)
        return np.asarray(1.0 + self.dearer * relative * self.crowd.density(places))

    def of(self, points: Array) -> float:
        """Cost of a way through points (P, 2), m, in s."""
        steps = np.diff(points, axis=0)
        lengths = np.hypot(*steps.T)
        counts = [min(max(ceil(one / CELL), 1), MOST) for one in lengths.tolist()]
        total = 0.0
        for begin, step, length, count in zip(points[:-1], steps, lengths, counts, strict=True):
            shares = (np.arange(count) + 0.5) / count
            total += float(self.ratio(begin + shares[:, None] * step).mean() * length)
        return total / self.speed

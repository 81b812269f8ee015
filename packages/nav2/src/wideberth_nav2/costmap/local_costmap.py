"""Costmaps in layers, as Nav2 keeps them: obstacles by rays, a known map, and inflation."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import ceil
from typing import final

import numpy as np
from numpy.typing import NDArray

from wideberth.framework.values.arrays import Array, BoolArray, positive
from wideberth.framework.values.costmap import Costmap
from wideberth.framework.values.motion import Detection
from wideberth.framework.values.polygon import Polygon
from wideberth.routes.inflation import Inflation

from ..costs import FREE_SPACE, LETHAL, NO_INFORMATION
from .footprint import RobotFootprint
from .forecast_layer import ShownForecast
from .rays import Rays

Cells = NDArray[np.uint8]
_LATE = 1e-9
"""s: an update that is due so soon is due now."""


@final
@dataclass(frozen=True)
class CostmapView:
    """How much of its surroundings a costmap shows, by Nav2's names.

    The defaults are those of the local costmap that Nav2 ships for its own robot. `privileged`
    is a wide, exact and fresh one, for studies in which no controller is to lose by its sight.

    Attributes
    ----------
    width, height : m.
    resolution : m, side of a cell.
    update_frequency : Hz.
    rolling_window : the robot stays in the middle; otherwise `origin_x` and `origin_y` hold.
    origin_x, origin_y : m, lower left corner.
    track_unknown_space : what no ray has passed is unknown; otherwise it is free.
    obstacle_max_range : m, within which ends of rays are marked.
    raytrace_max_range : m, within which rays clear.
    inf_is_valid : a ray that meets nothing clears, too. Nav2's default is false, which leaves
        the marks of bodies that have passed in open space for ever.
    static_layer : show polygons as a known map, wherever they are.
    obstacle_layer : show what rays have met.
    exact : show every disc and polygon as it is now, instead of what rays have met.
    laser_range : m, of rays that are cast against discs and polygons.
    inflation_radius : m.
    cost_scaling_factor : 1/m, how fast costs fall.
    inflate_unknown, inflate_around_unknown : see `Inflation`.
    footprint_padding : m, by which the robot's outline is enlarged.

    Raises
    ------
    WideberthError : a number that must be above zero and is not.
    """

    width: float = 3.0
    height: float = 3.0
    resolution: float = 0.05
    update_frequency: float = 5.0
    rolling_window: bool = True
    origin_x: float = 0.0
    origin_y: float = 0.0
    track_unknown_space: bool = False
    obstacle_max_range: float = 2.5
    raytrace_max_range: float = 3.0
    inf_is_valid: bool = True
    static_layer: bool = False
    obstacle_layer: bool = True
    exact: bool = False
    laser_range: float = 12.0
    inflation_radius: float = 0.70
    cost_scaling_factor: float = 3.0
    inflate_unknown: bool = False
    inflate_around_unknown: bool = False
    footprint_padding: float = 0.01

    def __post_init__(self) -> None:
        for name in (
            "width", "height", "resolution", "update_frequency", "obstacle_max_range",
            "raytrace_max_range", "laser_range",
        ):  # fmt: skip
            positive(f"view.{name}", getattr(self, name))
        for name in ("inflation_radius", "cost_scaling_factor", "footprint_padding"):
            positive(f"view.{name}", getattr(self, name), zero=True)

    @classmethod
    def privileged(cls) -> "CostmapView":
        """Return a view of 12 m x 12 m, exact, at the rate of the controller."""
        return cls(width=12.0, height=12.0, update_frequency=20.0, exact=True)


@final
@dataclass(frozen=True, eq=False)
class CostmapSurroundings:
    """What a costmap is updated with at one instant.

    Attributes
    ----------
    rays : of the newest scan; a lost ray (NaN) is left out. None for an exact view.
    centres, radii : (O, 2) and (O,), m, of discs, for an exact view.
    polygons : known walls, for an exact view and for the static layer.
    people : forecasts that are shown, too; None without a layer of them.
    """

    rays: Rays | None
    centres: Array
    radii: Array
    polygons: Sequence[Polygon] = ()
    people: ShownForecast | None = None


@final
class LayeredCostmap:
    """A costmap of Nav2 that is updated at its own rate.

    The obstacle layer first frees the cells that rays pass, then marks those where they end, and
    frees the robot's outline. A mark stays until a later ray passes it, so that a body which moves
    leaves a trail where no ray goes. The layers are merged by the highest cost, then inflated.

    Parameters
    ----------
    view : what it shows, and how often.
    footprint : of the robot, with its padding.
    """

    def __init__(self, view: CostmapView, footprint: RobotFootprint) -> None:
        self._view, self._footprint = view, footprint
        self._shape = (round(view.height / view.resolution), round(view.width / view.resolution))
        self._inflation = Inflation(
            footprint.inscribed, view.inflation_radius, view.cost_scaling_factor,
            view.inflate_unknown, view.inflate_around_unknown,
        )  # fmt: skip
        self.reset()

    def reset(self) -> None:
        """Forget everything."""
        view = self._view
        self._origin = (0.0, 0.0) if view.rolling_window else (view.origin_x, view.origin_y)
        self._marks = np.full(self._shape, self._default, np.uint8)
        self._updated = -np.inf
        self._shown: Costmap | None = None

    @property
    def shown(self) -> Costmap | None:
        """The newest costmap; None before the first update."""
        return self._shown

    @property
    def updated(self) -> float:
        """When that was made, s."""
        return self._updated

    def clear(self) -> None:
        """Forget all marks; the next call of `update` is due at once."""
        self._marks[:] = self._default
        self._updated = -np.inf

    def due(self, time: float) -> bool:
        """Return whether an update at a time, s, makes it anew: a clock that goes back does so."""
        period = 1.0 / self._view.update_frequency
        fresh = self._updated <= time < self._updated + period - _LATE
        return self._shown is None or not fresh

    def update(self, time: float, pose: Array, seen: CostmapSurroundings) -> Costmap:
        """Return the newest costmap; it is made anew where its time has come.

        Parameters
        ----------
        time : s.
        pose : (3,), of the robot.
        seen : what is around it.
        """
        if self._shown is not None and not self.due(time):
            return self._shown
        self._updated = time
        if self._view.rolling_window:
            self._roll(pose)
        grid = self._blank()
        if self._view.exact:
            cells = self._exact(grid, seen)
        else:
            if seen.rays is not None and self._view.obstacle_layer:
                self._observe(grid, pose, seen.rays)
            cells = self._marks.copy()
        if self._view.static_layer and not self._view.exact:
            cells = np.where(_covered(grid, seen.polygons), np.uint8(LETHAL), cells)
        if seen.people is not None:
            expected = seen.people.costs(grid).cells.copy()
            expected[_within(grid, self._footprint.at(pose))] = FREE_SPACE
            cells = np.maximum(cells, expected)
        master = Costmap(cells, grid.resolution, grid.origin)
        self._shown = self._inflation.inflated(master)
        return self._shown

    @property
    def _default(self) -> int:
        return NO_INFORMATION if self._view.track_unknown_space else FREE_SPACE

    def _blank(self) -> Costmap:
        """Return a costmap of the present place, all of it free."""
        return Costmap(np.zeros(self._shape, np.uint8), self._view.resolution, self._origin)

    def _roll(self, pose: Array) -> None:
        """Shift the window by whole cells so that the robot is in its middle."""
        size = self._view.resolution
        high, wide = self._shape
        moved = [
            int((float(pose[i]) - 0.5 * count * size - self._origin[i]) / size)
            for i, count in enumerate((wide, high))
        ]
        self._origin = (self._origin[0] + moved[0] * size, self._origin[1] + moved[1] * size)
        kept = np.full(self._shape, self._default, np.uint8)
        across, along = moved
        if abs(across) < wide and abs(along) < high:
            here = np.s_[max(-along, 0) : high - max(along, 0),
                         max(-across, 0) : wide - max(across, 0)]  # fmt: skip
            before = np.s_[max(along, 0) : high - max(-along, 0),
                           max(across, 0) : wide - max(-across, 0)]  # fmt: skip
            kept[here] = self._marks[before]
        self._marks = kept

    def _observe(self, grid: Costmap, pose: Array, rays: Rays) -> None:
        """Free what the rays pass, mark where they end, free the robot's outline."""
        view = self._view
        if not grid.inside(rays.origin):
            return
        clearing = rays.met | (rays.free & view.inf_is_valid)
        ranges = np.where(rays.free, rays.longest, rays.ranges)[clearing]
        self._free_along(grid, rays.origin, rays.directions[clearing], ranges)
        ends = rays.origin + rays.ranges[rays.met, None] * rays.directions[rays.met]
        near = rays.ranges[rays.met] < view.obstacle_max_range
        cells = grid.world_to_map(ends)
        apart = cells - grid.world_to_map(rays.origin)
        reach = ceil(view.obstacle_max_range / view.resolution)
        near &= np.hypot(apart[:, 0], apart[:, 1]).astype(np.int64) <= reach
        mx, my = cells[near & grid.inside(ends)].T
        self._marks[my, mx] = LETHAL
        self._marks[_within(grid, self._footprint.at(pose))] = FREE_SPACE

    def _free_along(self, grid: Costmap, origin: Array, directions: Array, ranges: Array) -> None:
        """Free the cells on straight lines from the sensor's cell."""
        reach = np.minimum(ranges, _to_border(grid, origin, directions))
        ends = grid.world_to_map(origin + reach[:, None] * directions)
        ends = np.clip(ends, 0, [grid.width - 1, grid.height - 1])
        begin = grid.world_to_map(origin)
        step = ends - begin
        size = np.abs(step)
        whole = size.max(axis=1, initial=0)
        length = np.hypot(step[:, 0], step[:, 1])
        limit = ceil(self._view.raytrace_max_range / self._view.resolution)
        share = np.minimum(1.0, limit / np.maximum(length, 1e-9))
        count = (share * whole).astype(np.int64)
        k = np.arange(int(count.max(initial=0)) + 1)
        used = k <= count[:, None]
        along = [
            np.sign(step[:, i, None])
            * ((whole[:, None] // 2 + k * size[:, i, None]) // np.maximum(whole, 1)[:, None])
            for i in range(2)
        ]
        # On the longer axis that is k itself, on the other one the integer line's step.
        mx, my = begin[0] + along[0][used], begin[1] + along[1][used]
        self._marks[my, mx] = FREE_SPACE

    def _exact(self, grid: Costmap, seen: CostmapSurroundings) -> Cells:
        """Return the cells that discs and polygons touch now."""
        lethal = _covered(grid, seen.polygons)
        half = 0.5 * grid.resolution
        for centre, radius in zip(seen.centres, seen.radii, strict=True):
            x, y, near = _around(grid, lethal, centre - radius, centre + radius)
            dx = np.maximum(np.abs(x - centre[0]) - half, 0.0)
            dy = np.maximum(np.abs(y - centre[1]) - half, 0.0)
            near |= dx**2 + dy**2 <= radius**2
        return np.where(lethal, LETHAL, FREE_SPACE).astype(np.uint8)


def discs_of(detections: Sequence[Detection]) -> tuple[Array, Array]:
    """Return the centres (O, 2) and radii (O,), m, of bodies where they are by now."""
    places = [
        one.position if one.velocity is None else one.position + one.age * one.velocity
        for one in detections
    ]
    radii = [one.radius for one in detections]
    return np.array(places, np.float64).reshape(-1, 2), np.array(radii, np.float64)


def _to_border(grid: Costmap, origin: Array, directions: Array) -> Array:
    """Distance along each ray (B, 2) from within a grid to its border, (B,), m."""
    low = np.array(grid.origin)
    high = low + grid.resolution * np.array([grid.width, grid.height])
    with np.errstate(divide="ignore", invalid="ignore"):
        far = np.where(directions > 0.0, (high - origin) / directions, (low - origin) / directions)
    return np.asarray(np.where(directions == 0.0, np.inf, far).min(axis=1, initial=np.inf))


def _around(
    grid: Costmap, cells: BoolArray, low: Array, high: Array
) -> tuple[Array, Array, BoolArray]:
    """Return centres (1, X) and (Y, 1), m, and a view of the cells that a box reaches."""
    x0, y0 = np.maximum(grid.world_to_map(low), 0)
    x1, y1 = grid.world_to_map(high) + 1
    x = grid.origin[0] + (np.arange(x0, min(x1, grid.width)) + 0.5) * grid.resolution
    y = grid.origin[1] + (np.arange(y0, min(y1, grid.height)) + 0.5) * grid.resolution
    return x[None], y[:, None], cells[y0 : y0 + len(y), x0 : x0 + len(x)]


def _within(grid: Costmap, corners: Array) -> BoolArray:
    """Return which cells have their centres within a polygon (V, 2), m, (height, width)."""
    inside = np.zeros((grid.height, grid.width), np.bool_)
    x, y, near = _around(grid, inside, corners.min(axis=0), corners.max(axis=0))
    for (u1, v1), (u2, v2) in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        if v1 != v2:
            crossing = u1 + (y - v1) / (v2 - v1) * (u2 - u1)
            near ^= ((v1 > y) != (v2 > y)) & (x < crossing)
    return inside


def _covered(grid: Costmap, polygons: Sequence[Polygon]) -> BoolArray:
    """Return which cells polygons cover: at their centres, or by an edge that passes them."""
    found = np.zeros((grid.height, grid.width), np.bool_)
    low = np.array(grid.origin)
    high = low + grid.resolution * np.array([grid.width, grid.height])
    for polygon in polygons:
        points = polygon.points
        if (points.max(axis=0) < low).any() or (points.min(axis=0) > high).any():
            continue
        found |= _within(grid, points)
        edges = np.roll(points, -1, axis=0) - points
        for begin, edge in zip(points, edges, strict=True):
            places = begin + _shares(begin, edge, low, high, grid.resolution)[:, None] * edge
            mx, my = grid.world_to_map(places[grid.inside(places)]).T
            found[my, mx] = True
    return found


def _shares(begin: Array, edge: Array, low: Array, high: Array, resolution: float) -> Array:
    """Shares of an edge at which it is looked at, half a cell apart, where it is in a box, (n,).

    Those of the whole edge are k / n with k = 0..n; of an edge that is far longer than the box
    only a few lie within.
    """
    count = 1 + ceil(2.0 * float(np.abs(edge).max()) / resolution)
    with np.errstate(divide="ignore", invalid="ignore"):
        ends = np.stack([(low - begin) / edge, (high - begin) / edge])
    ends = np.where(edge == 0.0, [[-np.inf], [np.inf]], ends)
    first, last = np.clip([ends.min(axis=0).max(), ends.max(axis=0).min()], 0.0, 1.0)
    near = np.arange(max(int(first * count) - 1, 0), min(int(last * count) + 2, count) + 1)
    return np.where(near == count, 1.0, near * (1.0 / count))

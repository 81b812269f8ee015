"""Static convex polygons: observed walls and boxes that stand still."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar, final

import numpy as np
from numpy.typing import NDArray

from ...region import Auxiliary, Constraint
from ...robot import Robot
from ...static_region import StaticRegion
from ...values.arrays import Array, Scalar
from ...values.errors import WideberthError
from ...values.motion import Pose
from ...values.polygon import MOST_CORNERS, Polygon, edge_normals, separation
from ..levels.base import LevelPolicy
from ..ocp.bodies import Body, BodyPath, bodies, body_starts
from ..ocp.problem import SlotNumbers, Slots
from ..ocp.stage import Frame, slots_of
from .base import (
    KnownObstacles,
    PlanningContext,
    SlotAssignment,
    SlotKind,
    SlotSizes,
    Touch,
    active_slots,
    next_capacity,
    quoted,
)

CORNERS = (4, 6, 8, 12, MOST_CORNERS)
"""Vertices that problems are compiled for; a convex part with fewer repeats its last one."""
_HARDLY_APART = 1e-9
"""m. Bodies and parts farther apart than this do not touch, whatever the rounding."""


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


def fill_walls(walls: Walls, region: StaticRegion, margin: float, spread: Array) -> SlotNumbers:
    """Fill the numbers of as many slots as the next of `CAPACITIES`; empty ones hold a triangle.

    Parameters
    ----------
    walls, region : the polygons, and what keeps clear of them.
    margin : m, radius of the robot's bodies and what is added to it.
    spread : (N, 2, 2), m^2, the robot's own covariance times the squared level.
    """
    steps, count = len(spread), len(walls)
    capacity = next_capacity(count)
    dummy = padded(np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]), walls.parts.shape[1])
    parts = np.concatenate([walls.parts, np.repeat(dummy[None], capacity - count, axis=0)])
    shape = (steps, capacity)
    numbers = region.parameters(
        np.broadcast_to(parts, (*shape, *dummy.shape)),
        np.broadcast_to(margin, shape),
        np.broadcast_to(spread[:, None], (*shape, 2, 2)),
    )
    return SlotNumbers(numbers, active_slots(count, capacity), np.zeros((*shape, 0)))


def nearness(around: float, aside: float, own: Array, level: LevelPolicy) -> float:
    """How near a polygon has to be to the route to come into the problem, m.

    A plan that goes farther aside is still held against all polygons.

    Parameters
    ----------
    around : m, radius of the robot and margin.
    aside, own, level : how far a plan may turn aside, own uncertainty, and level, see
        `PlanningContext`.
    """
    return around + aside + widest(own, level)


def widest(own: Array, level: LevelPolicy) -> float:
    """How much a body is enlarged before a polygon by the robot's own uncertainty, at most, m."""
    return deviations(level) * float(np.sqrt(np.linalg.eigvalsh(own)[:, -1].max(initial=0.0)))


def deviations(level: LevelPolicy) -> float:
    """Return s: a line that separates body and polygon by s deviations keeps the risk at Phi(-s).

    Of an outline that holds for each corner: where the heading is uncertain as well, corners on
    either side of the robot's position come near for opposite errors, and the risk of the body
    is at most twice that.
    """
    from scipy.special import ndtri

    return max(-float(ndtri(level.tail)), 0.0)


@final
@dataclass(frozen=True, eq=False)
class KnownPolygons(KnownObstacles):
    """Every part of every polygon, within reach or not."""

    kind: "StaticPolygons"
    walls: Walls

    def touched(self, robot: Robot, states: Array) -> Touch:
        """How deep the bodies enter parts on the way to each step."""
        steps = len(states) - 1
        near = self._near(robot, states)
        if not near.size:
            return Touch.none(steps)
        depth, names = np.zeros(steps), [""] * steps
        for body in self.kind.bodies(robot) or (Body(robot.radius),):
            way = BodyPath.of(robot, body, states)
            close = near[self._comes_close(way.corners, near, body.radius)]
            if not close.size:
                continue
            parts = self.walls.known[close]
            gaps = separation(way.corners[:, :, None], parts)[0].min(axis=1) - body.radius
            for i in np.flatnonzero(gaps.min(axis=1) < -np.maximum(depth, way.cut)):
                worst = int(gaps[i].argmin())
                depth[i], names[i] = -gaps[i, worst], self.walls.known_names[close[worst]]
        return Touch(depth, tuple(names))

    @cached_property
    def _normals(self) -> Array:
        """Outward normals of the edges of every part, (P, V, 2); NaN of edges without length."""
        normals = edge_normals(self.walls.known)
        return np.where(normals.any(axis=-1, keepdims=True), normals, np.nan)

    def _comes_close(
        self, corners: Array, near: NDArray[np.intp], radius: float
    ) -> NDArray[np.bool_]:
        """Which of some parts a body may touch: no edge of theirs has it all on its far side.

        An edge keeps them apart by the least n . (v - w), which costs far less than `separation`.
        """
        normals, parts = self._normals[near], self.walls.known[near]
        apart = corners[..., None, None, :] - parts
        heights = (apart * normals).sum(axis=-1).min(axis=2)  # (looks.., P, V)
        farthest = np.fmax.reduce(heights, axis=-1)
        return np.asarray(~(farthest > radius + _HARDLY_APART).all(axis=(0, 1)))

    def overlap(self, robot: Robot, states: Array) -> Array:
        """Return zeros: what `touched` finds says it all of things that stand still."""
        return np.zeros(len(states) - 1)

    def _near(self, robot: Robot, states: Array) -> NDArray[np.intp]:
        """Parts whose enclosing circle comes near the plan's, as indices."""
        if not len(self.walls.known):
            return np.zeros(0, dtype=np.intp)
        place = robot.pose(tuple(states.T)).points()
        middle = place.mean(axis=0)
        reach = np.linalg.norm(place - middle, axis=1).max() + robot.radius
        centre = self.walls.known.mean(axis=1)
        size = np.linalg.norm(self.walls.known - centre[:, None], axis=2).max(axis=1)
        return np.flatnonzero(np.linalg.norm(centre - middle, axis=1) < reach + size)


@final
@dataclass(frozen=True)
class StaticPolygons(SlotKind):
    """Observed polygons, one slot for each convex part; the room is (parts, corners of each).

    Parameters
    ----------
    region : keeps clear of them; None where no polygon may be observed.
    """

    region: StaticRegion | None

    name: ClassVar[str] = "polygon"

    def bodies(self, robot: Robot) -> tuple[Body, ...]:
        """Bodies with their corners; none without a region."""
        return () if self.region is None else bodies(robot)

    def slots(self, room: SlotSizes, frame: Frame) -> Slots:
        """State that every body is clear of the polygon."""
        region, count = self.region, room[0] if room else 0
        if region is None and count:
            raise WideberthError(f"{count} static polygons need a static region; got None")
        if region is None or not count:
            none = Constraint(())
            return slots_of(
                self.name, 0, 0, Auxiliary(), (), lambda *_: none, frame, levelled=False
            )
        parts, corners = self.bodies(frame.robot), room[1]
        own = region.auxiliary(corners, max(len(parts[0].outline), 1))
        width = region.parameter_count(corners)

        def state(pose: Pose, parameters: Scalar, level: Scalar, auxiliary: Scalar) -> Constraint:
            return region.constraint(pose, parameters, auxiliary)  # it has no level

        return slots_of(self.name, count, width, own, parts, state, frame, levelled=False)

    def choose(self, robot: Robot, view: PlanningContext) -> SlotAssignment:
        """Choose the convex parts that come closest to the route and the last plan."""
        walls, polygons = NONE, view.observation.polygons
        if polygons:
            route = np.concatenate([*view.route, view.planned])
            around = robot.radius + view.wall_margin
            reach = nearness(around, view.aside, view.own_on_map, view.level)
            walls = choose_walls(polygons, self.region, route, reach, view.most)
        return self.chosen(robot, walls, view.level, view.wall_margin, view.own_on_map)

    def chosen(
        self, robot: Robot, walls: Walls, level: LevelPolicy, margin: float, own: Array
    ) -> SlotAssignment:
        """Fill the slots of the smallest problem that has room for some polygons.

        Parameters
        ----------
        robot, level : see `PlanningContext`.
        walls : the polygons.
        margin : m, `PlanningContext.wall_margin`.
        own : (N, 2, 2), m^2, `PlanningContext.own_on_map`.
        """
        numbers = SlotNumbers.none(len(own))
        if self.region is not None and len(walls):
            spread = deviations(level) ** 2 * own
            radius = self.bodies(robot)[0].radius + margin
            numbers = fill_walls(walls, self.region, radius, spread)
        room = len(numbers.active), walls.parts.shape[1]
        return SlotAssignment(
            room, walls.names, walls.left_out, numbers, KnownPolygons(self, walls)
        )

    def auxiliary_start(self, robot: Robot, pose: Pose, numbers: SlotNumbers) -> Array:
        """Best auxiliaries of the region, body by body."""
        region, count = self.region, numbers.parameters.shape[1]
        assert region is not None  # else there are no slots

        def start(at: Pose) -> Array:
            return region.auxiliary_start(at, numbers.parameters)

        return body_starts(self.bodies(robot), pose, count, start)

    def explanation(self, dimension: int) -> str:
        """Quote the region."""
        return "" if self.region is None else quoted(self.region)

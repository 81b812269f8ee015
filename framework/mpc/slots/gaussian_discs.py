"""Gaussian discs: obstacles of a forecast, each a disc around an uncertain place."""

from dataclasses import dataclass
from functools import lru_cache
from itertools import compress
from math import sqrt
from typing import Any, ClassVar, NamedTuple, final

import numpy as np
from numpy.typing import NDArray

from ...numerics.symbolic import ca
from ...region import Bounded, ClosedForm, Polygonal, Region
from ...robot import Robot
from ...values.arrays import Array, BoolArray, assembled
from ...values.errors import WideberthError
from ...values.forecast import LIGHT, Forecast, GaussianObstacle
from ...values.motion import Pose
from ..levels.base import LevelPolicy, Promise, tail_of
from ..ocp.bodies import Body, apart, bodies, body_starts, discs
from ..ocp.problem import SlotNumbers, Slots
from ..ocp.reference import Reference
from ..ocp.stage import Frame, slots_of
from .at_rest import EndOfPlan
from .base import (
    FAR,
    WIDE,
    GaussianKind,
    KnownObstacles,
    LevelledKind,
    OutOfReach,
    PlanningContext,
    SlotAssignment,
    SlotKind,
    SlotSizes,
    Touch,
    active_slots,
    farthest,
    next_capacity,
    quoted,
)
from .reachability import leaves_out, lengths, out_of_reach


@dataclass(frozen=True, eq=False)
class ObstacleSet:
    """Gaussian discs on the plan's grid, one per obstacle and forecast mode.

    Attributes
    ----------
    mean : (N, O, D), m. covariance : (N, O, D, D), m^2.
    radius : (O,), m.
    ids : (O,) names; modes of one obstacle share a name.
    left_out : names that did not fit, or whose mode is too unlikely.
    out_of_reach : names of those that no plan can meet, see `slots.reachability`.
    counted : names of all that share what the level policy allows, in the forecast's order; ()
        for those that are here.
    """

    mean: Array
    covariance: Array
    radius: Array
    ids: tuple[str, ...]
    left_out: tuple[str, ...] = ()
    out_of_reach: tuple[str, ...] = ()
    counted: tuple[str, ...] = ()

    @classmethod
    def of(cls, forecast: Forecast, ids: tuple[str, ...], radius: Array) -> "ObstacleSet":
        """Make a disc of every mode that is not too unlikely.

        Parameters
        ----------
        forecast : on the plan's grid, N steps.
        ids, radius : of its obstacles.
        """
        likely = forecast.weight >= LIGHT
        if likely.shape[1] == 1 and likely.all():
            mean, covariance = forecast.mean[:, 0], forecast.covariance[:, 0]
            return cls(mean.swapaxes(0, 1), covariance.swapaxes(0, 1), radius, ids)
        owner, mode = np.nonzero(likely)
        # Modes of weight 0 only fill up the array; they are no modes.
        light = (forecast.weight < LIGHT) & (forecast.weight > 0)
        return cls(
            forecast.mean[owner, mode].swapaxes(0, 1),
            forecast.covariance[owner, mode].swapaxes(0, 1),
            radius[owner],
            tuple(ids[o] for o in owner),
            tuple(ids[o] for o in np.nonzero(light)[0]),
        )

    @classmethod
    def none(cls, steps: int, dimension: int) -> "ObstacleSet":
        """No disc at all."""
        mean = np.zeros((steps, 0, dimension))
        return cls(mean, np.zeros((steps, 0, dimension, dimension)), np.zeros(0), ())

    def __len__(self) -> int:
        """Count the discs."""
        return len(self.ids)


def choose_obstacles(
    discs: ObstacleSet, route: Array, most: int, far: BoolArray | None = None
) -> tuple[ObstacleSet, NDArray[np.intp]]:
    """Keep the discs that come closest to the route, at most ``most`` of them.

    Parameters
    ----------
    discs : all of them.
    route : (R, N, D), m, places where the robot may be at each step (the reference, and
        where it is now).
    most : how many discs the problem can hold.
    far : (O,), which ones are out of reach, and need no room in it; None for none.

    Returns
    -------
    The discs that are kept, and their indices; the same discs where these are all.
    """
    beyond = np.zeros(len(discs), dtype=np.bool_) if far is None else far
    kept = near = (~beyond).nonzero()[0]
    if len(near) > most:
        apart = lengths(discs.mean[:, near] - route[:, :, None])
        clearance = apart.min(axis=(0, 1)) - discs.radius[near]
        kept = np.sort(near[np.argsort(clearance, kind="stable")[:most]])
    if len(kept) == len(discs):
        return discs, kept
    counted = beyond.copy()
    counted[kept] = True
    pairs = list(zip(discs.ids, counted.tolist(), strict=True))
    chosen = ObstacleSet(
        discs.mean.take(kept, axis=1),
        discs.covariance.take(kept, axis=1),
        discs.radius[kept],
        tuple(discs.ids[i] for i in kept.tolist()),
        left_out=(*discs.left_out, *(name for name, held in pairs if not held)),
        out_of_reach=tuple(compress(discs.ids, beyond.tolist())),
        counted=tuple(name for name, held in pairs if held),
    )
    return chosen, kept


def fill(
    reference: Reference,
    obstacles: ObstacleSet,
    region: Region,
    level: LevelPolicy,
    radius: float,
    capacity: int,
    own: Array | None = None,
) -> SlotNumbers:
    """Fill the numbers of ``capacity`` slots.

    Numbers of any size become such that a solver can calculate with them, see `FAR`.

    ``radius``, m, is that of the robot's bodies and what is added to it. ``own`` (N, D, D), m^2,
    is the covariance of the robot's own position, which is added to every obstacle's.

    Empty slots hold a unit disc at the origin. Their level is that of the first obstacle.
    """
    numbers = within_scales(obstacles, reference, radius, own)
    found = DiscNumbers(*numbers, *_levels(level, region, obstacles))
    return found.filled(region, obstacles.ids, capacity)


def within_scales(
    obstacles: ObstacleSet, reference: Reference, radius: float, own: Array | None
) -> tuple[Array, Array, Array]:
    """Mean, covariance with the robot's own, and margin of each disc, as a solver can take them.

    The parameters are those of `fill`.
    """
    covariance = obstacles.covariance
    if own is not None:
        with np.errstate(over="ignore"):
            covariance = covariance + own[:, None]
    mean = within_reach(obstacles.mean, reference.position[:1, None])
    return mean, not_wider(covariance), np.minimum(obstacles.radius + radius, WIDE)


def within_reach(mean: Array, here: Array) -> Array:
    """Return means no coordinate of which is farther than `FAR` from ``here``."""
    return np.asarray(np.minimum(np.maximum(mean, here - FAR), here + FAR))


def not_wider(covariance: Array) -> Array:
    """Return covariances no standard deviation of which exceeds `WIDE`, (..., D, D).

    Those that are smaller are returned as they are. Others keep their axes; one whose numbers are
    too large to be decomposed becomes round.
    """
    size = covariance.shape[-1]
    entries, most = np.abs(covariance), WIDE**2 / size
    if np.maximum.reduce(entries, axis=None, initial=0.0) <= most:
        return covariance
    wide = ~(entries.max(axis=(-2, -1), initial=0.0) <= most)
    bounded = covariance.copy()
    for index in zip(*np.nonzero(wide), strict=True):
        one = covariance[index]
        largest = np.abs(one).max()
        if not np.isfinite(largest):
            bounded[index] = WIDE**2 * np.eye(size)
            continue
        values, vectors = np.linalg.eigh(one / largest)
        values = np.minimum(np.clip(values, 0.0, None), WIDE**2 / largest) * largest
        bounded[index] = (vectors * values) @ vectors.T
        bounded[index] = 0.5 * (bounded[index] + bounded[index].T)
    return bounded


def _levels(
    policy: LevelPolicy, region: Region, obstacles: ObstacleSet
) -> tuple[Array, dict[str, int]]:
    """Levels (N, M) of all that share what a policy allows, and the place of each name."""
    names = dict.fromkeys(obstacles.counted or obstacles.ids)
    asked = policy, region, len(obstacles.mean), max(len(names), 1), obstacles.mean.shape[2]
    try:
        levels = _known_levels(*asked)
    except TypeError:  # a third party's policy or region may not be hashable
        levels = policy.levels(*asked[1:])
    return levels, {name: place for place, name in enumerate(names)}


@lru_cache(maxsize=64)
def _known_levels(
    policy: LevelPolicy, region: Region, steps: int, count: int, dimension: int
) -> Array:
    """Levels of a policy, which is pure; the same are asked for at every decision."""
    return policy.levels(region, steps, count, dimension)


class DiscNumbers(NamedTuple):
    """Discs as a solver can take them.

    Attributes
    ----------
    mean : (N, O, D), m. covariance : (N, O, D, D), m^2, with the robot's own.
    margin : (O,), m, radii of both bodies and what is added.
    level : (N, M) of each name. places : of the names in it; modes of one obstacle share one.
    end : what holds the discs from step N on; None where that is not asked for.
    """

    mean: Array
    covariance: Array
    margin: Array
    level: Array
    places: dict[str, int]
    end: EndOfPlan | None = None

    @classmethod
    def of(
        cls,
        kind: "GaussianDiscs",
        robot: Robot,
        obstacles: ObstacleSet,
        reference: Reference,
        level: LevelPolicy,
        margin: float,
        own: Array | None,
    ) -> "DiscNumbers":
        """Compute numbers and levels of obstacles."""
        radius = kind.bodies(robot)[0].radius + margin
        numbers = within_scales(obstacles, reference, radius, own)
        return cls(*numbers, *_levels(level, kind.region, obstacles))

    def some(self, which: NDArray[np.intp], level: Array, places: dict[str, int]) -> "DiscNumbers":
        """Return those of some of the discs, by their indices, at levels of their own."""
        mean, covariance = self.mean.take(which, axis=1), self.covariance.take(which, axis=1)
        end = None if self.end is None else self.end.some(which)
        return DiscNumbers(mean, covariance, self.margin[which], level, places, end)

    def until(self, later: ObstacleSet, reference: Reference, own: Array) -> "DiscNumbers":
        """Return them with what holds the discs from step N to those ``later``.

        ``own`` (D, D), m^2, is the covariance of the place where the robot ends.
        """
        mean, covariance, _ = within_scales(later, reference, 0.0, own[None])
        both = (
            np.concatenate([a[-1:], b])
            for a, b in ((self.mean, mean), (self.covariance, covariance))
        )
        return self._replace(end=EndOfPlan.of(*both))

    def with_end(self, level: Array) -> "DiscNumbers":
        """Return them with one more step, that of the plan's end at levels (O,)."""
        assert self.end is not None
        mean, covariance = self.end.at(level)
        return self._replace(
            mean=np.concatenate([self.mean, mean[None]]),
            covariance=np.concatenate([self.covariance, covariance[None]]),
        )

    def levels(self, ids: tuple[str, ...], count: int) -> Array:
        """Levels of discs by their names, and of empty slots up to ``count``, (N, count)."""
        columns = [self.places[name] for name in ids] + [0] * (count - len(ids))
        return self.level.take(columns, axis=1)

    def filled(self, region: Region, ids: tuple[str, ...], capacity: int) -> SlotNumbers:
        """Fill ``capacity`` slots; empty ones hold a unit disc at the origin."""
        mean, covariance, margin = self.mean, self.covariance, self.margin
        steps, count, size = mean.shape
        if not capacity:
            return SlotNumbers.none(steps, region.parameter_count(size), levelled=True)
        if count < capacity:  # empty slots are all the same
            dummy = np.empty((steps, 1, size, size))
            dummy[...] = np.eye(size)
            mean = np.concatenate([mean, np.zeros((steps, 1, size))], axis=1)
            covariance = np.concatenate([covariance, dummy], axis=1)
            margin = np.append(margin, 1.0)
        room = np.empty(mean.shape[:2])
        room[...] = margin
        # of a checked forecast, brought within reach
        clear_of = assembled(GaussianObstacle, mean=mean, covariance=covariance)
        parameters = region.parameters(clear_of, room)
        parameters = parameters.take(np.minimum(np.arange(capacity), count), axis=1)
        none = np.zeros((steps, capacity, 0))
        return SlotNumbers(
            parameters, active_slots(count, capacity), none, self.levels(ids, capacity)
        )

    def at_end(self, region: Region, ids: tuple[str, ...], filled: SlotNumbers) -> Array | None:
        """Parameters of all slots at step N where the plan's end is held, (K, P); None else."""
        if self.end is None or not ids:
            return None
        mean, covariance = self.end.at(self.levels(ids, len(ids))[-1])
        held = assembled(GaussianObstacle, mean=mean, covariance=not_wider(covariance))
        last: Array = filled.parameters[-1].copy()
        last[: len(ids)] = region.parameters(held, self.margin)
        return last


@final
@dataclass(frozen=True, eq=False)
class KnownDiscs(KnownObstacles):
    """Discs that have a slot, at the forecast's means, which are known at the steps alone."""

    kind: SlotKind
    obstacles: ObstacleSet
    margin: float

    def touched(self, robot: Robot, states: Array) -> Touch:
        """Return no contact: a forecast between two steps is not known."""
        return Touch.none(len(states) - 1)

    def overlap(self, robot: Robot, states: Array) -> Array:
        """How deep the bodies are in the discs around the means, (N,), m."""
        pose = robot.pose(tuple(states[1:].T))
        means = self.obstacles.mean
        depth = np.zeros(len(means))
        for body in self.kind.bodies(robot) if means.shape[1] else ():
            room = body.radius + self.margin + self.obstacles.radius
            depth = np.maximum(depth, (room - apart(body, pose, means)).max(axis=1))
        return depth


@final
@dataclass(frozen=True)
class GaussianDiscs(LevelledKind, GaussianKind):
    """Obstacles of the forecast: one slot for each mode of each.

    Parameters
    ----------
    region : states the set that the robot keeps out of.
    """

    region: Region

    name: ClassVar[str] = "obstacle"

    def bodies(self, robot: Robot) -> tuple[Body, ...]:
        """Bodies with corners where the region knows them, else discs."""
        return bodies(robot) if isinstance(self.region, Polygonal) else discs(robot)

    def slots(self, room: SlotSizes, frame: Frame) -> Slots:
        """State that every body is outside of the region."""
        size, region = frame.robot.dimension, self.region
        own, width = region.auxiliary(size), region.parameter_count(size)
        parts = self.bodies(frame.robot)
        count = room[0] if room else 0
        return slots_of(
            self.name, count, width, own, parts, region.constraint, frame, levelled=True
        )

    def choose(self, robot: Robot, view: PlanningContext) -> SlotAssignment:
        """Choose the discs that come closest to the route, of those that a plan can meet."""
        given = view.reference, view.level, view.margin, view.own
        if view.tracks is None or view.forecast is None:
            return self.chosen(robot, ObstacleSet.none(*view.route.shape[1:]), *given)
        discs = ObstacleSet.of(view.forecast, view.tracks.ids, view.tracks.radius)
        numbers = DiscNumbers.of(self, robot, discs, *given)
        if view.beyond is not None:
            later = ObstacleSet.of(view.beyond, view.tracks.ids, view.tracks.radius)
            numbers = numbers.until(later, view.reference, view.own[-1])
        far = self.out_of_reach(robot, discs, numbers, view)
        chosen, kept = choose_obstacles(discs, view.route, view.most, far)
        if chosen is not discs:
            numbers = numbers.some(kept, *_levels(view.level, self.region, chosen))
        return self._assigned(chosen, numbers, view.margin)

    def out_of_reach(
        self, robot: Robot, discs: ObstacleSet, numbers: "DiscNumbers", view: PlanningContext
    ) -> BoolArray | None:
        """Which discs no plan can meet, (O,), see `reachability`; None where none is left out."""
        region = self.region
        if not (isinstance(region, Bounded) and len(discs) and leaves_out(view.level)):
            return None
        allowed = np.zeros(view.route.shape[:2])
        allowed[1] = view.travel
        allowed += sqrt(robot.dimension) * farthest(self.bodies(robot))
        levels, route = numbers.levels(discs.ids, len(discs)), view.route
        if numbers.end is not None:
            numbers = numbers.with_end(levels[-1])
            levels = np.concatenate([levels, levels[-1:]])
            allowed = np.concatenate([allowed, allowed[:, -1:]], axis=1)
            route = np.concatenate([route, route[:, -1:]], axis=1)
        given = numbers.mean, numbers.covariance, numbers.margin
        return out_of_reach(region, *given, levels, route, allowed)

    def chosen(
        self,
        robot: Robot,
        obstacles: ObstacleSet,
        reference: Reference,
        level: LevelPolicy,
        margin: float,
        own: Array | None = None,
    ) -> SlotAssignment:
        """Fill the slots of the smallest problem that has room for some obstacles.

        Parameters
        ----------
        robot, reference, level, margin, own : see `PlanningContext`.
        obstacles : on the plan's grid.
        """
        numbers = DiscNumbers.of(self, robot, obstacles, reference, level, margin, own)
        return self._assigned(obstacles, numbers, margin)

    def _assigned(
        self, obstacles: ObstacleSet, numbers: "DiscNumbers", margin: float
    ) -> SlotAssignment:
        capacity, far = next_capacity(len(obstacles)), obstacles.out_of_reach
        filled = numbers.filled(self.region, obstacles.ids, capacity)
        known = KnownDiscs(self, obstacles, margin)
        beyond = OutOfReach(far, numbers.levels(far, len(far))) if far else None
        names = obstacles.ids, obstacles.left_out
        end = numbers.at_end(self.region, obstacles.ids, filled)
        return SlotAssignment((capacity,), *names, filled, known, beyond, at_end=end)

    def parameters_of_one(self, robot: Robot, margin: float) -> Any:
        """Parameters of the region, the radii of body and obstacle in its margin.

        Raises
        ------
        WideberthError : the region states them in no closed form.
        """
        if not isinstance(self.region, ClosedForm):
            name = type(self.region).__name__
            raise WideberthError(f"the parameters of {name} have no closed form")
        size = robot.dimension
        mean, covariance = ca.SX.sym("mean", size), ca.SX.sym("covariance", size, size)
        radius = ca.SX.sym("radius")
        room = radius + (self.bodies(robot)[0].radius + margin)
        found = self.region.closed_form(mean, covariance, room)
        return ca.Function("parameters_of_one", [mean, covariance, radius], [ca.densify(found)])

    def auxiliary_start(self, robot: Robot, pose: Pose, numbers: SlotNumbers) -> Array:
        """Best auxiliaries of the region, body by body."""
        count, level = numbers.parameters.shape[1], numbers.level
        if not len(self.region.auxiliary(robot.dimension)):
            return np.zeros((*numbers.parameters.shape[:2], 0))
        assert level is not None  # every disc has one

        def start(at: Pose) -> Array:
            return self.region.auxiliary_start(at, numbers.parameters, level)

        return body_starts(self.bodies(robot), pose, count, start)

    def levels(self, policy: LevelPolicy, steps: int, count: int, dimension: int) -> Array:
        """Levels that the policy aims at with this region."""
        return policy.levels(self.region, steps, count, dimension)

    def tail(self, level: float, promise: Promise, dimension: int) -> float:
        """Tail of the region at a level."""
        return tail_of(self.region, promise, level, dimension)

    def explanation(self, dimension: int) -> str:
        """Quote the region, and show the parameters of one obstacle to check one's own against."""
        mean = 1.0 + np.arange(dimension, dtype=np.float64)
        covariance = 0.01 * np.eye(dimension) + 0.02 * np.outer(mean, mean)
        numbers = self.region.parameters(GaussianObstacle(mean, covariance), np.array(1.5))
        shown = ", ".join(repr(float(value)) for value in np.ravel(numbers))
        return "\n\n".join(
            [
                quoted(self.region),
                f"For the mean {mean.tolist()} m, the covariance {covariance.round(12).tolist()} "
                "m^2 and a margin (robot, obstacle and what is added) of 1.5 m they are "
                f"{shown}.",
            ]
        )


class OfDiscs(LevelledKind):
    """A kind that takes the place of `GaussianDiscs` and keeps out of the same region."""

    region: Region

    @property
    def discs(self) -> GaussianDiscs:
        """The kind whose place it takes."""
        return GaussianDiscs(self.region)

    def bodies(self, robot: Robot) -> tuple[Body, ...]:
        """Return the bodies of `GaussianDiscs`."""
        return self.discs.bodies(robot)

    def levels(self, policy: LevelPolicy, steps: int, count: int, dimension: int) -> Array:
        """Levels that the policy aims at with this region."""
        return self.discs.levels(policy, steps, count, dimension)

    def tail(self, level: float, promise: Promise, dimension: int) -> float:
        """Tail of the region at a level."""
        return self.discs.tail(level, promise, dimension)

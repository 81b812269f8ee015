"""Gaussian discs: obstacles of a forecast, each a disc around an uncertain place."""

from dataclasses import dataclass, replace
from math import sqrt
from typing import Any, ClassVar, final

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
from ..ocp.bodies import Body, bodies, body_starts, discs
from ..ocp.problem import SlotNumbers, Slots
from ..ocp.reference import Reference
from ..ocp.stage import Frame, slots
from .base import (
    FAR,
    WIDE,
    GaussianKind,
    KnownObstacles,
    LevelledKind,
    OutOfReach,
    PlanningContext,
    SlotAssignment,
    SlotSizes,
    next_capacity,
    quoted,
    reach_of_bodies,
    used,
)
from .contact import Touch, apart
from .screen import leaves_out, out_of_reach


@dataclass(frozen=True, eq=False)
class ObstacleSet:
    """Gaussian discs on the plan's grid, one per obstacle and forecast mode.

    Attributes
    ----------
    mean : (N, O, D), m. covariance : (N, O, D, D), m^2.
    radius : (O,), m.
    ids : (O,) names; modes of one obstacle share a name.
    left_out : names that did not fit, or whose mode is too unlikely.
    out_of_reach : those that no plan can meet, see `slots.screen`; None for none.
    counted : names of all that share what the level policy allows, in the forecast's order; ()
        for those that are here.
    """

    mean: Array
    covariance: Array
    radius: Array
    ids: tuple[str, ...]
    left_out: tuple[str, ...] = ()
    out_of_reach: "ObstacleSet | None" = None
    counted: tuple[str, ...] = ()

    @classmethod
    def of(cls, forecast: Forecast, ids: tuple[str, ...], radius: Array) -> "ObstacleSet":
        """Make a disc of every mode that is not too unlikely.

        Parameters
        ----------
        forecast : on the plan's grid, N steps.
        ids, radius : of its obstacles.
        """
        owner, mode = np.nonzero(forecast.weight >= LIGHT)
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

    def some(self, which: NDArray[np.intp]) -> "ObstacleSet":
        """Return some of the discs, by their indices."""
        kept = tuple(self.ids[i] for i in which)
        return ObstacleSet(
            self.mean[:, which], self.covariance[:, which], self.radius[which], kept
        )


def choose_obstacles(
    discs: ObstacleSet, route: Array, most: int, far: BoolArray | None = None
) -> ObstacleSet:
    """Keep the discs that come closest to the route, at most ``most`` of them.

    Parameters
    ----------
    discs : all of them.
    route : (R, N, D), m, places where the robot may be at each step (the reference, and
        where it is now).
    most : how many discs the problem can hold.
    far : (O,), which ones are out of reach, and need no room in it; None for none.
    """
    beyond = np.zeros(len(discs), dtype=np.bool_) if far is None else far
    near = np.flatnonzero(~beyond)
    kept = near
    if len(near) > most:
        apart = np.linalg.norm(discs.mean[:, near] - route[:, :, None], axis=3)
        clearance = apart.min(axis=(0, 1)) - discs.radius[near]
        kept = np.sort(near[np.argsort(clearance, kind="stable")[:most]])
    counted = beyond.copy()
    counted[kept] = True
    pairs = list(zip(discs.ids, counted.tolist(), strict=True))
    return replace(
        discs.some(kept),
        left_out=(*discs.left_out, *(name for name, held in pairs if not held)),
        out_of_reach=discs.some(np.flatnonzero(beyond)),
        counted=tuple(name for name, held in pairs if held),
    )


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
    steps, size = reference.position.shape
    count = len(obstacles)
    mean = np.zeros((steps, capacity, size))
    covariance = np.zeros((steps, capacity, size, size))
    covariance[:] = np.eye(size)
    margin = np.ones(capacity)
    numbers_of = within_scales(obstacles, reference, radius, own)
    mean[:, :count], covariance[:, :count], margin[:count] = numbers_of
    spread = np.broadcast_to(margin, (steps, capacity))
    numbers = np.zeros((steps, 0, region.parameter_count(size)))
    if capacity:
        # of a checked forecast, brought within reach
        clear_of = assembled(GaussianObstacle, mean=mean, covariance=covariance)
        numbers = region.parameters(clear_of, spread)
    levels = _levels(level, region, obstacles, capacity)
    none = np.zeros((steps, capacity, 0))
    return SlotNumbers(numbers, used(count, capacity), none, levels)


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
    wide = ~(np.abs(covariance).max(axis=(-2, -1), initial=0.0) <= WIDE**2 / size)
    if not wide.any():
        return covariance
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


def _levels(policy: LevelPolicy, region: Region, obstacles: ObstacleSet, capacity: int) -> Array:
    """Level of every slot, (N, capacity): one per obstacle, the same for all of its modes."""
    names = list(dict.fromkeys(obstacles.counted or obstacles.ids))
    steps, _, size = obstacles.mean.shape
    level = policy.levels(region, steps, max(len(names), 1), size)
    owner = [names.index(name) for name in obstacles.ids]
    return level[:, owner + [0] * (capacity - len(owner))]


@final
@dataclass(frozen=True, eq=False)
class KnownDiscs(KnownObstacles):
    """Discs that have a slot, at the forecast's means, which are known at the steps alone."""

    kind: "GaussianDiscs"
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
        return slots(self.name, count, width, own, parts, region.constraint, frame, levelled=True)

    def choose(self, robot: Robot, view: PlanningContext) -> SlotAssignment:
        """Choose the discs that come closest to the route, of those that a plan can meet."""
        obstacles = ObstacleSet.none(*view.reference.position.shape)
        if view.tracks is not None and view.forecast is not None:
            obstacles = ObstacleSet.of(view.forecast, view.tracks.ids, view.tracks.radius)
            far = self.out_of_reach(robot, obstacles, view)
            obstacles = choose_obstacles(obstacles, view.route, view.most, far)
        return self.chosen(robot, obstacles, view.reference, view.level, view.margin, view.own)

    def out_of_reach(
        self, robot: Robot, discs: ObstacleSet, view: PlanningContext
    ) -> BoolArray | None:
        """Which discs no plan can meet, (O,), see `slots.screen`; None where none is left out."""
        region = self.region
        if not (isinstance(region, Bounded) and len(discs) and leaves_out(view.level)):
            return None
        bodies_to = sqrt(robot.dimension) * reach_of_bodies(robot, (self,))
        allowed = np.stack([np.zeros_like(view.travel), view.travel]) + bodies_to
        radius = self.bodies(robot)[0].radius + view.margin
        numbers = within_scales(discs, view.reference, radius, view.own)
        level = _levels(view.level, region, discs, len(discs))
        places = np.stack([view.reference.position, view.here])
        return out_of_reach(region, *numbers, level, places, allowed)

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
        capacity = next_capacity(len(obstacles))
        radius = self.bodies(robot)[0].radius + margin
        numbers = fill(reference, obstacles, self.region, level, radius, capacity, own)
        known = KnownDiscs(self, obstacles, margin)
        names, far = (obstacles.ids, obstacles.left_out), obstacles.out_of_reach
        if far is None:
            return SlotAssignment((capacity,), *names, numbers, known)
        counted = replace(far, counted=obstacles.counted)
        beyond = OutOfReach(far.ids, _levels(level, self.region, counted, len(far)))
        return SlotAssignment((capacity,), *names, numbers, known, beyond)

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

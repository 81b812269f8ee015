"""Planning problems among discs and polygons that several tests solve."""

from dataclasses import replace
from typing import Any

import numpy as np

from wideberth.framework.mpc import assembly
from wideberth.framework.mpc.levels.base import LevelPolicy, SharedLevel
from wideberth.framework.mpc.levels.fixed import Fixed
from wideberth.framework.mpc.ocp.problem import Parameters, Problem, SlotNumbers
from wideberth.framework.mpc.ocp.reference import Reference, lay_reference
from wideberth.framework.mpc.ocp.transcription import Guess
from wideberth.framework.mpc.planner.rollout import steer
from wideberth.framework.mpc.slots import base, gaussian_discs
from wideberth.framework.mpc.slots.base import ActiveObstacles, SlotKind
from wideberth.framework.mpc.slots.gaussian_discs import GaussianDiscs, KnownDiscs, ObstacleSet
from wideberth.framework.mpc.slots.static_polygons import NONE, StaticPolygons, Walls
from wideberth.framework.region import Region
from wideberth.framework.robot import Robot
from wideberth.framework.static_region import StaticRegion
from wideberth.framework.values.arrays import Array
from wideberth.framework.values.motion import Pose, Twist
from wideberth.framework.values.path import Path

STEPS, DT = 15, 0.5


def built_in(
    region: Region, static_region: StaticRegion | None = None
) -> tuple[GaussianDiscs, StaticPolygons]:
    """The kinds of every planner."""
    return GaussianDiscs(region), StaticPolygons(static_region)


def kinds(region: Region, static_region: StaticRegion | None = None) -> tuple[SlotKind, ...]:
    """Discs, and polygons where there is a region for them."""
    return built_in(region, static_region) if static_region else (GaussianDiscs(region),)


def assemble(
    robot: Robot,
    region: Region,
    level: LevelPolicy,
    *,
    capacity: int,
    static_region: StaticRegion | None = None,
    statics: int = 0,
    corners: int = 4,
    **settings: Any,
) -> Problem:
    """Build a problem with slots for discs and polygons."""
    rooms = [(capacity,), (statics, corners)][: 2 if static_region else 1]
    return assembly.assemble(robot, kinds(region, static_region), level, rooms=rooms, **settings)


def of_slots(initial: Array, reference: Reference, *slots: SlotNumbers) -> Parameters:
    """Numbers of an instance on a reference."""
    along = reference.position, reference.direction, reference.speed
    return Parameters(initial, *along, slots, reference.curve)


def fill(
    start: Array,
    reference: Reference,
    obstacles: ObstacleSet,
    region: Region,
    level: LevelPolicy,
    radius: float,
    capacity: int,
    own: Array | None = None,
) -> Parameters:
    """Numbers of an instance with discs alone."""
    discs = gaussian_discs.fill(reference, obstacles, region, level, radius, capacity, own)
    return of_slots(start, reference, discs)


def among(
    start: Array,
    reference: Reference,
    obstacles: ObstacleSet,
    walls: Walls,
    own: Array,
    plugs: tuple[Robot, Region, LevelPolicy, float, StaticRegion | None],
) -> Parameters:
    """Numbers of the smallest instance with room for discs and polygons."""
    robot, region, level, margin, static = plugs
    discs = GaussianDiscs(region).chosen(robot, obstacles, reference, level, margin, own)
    if static is None:
        return of_slots(start, reference, discs.numbers)
    still = StaticPolygons(static).chosen(robot, walls, level, margin, own)
    return of_slots(start, reference, discs.numbers, still.numbers)


def with_auxiliaries(
    robot: Robot,
    region: Region,
    parameters: Parameters,
    guess: Guess,
    static_region: StaticRegion | None = None,
) -> Guess:
    """Fill in the auxiliaries of discs and polygons."""
    return base.with_auxiliaries(robot, kinds(region, static_region), parameters, guess)


def surroundings(
    robot: Robot,
    region: Region,
    static_region: StaticRegion | None = None,
    obstacles: ObstacleSet | None = None,
    walls: Walls = NONE,
    margin: float = 0.0,
) -> ActiveObstacles:
    """What a plan is held against; the numbers of its slots are left out."""
    obstacles = obstacles or ObstacleSet.none(1, robot.dimension)
    discs, polygons = GaussianDiscs(region), StaticPolygons(static_region)
    none = SlotNumbers.none(1)
    known = base.SlotAssignment(
        (0,), obstacles.ids, (), none, KnownDiscs(discs, obstacles, margin)
    )
    still = polygons.chosen(robot, replace(walls, parts=walls.parts[:0], names=()),
                            Fixed(), margin, np.zeros((1, 2, 2)))  # fmt: skip
    return ActiveObstacles(robot, (discs, polygons), (known, still))


def slots_of(given: Parameters, place: int = 0, /, **changes: Any) -> Parameters:
    """Change the numbers of the slots of one kind."""
    slots = list(given.slots)
    slots[place] = replace(slots[place], **changes)
    return replace(given, slots=tuple(slots))


def set_up(
    robot: Robot,
    region: Region,
    level: LevelPolicy,
    capacity: int,
    penalty: float | None = None,
    y: float = 0.4,
) -> tuple[Problem, Parameters, Guess]:
    """One obstacle stands near the robot's straight path."""
    start = np.array(robot.state_at(Pose((0.0, 0.0), 0.0), Twist((0.4, 0.0))), dtype=float)
    path = Path(np.array([[0.0, 0.0], [20.0, 0.0]]))
    reference = lay_reference(path, 0.0, 0.5, STEPS, DT)
    mean = np.tile([4.0, y], (STEPS, 1, 1))
    covariance = np.tile([[0.04, 0.01], [0.01, 0.02]], (STEPS, 1, 1, 1))
    obstacles = ObstacleSet(mean, covariance, np.array([0.4]), ("a",))
    parameters = fill(start, reference, obstacles, region, level, robot.radius, capacity)
    problem = assemble(
        robot, region, level, horizon=STEPS, dt=DT, capacity=capacity, penalty=penalty
    )
    states, inputs = steer(robot, start, Twist((0.4, 0.0), -0.05), STEPS, DT)
    scale = region.level(level.tail) if isinstance(level, SharedLevel) else float("nan")
    guess = Guess.bare(states, inputs, scale)
    guess = with_auxiliaries(robot, region, parameters, guess)
    return problem, guess.pull(parameters), guess

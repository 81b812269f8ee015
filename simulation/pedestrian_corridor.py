"""The corridor of mpc_planner: walls 7 m apart, and people both ways."""

from dataclasses import dataclass, field
from functools import partial
from typing import ClassVar, Literal, TypeAlias, final

import numpy as np

from ..framework.arrays import Array, positive, whole
from ..framework.path import Path
from ..framework.polygon import Polygon
from .agents import RobotAgent
from .crowd_mix import CrowdMix, mix_of
from .placing import apart, checked_choice, corridor_walls, draw_place
from .scenario import Placement, Range, Scenario, checked_range, draw

Flow: TypeAlias = Literal["random", "both_ways"]

HALF_WIDTH = 3.5
ENDS = (-6.5, 39.5)
"""m: y of the walls, and their ends along x."""
AHEAD, AGAINST = ((4.0, 12.0), 30.0), ((20.0, 35.0), -30.0)
"""Range of x of the starts and way along x, m, of those who go with the robot and against it."""
ASIDE = (-3.0, 3.0)
"""m, range of y of the starts."""
BOTH_WAYS = (
    ((10.0, 2.8), (0.0, 2.8)), ((10.0, 1.5), (0.0, 1.5)), ((4.0, -1.5), (10.0, -0.5)),
    ((4.0, 0.2), (10.0, 0.2)),
)  # fmt: skip
"""m, starts and goals of ``both_ways``."""
BOTH_WAYS_SPEED = 1.3
"""m/s, of those."""


@final
@dataclass(frozen=True, eq=False)
class PedestrianCorridor(Scenario):
    """The robot drives along a corridor about the x axis; people walk with it and against it.

    ``random``: each person is one of two groups with equal chances: from x in [4, 12] to 30 m
    farther on, or from x in [20, 35] to 30 m back, y in [-3, 3], at a drawn speed; by social
    forces. ``both_ways``: four people at 1.3 m/s on fixed ways, straight to their goals.

    Parameters
    ----------
    layout : "random" or "both_ways".
    pedestrians : number of people of ``random``; there 0, 4, 8 or 12.
    pedestrian_speed : m/s, range, of ``random``.
    pedestrian_radius : m.
    robot_radius : m, of the robot that there is room for.
    length : m, of the robot's way from the origin.
    crowd : who the people are of ``random``.
    blind : who they are of ``both_ways``.
    phase : range of the phase offset, as a share of the control period, in [0, 1).
    speed : m/s, of the robot at time 0, and its reference speed.

    Raises
    ------
    WideberthError : a number out of range; when drawing, too many people.

    Notes
    -----
    Walls, groups, speeds and radii are those of ``random_social/8_corridor`` and
    ``corridor/4_both_ways`` of mpc_planner's pedestrian simulator, the reference speed of
    2 m/s its planner's. Departures: nobody appears anew after arriving (at these speeds a way
    takes 18 s or more, the robot's 15 s); who would stand on another one is drawn again; the
    social force is the model that it names (Moussaïd's) with the numbers of PySocialForce; the
    walls stand in ``both_ways`` as well; the length of the robot's way is ours. "Process noise"
    of its pedestrians is motion: `CrossingField` has walkers with it.
    """

    reference: ClassVar[str] = "degroot2024topology"

    layout: Flow = "random"
    pedestrians: int = 8
    pedestrian_speed: Range = (1.14, 1.66)
    pedestrian_radius: float = 0.4
    robot_radius: float = 0.325
    length: float = 30.0
    crowd: CrowdMix = field(default_factory=partial(mix_of, {"moussaid_force": {}}))
    blind: CrowdMix = field(default_factory=partial(mix_of, {"constant_velocity": {}}))
    phase: Range = (0.0, 0.99)
    speed: float = 2.0

    def __post_init__(self) -> None:
        checked_choice("pedestrian_corridor.layout", self.layout, Flow)
        whole("pedestrian_corridor.pedestrians", self.pedestrians, least=0)
        for name in ("pedestrian_radius", "robot_radius", "length", "speed"):
            positive(f"pedestrian_corridor.{name}", getattr(self, name))
        checked_range("pedestrian_corridor.pedestrian_speed", self.pedestrian_speed, 1e-3)
        checked_range("pedestrian_corridor.phase", self.phase, 0.0, 1.0 - 1e-9)

    def build(self, rng: np.random.Generator) -> tuple[Placement, ...]:
        """Draw the phase; the way is the same for every seed."""
        way = Path(np.array([[0.0, 0.0], [self.length, 0.0]]))
        return (Placement("robot", way, self.speed, draw(rng, self.phase)),)

    def people(
        self, rng: np.random.Generator, placements: tuple[Placement, ...]
    ) -> tuple[RobotAgent, ...]:
        """Draw the people."""
        if self.layout == "both_ways":
            return tuple(
                self.blind.person(
                    rng, f"person {k}", Path(np.array(way)), BOTH_WAYS_SPEED,
                    self.pedestrian_radius,
                )
                for k, way in enumerate(BOTH_WAYS, start=1)
            )  # fmt: skip
        taken = [(placements[0].path.points[0], self.robot_radius)]
        found = []
        for k in range(1, self.pedestrians + 1):
            way = self._draw_way(rng, taken, k)
            taken.append((way[0], self.pedestrian_radius))
            speed = draw(rng, self.pedestrian_speed)
            radius = self.pedestrian_radius
            found.append(self.crowd.person(rng, f"person {k}", Path(way), speed, radius))
        return tuple(found)

    def polygons(self, rng: np.random.Generator) -> tuple[Polygon, ...]:
        """Both walls; the same for every seed."""
        return corridor_walls(2.0 * HALF_WIDTH, *ENDS)

    def _draw_way(
        self, rng: np.random.Generator, taken: list[tuple[Array, float]], k: int
    ) -> Array:
        """Start and goal of one person, (2, 2), m."""
        group, onward = AHEAD if rng.random() < 0.5 else AGAINST

        def place() -> Array:
            return np.array([draw(rng, group), draw(rng, ASIDE)])

        def free(start: Array) -> bool:
            return apart(start, self.pedestrian_radius, taken, 0.0)

        what = f"person {k} of {self.pedestrians}: take fewer, or smaller people"
        start = draw_place(place, free, what)
        return np.stack([start, start + np.array([onward, 0.0])])

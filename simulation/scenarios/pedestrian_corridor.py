"""The corridor of mpc_planner: walls 7 m apart, and people both ways."""

from dataclasses import dataclass, field, replace
from typing import Any, ClassVar, Literal, TypeAlias, cast, final

import numpy as np

from ...framework.controller import Controller
from ...framework.values.arrays import Array, checked_choice, positive, whole
from ...framework.values.errors import WideberthError
from ...framework.values.motion import Command, Observation
from ...framework.values.path import Path
from ...framework.values.plan import Plan
from ...framework.values.polygon import Polygon
from ..engine.agents import RobotAgent
from .base import PHASE, Placement, Range, Scenario, draw_value
from .crowd_mix import mix_of
from .placing import apart, corridor_walls, draw_place

HEAD_ROOM = 5.0
"""Standard deviations by which a body that sways may be faster than without.

The plant clips what is faster: of two axes, at most exp(-5^2 / 2), four draws in a million.
"""


@final
@dataclass(eq=False)
class Swaying(Controller):
    """Another controller, with white noise on the velocity that it commands.

    ::

        v_k = v(controller)_k + n_k,    n_k ~ N(0, s^2 I),    s^2 T = process_noise^2 update

    with T the controller's period: a position then spreads as that of a body which is moved by
    noise of ``process_noise`` every ``update`` s, process_noise sqrt(update t) per axis after
    t s. The noise hangs on the seed and the time alone.

    Parameters
    ----------
    controller : decides.
    process_noise : m/s per axis, standard deviation.
    seed : of the noise.
    update : s between two draws of the noise that is stood for.

    Raises
    ------
    WideberthError : a number out of range.
    """

    controller: Controller
    process_noise: float
    seed: int
    update: float = 0.05
    period: float = field(init=False)

    def __post_init__(self) -> None:
        positive("swaying.process_noise", self.process_noise, zero=True)
        positive("swaying.update", self.update)
        whole("swaying.seed", self.seed, least=0)
        self.period = self.controller.period

    @property
    def deviation(self) -> float:
        """Standard deviation of the noise on one command, s, per axis, m/s."""
        return float(self.process_noise * np.sqrt(self.update / self.period))

    def reset(self) -> None:
        """Forget everything but the settings."""
        self.controller.reset()

    def set_path(self, path: Path) -> None:
        """Follow this path from now on."""
        self.controller.set_path(path)

    def remember(self, observation: Observation) -> None:
        """Pass the observation on."""
        self.controller.remember(observation)

    def command(self, observation: Observation) -> Command:
        """Decide, and sway; without noise where the observation is useless."""
        command = self.controller.command(observation)
        if observation.flaw:
            return command  # its stop
        rng = np.random.default_rng((self.seed, abs(round(1e6 * observation.stamp))))
        noise = self.deviation * rng.standard_normal(len(command.linear))
        return replace(
            command, linear=tuple(v + float(n) for v, n in zip(command.linear, noise, strict=True))
        )

    @property
    def last_plan(self) -> Plan | None:
        """The plan of the controller, without the noise."""
        return self.controller.last_plan


def made_to_sway(person: RobotAgent, process_noise: float, seed: int) -> RobotAgent:
    """Return a person with velocity noise and the top speed for it; see `Swaying`."""
    made = Swaying(person.controller, process_noise, seed)
    body = cast(Any, person.robot)
    fastest = body.max_speed + HEAD_ROOM * made.deviation
    return replace(person, robot=replace(body, max_speed=fastest), controller=made)


Flow: TypeAlias = Literal["random", "both_ways", "16_random", "8_gaussian"]
Way: TypeAlias = tuple[tuple[float, float], tuple[float, float]]

HALF_WIDTH = 3.5
ENDS = (-6.5, 39.5)
"""m: y of the walls, and their ends along x."""
WALLED = ("random", "both_ways")
"""Layouts with walls."""


@dataclass(frozen=True)
class Group:
    """People who go the same way: ranges of x and y of their starts and way along x, m."""

    x: Range
    y: Range
    onward: float


@dataclass(frozen=True)
class DrawnCrowd:
    """A layout with random people: the groups (with the robot, against it), speeds, number."""

    groups: tuple[Group, Group]
    speed: Range
    pedestrians: int


@dataclass(frozen=True)
class ListedCrowd:
    """A layout with fixed people: starts and goals, m, and their speed, m/s."""

    ways: tuple[Way, ...]
    speed: float


CROWDS = {
    "random": DrawnCrowd(
        (Group((4.0, 12.0), (-3.0, 3.0), 30.0), Group((20.0, 35.0), (-3.0, 3.0), -30.0)),
        (1.14, 1.66), 8,
    ),
    "16_random": DrawnCrowd(
        (Group((2.0, 10.0), (-3.0, 1.0), 40.0), Group((38.0, 44.0), (-1.0, 3.0), -40.0)),
        (0.7, 1.3), 16,
    ),
}  # fmt: skip
FIXED = {
    "both_ways": ListedCrowd(
        (
            ((10.0, 2.8), (0.0, 2.8)), ((10.0, 1.5), (0.0, 1.5)), ((4.0, -1.5), (10.0, -0.5)),
            ((4.0, 0.2), (10.0, 0.2)),
        ),
        1.3,
    ),
    "8_gaussian": ListedCrowd(
        (
            ((2.5, -3.0), (12.0, -1.5)), ((2.35, 0.5), (15.0, -1.0)), ((10.0, -3.5), (0.0, -2.0)),
            ((7.0, 3.0), (0.0, 0.0)), ((3.0, 0.0), (10.0, 0.5)), ((3.0, 1.0), (12.0, 4.0)),
            ((3.5, -3.5), (7.5, 6.0)), ((5.0, -1.0), (9.0, 0.0)),
        ),
        0.7,
    ),
}  # fmt: skip

PEDESTRIAN_RADIUS = 0.4
"""m, of a person."""
LENGTH = 30.0
"""m, of the robot's way from the origin."""
SPEED = 2.0
"""m/s, of the robot at time 0, and its reference speed."""


@final
@dataclass(frozen=True, eq=False)
class PedestrianCorridor(Scenario):
    """The robot drives along a corridor about the x axis; people walk with it and against it.

    ``random``: each person is one of two groups with equal chances: from x in [4, 12] to 30 m
    farther on, or from x in [20, 35] to 30 m back, y in [-3, 3], at a drawn speed; by social
    forces. ``16_random``: likewise from x in [2, 10], y in [-3, 1] to 40 m farther on, or from
    x in [38, 44], y in [-1, 3] to 40 m back, without walls. ``both_ways``: four people at
    1.3 m/s on fixed ways, straight to their goals. ``8_gaussian``: eight at 0.7 m/s, without
    walls.

    Parameters
    ----------
    layout : "random", "16_random", "both_ways" or "8_gaussian".
    pedestrians : number of people, of the random layouts alone; by default 8 in ``random``
        (there 0, 4, 8 or 12) and 16 in ``16_random``.
    robot_radius : m, of the robot that there is room for.
    respawn : whether who has arrived comes anew from the start, see `RobotAgent`.
    process_noise : m/s per axis: at each of 20 updates a second all people are moved by the noise
        of this standard deviation as well, see `Swaying`. There 0, 0.3 ("Safe-Horizon") or 0.8
        ("excessive").

    Raises
    ------
    WideberthError : a number out of range; of a fixed layout, a number of people, or
        people who would touch another body at their starts; when drawing, too many people.

    Notes
    -----
    Groups, ways, speeds and radii are those of ``random_social/8_corridor``,
    ``corridor/16_random``, ``corridor/4_both_ways`` and ``new_safe_horizon/8_gaussian`` of
    mpc_planner's pedestrian simulator (the last one as its older ``crowded_gaussian`` has it,
    with the same speed and first way), the reference speed of 2 m/s its planner's. Departures:
    a goal lies straight ahead of its start, where there it is drawn as the start is and moved
    on; who would stand on another one is drawn again, and one start of ``8_gaussian`` is at
    x = 2.35 m for 2.5 m, where it would touch two others; the social force is the model that it
    names (Moussaïd's) with the numbers of PySocialForce; the walls stand in ``both_ways`` as
    well; blind people stop at their goals, where there they walk on; the length of the robot's
    way is ours. There a person who arrives is no longer seen, and a start for a new one is drawn
    until it is 5 m from the robot; with ``respawn`` the same start is taken as soon as it is.

    The noise is a velocity, not the length as which it is quoted: a position spreads as a random
    walk by process_noise sqrt(0.05 s t), 0.07 m after 1 s of 0.3 m/s. (Its planner counts on
    twice that, on noise that is held for its own steps of 0.2 s.)
    """

    reference: ClassVar[str] = "degroot2024topology"

    layout: Flow = "random"
    pedestrians: int | None = None
    robot_radius: float = 0.325
    respawn: bool = False
    process_noise: float = 0.0

    def __post_init__(self) -> None:
        checked_choice("pedestrian_corridor.layout", self.layout, Flow)
        if self.pedestrians is not None:
            whole("pedestrian_corridor.pedestrians", self.pedestrians, least=0)
        positive("pedestrian_corridor.robot_radius", self.robot_radius)
        positive("pedestrian_corridor.process_noise", self.process_noise, zero=True)
        if self.layout in FIXED:
            self._check_fixed(FIXED[self.layout])

    def _check_fixed(self, layout: ListedCrowd) -> None:
        """Refuse what the random layouts alone have, and people who would touch at the start."""
        if self.pedestrians is not None:
            raise WideberthError(
                f"pedestrian_corridor.pedestrians is {self.pedestrians}, and {self.layout} "
                f"lists its people; leave it out, or take {' or '.join(CROWDS)}"
            )
        taken = [(np.zeros(2), self.robot_radius)]
        for k, (start, _) in enumerate(layout.ways, start=1):
            if not apart(np.array(start), PEDESTRIAN_RADIUS, taken, 0.0):
                raise WideberthError(
                    f"pedestrian_corridor: person {k} of {self.layout} would touch another body "
                    "at the start; take a smaller robot_radius"
                )
            taken.append((np.array(start), PEDESTRIAN_RADIUS))

    def build(self, rng: np.random.Generator) -> tuple[Placement, ...]:
        """Draw the phase; the way is the same for every seed."""
        way = Path(np.array([[0.0, 0.0], [LENGTH, 0.0]]))
        return (Placement("robot", way, SPEED, draw_value(rng, PHASE)),)

    def people(
        self, rng: np.random.Generator, placements: tuple[Placement, ...]
    ) -> tuple[RobotAgent, ...]:
        """Draw the people, and then the seeds of their noise."""
        if self.layout in FIXED:
            found = self._listed(rng, FIXED[self.layout])
        else:
            found = self._drawn(rng, CROWDS[self.layout], placements[0].path.points[0])
        if self.respawn:
            found = [replace(one, respawn=True) for one in found]
        if self.process_noise:
            seeds = [int(seed) for seed in rng.integers(2**31, size=len(found))]
            noise = self.process_noise
            found = [
                made_to_sway(one, noise, seed) for one, seed in zip(found, seeds, strict=True)
            ]
        return tuple(found)

    def polygons(self, rng: np.random.Generator) -> tuple[Polygon, ...]:
        """Both walls, where the layout has them; the same for every seed."""
        return corridor_walls(2.0 * HALF_WIDTH, *ENDS) if self.layout in WALLED else ()

    def _listed(self, rng: np.random.Generator, layout: ListedCrowd) -> list[RobotAgent]:
        blind = mix_of({"constant_velocity": {}})
        return [
            blind.person(rng, f"person {k}", Path(np.array(way)), layout.speed, PEDESTRIAN_RADIUS)
            for k, way in enumerate(layout.ways, start=1)
        ]

    def _drawn(
        self, rng: np.random.Generator, layout: DrawnCrowd, robot: Array
    ) -> list[RobotAgent]:
        count = layout.pedestrians if self.pedestrians is None else self.pedestrians
        crowd = mix_of({"moussaid_force": {}})
        taken, found = [(robot, self.robot_radius)], []
        for k in range(1, count + 1):
            what = f"person {k} of {count}: take fewer, or smaller people"
            way = self._draw_way(rng, layout, taken, what)
            taken.append((way[0], PEDESTRIAN_RADIUS))
            speed = draw_value(rng, layout.speed)
            found.append(crowd.person(rng, f"person {k}", Path(way), speed, PEDESTRIAN_RADIUS))
        return found

    def _draw_way(
        self,
        rng: np.random.Generator,
        layout: DrawnCrowd,
        taken: list[tuple[Array, float]],
        what: str,
    ) -> Array:
        """Start and goal of one person, (2, 2), m."""
        ahead, against = layout.groups
        group = ahead if rng.random() < 0.5 else against

        def place() -> Array:
            return np.array([draw_value(rng, group.x), draw_value(rng, group.y)])

        def free(start: Array) -> bool:
            return apart(start, PEDESTRIAN_RADIUS, taken, 0.0)

        start = draw_place(place, free, what)
        return np.stack([start, start + np.array([group.onward, 0.0])])

"""The hallways of CrowdSimPlus: three people in a narrow corridor, with and without a door."""

from dataclasses import dataclass
from typing import ClassVar, final

import numpy as np

from ...framework.values.arrays import Array, positive, whole
from ...framework.values.errors import WideberthError
from ...framework.values.path import Path
from ...framework.values.polygon import Polygon
from ..engine.agents import RobotAgent
from .base import Cast, Placement, Scenario
from .crowd_mix import CrowdMix, mix_of
from .hallway_walls import Hall, Layout
from .head_start import head_start
from .placing import DRAWS, checked_choice

CASES = 1000
"""Added to the seed: there the test cases follow 1000 validation cases."""
DOWN, RIGHT, CROSSES = 0.15, 0.8, 0.3
"""Chances that a person walks down, walks on the right, and crosses over."""
DISCOMFORT = 0.2
"""m between a person and the robot, at first."""
STRETCH = 1.1
"""Factor of the drawn heights after each place that was not free."""
JAMMED = 0.547
"""Share of a floor that equal discs cover at most when they are placed one after the other at
random (Feder 1980): whoever comes later would be placed beyond the hallway, ever farther away."""


@final
@dataclass(frozen=True, eq=False)
class Hallway(Scenario):
    """The robot goes up a hallway from (0, -R) to (0, R), and people walk up and down it.

    `Hall` has the layouts. With the seed k the people's starts and goals are those of test case k
    of CrowdSimPlus: they are drawn in its order from its generator. 15 % of them walk down,
    towards the robot, 80 % start on their own right. Whose way leads through a door heads
    for its middle first.

    ``head_start`` s before time 0 the people begin to walk from a stand, while the robot waits.

    Parameters
    ----------
    layout : "open", "static", "static_with_back", "bottleneck" or "squeeze".
    persons : number of people.
    person_radius : m. person_speed : m/s.
    robot_radius : m, of the robot that there is room for; the door's length hangs on it, too.
    reference_speed : m/s, of the robot, which stands at time 0.
    circle_radius : R, m.
    width, height : m, of the hallway; its walls go up and down as far as its height.
    door : m, width of the door of "static" and "bottleneck"; that of "squeeze" is half of the
        hallway's.
    head_start : s; there 10 steps of 0.25 s.
    crowd : who the people are; None for the social force with the numbers from there, which
        are others at the bottleneck.

    Raises
    ------
    WideberthError : a number out of range; a door too narrow for those who have to go through
        it; more people than could find room between the walls, however they
        stood.

    Notes
    -----
    Departures: everybody wants to walk at ``person_speed`` (there, by default, at a speed drawn
    from 0.5 to 1.5 m/s, which changes the draws that follow); people go on from the head start
    with a new controller, at the speed that they had towards their goal, and from an earlier
    instant where somebody would begin in contact; walls have a thickness, of 0.02 m where they
    are doors; nobody is stopped by a wall (there an action that would enter one is shortened),
    people keep clear of it by their forces. As there, with walls at the back a person for whom
    there is no room inside is placed, or heads, beyond them.
    """

    reference: ClassVar[str] = "samavi2024sicnav"

    layout: Layout = "open"
    persons: int = 3
    person_radius: float = 0.3
    person_speed: float = 1.0
    robot_radius: float = 0.25
    reference_speed: float = 1.0
    circle_radius: float = 1.5
    width: float = 2.0
    height: float = 4.0
    door: float = 1.0
    head_start: float = 2.5
    crowd: CrowdMix | None = None

    def __post_init__(self) -> None:
        checked_choice("hallway.layout", self.layout, Layout)
        whole("hallway.persons", self.persons, least=0)
        positive("hallway.head_start", self.head_start, zero=True)
        for name in ("person_radius", "person_speed", "robot_radius", "reference_speed", "door"):
            positive(f"hallway.{name}", getattr(self, name))
        for name in ("circle_radius", "width", "height"):
            positive(f"hallway.{name}", getattr(self, name) - 2.0 * self.person_radius)
        self._check_room()
        body = max(self.robot_radius, self.person_radius)
        if self.layout != "open" and self.hall.door <= 2.0 * body:
            raise WideberthError(
                f"hallway: the door is {self.hall.door:g} m wide and a body of radius {body:g} m "
                "does not fit through it; take a wider door or smaller bodies"
            )

    def _check_room(self) -> None:
        """Refuse more people than can be placed at random between the walls."""
        floor = 2.0 * self.width * self.height
        most = int(JAMMED * floor / (np.pi * self.person_radius**2))
        if self.persons > most:
            raise WideberthError(
                f"hallway.persons is {self.persons}; on its {floor:g} m^2 there is room for "
                f"{most} at most of radius {self.person_radius:g} m: take fewer people, smaller "
                "ones, or a larger hallway"
            )

    @property
    def hall(self) -> Hall:
        """Its walls."""
        door = 0.5 * self.width if self.layout == "squeeze" else self.door
        low = self.circle_radius - 2.0 * self.robot_radius
        return Hall(self.layout, self.width, self.height, door, low, self.circle_radius)

    def cast(self, seed: int) -> Cast:
        """Draw the people from the generator of CrowdSimPlus; nothing else is drawn."""
        rng = np.random.default_rng(CASES + seed)
        placements = self.build(rng)
        return Cast(placements, self.people(rng, placements), (), self.polygons(rng))

    def build(self, rng: np.random.Generator) -> tuple[Placement, ...]:
        """Place the robot, standing; the same for every seed."""
        way = np.array([[0.0, -self.circle_radius], [0.0, self.circle_radius]])
        return (Placement("robot", Path(way), 0.0, reference_speed=self.reference_speed),)

    def people(
        self, rng: np.random.Generator, placements: tuple[Placement, ...]
    ) -> tuple[RobotAgent, ...]:
        """Draw the people, and let them walk until time 0."""
        robot = placements[0].path
        starts, goals = [robot.points[0]], [robot.goal]
        for _ in range(self.persons):
            start, goal = self._draw_way(rng, starts, goals)
            starts.append(start)
            goals.append(goal)
        crowd = _social_force(self.layout) if self.crowd is None else self.crowd
        people = [  # their kinds are drawn last, so that the ways are those of CrowdSimPlus
            crowd.person(
                rng, f"person {k}", self._route(starts[k], goals[k]), self.person_speed,
                self.person_radius,
            )
            for k in range(1, self.persons + 1)
        ]  # fmt: skip
        waiting = [(starts[0], self.robot_radius)]
        return head_start(people, self.head_start, waiting, self.hall.polygons(), self._route)

    def polygons(self, rng: np.random.Generator) -> tuple[Polygon, ...]:
        """Walls and door; the same for every seed."""
        return self.hall.polygons()

    def _draw_way(
        self, rng: np.random.Generator, starts: list[Array], goals: list[Array]
    ) -> tuple[Array, Array]:
        """Draw start and goal of one person as CrowdSimPlus does, (2,) each, m.

        Each failed attempt draws everything again, from a range of y that is `STRETCH` times as
        high. A start keeps clear of the other starts; a goal keeps clear of the robot's goal and
        of what the people before head for, which is the door's middle for those who pass it
        (`_route`; the robot heads for its goal). Both keep clear of the walls.

        Raises
        ------
        WideberthError : no room in `DRAWS` attempts.
        """
        size = 2.0 * self.person_radius
        lines = self.hall.lines()
        people = zip(starts[1:], goals[1:], strict=True)
        heads = goals[:1] + [self._route(start, goal).points[1] for start, goal in people]
        radii = np.array([self.robot_radius] + [self.person_radius] * (len(starts) - 1))
        apart = self.person_radius + radii
        around = np.concatenate([apart[:1] + DISCOMFORT, apart[1:]])
        height = self.height
        for _ in range(DRAWS):
            down = 1.0 if rng.random() < DOWN else -1.0
            left = RIGHT if down > 0.0 else 1.0 - RIGHT  # chance to start at x < 0
            side = -1.0 if rng.random() < left else 1.0
            crosses = 1.0 - CROSSES if rng.random() < left else CROSSES
            other = -side if rng.random() < crosses else side
            scale = np.array([0.5 * (self.width - size), self.circle_radius * (height - size)])
            start = rng.random(2) * scale * np.array([side, 0.25 * down])
            height *= STRETCH
            if not _free(start, starts, around, lines, self.person_radius + 0.01):
                continue
            goal = rng.random(2) * scale * np.array([other, -0.5 * down])
            if _free(goal, heads, apart, lines, self.person_radius):
                return start, goal
        raise WideberthError(
            f"in {DRAWS} draws there was no room in the hallway for person {len(starts)} of "
            f"{self.persons}; take fewer people, or a wider hallway"
        )

    def _route(self, place: Array, goal: Array) -> Path:
        """Way to a goal, through the middle of the door where there is one."""
        if self.hall.through(place, goal):
            return Path(np.stack([place, np.zeros(2), goal]))
        return Path(np.stack([place, goal]))


def _social_force(layout: Layout) -> CrowdMix:
    """Return the people of CrowdSimPlus."""
    strength, reach = (6.0, 0.12) if layout == "bottleneck" else (3.0, 0.18)
    settings = {"period": 0.25, "strength": strength, "reach": reach}
    return mix_of({"social_force": settings | {"wall_strength": 2.0, "wall_reach": 0.025}})


def _free(place: Array, others: list[Array], least: Array, lines: Array, wall: float) -> bool:
    """Whether a place keeps these distances from others (O,) and from segments (L, 2, 2), m."""
    if (np.linalg.norm(np.array(others) - place, axis=1) < least).any():
        return False
    begin, step = lines[:, 0], lines[:, 1] - lines[:, 0]
    share = np.einsum("ld,ld->l", place - begin, step) / np.einsum("ld,ld->l", step, step)
    nearest = begin + np.clip(share, 0.0, 1.0)[:, None] * step
    return bool(np.linalg.norm(nearest - place, axis=1).min() >= wall)

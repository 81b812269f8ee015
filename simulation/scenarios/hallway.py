"""The hallways of CrowdSimPlus: three people in a narrow corridor, with and without a door."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import ClassVar, final

import numpy as np

from ...framework.controller import fresh
from ...framework.values.arrays import Array, checked_choice, positive
from ...framework.values.errors import WideberthError
from ...framework.values.path import Path
from ...framework.values.polygon import Polygon, separation
from ..crowds.hall import Hall, Layout, PeopleDraws
from ..engine.agents import ReplayAgent, RobotAgent
from ..engine.episode import run_episode
from ..engine.settings import Settings
from ..log.episode_log import Episode
from ..sensing.channel import Channel
from .base import Cast, Placement, Scenario
from .crowd_mix import CrowdMix, mix_of

PERSONS = 3
"""Number of people."""
PERSON_RADIUS = 0.3
"""m, of a person."""
PERSON_SPEED = 1.0
"""m/s, at which all people want to walk."""
CIRCLE_RADIUS = 1.5
"""R, m."""
WIDTH, HEIGHT = 2.0, 4.0
"""m, of the hallway; its walls go up and down as far as its height."""
DOOR = 1.0
"""m, width of the door of "static" and "bottleneck"; that of "squeeze" is half of the
hallway's."""
HEAD_START = 2.5
"""s before time 0 at which people begin to walk: 10 steps of 0.25 s."""


@final
@dataclass(frozen=True, eq=False)
class Hallway(Scenario):
    """The robot goes up a hallway from (0, -R) to (0, R), and people walk up and down it.

    `Hall` has the layouts. With the seed k the people's starts and goals are those of test case k
    of CrowdSimPlus: they are drawn in its order from its generator. 15 % of them walk down,
    towards the robot, 80 % start on their own right. Whose way leads through a door heads
    for its middle first.

    `HEAD_START` s before time 0 the people begin to walk from a stand, while the robot waits.

    Parameters
    ----------
    layout : "open", "static", "static_with_back", "bottleneck" or "squeeze".
    robot_radius : m, of the robot that there is room for; the door's length hangs on it, too.
    reference_speed : m/s, of the robot, which stands at time 0.

    Raises
    ------
    WideberthError : a number out of range; a door too narrow for those who have to go through
        it; more people than could find room between the walls, however they
        stood.

    Notes
    -----
    `CrowdSimPlus` has the original's rules. Departures here: all people want to walk at
    `PERSON_SPEED` (there, by default, at a speed drawn from 0.5 to 1.5 m/s, which changes the
    draws that follow); people go on from the head start with a new controller, at the speed that
    they had towards their goal, and from an earlier instant where a person would begin in contact;
    walls have a thickness, of 0.02 m where they are doors; no one is stopped by a wall (there an
    action that would enter one is shortened), people keep clear of it by their forces. As there,
    with walls at the back a person for whom there is no room inside is placed, or heads, beyond
    them.
    """

    reference: ClassVar[str] = "samavi2024sicnav"

    layout: Layout = "open"
    robot_radius: float = 0.25
    reference_speed: float = 1.0

    def __post_init__(self) -> None:
        checked_choice("hallway.layout", self.layout, Layout)
        for name in ("robot_radius", "reference_speed"):
            positive(f"hallway.{name}", getattr(self, name))
        body = max(self.robot_radius, PERSON_RADIUS)
        if self.layout != "open" and self.hall.door <= 2.0 * body:
            raise WideberthError(
                f"hallway: the door is {self.hall.door:g} m wide and a body of radius {body:g} m "
                "does not fit through it; take a wider door or smaller bodies"
            )

    @property
    def hall(self) -> Hall:
        """Its walls."""
        door = 0.5 * WIDTH if self.layout == "squeeze" else DOOR
        low = CIRCLE_RADIUS - 2.0 * self.robot_radius
        return Hall(self.layout, WIDTH, HEIGHT, door, low, CIRCLE_RADIUS)

    def cast(self, seed: int) -> Cast:
        """Draw the people from the generator of CrowdSimPlus; nothing else is drawn."""
        rng = PeopleDraws.generator(seed)
        placements = self.build(rng)
        return Cast(placements, self.people(rng, placements), (), self.polygons(rng))

    def build(self, rng: np.random.Generator) -> tuple[Placement, ...]:
        """Place the robot, standing; the same for every seed."""
        way = np.array([[0.0, -CIRCLE_RADIUS], [0.0, CIRCLE_RADIUS]])
        return (Placement("robot", Path(way), 0.0, reference_speed=self.reference_speed),)

    def people(
        self, rng: np.random.Generator, placements: tuple[Placement, ...]
    ) -> tuple[RobotAgent, ...]:
        """Draw the people, and let them walk until time 0."""
        draws = PeopleDraws(self.hall, PERSON_RADIUS, self.robot_radius)
        ways = [(start, goal) for _, start, goal in draws.ways(rng, PERSONS)]
        crowd = _social_force(self.layout)
        people = [  # their kinds are drawn last, so that the ways are those of CrowdSimPlus
            crowd.person(rng, f"person {k}", self._route(start, goal), PERSON_SPEED, PERSON_RADIUS)
            for k, (start, goal) in enumerate(ways, start=1)
        ]
        waiting = [(placements[0].path.points[0], self.robot_radius)]
        return head_start(people, HEAD_START, waiting, self.hall.polygons(), self._route)

    def polygons(self, rng: np.random.Generator) -> tuple[Polygon, ...]:
        """Walls and door; the same for every seed."""
        return self.hall.polygons()

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


HEAD_START_STEP = 0.05
"""s, step of the plants meanwhile."""
ARRIVED = 1e-3
"""m; a robot nearer to its goal keeps a path of this length, since a path needs two points."""


def head_start(
    people: Sequence[RobotAgent],
    duration: float,
    standing: Sequence[tuple[Array, float]],
    polygons: Sequence[Polygon],
    route: Callable[[Array, Array], Path],
) -> tuple[RobotAgent, ...]:
    """Let people walk for ``duration`` s, from a stand, while the robots stand; and go on there.

    Each starts anew where it has come to, along its remaining way and at the speed that it then
    had in that direction. What its controller remembers is lost. Where a person touches a robot
    or another person at the end, or has touched a wall, all start at the last instant at which
    no one did.

    Parameters
    ----------
    people : at their first places; they see each other and the robots.
    duration : s; 0 leaves them where they are.
    standing : (place (2,), radius) of each robot, m.
    polygons : walls.
    route : from (place, goal), (2,) each, m, to the way still to go.
    """
    if not people or not duration:
        return tuple(people)
    always = np.array([-1.0, duration + 1.0])
    waiting = [
        ReplayAgent(f"waiting {i}", always, np.stack([place, place]), radius)
        for i, (place, radius) in enumerate(standing)
    ]
    # People take part as robots, for an episode needs some and ends with them.
    walkers = [
        replace(one, controller=fresh(one.controller), person=False, speed=0.0) for one in people
    ]
    settings = Settings(
        time_limit=duration,
        plant_step=HEAD_START_STEP,
        history=0.0,
        deadlock_after=duration + 1.0,
        goal_tolerance=1e-9,  # no one arrives: the time is spent to the end
        channel=Channel(noise=0.0),
    )
    log = run_episode(walkers, settings, others=waiting, polygons=polygons)
    last = _last_free(log, polygons)
    return tuple(
        _going_on(one, log.agent(one.name).positions[: last + 1], log.times[: last + 1], route)
        for one in people
    )


def _last_free(log: Episode, polygons: Sequence[Polygon]) -> int:
    """Return the index of the last instant without contacts, and before any touch of a wall.

    0 if there is none.
    """
    free = np.ones(len(log.times), dtype=bool)
    for one, other in combinations(log.agents, 2):
        between = np.linalg.norm(one.positions - other.positions, axis=1)
        free &= between >= one.radius + other.radius
    parts = [part for polygon in polygons for part in polygon.parts]
    for one in log.robots:
        for part in parts:
            clear = separation(one.positions[:, None], part)[0] >= one.radius
            free &= np.logical_and.accumulate(clear)  # behind a wall: passed through it
    return int(np.flatnonzero(free)[-1]) if free.any() else 0


def _going_on(
    one: RobotAgent, places: Array, times: Array, route: Callable[[Array, Array], Path]
) -> RobotAgent:
    """Return the same person from the last of these places on, (T, 2), m."""
    place, goal = places[-1], one.path.goal
    if np.hypot(*(goal - place)) < ARRIVED:
        path = Path(np.stack([place, place + ARRIVED * one.path.direction(np.array(np.inf))]))
    else:
        path = route(place, goal)
    if len(places) == 1:
        return replace(one, path=path, speed=0.0)
    velocity = (places[-1] - places[-2]) / (times[-1] - times[-2])
    speed = max(float(velocity @ path.direction(np.zeros(1))[0]), 0.0)
    return replace(one, path=path, speed=speed)

"""The hallways of CrowdSimPlus: three people in a narrow corridor, with and without a door."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import combinations, pairwise
from typing import ClassVar, Literal, TypeAlias, final

import numpy as np

from ...framework.controller import fresh
from ...framework.values.arrays import Array, positive, whole
from ...framework.values.errors import WideberthError
from ...framework.values.path import Path
from ...framework.values.polygon import Polygon, separation
from ..engine.agents import ReplayAgent, RobotAgent
from ..engine.episode import run_episode
from ..engine.settings import Settings
from ..log.episode_log import Episode
from ..sensing.channel import Channel
from .base import Cast, Placement, Scenario
from .crowd_mix import CrowdMix, mix_of
from .placing import DRAWS, box, checked_choice

Layout: TypeAlias = Literal["open", "static", "static_with_back", "bottleneck", "squeeze"]
Corners: TypeAlias = list[tuple[float, float]]

OUTSIDE = 0.2
"""m of wall behind its surface."""
THIN = 0.02
"""m, thickness of the walls that have none there and are met from both sides."""
MIDDLE = 0.4, 0.6
"""Where a static door begins and ends to be at its narrowest, as shares of its length."""
SLANT = 0.75
"""Where its slanted sides begin, as a share of the way from its edge to the wall."""
SQUEEZE = 2.5
"""Half the length of the squeezing walls over the circle's radius."""


@final
@dataclass(frozen=True)
class Hall:
    """A hallway along the y axis, with its middle in the origin.

    - ``open``: two walls.
    - ``static``: and a block on either side of the middle, which leave a door with slanted
      jambs from y = -length to y = length.
    - ``static_with_back``: and a wall across at either end, y = -height / 2 and y = height / 2.
    - ``bottleneck``: the two walls, and a thin one across with a door in it at y = 0.
    - ``squeeze``: two walls that come nearer up to a door at y = 0, and go apart again.

    Parameters
    ----------
    layout : which of them.
    width, height : m; the straight walls go from -height to height.
    door : m, width of the door.
    length : m, half the length of a static door.
    circle_radius : m, which the squeezing walls' length hangs on.
    """

    layout: Layout
    width: float
    height: float
    door: float
    length: float
    circle_radius: float

    def polygons(self) -> tuple[Polygon, ...]:
        """Return the walls as bodies."""
        side, end, edge = 0.5 * self.width, self.height, 0.5 * self.door
        out = side + OUTSIDE
        if self.layout == "squeeze":
            far = SQUEEZE * self.circle_radius
            return _both([(side, -far), (out, -far), (out, far), (side, far), (edge, 0.0)], "wall")
        walls = _both([(side, -end), (out, -end), (out, end), (side, end)], "wall")
        if self.layout == "bottleneck":
            half = 0.5 * THIN
            return walls + _both(
                [(edge, -half), (side, -half), (side, half), (edge, half)], "jamb"
            )
        if self.layout in ("static", "static_with_back"):
            walls += _both(self._block(), "block")
        if self.layout == "static_with_back":
            back = 0.5 * self.height
            walls += (
                box((-side, back), (side, back + THIN), "back above"),
                box((-side, -back - THIN), (side, -back), "back below"),
            )
        return walls

    def lines(self) -> Array:
        """Return the segments that CrowdSimPlus has, (L, 2, 2), m: where nobody may start."""
        side, end, edge = 0.5 * self.width, self.height, 0.5 * self.door
        if self.layout == "squeeze":
            far = SQUEEZE * self.circle_radius
            right: Corners = [(side, -far), (edge, 0.0), (side, far)]
            return _segments([right, _mirrored(right)])
        right = [(side, -end), (side, end)]
        chains = [right, _mirrored(right)]
        if self.layout == "bottleneck":
            chains += [[(edge, 0.0), (side, 0.0)], [(-side, 0.0), (-edge, 0.0)]]
        elif self.layout != "open":
            chains += [self._block(), _mirrored(self._block())]
        if self.layout == "static_with_back":
            back = 0.5 * self.height
            chains += [[(-side, y), (side, y)] for y in (-back, back)]
        return _segments(chains)

    def through(self, place: Array, goal: Array) -> bool:
        """Whether a person on the way to a goal heads for the middle of the door.

        There, those whose way leads through the door do, up to half its width from its
        middle; in the open and the squeezing hallway nobody does.
        """
        if self.layout in ("open", "squeeze"):
            return False
        narrow = self.length * (MIDDLE[1] - MIDDLE[0])
        below, above = sorted((float(place[1]), float(goal[1])))
        return below < -narrow and above > narrow and float(np.hypot(*place)) > 0.5 * self.door

    def _block(self) -> Corners:
        """Corners of the block on the right, from its lower end on the wall to its upper."""
        side, edge = 0.5 * self.width, 0.5 * self.door
        slant = edge + SLANT * (side - edge)
        narrow = self.length * (MIDDLE[1] - MIDDLE[0])
        return [
            (side, -self.length), (slant, -self.length), (edge, -narrow), (edge, narrow),
            (slant, self.length), (side, self.length),
        ]  # fmt: skip


def _mirrored(corners: Corners) -> Corners:
    return [(-x, y) for x, y in corners]


def _both(corners: Corners, name: str) -> tuple[Polygon, ...]:
    """Return a polygon on the right and its mirror image on the left."""
    return (
        Polygon(tuple(corners), f"{name} right"),
        Polygon(tuple(_mirrored(corners)), f"{name} left"),
    )


def _segments(chains: list[Corners]) -> Array:
    """Segments between neighbours of each chain, (L, 2, 2)."""
    return np.array([pair for chain in chains for pair in pairwise(chain)])


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
    person_radius : m.
    person_speed : m/s, at which everybody wants to walk.
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
    had in that direction. What its controller remembers is lost. Where somebody touches a robot
    or somebody else at the end, or has touched a wall, all start at the last instant at which
    nobody did.

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
        goal_tolerance=1e-9,  # nobody arrives: the time is spent to the end
        channel=Channel(noise=0.0),
    )
    log = run_episode(walkers, settings, others=waiting, polygons=polygons)
    last = _last_free(log, polygons)
    return tuple(
        _going_on(one, log.agent(one.name).positions[: last + 1], log.times[: last + 1], route)
        for one in people
    )


def _last_free(log: Episode, polygons: Sequence[Polygon]) -> int:
    """Index of the last instant at which nobody touches anybody, and nobody has touched a wall.

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

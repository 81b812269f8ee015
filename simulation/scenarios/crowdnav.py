"""CrowdNav: a robot crosses a circle or a square of people who avoid each other."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from math import cos, hypot, pi, sin
from typing import Any, ClassVar, Literal, final

import numpy as np

from ...framework.controller import Controller, DrivesRobot, driving, fresh
from ...framework.plugins.config import build
from ...framework.robot import SpeedLimited
from ...framework.values.arrays import positive, whole
from ...framework.values.errors import WideberthError
from ...framework.values.path import Path
from ..engine.agents import RobotAgent
from ..log.episode_log import Episode
from ..measures.crowdnav_verdict import verdict
from .base import Cast, Placement, Scenario

DRAWS = 10000
"""Tries to place a person before the crowd is said to leave no room."""
STANDING = {0: 0.05, 1: 0.2, 2: 0.2, 3: 0.3, 4: 0.1, 5: 0.15}
WALKING = {1: 0.3, 2: 0.3, 3: 0.2, 4: 0.1, 5: 0.1}
"""How many people a mixed situation has, and how probable that is."""
OFFSET = {"validation": 0, "test": 1000}
"""First seed of each phase."""

Point = tuple[float, float]


def _orca() -> Controller:
    """Return a person as CrowdNav has them: ORCA, 0.3 m, 1 m/s."""
    body = {"type": "holonomic_velocity", "radius": 0.3, "max_speed": 1.0}
    made = build("controllers", {"type": "orca", "robot": body})
    assert isinstance(made, Controller)
    return made


@dataclass(frozen=True)
class _Body:
    """A person: start and goal, m, radius, m, and preferred speed, m/s."""

    start: Point
    goal: Point
    radius: float
    speed: float = 1.0


@final
@dataclass(frozen=True)
class CrowdNav(Scenario):
    """The simulation cases of CrowdNav, seed for seed.

    The robot goes from (0, -R) to (0, R). In the ``circle``, each person starts near a circle of
    radius R, at R (cos a, sin a) + n with a uniform in [0, 2 pi) and n uniform in
    [-1/2, 1/2] v_pref per axis, and wants to the point opposite; in the ``square``, on one side
    of the y axis, and wants to the other. ``mixed`` is either up to five who stand in a field of
    4 m x 8 m, or up to five who walk, two as in the circle and the others as in the square.
    Starts and goals that come nearer than ``room`` to those before are drawn again. Everybody
    stands at time 0.

    Case k draws from MT19937 seeded with 1000 + k (``test``; 500 cases are usual) or k
    (``validation``), in the order of the original, so that the cases are the same ones.

    The settings of an episode that make it CrowdNav's: ``plant_step: 0.25``, ``history: 0``,
    ``channel: {noise: 0}``, ``time_limit: 24``, ``goal_tolerance`` the robot's radius,
    ``deadlock_after: 30``. `judge` gives its verdict, see `crowdnav_verdict`; robots with
    limited accelerations are no part of the original: mark them as kinodynamic.

    Parameters
    ----------
    layout : see above.
    humans : how many people; a mixed situation draws their number.
    visible : whether people see the robot. Where they do not, it has to make all the way.
    random_attributes : draw v_pref in [0.5, 1.5] m/s and the radius in [0.3, 0.5] m of each.
    phase : which seeds.
    circle_radius : R, m.
    square_width : m.
    room : m between surfaces at first; the verdict counts less as danger.
    robot_radius : m, for which room is kept.
    speed : m/s, reference speed of the robot.
    human : controller of the people; its ``robot`` is their body.

    Raises
    ------
    WideberthError : a number out of range, a controller without body; when drawing, no room.
    """

    reference: ClassVar[str] = "chen2019crowd"

    layout: Literal["circle", "square", "mixed"] = "circle"
    humans: int = 5
    visible: bool = False
    random_attributes: bool = False
    phase: Literal["validation", "test"] = "test"
    circle_radius: float = 4.0
    square_width: float = 10.0
    room: float = 0.2
    robot_radius: float = 0.3
    speed: float = 1.0
    human: Controller = field(default_factory=_orca)

    def __post_init__(self) -> None:
        whole("crowdnav.humans", self.humans, least=0)
        for name in ("circle_radius", "square_width", "robot_radius", "speed"):
            positive(f"crowdnav.{name}", getattr(self, name))
        positive("crowdnav.room", self.room, zero=True)
        if self.layout not in ("circle", "square", "mixed"):
            raise WideberthError(
                f"crowdnav.layout is {self.layout!r}; wanted circle, square or mixed"
            )
        if self.phase not in OFFSET:
            raise WideberthError(f"crowdnav.phase is {self.phase!r}; wanted one of {list(OFFSET)}")
        _ = self.body

    @property
    def body(self) -> SpeedLimited:
        """The robot that stands for a person.

        Raises
        ------
        WideberthError : the controller of people drives no robot with a largest speed.
        """
        if isinstance(self.human, DrivesRobot) and isinstance(self.human.robot, SpeedLimited):
            return self.human.robot
        raise WideberthError(
            f"crowdnav.human is {type(self.human).__name__}; wanted a controller with a robot "
            "that has a radius and a max_speed, as orca on holonomic_velocity"
        )

    def build(self, rng: np.random.Generator) -> tuple[Placement, ...]:
        """Place the robot; nothing is drawn."""
        reach = self.circle_radius
        way = Path(np.array([[0.0, -reach], [0.0, reach]]))
        return (Placement("robot", way, self.speed, visible=self.visible),)

    def cast(self, seed: int) -> Cast:
        """Draw the case of a seed, all from one generator as in the original."""
        draws = _Draws(self, np.random.RandomState(OFFSET[self.phase] + seed))
        placements = self.build(np.random.default_rng(seed))
        people = [self._person(i, body) for i, body in enumerate(draws.people(), start=1)]
        return Cast(placements, tuple(people))

    def judge(self, episode: Episode) -> dict[str, Any]:
        """Judge an episode by CrowdNav's own rules."""
        return verdict(episode, self.room)

    def _person(self, number: int, body: _Body) -> RobotAgent:
        controller: Any = self.human
        robot = replace(controller.robot, radius=body.radius, max_speed=body.speed)
        start, goal = np.array(body.start), np.array(body.goal)
        if np.array_equal(start, goal):  # stands: a path has a length
            start = goal - (0.0, 1e-9)
        path, made = Path(np.stack([start, goal])), driving(fresh(controller), robot)
        return RobotAgent(f"person {number}", robot, made, path, speed=0.0, person=True)


class _Draws:
    """Draws the people of one case, in the order of the original."""

    def __init__(self, scenario: CrowdNav, rng: np.random.RandomState) -> None:
        self.scenario, self.rng = scenario, rng
        reach = scenario.circle_radius
        robot = _Body((0.0, -reach), (0.0, reach), scenario.robot_radius)
        self.known = [robot]

    def people(self) -> list[_Body]:
        """Draw all of them."""
        layout, count = self.scenario.layout, self.scenario.humans
        if layout != "mixed":
            one = self._on_circle if layout == "circle" else self._in_square
            ways: list[Callable[[], _Body]] = [one] * count
        elif self.rng.random_sample() < 0.2:
            ways = [self._standing] * self._number(STANDING) or [self._absent]
        else:
            count = self._number(WALKING)
            ways = [self._on_circle if i < 2 else self._in_square for i in range(count)]
        for way in ways:
            self.known.append(way())
        return self.known[1:]

    def _number(self, shares: dict[int, float]) -> int:
        left = self.rng.random_sample()
        for count, share in shares.items():
            if left - share <= 0:
                return count
            left -= share
        return max(shares)

    def _attributes(self) -> tuple[float, float]:
        """Radius and preferred speed of the next person."""
        body = self.scenario.body
        if not self.scenario.random_attributes:
            return float(body.radius), float(body.max_speed)
        speed = self.rng.uniform(0.5, 1.5)
        return self.rng.uniform(0.3, 0.5), speed

    def _on_circle(self) -> _Body:
        radius, speed = self._attributes()

        def draw() -> Point:
            angle = self.rng.random_sample() * pi * 2
            dx = (self.rng.random_sample() - 0.5) * speed
            dy = (self.rng.random_sample() - 0.5) * speed
            reach = self.scenario.circle_radius
            return reach * cos(angle) + dx, reach * sin(angle) + dy

        x, y = self._free(draw, radius, starts=True, goals=True)
        return _Body((x, y), (-x, -y), radius, speed)

    def _in_square(self) -> _Body:
        radius, speed = self._attributes()
        side, width = self._side(), self.scenario.square_width
        start = self._free(self._field(width, width, side), radius, starts=True)
        goal = self._free(self._field(width, width, -side), radius, goals=True)
        return _Body(start, goal, radius, speed)

    def _standing(self) -> _Body:
        body = self.scenario.body
        side = self._side()
        place = self._free(self._field(4.0, 8.0, side), float(body.radius), starts=True)
        return _Body(place, place, float(body.radius), float(body.max_speed))

    def _absent(self) -> _Body:
        """Put one person far away, as the original does where there is no one."""
        body = self.scenario.body
        return _Body((0.0, -10.0), (0.0, -10.0), float(body.radius), float(body.max_speed))

    def _side(self) -> float:
        return -1.0 if self.rng.random_sample() > 0.5 else 1.0

    def _field(self, width: float, height: float, side: float) -> Callable[[], Point]:
        """Draw a place in half a field, on one side of the y axis."""

        def draw() -> Point:
            x = self.rng.random_sample() * width * 0.5 * side
            return x, (self.rng.random_sample() - 0.5) * height

        return draw

    def _free(
        self,
        draw: Callable[[], Point],
        radius: float,
        *,
        starts: bool = False,
        goals: bool = False,
    ) -> Point:
        """Draw until there is room before the starts, or the goals, of those who are there."""
        for _ in range(DRAWS):
            x, y = draw()
            taken = False
            for body in self.known:
                least = radius + body.radius + self.scenario.room
                kept = [body.start] * starts + [body.goal] * goals
                taken = taken or any(hypot(x - a, y - b) < least for a, b in kept)
            if not taken:
                return x, y
        raise WideberthError(
            f"in {DRAWS} draws there was no room for person {len(self.known)} of "
            f"{self.scenario.humans}; take fewer humans or a larger circle_radius or square_width"
        )

"""CrowdNav: a robot crosses a circle or a square of people who avoid each other."""

from collections.abc import Callable
from dataclasses import dataclass
from math import cos, hypot, pi, sin
from typing import Any, ClassVar, Literal, TypeAlias, final

import numpy as np

from wideberth.framework.plugins.config import build
from wideberth.framework.values.arrays import Array, BoolArray, checked_choice, positive, whole
from wideberth.framework.values.errors import WideberthError
from wideberth.framework.values.path import Path
from wideberth.metrics.episode import approach
from wideberth.simulation.engine.agents import RobotAgent
from wideberth.simulation.log.episode_log import Episode
from wideberth.simulation.scenarios.base import Cast, Placement, Scenario

CROWDNAV_STEP = 0.25
"""s, CrowdNav's step."""
LIMIT = 24.0
"""s; a step that begins then or later is a timeout (its time limit of 25 s less 1 s)."""


@dataclass(frozen=True)
class _Steps:
    """Per step of 0.25 s: nearest surface distance, m, and whether the goal is reached."""

    distance: Array
    arrived: BoolArray


def verdict(episode: Episode, danger: float = 0.2) -> dict[str, Any]:
    """Judge an episode with one robot as CrowdNav does, from its log.

    In every step of 0.25 s it looks at, in this order: timeout (the step begins at 24 s or
    later); collision; goal (the robot's end is nearer to it than its own radius); danger. The
    distance to a person is taken on the straight segment of the relative position, which
    starts where both are and moves with the robot's *new* and the person's *previous* velocity
    (0 at first): CrowdNav decides on the step before it is made. Our own collisions are those of
    where both really were, see `gaps`; the two differ where a person turns.

    Robots with heading, and logs at finer steps, are judged by their displacement in a step.

    Returns
    -------
    row : ``outcome`` (success, collision, timeout), ``time_s`` of the end of
        the step that decided, ``danger_share`` of the steps in which a person came
        nearer than ``danger`` (surfaces, m) without a collision, ``distance_m``, the
        mean distance (surface) in those steps, None without any.

    References
    ----------
    chen2019crowd; its simulator's step.
    """
    count = max(int(np.ceil(episode.duration / CROWDNAV_STEP - 1e-6)), 1)
    steps = _looked_at(episode, count)
    begin = CROWDNAV_STEP * np.arange(count)
    ends = np.flatnonzero((begin >= LIMIT) | (steps.distance < 0.0) | steps.arrived)
    last = int(ends[0]) if ends.size else count - 1
    if not ends.size or begin[last] >= LIMIT:
        outcome = "timeout"
    else:
        outcome = "collision" if steps.distance[last] < 0.0 else "success"
    near = steps.distance[:last]  # the step that decides is not one of danger
    near = near[near < danger]
    return {
        "outcome": outcome,
        "time_s": float(begin[last] + CROWDNAV_STEP),
        "danger_share": len(near) / (last + 1),
        "distance_m": float(near.mean()) if near.size else None,
    }


def _looked_at(episode: Episode, count: int) -> _Steps:
    robot = episode.robots[0]
    times = np.minimum(CROWDNAV_STEP * np.arange(count + 1), episode.duration)
    way = episode.at(robot, times)
    distance = np.full(count, np.inf)
    for other in episode.agents:
        if other is robot:
            continue
        place = episode.at(other, times)
        moved = np.diff(place, axis=0)
        before = np.concatenate([np.zeros((1, 2)), moved[:-1]])
        start = place[:-1] - way[:-1]
        end = start + before - np.diff(way, axis=0)
        gap = _to_origin(start, end) - other.radius - robot.radius
        distance = np.minimum(distance, gap)
    away = np.linalg.norm(way[1:] - robot.paths[-1][1].goal, axis=1)
    return _Steps(distance, away < robot.radius)


def _to_origin(start: Array, end: Array) -> Array:
    """Distance of the origin to segments, (T, 2) and (T, 2) -> (T,)."""
    pairs = np.stack([start, end], axis=1).reshape(-1, 2)
    return approach(pairs, np.zeros_like(pairs))[::2]


DRAWS = 10000
"""Tries to place a person before the crowd is said to leave no room."""
STANDING = {0: 0.05, 1: 0.2, 2: 0.2, 3: 0.3, 4: 0.1, 5: 0.15}
WALKING = {1: 0.3, 2: 0.3, 3: 0.2, 4: 0.1, 5: 0.1}
"""How many people a mixed situation has, and how probable that is."""
RADIUS, SPEED = 0.3, 1.0
"""m and m/s, of a person whose attributes are not drawn; the speed is the robot's too."""
CIRCLE_RADIUS = 4.0
"""m, R."""
SQUARE_WIDTH = 10.0
"""m."""
ROOM = 0.2
"""m between surfaces at first; the verdict counts less as danger."""
OFFSET = {"validation": 0, "test": 1000}
"""First seed of each phase."""

Point: TypeAlias = tuple[float, float]
Kind: TypeAlias = Literal["circle", "square", "mixed"]
Phase: TypeAlias = Literal["validation", "test"]


def _person(number: int, body: "_Body") -> RobotAgent:
    """Return a person of this body, who walks by ORCA."""
    robot = build(
        "robots", {"type": "holonomic_velocity", "radius": body.radius, "max_speed": body.speed}
    )
    start, goal = np.array(body.start), np.array(body.goal)
    if np.array_equal(start, goal):  # stands: a path has a length
        start = goal - (0.0, 1e-9)
    orca = build("controllers", {"type": "orca", "robot": robot})
    path = Path(np.stack([start, goal]))
    return RobotAgent(f"person {number}", robot, orca, path, speed=0.0, person=True)


@dataclass(frozen=True)
class _Body:
    """A person: start and goal, m, radius, m, and preferred speed, m/s."""

    start: Point
    goal: Point
    radius: float
    speed: float = SPEED


@final
@dataclass(frozen=True)
class CrowdNav(Scenario):
    """The simulation cases of CrowdNav, seed for seed.

    The robot goes from (0, -R) to (0, R). In the ``circle``, each person starts near a circle of
    radius R, at R (cos a, sin a) + n with a uniform in [0, 2 pi) and n uniform in
    [-1/2, 1/2] v_pref per axis, and wants to the point opposite; in the ``square``, on one side
    of the y axis, and wants to the other. ``mixed`` is either up to five who stand in a field of
    4 m x 8 m, or up to five who walk, two as in the circle and the others as in the square.
    Starts and goals that come nearer than `ROOM` to those before are drawn again. All
    stand at time 0.

    Case k draws from MT19937 seeded with 1000 + k (``test``; 500 cases are usual) or k
    (``validation``), in the order of the original, so that the cases are the same ones.

    The settings of an episode that make it CrowdNav's: ``plant_step: 0.25``, ``history: 0``,
    ``channel: {noise: 0}``, ``time_limit: 24``, ``goal_tolerance`` the robot's radius,
    ``deadlock_after: 30``. `judge` gives its verdict, see `verdict`; robots with
    limited accelerations are no part of the original: mark them as kinodynamic.

    Parameters
    ----------
    layout : see above.
    humans : how many people; a mixed situation draws their number.
    visible : whether people see the robot. Where they do not, it has to make all the way.
    random_attributes : draw v_pref in [0.5, 1.5] m/s and the radius in [0.3, 0.5] m of each.
    phase : which seeds.
    robot_radius : m, for which room is kept.

    Raises
    ------
    WideberthError : a number out of range; when drawing, no room.
    """

    reference: ClassVar[str] = "chen2019crowd"

    layout: Kind = "circle"
    humans: int = 5
    visible: bool = False
    random_attributes: bool = False
    phase: Phase = "test"
    robot_radius: float = 0.3

    def __post_init__(self) -> None:
        whole("crowdnav.humans", self.humans, least=0)
        positive("crowdnav.robot_radius", self.robot_radius)
        checked_choice("crowdnav.layout", self.layout, Kind)
        checked_choice("crowdnav.phase", self.phase, Phase)

    def build(self, rng: np.random.Generator) -> tuple[Placement, ...]:
        """Place the robot; nothing is drawn."""
        way = Path(np.array([[0.0, -CIRCLE_RADIUS], [0.0, CIRCLE_RADIUS]]))
        return (Placement("robot", way, SPEED, visible=self.visible),)

    def cast(self, seed: int) -> Cast:
        """Draw the case of a seed, all from one generator as in the original."""
        draws = _Draws(self, np.random.RandomState(OFFSET[self.phase] + seed))
        placements = self.build(np.random.default_rng(seed))
        people = [_person(i, body) for i, body in enumerate(draws.people(), start=1)]
        return Cast(placements, tuple(people))

    def judge(self, episode: Episode) -> dict[str, Any]:
        """Judge an episode by CrowdNav's own rules."""
        return verdict(episode, ROOM)


class _Draws:
    """Draws the people of one case, in the order of the original."""

    def __init__(self, scenario: CrowdNav, rng: np.random.RandomState) -> None:
        self.scenario, self.rng = scenario, rng
        robot = _Body((0.0, -CIRCLE_RADIUS), (0.0, CIRCLE_RADIUS), scenario.robot_radius)
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
        if not self.scenario.random_attributes:
            return RADIUS, SPEED
        speed = self.rng.uniform(0.5, 1.5)
        return self.rng.uniform(0.3, 0.5), speed

    def _on_circle(self) -> _Body:
        radius, speed = self._attributes()

        def draw() -> Point:
            angle = self.rng.random_sample() * pi * 2
            dx = (self.rng.random_sample() - 0.5) * speed
            dy = (self.rng.random_sample() - 0.5) * speed
            return CIRCLE_RADIUS * cos(angle) + dx, CIRCLE_RADIUS * sin(angle) + dy

        x, y = self._free(draw, radius, starts=True, goals=True)
        return _Body((x, y), (-x, -y), radius, speed)

    def _in_square(self) -> _Body:
        radius, speed = self._attributes()
        side = self._side()
        start = self._free(self._field(SQUARE_WIDTH, SQUARE_WIDTH, side), radius, starts=True)
        goal = self._free(self._field(SQUARE_WIDTH, SQUARE_WIDTH, -side), radius, goals=True)
        return _Body(start, goal, radius, speed)

    def _standing(self) -> _Body:
        place = self._free(self._field(4.0, 8.0, self._side()), RADIUS, starts=True)
        return _Body(place, place, RADIUS)

    def _absent(self) -> _Body:
        """Put one person far away, as the original does where there is no one."""
        return _Body((0.0, -10.0), (0.0, -10.0), RADIUS)

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
                least = radius + body.radius + ROOM
                for at, counts in ((body.start, starts), (body.goal, goals)):
                    taken |= counts and hypot(x - at[0], y - at[1]) < least
            if not taken:
                return x, y
        raise WideberthError(
            f"in {DRAWS} draws there was no room for person {len(self.known)} of "
            f"{self.scenario.humans}; take fewer humans"
        )

"""The crowd of CrowdNav++: twenty people who are replaced when they arrive, and see no robot."""

from dataclasses import dataclass, field
from math import cos, hypot, pi, sin
from typing import Any, Literal, TypeAlias, final

import numpy as np
from numpy.typing import NDArray

from ...framework.plugins.rvo2 import rvo2
from ...framework.values.arrays import Array, BoolArray
from ...framework.values.errors import WideberthError
from .base import STEP, Crowd

Point: TypeAlias = tuple[float, float]
Variant: TypeAlias = Literal["plain", "random"]
Phase: TypeAlias = Literal["validation", "test"]
Outcome: TypeAlias = Literal["", "success", "collision", "timeout"]

LIMIT = 49.0
"""s; a step that begins then or later is a timeout (its time limit of 50 s less 1 s)."""
PEOPLE = 20
CIRCLE = 6.0 * 2.0**0.5
"""m, radius of the circle that people cross."""
ARENA = 6.0
"""m, half the side of the square that the robot crosses."""
LEAST_WAY = 8.0
"""m, from the robot's start to its goal."""
RADIUS = 0.3
"""m, of the robot, and of people whose attributes are not drawn."""
ROOM = 0.25
"""m, least distance between surfaces at which a person is placed."""
SENSOR_RANGE = 5.0
"""m between surfaces up to which the robot sees a person."""
UNSEEN = (15.0, 15.0)
"""m, where the original believes a person to be whom it has not seen at time 0."""
HORIZON = 5
"""Steps into people's true future that count as an intrusion."""
INTRUSION = 0.6
"""m between the robot's centre and a future centre of a person; whatever the radii."""
GOAL_PERIOD = 5.0
"""s; as often, each person changes their goal with a chance of 1/2 (``random``)."""
OFFSET: dict[Phase, int] = {"validation": 0, "test": 1000}
"""First seed of each phase."""
DRAWS = 10000
"""Tries to place a person; the original has no limit."""

NEIGHBOUR_DISTANCE = 10.0
"""m, of ORCA where it is not drawn."""
TIME_HORIZON = 5.0
"""s, of ORCA, for people and for walls."""
PADDING = 0.01 + 0.15
"""m, which ORCA adds to every radius: a constant, and the safety space."""


@final
@dataclass
class CrowdNavPlusVerdict:
    """What the original's rules say of a case up to now.

    Attributes
    ----------
    outcome : "success", "collision" or "timeout"; empty while it goes on.
    time : s, of the newest state that was judged.
    steps : number of states that were judged, the first and the last included.
    intrusions : m, of each state in which the robot stood where a person whom it sees will be
        soon: the least distance from its centre to such a future centre.
    way : m, that the robot has gone from state to state.
    """

    outcome: Outcome = ""
    time: float = 0.0
    steps: int = 0
    intrusions: list[float] = field(default_factory=list)
    way: float = 0.0

    def row(self) -> dict[str, Any]:
        """Return it as columns of a table; of a case that was cut short as a timeout.

        ``intrusion_percent`` is the share of the judged states with an intrusion, and
        ``intrusion_distance_m`` the mean of their distances, None without any.
        """
        near = self.intrusions
        return {
            "outcome": self.outcome or "timeout",
            "time_s": self.time,
            "steps": self.steps,
            "danger_steps": len(near),
            "intrusion_percent": 100.0 * len(near) / self.steps,
            "intrusion_distance_m": float(np.mean(near)) if near else None,
            "way_m": self.way,
        }


@final
class CrowdNavPlusCrowd(Crowd):
    """One case: the people, what the robot sees and believes of them, and the verdict.

    Made at time 0, with the first state judged. `step` moves the people on by 0.25 s, takes the
    robot's next place, and does what the original does then, in its order: look, change goals,
    replace who has arrived, decide for all people, judge. So a state is judged with the people
    as they are after a person was replaced, but the robot sees them as they were before.

    Parameters
    ----------
    case : from 0; with the seed it gives the generator, ``RandomState(offset + case + seed)``.
    variant : "random" draws radius, preferred speed and ORCA's neighbour distance of each, and
        has people change their goals.
    seed : S of the original, its "thisSeed".
    phase : "test" or "validation".

    Attributes
    ----------
    positions, velocities, goals : (20, 2), m and m/s, of the people in their slots.
    radii, speeds : (20,), m and m/s; the preferred speed is used as the largest one.
    neighbour_distances : (20,), m, as drawn.
    arrivals : (20,), how many have had this slot before.
    seen : (20,), whether the robot saw who was in this slot when it looked last.
    believed : (20, 5), x, y, vx, vy and radius as the original's robots believe them to be: of
        those seen the truth, of others the last belief moved on.
    robot, robot_goal : (2,), m.
    futures : (5, 20, 2), m, people's places at the next steps if no one changed their goal.
    """

    def __init__(self, case: int, variant: Variant, seed: int, phase: Phase = "test") -> None:
        self._rng: Any = np.random.RandomState(OFFSET[phase] + case + seed)
        self.random: bool = variant == "random"
        self.ticks: int = 0
        self.verdict: CrowdNavPlusVerdict = CrowdNavPlusVerdict()
        self._nearest: float = NEIGHBOUR_DISTANCE  # one variable for all, as there
        self.positions: Array = np.zeros((0, 2))
        self.goals: Array = np.zeros((0, 2))
        self.radii: Array = np.zeros(0)
        self.speeds: Array = np.zeros(0)
        self.neighbour_distances: Array = np.zeros(0)
        robot, goal = self._draw_robot()
        self.robot: Array = robot
        self.robot_goal: Array = goal
        for _ in range(PEOPLE):
            self._add(self._draw_person())
        self.velocities: Array = np.zeros((PEOPLE, 2))
        self.arrivals: NDArray[np.int64] = np.zeros(PEOPLE, dtype=np.int64)
        self.believed: Array = np.tile([*UNSEEN, 0.0, 0.0, RADIUS], (PEOPLE, 1))
        self._minds = _Minds(self.random)
        self._look()
        self._decide()
        self._judge()

    @property
    def time(self) -> float:
        """Time of the present state, s."""
        return STEP * self.ticks

    @property
    def ahead(self) -> Array:
        """Where people will be after the next step, (20, 2), m."""
        return np.asarray(self.futures[0])

    def verdict_row(self) -> dict[str, Any]:
        """Return what the original's rules say up to now, see `CrowdNavPlusVerdict.row`."""
        return self.verdict.row()

    def step(self, robot: Array, *, stopped: bool = False) -> Outcome:
        """Move on by one step, at whose end the robot is at ``robot``, (2,), m; judge the state.

        There are no walls that could have stopped it.

        Raises
        ------
        WideberthError : in ``DRAWS`` draws no place was free for a person.
        """
        robot = np.asarray(robot, dtype=np.float64)
        self.verdict.way += hypot(*(robot - self.robot))
        self.robot = robot
        self.positions = self.ahead
        self.velocities = self._actions
        self.ticks += 1
        self._look()
        if self.random and self.ticks % round(GOAL_PERIOD / STEP) == 0:
            self._change_goals()
        self._replace()
        self._decide()
        return self._judge()

    def _draw_robot(self) -> tuple[Array, Array]:
        while True:
            px, py, gx, gy = self._rng.uniform(-ARENA, ARENA, 4)
            if hypot(px - gx, py - gy) >= LEAST_WAY:
                return np.array([px, py]), np.array([gx, gy])

    def _draw_person(self) -> tuple[Array, float, float, float]:
        """Draw a person: start, radius, speed and neighbour distance."""
        rng = self._rng
        speed, radius = 1.0, RADIUS
        if self.random:
            self._nearest = rng.uniform(5.0, 10.0)
            speed, radius = rng.uniform(0.5, 1.5), rng.uniform(0.3, 0.5)

        def draw() -> Point:
            angle = rng.random_sample() * pi * 2.0
            dx, dy = rng.uniform(0.0, 1.0) * 2.0, rng.uniform(0.0, 1.0) * 2.0
            return CIRCLE * cos(angle) + dx, CIRCLE * sin(angle) + dy

        return self._free(draw, radius, [*range(len(self.radii))]), radius, speed, self._nearest

    def _add(self, drawn: tuple[Array, float, float, float]) -> None:
        start, radius, speed, nearest = drawn
        self.positions = np.concatenate([self.positions, start[None]])
        self.goals = np.concatenate([self.goals, -start[None]])
        self.radii = np.append(self.radii, radius)
        self.speeds = np.append(self.speeds, speed)
        self.neighbour_distances = np.append(self.neighbour_distances, nearest)

    def _free(self, draw: Any, radius: float, others: list[int]) -> Array:
        """Draw a place until it is free of these people and the robot, and of their goals."""
        places = np.concatenate([self.positions[others], self.goals[others]])
        places = np.concatenate([places, [self.robot, self.robot_goal]])
        radii = np.concatenate([self.radii[others], self.radii[others], [RADIUS, RADIUS]])
        least = radius + radii + ROOM
        for _ in range(DRAWS):
            x, y = draw()
            if not (np.hypot(x - places[:, 0], y - places[:, 1]) < least).any():
                return np.array([x, y])
        raise WideberthError(
            f"crowdnav_plus: in {DRAWS} draws no place was free for a person of {radius:g} m"
        )

    def _change_goals(self) -> None:
        """Give each person a new goal with a chance of 1/2."""
        rng = self._rng
        for i in range(PEOPLE):
            if rng.random_sample() <= 0.5:
                speed = self.speeds[i]

                def draw(speed: float = speed) -> Point:
                    angle = rng.random_sample() * pi * 2.0
                    dx = (rng.random_sample() - 0.5) * speed
                    dy = (rng.random_sample() - 0.5) * speed
                    return CIRCLE * cos(angle) + dx, CIRCLE * sin(angle) + dy

                others = [j for j in range(PEOPLE) if j != i]
                self.goals[i] = self._free(draw, float(self.radii[i]), others)

    def _replace(self) -> None:
        """Put another person into the slot of each one who has arrived.

        The one who arrived still counts as present while the new place is drawn.
        """
        self.positions, self.velocities = self.positions.copy(), self.velocities.copy()
        for i in range(PEOPLE):
            if hypot(*(self.goals[i] - self.positions[i])) < self.radii[i]:
                start, radius, speed, nearest = self._draw_person()
                self.positions[i], self.goals[i], self.velocities[i] = start, -start, 0.0
                self.radii[i], self.speeds[i] = radius, speed
                self.neighbour_distances[i] = nearest
                self.arrivals[i] += 1
                self._minds.forget(i)

    def _look(self) -> None:
        """See who is near, and believe the others to go on."""
        apart = np.hypot(*(self.positions - self.robot).T)
        self.seen: BoolArray = apart - RADIUS - self.radii <= SENSOR_RANGE
        truth = np.column_stack([self.positions, self.velocities, self.radii])
        if self.ticks:
            self.believed[:, :2] += STEP * self.believed[:, 2:4]
        self.believed = np.where(self.seen[:, None], truth, self.believed)

    def _decide(self) -> None:
        """Let all people decide, five times over: the first time is what they will do."""
        self._minds.meet(self.radii, self._nearest)
        places, velocities, futures = self.positions, self.velocities, []
        for ahead in range(HORIZON):
            velocities = self._minds.decide(places, velocities, self.goals, self.speeds)
            places = places + STEP * velocities
            futures.append(places)
            if not ahead:
                self._actions: Array = velocities
        self.futures: Array = np.stack(futures)

    def _judge(self) -> Outcome:
        """Judge the present state, see the class."""
        found = self.verdict
        found.time, found.steps = self.time, found.steps + 1
        apart = np.hypot(*(self.positions - self.robot).T) - self.radii - RADIUS
        if self.time >= LIMIT:
            found.outcome = "timeout"
        elif (apart < 0.0).any():
            found.outcome = "collision"
        elif hypot(*(self.robot - self.robot_goal)) < RADIUS:
            found.outcome = "success"
        elif self.seen.any():
            ahead = self.futures[:, self.seen] - self.robot
            least = float(np.hypot(ahead[..., 0], ahead[..., 1]).min())
            if least < INTRUSION:
                found.intrusions.append(least)
        return found.outcome


class _Minds:
    """ORCA of all people, with the simulators that each keeps in the original.

    There, each agent has a simulator of its own from its first decision on; the radii that
    it holds of the others and its neighbour distance stay as they were then, also when others
    are replaced. All who made theirs at the same instant hold the same, and here they share it.

    Parameters
    ----------
    random : whether attributes are drawn; if not, nothing ever differs.
    """

    def __init__(self, random: bool) -> None:
        self._random = random
        self._without = set(range(PEOPLE))
        self._shared: list[tuple[Any, set[int]]] = []

    def forget(self, person: int) -> None:
        """Note that another person has this slot, and needs a simulator of their own."""
        if self._random:
            self._without.add(person)

    def meet(self, radii: Array, nearest: float) -> None:
        """Make a simulator for those who have none, from all radii, m, and a distance, m."""
        if not self._without:
            return
        for _, members in self._shared:
            members -= self._without
        self._shared = [(world, members) for world, members in self._shared if members]
        made = simulator(radii, nearest)
        self._shared.append((made, self._without))
        self._without = set()

    def decide(self, places: Array, velocities: Array, goals: Array, speeds: Array) -> Array:
        """Return the next velocity of each agent, (20, 2), m/s."""
        wanted = towards(goals - places)
        found = np.empty((PEOPLE, 2))
        for world, members in self._shared:
            for i, (place, velocity) in enumerate(zip(places, velocities, strict=True)):
                world.set_agent_position(i, tuple(place.tolist()))
                world.set_agent_velocity(i, tuple(velocity.tolist()))
                world.set_agent_max_neighbors(i, PEOPLE - 1 if i in members else 0)
            for i in members:
                world.set_agent_max_speed(i, float(speeds[i]))
                world.set_agent_pref_velocity(i, tuple(wanted[i].tolist()))
            world.do_step()
            for i in members:
                best = world.get_agent_velocity(i)
                found[i] = best.x, best.y
        return found


def towards(ways: Array) -> Array:
    """Return ways (..., 2), m, as velocities of at most 1 m/s: whatever the preferred speed."""
    length = np.hypot(ways[..., 0], ways[..., 1])[..., None]
    return np.asarray(np.where(length > 1.0, ways / np.maximum(length, 1.0), ways))


def simulator(radii: Array, nearest: float) -> Any:
    """Return an RVO2 simulator of discs with these radii, m, and neighbour distance, m."""
    horizons = TIME_HORIZON, TIME_HORIZON
    world = rvo2("crowdnav_plus").RVOSimulator(STEP, nearest, len(radii), *horizons, 0.0, 1.0)
    for radius in radii.tolist():
        world.add_agent(
            (0.0, 0.0), nearest, len(radii) - 1, *horizons, radius + PADDING, 1.0, (0.0, 0.0)
        )
    return world

"""The crowd of CrowdNav++: twenty people who are replaced when they arrive, and see no robot."""

from dataclasses import dataclass, field
from math import cos, hypot, pi, sin
from typing import Any, Literal, TypeAlias, final

import numpy as np
from numpy.typing import NDArray

from wideberth.framework.values.arrays import Array, BoolArray
from wideberth.framework.values.errors import WideberthError
from wideberth.simulation.crowds.base import STEP, Crowd

from .gensafenav import (
    BESIDE,
    RUSHING_SHARE,
    RUSHING_SPEED,
    Groups,
    Inference,
    Shift,
    social_force,
)

Point: TypeAlias = tuple[float, float]
Variant: TypeAlias = Literal["plain", "random", "gensafenav"]
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
"""s; as often, each person changes their goal with a chance of 1/2 (not in ``plain``)."""
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
    in_groups : number of judged states in which the robot stood between the members of a group;
        None where there are no groups.
    """

    outcome: Outcome = ""
    time: float = 0.0
    steps: int = 0
    intrusions: list[float] = field(default_factory=list)
    way: float = 0.0
    in_groups: int | None = None

    def row(self) -> dict[str, Any]:
        """Return it as columns of a table; of a case that was cut short as a timeout.

        ``intrusion_percent`` is the share of the judged states with an intrusion, and
        ``intrusion_distance_m`` the mean of their distances, None without any. With groups,
        ``group_percent`` is the share of the judged states between the members of one.
        """
        near = self.intrusions
        groups = (
            {}
            if self.in_groups is None
            else {"group_percent": 100.0 * self.in_groups / self.steps}
        )
        return {
            "outcome": self.outcome or "timeout",
            "time_s": self.time,
            "steps": self.steps,
            "danger_steps": len(near),
            "intrusion_percent": 100.0 * len(near) / self.steps,
            "intrusion_distance_m": float(np.mean(near)) if near else None,
            "way_m": self.way,
            **groups,
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
        has people change their goals; "gensafenav" also draws what GenSafeNav's code draws
        between, see `Inference`.
    seed : S of the original, its "thisSeed".
    phase : "test" or "validation".
    shift : how people differ, see `CrowdNavPlus`. Its own draws are from another generator, so
        that a case begins as it does without.

    Attributes
    ----------
    variant, shift : as given.
    positions, velocities, goals : (20, 2), m and m/s, of the people in their slots.
    radii, speeds : (20,), m and m/s; the preferred speed is used as the largest one.
    paces : (20,), m/s, with which people walk by ORCA who are alone.
    neighbour_distances : (20,), m, as drawn.
    arrivals : (20,), how many have had this slot before.
    seen : (20,), whether the robot saw who was in this slot when it looked last.
    believed : (20, 5), x, y, vx, vy and radius as the original's robots believe them to be: of
        those seen the truth, of others the last belief moved on.
    robot, robot_goal : (2,), m.
    futures : (5, 20, 2), m, people's places at the next steps if no one changed their goal.
    """

    def __init__(
        self,
        case: int,
        variant: Variant,
        seed: int,
        phase: Phase = "test",
        shift: Shift = "none",
    ) -> None:
        first = OFFSET[phase] + case + seed
        self._rng: Any = np.random.RandomState(first)
        self._own: np.random.Generator = np.random.default_rng(first)
        self.random: bool = variant != "plain"
        self.variant: Variant = variant
        self.shift: Shift = shift
        self._inference = Inference(self._rng, PEOPLE) if variant == "gensafenav" else None
        self._groups = Groups(self._own, PEOPLE) if shift == "groups" else None
        self.ticks: int = 0
        self.verdict: CrowdNavPlusVerdict = CrowdNavPlusVerdict(
            in_groups=0 if self._groups else None
        )
        self._nearest: float = NEIGHBOUR_DISTANCE  # one variable for all, as there
        self.positions: Array = np.zeros((PEOPLE, 2))
        self.velocities: Array = np.zeros((PEOPLE, 2))
        self.goals: Array = np.zeros((PEOPLE, 2))
        self.radii: Array = np.zeros(PEOPLE)
        self.speeds: Array = np.zeros(PEOPLE)
        self.paces: Array = np.zeros(PEOPLE)
        self.neighbour_distances: Array = np.zeros(PEOPLE)
        robot, goal = self._draw_robot()
        self.robot: Array = robot
        self.robot_goal: Array = goal
        self._led = self._groups.led if self._groups else {i: [] for i in range(PEOPLE)}
        self._present = 0
        for leader in self._led:
            self._renew(leader)
        self.arrivals: NDArray[np.int64] = np.zeros(PEOPLE, dtype=np.int64)
        self.believed: Array = np.tile([*UNSEEN, 0.0, 0.0, RADIUS], (PEOPLE, 1))
        self._minds = _Minds(self.random)
        self._look()
        if self._inference:
            self._inference.follow(self.positions, self.seen, self.positions, self.robot)
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
        looked = self.positions
        if self.random and self.ticks % round(GOAL_PERIOD / STEP) == 0:
            self._change_goals()
        self._replace()
        if self._inference:
            self._inference.learn()
            self._inference.follow(looked, self.seen, self.positions, self.robot)
        self._decide()
        return self._judge()

    def _draw_robot(self) -> tuple[Array, Array]:
        while True:
            px, py, gx, gy = self._rng.uniform(-ARENA, ARENA, 4)
            if hypot(px - gx, py - gy) >= LEAST_WAY:
                return np.array([px, py]), np.array([gx, gy])

    def _renew(self, leader: int) -> None:
        """Draw a person, and who walks with them."""
        self._draw_person(leader, None)
        for slot in self._led[leader]:
            self._draw_person(slot, leader)

    def _draw_person(self, slot: int, leader: int | None) -> None:
        """Draw who is in a slot from now on, beside a leader if there is one."""
        rng = self._rng
        speed, radius, pace = 1.0, RADIUS, 1.0
        if self.random:
            self._nearest = rng.uniform(5.0, 10.0)
            if self._inference:
                self._inference.meet(slot)
            speed, radius = rng.uniform(0.5, 1.5), rng.uniform(0.3, 0.5)
        if self.shift == "rushing" and self._own.random() < RUSHING_SHARE:
            speed = pace = RUSHING_SPEED

        def draw() -> Point:
            angle = rng.random_sample() * pi * 2.0
            dx, dy = rng.uniform(0.0, 1.0) * 2.0, rng.uniform(0.0, 1.0) * 2.0
            return CIRCLE * cos(angle) + dx, CIRCLE * sin(angle) + dy

        def draw_beside() -> Point:
            x, y = self._own.normal(self.positions[leader], BESIDE)
            return float(x), float(y)

        everyone = [*range(self._present)]
        start = self._free(draw if leader is None else draw_beside, radius, everyone)
        goal = -start
        if leader is not None:
            speed = self.speeds[leader]
            goal = self.goals[leader] + start - self.positions[leader]
        self.positions[slot], self.velocities[slot], self.goals[slot] = start, 0.0, goal
        self.radii[slot], self.speeds[slot], self.paces[slot] = radius, speed, pace
        self.neighbour_distances[slot] = self._nearest
        self._present = max(self._present, slot + 1)

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
        """Give each person, and who walks with them, a new goal with a chance of 1/2."""
        rng = self._rng
        for i, led in self._led.items():
            if rng.random_sample() <= 0.5:
                speed = self.speeds[i]

                def draw(speed: float = speed) -> Point:
                    angle = rng.random_sample() * pi * 2.0
                    dx = (rng.random_sample() - 0.5) * speed
                    dy = (rng.random_sample() - 0.5) * speed
                    return CIRCLE * cos(angle) + dx, CIRCLE * sin(angle) + dy

                others = [j for j in range(PEOPLE) if j not in (i, *led)]
                goal = self._free(draw, float(self.radii[i]), others)
                self.goals[led] += goal - self.goals[i]
                self.goals[i] = goal

    def _replace(self) -> None:
        """Put others into the slots of each one who has arrived, and of who walks with them.

        The one who arrived still counts as present while the new place is drawn.
        """
        self.positions, self.velocities = self.positions.copy(), self.velocities.copy()
        for i, led in self._led.items():
            if hypot(*(self.goals[i] - self.positions[i])) < self.radii[i]:
                self._renew(i)
                for slot in (i, *led):
                    self.arrivals[slot] += 1
                    self._minds.forget(slot)

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
            velocities = self._next_velocities(places, velocities)
            places = places + STEP * velocities
            futures.append(places)
            if not ahead:
                self._actions: Array = velocities
        self.futures: Array = np.stack(futures)

    def _next_velocities(self, places: Array, velocities: Array) -> Array:
        """Return what all people decide who are here, and so fast, (20, 2), m/s."""
        if self.shift == "social_force":
            return social_force(places, velocities, self.goals, self.radii, self.speeds)
        paces = self.paces[:, None]
        wanted = paces * towards((self.goals - places) / paces)
        if self._groups:
            wanted = wanted + self._groups.pull(places)
        return self._minds.decide(places, velocities, wanted, self.speeds)

    def _judge(self) -> Outcome:
        """Judge the present state, see the class."""
        found = self.verdict
        found.time, found.steps = self.time, found.steps + 1
        if self._groups:
            assert found.in_groups is not None
            found.in_groups += self._groups.entered(self.positions, self.robot, RADIUS)
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

    def decide(self, places: Array, velocities: Array, wanted: Array, speeds: Array) -> Array:
        """Return the next velocity of each agent, (20, 2), m/s, from the one that it prefers."""
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
    import pyrvo

    horizons = TIME_HORIZON, TIME_HORIZON
    world = pyrvo.RVOSimulator(STEP, nearest, len(radii), *horizons, 0.0, 1.0)
    for radius in radii.tolist():
        world.add_agent(
            (0.0, 0.0), nearest, len(radii) - 1, *horizons, radius + PADDING, 1.0, (0.0, 0.0)
        )
    return world

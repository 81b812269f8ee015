"""The crowd of CrowdSimPlus: three people in a hallway who see the robot, and walls that stop."""

from dataclasses import dataclass
from math import hypot, sqrt
from typing import Any, Literal, TypeAlias, final

import numpy as np
from numpy.typing import NDArray

from wideberth.framework.values.arrays import Array, BoolArray
from wideberth.people.models import circular_force
from wideberth.simulation.crowds.base import STEP, Crowd
from wideberth.simulation.crowds.hall import Hall, Layout, PeopleDraws, nearest

Kind: TypeAlias = Literal["orca_plus", "sfm"]
Outcome: TypeAlias = Literal["", "success", "timeout"]

PEOPLE = 3
RADIUS, ROBOT_RADIUS = 0.3, 0.25
"""m, of people and of the robot."""
SPEEDS = 0.5, 1.5
"""m/s, between which preferred speeds are drawn; the upper one where they are not."""
LIMIT = 15.0
"""s; a step that begins then or later is the last."""
HEAD_START = 10
"""Steps before time 0 in which people walk while the robot stands."""
FROZEN = 0.01
"""m; a robot that goes less in a step is frozen."""

NEIGHBOUR_DISTANCE, MOST_NEIGHBOURS = 10.0, 10
TIME_HORIZON, OBSTACLE_HORIZON = 2.0, 0.5
"""s, of ORCA."""
PADDING = 0.01 + 0.01
"""m, which ORCA adds to every radius: a constant, and the safety space."""
SLOWER = 0.001
"""m/s, by which the velocity that ORCA prefers is below the preferred speed."""

GAP = 0.01
"""m, added to radii by the social force."""
STRENGTH, REACH = 3.0, 0.18
WALLS, JAMBS = (2.0, 0.025), (6.0, 0.12)
"""m/s^2 and m, of the social force from people, from walls, and from the bottleneck's jambs."""

TOUCHING, SAME, SLIP = 1e-4, 1e-8, 1e-7
"""m: nearer than this a wall is touched; two points are one; left between body and wall."""


def hall_of(layout: Layout) -> Hall:
    """Return the hallway of the original's experiment: 2 m wide, a door of 1 m."""
    return Hall(layout, width=2.0, height=4.0, door=1.0, length=1.0, circle_radius=1.5)


@final
@dataclass
class CrowdSimPlusVerdict:
    """What the original's rules say of a case up to now.

    Attributes
    ----------
    outcome : "success" or "timeout"; empty while it goes on. Contacts do not end a case.
    steps : how many there were.
    collisions : steps at whose end the robot overlapped a person.
    wall_collisions : steps in which a wall shortened the robot's way.
    frozen : steps in which the robot went less than 0.01 m.
    """

    outcome: Outcome = ""
    steps: int = 0
    collisions: int = 0
    wall_collisions: int = 0
    frozen: int = 0

    def row(self) -> dict[str, Any]:
        """Return it as columns of a table; of a case that was cut short as a timeout.

        ``nav_time_s`` is the time after the last step, of a timeout 15.25 s. The frequencies are
        shares of the steps; ``clean`` says whether there was no collision with anybody.
        """
        counts = {
            "coll": self.collisions,
            "wall_coll": self.wall_collisions,
            "frozen": self.frozen,
        }
        return {
            "success": self.outcome == "success",
            "outcome": self.outcome or "timeout",
            "nav_time_s": STEP * self.steps,
            "steps": self.steps,
            "num_collisions": self.collisions,
            "num_wall_collisions": self.wall_collisions,
            "num_frozen": self.frozen,
            "clean": not self.collisions,
            **{f"{name}_freq": count / max(self.steps, 1) for name, count in counts.items()},
        }


@final
class CrowdSimPlusCrowd(Crowd):
    """One case: three people who see each other and the robot, and the verdict.

    Made at time 0, after ten steps in which the robot stands at its start. All decide from the
    state at the beginning of a step. Walls shorten whatever would lead into them.

    Parameters
    ----------
    case : from 0; the generator is ``default_rng(1000 + case)``.
    layout : of the hallway.
    kind : who the people are.
    attributes : whether preferred speeds are drawn; the speed is 1.5 m/s if not.

    Attributes
    ----------
    velocities : (3, 2), m/s, as walls have shortened them.
    starts, goals, heads : (3, 2), m; what people head for is asked anew after every step.
    speeds : (3,), m/s.
    robot_goal : (2,), m.
    robot_velocity : (2,), m/s.
    verdict : up to now.
    """

    def __init__(self, case: int, layout: Layout, kind: Kind, *, attributes: bool = True) -> None:
        self.hall: Hall = hall_of(layout)
        self.lines: Array = self.hall.lines()
        self._kind = kind
        draws = PeopleDraws(self.hall, RADIUS, ROBOT_RADIUS, SPEEDS if attributes else None)
        ways = draws.ways(draws.generator(case), PEOPLE)
        self.speeds: Array = np.array([SPEEDS[1] if v is None else v for v, _, _ in ways])
        self.starts: Array = np.stack([start for _, start, _ in ways])
        self.goals: Array = np.stack([goal for _, _, goal in ways])
        self.robot: Array = np.array([0.0, -self.hall.circle_radius])
        self.robot_goal: Array = -self.robot
        self.robot_velocity: Array = np.zeros(2)
        self.positions: Array = self.starts.copy()
        self.velocities: Array = np.zeros((PEOPLE, 2))
        self.radii: Array = np.full(PEOPLE, RADIUS)
        self.arrivals: NDArray[np.int64] = np.zeros(PEOPLE, dtype=np.int64)
        self.seen: BoolArray = np.ones(PEOPLE, dtype=bool)
        self.verdict: CrowdSimPlusVerdict = CrowdSimPlusVerdict()
        self._decide()
        for _ in range(HEAD_START):
            self._walk()

    @property
    def time(self) -> float:
        """Time of the present state, s."""
        return STEP * self.verdict.steps

    @property
    def ahead(self) -> Array:
        """Where people will be after the next step, (3, 2), m."""
        return np.asarray(self.positions + STEP * self._actions)

    def verdict_row(self) -> dict[str, Any]:
        """Return what the original's rules say up to now, see `CrowdSimPlusVerdict.row`."""
        return self.verdict.row()

    def step(self, robot: Array, *, stopped: bool = False) -> Outcome:
        """Move on by one step, at whose end the robot is at ``robot``, (2,), m; judge.

        Where the robot comes to is for the caller to shorten, with `stop`.
        """
        robot = np.asarray(robot, dtype=np.float64)
        begin, found = self.time, self.verdict
        self.robot_velocity, self.robot = (robot - self.robot) / STEP, robot
        self._walk()
        apart = np.hypot(*(self.positions - robot).T)
        found.steps += 1
        found.collisions += bool((apart < ROBOT_RADIUS + RADIUS).any())
        found.wall_collisions += stopped
        found.frozen += hypot(*self.robot_velocity) * STEP < FROZEN
        if hypot(*(robot - self.robot_goal)) < ROBOT_RADIUS:
            found.outcome = "success"
        elif begin >= LIMIT:
            found.outcome = "timeout"
        return found.outcome

    def stop(self, place: Array, wanted: Array, radius: float) -> Array:
        """Return where a disc comes that wants from ``place`` to ``wanted``, (2,), m.

        Of all segments that it would come nearer to than its radius, the one counts that leaves
        it the shortest way; it goes straight, and slides along none.
        """
        found, least = wanted, np.inf
        step = wanted - place
        middle, reach = place + 0.5 * step, radius + 0.5 * hypot(*step)
        near = np.hypot(*(nearest(middle, self.lines) - middle).T) < reach
        for line in self.lines[near]:
            end = _end(place, wanted, radius, line)
            if end is not None and (length := hypot(*(end - place))) < least:
                found, least = end, length
        return np.asarray(found)

    def _walk(self) -> None:
        """Do what all people have decided, and let them decide anew."""
        self.positions, self.velocities = self.ahead, self._actions
        self._decide()

    def _decide(self) -> None:
        """Let all people decide, and shorten what leads into walls."""
        self.heads: Array = np.stack(
            [self.hall.head(p, g) for p, g in zip(self.positions, self.goals, strict=True)]
        )
        actions = np.empty((PEOPLE, 2))
        for i in range(PEOPLE):
            wanted = self._orca(i) if self._kind == "orca_plus" else self._social_force(i)
            place, there = self.positions[i], self.positions[i] + STEP * wanted
            reached = self.stop(place, there, RADIUS)
            actions[i] = wanted if reached is there else (reached - place) / STEP
        self._actions: Array = actions

    def _others(self, i: int) -> tuple[Array, Array, Array]:
        """Places, velocities and radii of all but one, the robot last."""
        rest = [j for j in range(PEOPLE) if j != i]
        places = np.vstack([self.positions[rest], self.robot])
        velocities = np.vstack([self.velocities[rest], self.robot_velocity])
        return places, velocities, np.array([RADIUS] * len(rest) + [ROBOT_RADIUS])

    def _orca(self, i: int) -> Array:
        way = self.heads[i] - self.positions[i]
        own = self.positions[i], self.velocities[i], RADIUS, float(self.speeds[i])
        return orca_velocity(*own, way, self._others(i), self.lines)

    def _social_force(self, i: int) -> Array:
        """Return a person's next velocity by the circular social force, (2,), m/s."""
        place, velocity, speed = self.positions[i], self.velocities[i], self.speeds[i]
        way = self.heads[i] - place
        length = hypot(*way)
        force = speed * way / (length if length >= 1e-6 else 1.0) - velocity
        others, _, radii = self._others(i)
        touch = RADIUS + radii + np.abs(RADIUS - radii) + GAP
        force += circular_force(place - others, touch, STRENGTH, REACH)
        walls = np.tile(WALLS, (len(self.lines), 1))
        if self.hall.layout == "bottleneck":
            walls[2:] = JAMBS
        apart = place - nearest(place, self.lines)
        force += circular_force(apart, np.array(RADIUS + GAP), *walls.T)
        found = velocity + STEP * force
        length = hypot(*found)
        return np.asarray(found * (speed / length) if length > speed else found)


def orca_velocity(
    place: Array,
    velocity: Array,
    radius: float,
    speed: float,
    way: Array,
    others: tuple[Array, Array, Array],
    lines: Array,
) -> Array:
    """Return the next velocity by ORCA, (2,), m/s; segments are obstacles of two vertices."""
    import pyrvo

    horizons = TIME_HORIZON, OBSTACLE_HORIZON
    world = pyrvo.RVOSimulator(STEP, NEIGHBOUR_DISTANCE, MOST_NEIGHBOURS, *horizons, radius, speed)
    for begin, end in lines.tolist():
        world.add_obstacle([tuple(begin), tuple(end)])
    world.process_obstacles()
    sight = NEIGHBOUR_DISTANCE, MOST_NEIGHBOURS, *horizons
    world.add_agent(tuple(place.tolist()), *sight, radius + PADDING, speed, tuple(velocity))
    blind = NEIGHBOUR_DISTANCE, 0, *horizons  # what the others would do does not matter
    for there, moving, size in zip(*(one.tolist() for one in others), strict=True):
        world.add_agent(tuple(there), *blind, size + PADDING, 1.0, tuple(moving))
    wanted, length = speed - SLOWER, hypot(*way)
    world.set_agent_pref_velocity(0, tuple(way if length <= wanted else way / length * wanted))
    world.do_step()
    best = world.get_agent_velocity(0)
    return np.array([best.x, best.y])


def _end(place: Array, wanted: Array, radius: float, line: Array) -> Array | None:
    """Return where a wall ends the way of a disc, (2,), m; None where it does not."""
    on_wall, on_way = _nearest_pair(line[0], line[1], place, wanted)
    gap = on_way - on_wall
    distance = hypot(*gap)
    if distance >= radius:
        return None
    step = wanted - place
    corner = min(hypot(*(on_wall - one)) for one in line) < SAME
    if corner and distance > SAME:
        return _before_corner(place, step, on_wall, on_way, radius)
    along = line[1] - line[0]
    foot = line[0] + (place - line[0]) @ along / (along @ along) * along
    clear = hypot(*(foot - place))
    across = step[0] * along[1] - step[1] * along[0]
    towards = float(step @ (foot - place)) > -SAME
    if (clear - radius < TOUCHING and towards) or not across:
        return place
    start = line[0] - place
    share = (start[0] * along[1] - start[1] * along[0]) / across
    return np.asarray(place + share * step * max(0.0, (clear - radius - SLIP) / clear))


def _before_corner(
    place: Array, step: Array, corner: Array, on_way: Array, radius: float
) -> Array:
    """Return where the way comes as near to a corner as the disc's radius, (2,), m."""
    way = on_way - place
    length = hypot(*way)
    if not length:
        return place
    towards = corner - place
    if hypot(*towards) - radius < TOUCHING and step @ towards > -SAME:
        return place
    unit, gap = way / length, on_way - corner
    along = float(unit @ gap)
    back = along + sqrt(along * along - float(gap @ gap) + radius * radius) + SLIP
    return np.asarray(place + unit * max(length - back, 0.0))


def _nearest_pair(a: Array, b: Array, p: Array, q: Array) -> tuple[Array, Array]:
    """Return the nearest points of two segments a b and p q, (2,) each, m."""
    first, second, between = b - a, q - p, a - p
    aa, bb, ab = float(first @ first), float(second @ second), float(first @ second)
    ac, bc = float(first @ between), float(second @ between)
    determinant = aa * bb - ab * ab
    s = min(max((ab * bc - ac * bb) / determinant, 0.0), 1.0) if determinant > 0.0 else 0.0
    t = (ab * s + bc) / bb if bb > 0.0 else 0.0
    if not 0.0 <= t <= 1.0 or bb == 0.0:
        t = min(max(t, 0.0), 1.0)
        s = min(max((ab * t - ac) / aa, 0.0), 1.0)
    return a + s * first, p + t * second

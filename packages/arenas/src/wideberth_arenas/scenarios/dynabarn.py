"""DynaBARN: 60 worlds of cylinders that move on loops whatever the robot does."""

import json
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from typing import Any, ClassVar, Literal, TypeAlias, final

import numpy as np

from wideberth.framework.values.arrays import Array, checked_choice, whole
from wideberth.framework.values.path import Path
from wideberth.framework.values.polygon import Polygon
from wideberth.metrics.gaps import gaps, wall_gaps
from wideberth.routes.walls import box
from wideberth.simulation.engine.agents import ReplayAgent
from wideberth.simulation.log.episode_log import Episode
from wideberth.simulation.scenarios.base import Cast, Placement, Scenario

Tier: TypeAlias = Literal["all", "easy", "medium", "hard"]

WORLDS: dict[Tier, range] = {
    "all": range(60),
    "easy": range(20),
    "medium": range(20, 40),
    "hard": range(40, 60),
}
RUNS = 10
"""Runs of each world."""
RADIUS = 0.5
"""m, of the obstacles."""
START, GOAL = (11.0, 0.0), (-9.0, 0.0)
ROBOT_RADIUS = 0.334
"""m, of the disc about a Jackal's outline, 0.51 m x 0.43 m."""
LIMIT = 100.0
"""s."""
PHASES = 5.0, 105.0
"""s after the load of a world, between which a run begins."""
BEFORE, AFTER = 5.0, 20.0
"""s before time 0 and after the time limit for which the motion is sampled."""
SAMPLE = 0.02
"""s."""
SAFE = 1.0
"""s after time 0 in which no obstacle may touch the robot at its start."""
LATER = 200
"""Times that a run is begun a second later for that reason, at most."""
BEST_TIME = 10.0
"""s: 20 m at the Jackal's 2 m/s, the OT of the score."""
FAST = 3.0
"""m/s; what moves faster than this, no planner can reckon with."""
CLOSED = 1e-3
"""m between first and last key of a loop that is closed."""


@cache
def _data() -> dict[str, Any]:
    text = files("wideberth_arenas").joinpath("scenarios", "dynabarn.json")
    found: dict[str, Any] = json.loads(text.read_text(encoding="utf-8"))
    return found


@cache
def keys_of(obstacle: str) -> Array:
    """Return the keys of an obstacle such as ``"easy/51"``, (N, 3): time s, x and y m."""
    return np.array(_data()["obstacles"][obstacle], dtype=np.float64).T / 100.0


def obstacles_of(world: int) -> tuple[str, ...]:
    """Return the names of a world's obstacles; worlds are numbered from 0."""
    return tuple(_data()["worlds"][world])


def place_at(keys: Array, times: Array) -> Array:
    """Return where an obstacle is, (T,) -> (T, 2), m, at times after the load of its world, s.

    The keys (t_k, p_k) are a loop of length L = t_{N-1}, which jumps from its end to its start.
    With s = t mod L in [t_k, t_{k+1}) and u = (s - t_k) / (t_{k+1} - t_k), Gazebo's animation is a
    uniform Catmull-Rom spline::

        p = (2u^3 - 3u^2 + 1) p_k + (3u^2 - 2u^3) p_{k+1}
            + (u^3 - 2u^2 + u) m_k + (u^3 - u^2) m_{k+1}

        m_k = (p_{k+1} - p_{k-1}) / 2, at the ends (p_1 - p_0) / 2 and (p_{N-1} - p_{N-2}) / 2,
        or (p_1 - p_{N-2}) / 2 at both where p_0 = p_{N-1}

    Tangents are per segment, not per second, so that an obstacle darts through a short segment
    beside a long one, far faster than the polyline says.

    Parameters
    ----------
    keys : (N, 3), time s, x and y m.
    times : (T,), s.
    """
    clock, points = keys[:, 0], keys[:, 1:]
    return _within(keys, clock, points, np.fmod(np.asarray(times, float), clock[-1]))


def _within(keys: Array, clock: Array, points: Array, asked: Array) -> Array:
    """Return places within the loop, at (T,) s in [0, L], (T, 2), m."""
    last = len(keys) - 2
    k = np.clip(np.searchsorted(clock, asked, side="right") - 1, 0, last)
    u = ((asked - clock[k]) / (clock[k + 1] - clock[k]))[:, None]
    tangents = np.empty_like(points)
    tangents[1:-1] = 0.5 * (points[2:] - points[:-2])
    tangents[0], tangents[-1] = 0.5 * (points[1] - points[0]), 0.5 * (points[-1] - points[-2])
    if np.abs(points[0] - points[-1]).max() < CLOSED:
        tangents[[0, -1]] = 0.5 * (points[1] - points[-2])
    square, cube = u**2, u**3
    return np.asarray(
        (2.0 * cube - 3.0 * square + 1.0) * points[k]
        + (3.0 * square - 2.0 * cube) * points[k + 1]
        + (cube - 2.0 * square + u) * tangents[k]
        + (cube - square) * tangents[k + 1]
    )


@cache
def _lap(obstacle: str) -> tuple[Array, Array]:
    """Return one lap of an obstacle, sampled: times (T,), s, from 0, and places (T, 2), m."""
    keys = keys_of(obstacle)
    length = float(keys[-1, 0])
    clock = np.linspace(0.0, length, int(np.ceil(length / SAMPLE)) + 1)
    return clock, _within(keys, keys[:, 0], keys[:, 1:], clock)


@final
@dataclass(frozen=True)
class DynaBarn(Scenario):
    """The 60 worlds of DynaBARN: a robot crosses 20 m among cylinders that nothing stops.

    The robot starts at rest at (11, 0), outside the open side of a square with three walls, and
    has 100 s to come within 1 m of (-9, 0). Worlds 0 to 19 are easy (5 to 14 obstacles of radius
    0.5 m, polylines at 0.5 to 0.9 m/s), 20 to 39 medium (15 to 19, 1.0 to 1.4 m/s), 40 to 59 hard
    (20 to 24, 1.5 to 1.9 m/s). They move as `place_at` says; at the end of a loop an obstacle
    jumps, and is another one from then on: "obstacle 3" is followed by "obstacle 3 (2)".
    Obstacles pass through each other and through the walls.

    The original does not control the phase at which a run meets the obstacles. Here run j of world
    w has the seed s = 10 w + j, and begins at tau = ``default_rng(s).uniform(5, 105)`` s after the
    load of the world; a second later, and later again, while an obstacle would touch the robot at
    its start within 1 s. In one tier the seeds are counted from 0. After the 10 runs of the last
    world the worlds begin again, with other phases: to choose settings on.

    The settings of an episode: ``goal_tolerance: 1.0``, ``time_limit: 100``, ``stop_on_collision:
    true``, ``plant_step`` of 0.02 s, for obstacles dart. `judge` adds what the original's program
    says: collision before timeout before success, and the score with the OT that it means.

    Parameters
    ----------
    tier : "all", "easy", "medium" or "hard".

    Raises
    ------
    WideberthError : an unknown tier.
    """

    reference: ClassVar[str] = "xu2022barn"
    robot_radius = ROBOT_RADIUS

    tier: Tier = "all"

    def __post_init__(self) -> None:
        checked_choice("dynabarn.tier", self.tier, Tier)

    def case(self, seed: int) -> tuple[int, int]:
        """Return the world of a seed, and the seed of its phase."""
        worlds = WORLDS[self.tier]
        again, run = divmod(whole("seed", seed, least=0), RUNS * len(worlds))
        every = RUNS * len(WORLDS["all"])
        return worlds[run // RUNS], again * every + RUNS * worlds.start + run

    def phase(self, seed: int) -> float:
        """Return tau of a seed: when its run begins after the load of the world, s."""
        world, own = self.case(seed)
        return self._phase(world, np.random.default_rng(own))

    def cast(self, seed: int) -> Cast:
        """Place the robot and the obstacles of a run."""
        world, own = self.case(seed)
        rng = np.random.default_rng(own)
        return Cast(
            self.build(rng), (), self._laps(world, self._phase(world, rng)), self.polygons(rng)
        )

    def build(self, rng: np.random.Generator) -> tuple[Placement, ...]:
        """Place the robot; the same for every seed."""
        way = Path(np.array([START, GOAL]))
        return (Placement("robot", way, 0.0, reference_speed=2.0),)

    def bystanders(
        self, rng: np.random.Generator, placements: tuple[Placement, ...]
    ) -> tuple[ReplayAgent, ...]:
        """Draw world and phase."""
        world = int(rng.choice(WORLDS[self.tier]))
        return self._laps(world, self._phase(world, rng))

    def polygons(self, rng: np.random.Generator) -> tuple[Polygon, ...]:
        """Return the three walls; the same for every seed."""
        return (
            box((-10.25, -10.0), (-9.75, 10.0), "back wall"),
            box((-10.0, 9.75), (10.0, 10.25), "top wall"),
            box((-10.0, -10.25), (10.0, -9.75), "bottom wall"),
        )

    def judge(self, episode: Episode) -> dict[str, Any]:
        """Judge an episode as the original does: collision, then timeout, then success.

        Returns
        -------
        row : ``outcome``; ``time_s`` of the contact, the arrival, or the end; ``score``,
            10 s / clip(time, 20 s, 80 s) of a success and 0 otherwise, as the original means it
            (its program has 0.125 for every success); ``touched`` "obstacle", "wall" or nothing;
            ``contact_speed_m_s`` of the obstacle at the contact, None without; and ``darted``,
            whether that was above 3 m/s.
        """
        robot, times = episode.robots[0], episode.times
        met: list[tuple[float, str, float | None]] = []
        for other in episode.agents:
            if other is robot:
                continue
            first = np.flatnonzero(gaps(robot, other) < 0.0)[:1]
            for index in first.tolist():
                moved = np.hypot(*(other.positions[index + 1] - other.positions[index]))
                pace = float(moved / (times[index + 1] - times[index]))
                met.append((float(times[index + 1]), "obstacle", pace))
        for wall in episode.polygons:
            first = np.flatnonzero(wall_gaps(robot, wall) < 0.0)[:1]
            met += [(float(times[index + 1]), "wall", None) for index in first.tolist()]
        nothing: tuple[float, str, float | None] = (np.inf, "", None)
        time, touched, speed = min(met, key=lambda one: one[0], default=nothing)
        arrived = robot.reached if robot.reached == robot.reached else np.inf
        if time <= min(arrived, LIMIT):
            outcome = "collision"
        else:
            time, touched, speed = min(arrived, episode.duration), "", None
            outcome = "success" if arrived < LIMIT else "timeout"
        success = outcome == "success"
        return {
            "outcome": outcome,
            "time_s": time,
            "score": BEST_TIME / float(np.clip(time, 20.0, 80.0)) if success else 0.0,
            "touched": touched,
            "contact_speed_m_s": speed,
            "darted": speed is not None and speed > FAST,
        }

    def _phase(self, world: int, rng: np.random.Generator) -> float:
        """Draw tau, and put it off while an obstacle would touch the robot at its start."""
        tau = float(rng.uniform(*PHASES))
        clock = np.arange(0.0, SAFE + 0.5 * SAMPLE, SAMPLE)
        for _ in range(LATER):
            ways = [place_at(keys_of(name), tau + clock) for name in obstacles_of(world)]
            apart = np.hypot(*(np.stack(ways) - START).transpose(2, 0, 1))
            if apart.min() >= RADIUS + ROBOT_RADIUS:
                break
            tau += 1.0
        return tau

    def _laps(self, world: int, tau: float) -> tuple[ReplayAgent, ...]:
        """Return every lap of every obstacle that a run meets, on the run's clock."""
        found = []
        for number, obstacle in enumerate(obstacles_of(world), start=1):
            clock, places = _lap(obstacle)
            length = float(clock[-1])
            first = int((tau - BEFORE) // length)
            last = int((tau + LIMIT + AFTER) // length)
            for lap in range(first, last + 1):
                again = f" ({lap - first + 1})" if lap > first else ""
                times = clock + (lap * length - tau)
                found.append(ReplayAgent(f"obstacle {number}{again}", times, places, RADIUS))
        return tuple(found)

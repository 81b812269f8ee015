"""The robots of CrowdNav++ and CrowdSimPlus, which played the rows that their authors publish."""

from functools import lru_cache
from math import hypot
from typing import Any, final

import numpy as np

from wideberth.framework.values.arrays import Array
from wideberth.simulation.crowds.base import STEP
from wideberth_arenas.crowds.crowdnav_plus import (
    NEIGHBOUR_DISTANCE,
    RADIUS,
    CrowdNavPlusCrowd,
    Phase,
    Variant,
    simulator,
    towards,
)
from wideberth_arenas.crowds.crowdsimplus import (
    ROBOT_RADIUS,
    CrowdSimPlusCrowd,
    orca_velocity,
)
from wideberth_arenas.crowds.gensafenav import HIDDEN
from wideberth_arenas.scenarios.crowdnav_plus import CrowdNavPlus
from wideberth_arenas.scenarios.crowdsimplus import CrowdSimPlus


@final
class CrowdNavPlusOrca:
    """The original's ORCA robot; GenSafeNav's in its variant, see `perceived`.

    Its simulator is made in the first step of the process, that of case 0, and never again: in
    the variant "random" its neighbour distance is that of the last person of case 0, and
    the radii are those believed at time 0 of case 0, of most people too small.

    Parameters
    ----------
    variant, seed, phase : of the crowd.
    informed : make the simulator anew at each step, with the radii that are believed now and
        the neighbour distance 10 m. No robot of the original.
    """

    def __init__(
        self, variant: Variant, seed: int, phase: Phase = "test", *, informed: bool = False
    ) -> None:
        self._informed = informed
        self._world = simulator(*_first_radii(variant, seed, phase))

    def act(self, crowd: CrowdNavPlusCrowd, velocity: Array) -> Array:
        """Return the next velocity, (2,), m/s, of a robot with this one now."""
        if self._informed:
            radii = np.append(RADIUS, crowd.believed[:, 4])
            self._world = simulator(radii, NEIGHBOUR_DISTANCE)
        world = self._world
        world.set_agent_position(0, tuple(crowd.robot.tolist()))
        world.set_agent_velocity(0, tuple(velocity.tolist()))
        wanted = towards(crowd.robot_goal - crowd.robot)
        world.set_agent_pref_velocity(0, tuple(wanted.tolist()))
        for i, (x, y, vx, vy, _) in enumerate(perceived(crowd).tolist(), start=1):
            world.set_agent_position(i, (x, y))
            world.set_agent_velocity(i, (vx, vy))
            world.set_agent_max_neighbors(i, 0)
        world.do_step()
        best = world.get_agent_velocity(0)
        return np.array([best.x, best.y])


def perceived(crowd: CrowdNavPlusCrowd) -> Array:
    """Return the bodies that the original's robots reckon with, (N, 5): x, y, vx, vy, radius.

    CrowdNav++ gives them its beliefs; GenSafeNav the truth of now and of each of the next five
    steps, all as bodies that are there now, with those who are not seen at (15, 15).
    """
    if crowd.variant != "gensafenav":
        return crowd.believed
    places = np.concatenate([crowd.positions[None], crowd.futures])
    velocities = np.concatenate([crowd.velocities[None], np.diff(places, axis=0) / STEP])
    places[:, ~crowd.seen], velocities[:, ~crowd.seen] = HIDDEN, 0.0
    radii = np.tile(crowd.believed[:, 4], len(places))
    return np.column_stack([places.reshape(-1, 2), velocities.reshape(-1, 2), radii])


@lru_cache(maxsize=8)
def _first_radii(variant: Variant, seed: int, phase: Phase) -> tuple[Array, float]:
    """Radii of all bodies at time 0 of case 0, m, and the last neighbour distance drawn, m."""
    first = CrowdNavPlusCrowd(0, variant, seed, phase)
    radii = np.append(RADIUS, perceived(first)[:, 4])
    return radii, float(first.neighbour_distances[-1])


@final
class SocialForceRobot:
    """The original's social force robot: A = 2, B = 1, K = 1."""

    def act(self, crowd: CrowdNavPlusCrowd, velocity: Array) -> Array:
        """Return the next velocity, (2,), m/s, of a robot with this one now."""
        way, bodies = crowd.robot_goal - crowd.robot, perceived(crowd)
        apart = crowd.robot - bodies[:, :2]
        distance = np.hypot(*apart.T)
        push = 2.0 * np.exp(RADIUS + bodies[:, 4] - distance) / distance
        force = way / hypot(*way) - velocity + push @ apart
        found = velocity + STEP * force
        speed = hypot(*found)
        return np.asarray(found / speed if speed > 1.0 else found)


def plus_row(scenario: CrowdNavPlus, seed: int, robot: str) -> dict[str, Any]:
    """Play the case of a seed with one of the original's robots, and return its row."""
    return plus_played(scenario, seed, robot).verdict_row()


def plus_played(scenario: CrowdNavPlus, seed: int, robot: str) -> CrowdNavPlusCrowd:
    """Play the case of a seed with one of the original's robots to its end.

    Parameters
    ----------
    robot : "orca", "social_force", or "orca_informed", who knows all believed radii and is no
        part of the original.
    """
    case, variant, phase = scenario.case(seed), scenario.variant, scenario.phase
    crowd = CrowdNavPlusCrowd(case, variant, scenario.seed, phase, scenario.shift)
    who: CrowdNavPlusOrca | SocialForceRobot = SocialForceRobot()
    if robot != "social_force":
        informed = robot == "orca_informed"
        who = CrowdNavPlusOrca(variant, scenario.seed, phase, informed=informed)
    velocity = np.zeros(2)
    while not crowd.verdict.outcome:
        velocity = who.act(crowd, velocity)
        crowd.step(crowd.robot + STEP * velocity)
    return crowd


@final
class CrowdSimPlusOrca:
    """The original's ORCA robot: 1 m/s, sees everybody and the walls, heads for its goal."""

    def act(self, crowd: CrowdSimPlusCrowd) -> Array:
        """Return the next velocity, (2,), m/s, before walls shorten it."""
        others = crowd.positions, crowd.velocities, crowd.radii
        own = crowd.robot, crowd.robot_velocity, ROBOT_RADIUS, 1.0
        return orca_velocity(*own, crowd.robot_goal - crowd.robot, others, crowd.lines)


def simple_row(scenario: CrowdSimPlus, seed: int) -> dict[str, Any]:
    """Play the case of a seed with the original's robot, and return its row.

    A step counts as a wall collision where the x component of its velocity was changed.
    """
    crowd, robot = (
        CrowdSimPlusCrowd(seed, scenario.layout, scenario.people_kind),
        CrowdSimPlusOrca(),
    )
    while not crowd.verdict.outcome:
        wanted = crowd.robot + STEP * robot.act(crowd)
        reached = crowd.stop(crowd.robot, wanted, ROBOT_RADIUS)
        crowd.step(reached, stopped=bool(reached[0] != wanted[0]))
    return crowd.verdict_row()

"""People who have been walking for a while before the robot may move."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np

from ...framework.controller import fresh
from ...framework.values.arrays import Array
from ...framework.values.path import Path
from ...framework.values.polygon import Polygon, separation
from ..engine.agents import ReplayAgent, RobotAgent
from ..engine.episode import run_episode
from ..engine.settings import Settings
from ..log.episode_log import Episode
from ..sensing.channel import Channel

STEP = 0.05
"""s, step of the plants meanwhile."""
ARRIVED = 1e-3
"""m; whoever is nearer to the goal keeps a way of this length, for a path needs one."""


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
        plant_step=STEP,
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
            free &= np.logical_and.accumulate(clear)  # whoever is behind a wall came through it
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

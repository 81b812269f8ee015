"""CrowdNav's own verdict on an episode; its rule for collisions differs from ours."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from ...framework.values.arrays import Array, BoolArray
from ...metrics.episode import approach
from ..log.episode_log import Episode

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

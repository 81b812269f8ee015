"""Comfort, proximity and risk of an episode: the columns beside `summarise`."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, final

import numpy as np

from ...framework.values.arrays import Array
from ...metrics import comfort as comfort
from ...metrics import motion as motion
from ...metrics.episode import along_and_aside
from ...metrics.gaps import gaps
from ...metrics.statistics import known_mean
from ..log.episode_log import AgentLog, Episode
from .plan_calibration import between_steps, promises, successors
from .summary import clearances

WORDS = {"goals": "success", "time limit": "timeout"}
"""Why an episode ended -> its outcome, where nothing touched."""


def measures(episode: Episode, tail: float, time_limit: float) -> dict[str, Any]:
    """One row for the whole episode; docs/metrics.md lists every column.

    Of several robots a column is the mean over the robots for which it is known; the smallest
    distance and time to collision are over all robots, contacts and successors are summed, and the
    episode is ``frozen`` if one robot was. A robot counts until it has reached its goal.

    Parameters
    ----------
    episode : that was played.
    tail : 1 - content of the regions whose area is measured.
    time_limit : s, which an episode without success counts as.
    """
    rows = [
        {
            **_motion(one),
            **_comfort(one),
            **promises(episode, one.log, tail),
            **between_steps(one.log.plans),
            **successors(one.log.plans),
        }
        for one in (Sampled.of(episode, log) for log in episode.robots)
    ]
    joined: dict[str, Any] = {}
    for name in rows[0]:
        join: Callable[[Any], Any] = _JOINED.get(name, known_mean)
        joined[name] = join([row[name] for row in rows])
    return {**verdict(episode, time_limit), **joined}


def verdict(episode: Episode, time_limit: float) -> dict[str, Any]:
    """How it ended: success, collision, deadlock or timeout; and when the last robot arrived.

    A collision counts whatever came after it, polygons included.
    """
    least = min(clearances(episode).values(), default=float("inf"))
    outcome = "collision" if least < 0.0 else WORDS.get(episode.ended, episode.ended)
    success = outcome == "success"
    last = max(log.reached for log in episode.robots)
    return {
        "outcome": outcome,
        "success_time": last if success else float("nan"),
        "penalised_time": last if success else time_limit,
    }


@final
@dataclass(frozen=True, eq=False)
class Sampled:
    """A robot and all others at equally spaced instants, until the robot is at its goal.

    Attributes
    ----------
    log : of the robot.
    step : s.
    positions : (K, D), m; headings and yaw_rates : (K,), rad and rad/s.
    others : (O, K, D), m, NaN where absent; radii : (O,), m, of both together.
    contacts : how often the robot ran into another agent, and another agent into the robot.
    goal : (D,), m; tolerance : m.
    """

    log: AgentLog
    step: float
    positions: Array
    headings: Array
    yaw_rates: Array
    others: Array
    radii: Array
    contacts: tuple[int, int]
    goal: Array
    tolerance: float

    @classmethod
    def of(cls, episode: Episode, log: AgentLog) -> "Sampled":
        """Sample a robot of an episode."""
        last = log.reached if log.reached == log.reached else episode.duration
        times = motion.uniform_times(episode.times, max(last, episode.times[1]))
        others = [other for other in episode.agents if other is not log]
        places = [episode.at(other, times) for other in others]
        until = int(np.searchsorted(episode.times, last, side="right"))
        met = [
            comfort.contacts(
                log.positions[:until],
                other.positions[:until],
                gaps(log, other)[: max(until - 1, 0)],
            )
            for other in others
        ]
        return cls(
            log=log,
            step=float(times[1] - times[0]) if len(times) > 1 else motion.SAMPLE,
            positions=episode.at(log, times),
            headings=np.interp(times, episode.times, np.unwrap(log.headings)),
            yaw_rates=np.interp(times, episode.times, log.yaw_rates),
            others=np.array(places).reshape(len(others), *episode.at(log, times).shape),
            radii=np.array([log.radius + other.radius for other in others]),
            contacts=(sum(one for one, _ in met), sum(two for _, two in met)),
            goal=log.paths[-1][1].goal,
            tolerance=episode.goal_tolerance,
        )


def _motion(one: Sampled) -> dict[str, Any]:
    speeds = np.linalg.norm(motion.velocities(one.positions, one.step), axis=1)
    pulls = np.linalg.norm(motion.accelerations(one.positions, one.step), axis=1)
    frozen = motion.frozen_steps(one.positions, one.goal, one.tolerance, one.step)
    aside = along_and_aside(one.positions, one.log.paths[0][1])[1]
    has_heading = bool(np.isfinite(one.headings).all())
    turned = (
        motion.heading_change(one.headings) if has_heading else motion.course_change(one.positions)
    )
    return {
        "speed_mean": known_mean(speeds),
        "speed_deviation": motion.root_mean_square(speeds - one.log.speed),
        "turn_mean": known_mean(np.abs(one.yaw_rates)),
        "acceleration_mean": known_mean(pulls),
        "jerk_rms": motion.jerk_rms(one.positions, one.step),
        "smoothness_sparc": motion.spectral_arc_length(speeds, one.step),
        "effort": motion.effort(one.positions, one.yaw_rates, one.step),
        "heading_change": turned,
        "turn_sign_changes": motion.sign_changes(one.yaw_rates),
        "irregularity": motion.irregularity(one.positions, one.headings, one.goal),
        "cross_track_mean": known_mean(aside),
        "cross_track_max": float(aside.max()),
        "not_moving": motion.not_moving(one.positions, one.yaw_rates, one.step),
        "freeze_share": known_mean(frozen),
        "frozen": motion.longest_run(frozen) * one.step >= motion.FREEZE_TIME - 1e-9,
    }


def _comfort(one: Sampled) -> dict[str, Any]:
    towards = one.others - one.positions
    apart = np.linalg.norm(towards, axis=-1) - one.radii[:, None]
    closest = comfort.nearest(apart)
    share, depth = comfort.intrusion(closest)
    own = motion.velocities(one.positions, one.step)
    theirs = np.diff(one.others, axis=1) / one.step
    before = comfort.time_to_collision(towards[:, :-1], own - theirs, one.radii[:, None])
    space = np.nan_to_num(comfort.personal_space(-towards[:, :-1], theirs))
    plane = one.positions.shape[1] == 2
    return {
        "distance_mean": comfort.mean_distance(closest),
        "distance_min": float(closest.min()),
        **{f"zone_{name}": part for name, part in comfort.proxemics(closest).items()},
        "intrusion_share": share,
        "intrusion_depth": depth,
        "time_to_collision_min": float(np.nanmin(before, initial=np.inf)),
        "personal_space": known_mean(space.max(axis=0, initial=0.0)),
        "social_work": comfort.social_work(one.positions, one.others, one.step)
        if plane
        else np.nan,
        "contacts_by_robot": one.contacts[0],
        "contacts_by_other": one.contacts[1],
    }


def _sum(values: Sequence[float]) -> int:
    return int(sum(values))


_JOINED: dict[str, Callable[[Any], Any]] = {
    "distance_min": min,
    "time_to_collision_min": min,
    "contacts_by_robot": _sum,
    "contacts_by_other": _sum,
    "turn_sign_changes": _sum,
    "frozen": any,
    "plan_risk_max": max,
    "cross_track_max": max,
    "episode_touched": max,
    "between_depth": max,
    "feasible_successors": _sum,
    "infeasible_successors": _sum,
    "aimed_successors": _sum,
    "lowered_successors": _sum,
}
"""How the values of several robots become one, where it is not the mean."""

"""The first contact of an episode: of which kind it is, and what was planned shortly before.

Its kind is found by rules from the log, so that contacts of many episodes can be counted. The
rules are facts that may hold together; of those that hold, the first of `KINDS` is the kind.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import combinations
from typing import Any, final

import numpy as np

from ...framework.robot import Robot, SpeedLimited
from ...framework.values.forecast import Forecast, resample
from ...framework.values.plan import Plan
from ...metrics.episode import squared_mahalanobis
from ...metrics.gaps import BodyMotion, gaps, wall_gaps
from ...metrics.motion import FREEZE_SPEED, SAMPLE
from ...metrics.plan import plan_risk
from ...metrics.scoring import displacement
from ..log.episode_log import AgentLog, Episode

LEADS = (2.0, 1.5, 1.0, 0.75, 0.5)
"""s before the contact, at which is asked what could have been done, and what was planned."""
KINDS = (
    *("turned", "faster", "between", "stood", "gave_up_level", "not_driven", "turned_earlier"),
)
"""Kinds of contacts, in order of precedence; where none applies, it is "other"."""
RECENT, EARLIER = 1.5, 3.0
"""s before the contact, in which the other turned, or turned earlier."""
TURN = np.pi / 3.0
"""rad, by which the direction of the other's motion changes if it turned."""
MOVING = 0.2
"""m/s, below which a motion has no direction."""
CLOSING = 0.2
"""s before the contact, over which the other's speed towards the robot is the mean."""
STOOD = 0.4
"""s before the contact, throughout which a robot that stood was slower than `FREEZE_SPEED`."""
BEHIND = np.pi / 2.0
"""rad, at least between the directions from a robot to the two that it is between."""
_SAME = 1e-9
"""s; instants closer together are one."""


@final
@dataclass(frozen=True, eq=False)
class FirstContact:
    """The first instant at which a robot touches anything.

    Attributes
    ----------
    index : of the interval in which it begins; time : s, of its beginning.
    robots : names of all robots that touch something in it.
    robot, other : names of two that touch, the robot of which plans are looked at and an agent or
        a wall; the first ones in the order of the log.
    """

    index: int
    time: float
    robots: tuple[str, ...]
    robot: str
    other: str


def first_contact(episode: Episode) -> FirstContact | None:
    """Return when a robot first touches an agent or a wall, and who; None if none does."""
    bodies = [log.name for log in episode.robots]
    pairs = [
        (gaps(one, two), (one.name, two.name) if one.name in bodies else (two.name, one.name))
        for one, two in combinations(episode.agents, 2)
        if one.name in bodies or two.name in bodies
    ]
    pairs += [(wall_gaps(log, wall), (log.name, wall.name)) for log in episode.robots
              for wall in episode.polygons]  # fmt: skip
    first = [(int(np.argmax(gap < 0.0)), names) for gap, names in pairs if (gap < 0.0).any()]
    if not first:
        return None
    begins = min(index for index, _ in first)
    touching = [names for index, names in first if index == begins]
    named = {name for names in touching for name in names}
    robots = tuple(name for name in bodies if name in named)
    return FirstContact(begins, float(episode.times[begins]), robots, *touching[0])


def decision(log: AgentLog, contact: float, lead: float) -> float | None:
    """Time of the first decision in the last ``lead`` s before the contact, s; None without."""
    stamps = log.commands.stamp
    known = stamps[(stamps >= contact - lead - _SAME) & (stamps < contact)]
    return float(known[0]) if known.size else None


def plan_at(log: AgentLog, contact: float, lead: float) -> Plan | None:
    """Return the plan of that decision; None without a decision, or a plan before the contact."""
    start = decision(log, contact, lead)
    if start is None:
        return None
    later = (plan for plan in log.plans if start - _SAME <= plan.stamp < contact)
    return next(later, None)


def lead_column(name: str, lead: float, ending: str = "") -> str:
    """Name the column of what is asked so many s before the contact."""
    return f"{name}_{lead:g}s{ending}".replace(".", "_")


def contact_columns(
    episode: Episode, robots: Mapping[str, Robot], level_held: Mapping[str, Any]
) -> dict[str, Any]:
    """Return facts of the first contact, its kind and the plans before it; see docs/metrics.md.

    Of each lead of `LEADS` the plan is that of the first decision in so many s before the contact:
    the decision from which `avoidable` tries other commands.

    Parameters
    ----------
    episode : that was played.
    robots : models of the robots, by name.
    level_held : columns of `avoidable`, which say whether another motion held the level.

    Returns
    -------
    columns : NaN, or "" where there is text, in all where nothing touched, and where a plan or
        its forecast of the other does not exist.
    """
    met = first_contact(episode)
    found: dict[str, Any] = {
        "contact_kind": "", "contact_with": "",
        **dict.fromkeys(("contact_time", "contact_turn", "contact_turn_before"), np.nan),
        **{f"contact_{kind}": np.nan for kind in KINDS},
    }  # fmt: skip
    for lead in LEADS:
        plan = None if met is None else plan_at(episode.agent(met.robot), met.time, lead)
        known = _planned(episode, met, plan)
        found |= {lead_column(name, lead): value for name, value in known.items()}
    if met is None:
        return found
    found |= _facts(episode, met, robots[met.robot]) | _decisions({**level_held, **found})
    holding = [kind for kind in KINDS if found[f"contact_{kind}"] is True]
    return {**found, "contact_kind": [*holding, "other"][0]}


def _decisions(found: Mapping[str, Any]) -> dict[str, Any]:
    """Return what holds of any plan before the contact; NaN where it is known of none."""

    def column(name: str) -> list[Any]:
        return [found[lead_column(name, lead)] for lead in LEADS]

    given_up = [
        gave_way and held
        for gave_way, held in zip(column("plan_gave_way"), column("level_held"), strict=True)
        if isinstance(gave_way, bool) and isinstance(held, bool)
    ]
    clear = [one for one in column("plan_clear") if isinstance(one, bool)]
    return {
        "contact_gave_up_level": any(given_up) if given_up else np.nan,
        "contact_not_driven": any(clear) if clear else np.nan,
    }


def _facts(episode: Episode, met: FirstContact, robot: Robot) -> dict[str, Any]:
    """Return what holds of the bodies at the contact; of a wall only that the robot stood."""
    log = episode.agent(met.robot)
    window = (episode.times >= met.time - STOOD - _SAME) & (episode.times <= met.time + _SAME)
    turn, before, earlier, faster, between = 0.0, np.nan, 0.0, False, False
    if met.other in {one.name for one in episode.agents}:
        other = episode.agent(met.other)
        turn, before = _turn(episode, other, met.time, RECENT)
        earlier, _ = _turn(episode, other, met.time, EARLIER)
        fastest = robot.max_speed if isinstance(robot, SpeedLimited) else np.inf
        faster = _closing(episode, other, log, met.time) > fastest
        between = _between(episode, met)
    return {
        "contact_with": met.other,
        "contact_time": met.time,
        "contact_turn": turn,
        "contact_turn_before": before if turn >= TURN else np.nan,
        "contact_turned": turn >= TURN,
        "contact_turned_earlier": turn < TURN <= earlier,
        "contact_faster": faster,
        "contact_between": between,
        "contact_stood": bool((log.speeds[window] < FREEZE_SPEED).all()),
    }


def _turn(episode: Episode, other: AgentLog, time: float, span: float) -> tuple[float, float]:
    """Return the largest change of direction in so many s before a time, and when it was.

    The change is the angle to the direction at the beginning of the span, rad; it was, s before
    the time, when half of it was first reached.
    """
    count = round(span / SAMPLE)
    times = time - SAMPLE * np.arange(count, -1, -1, dtype=np.float64)
    moves = np.diff(episode.at(other, times), axis=0)
    lengths = np.linalg.norm(moves, axis=1)
    moving = lengths > MOVING * SAMPLE  # NaN, before the episode or unseen, is none
    if not moving.any():
        return 0.0, np.nan
    ways = moves[moving] / lengths[moving, None]
    angles = np.arccos(np.clip(ways @ ways[0], -1.0, 1.0))
    half = int(np.argmax(angles >= 0.5 * angles.max()))
    return float(angles.max()), float(time - times[:-1][moving][half])


def _closing(episode: Episode, other: AgentLog, robot: AgentLog, time: float) -> float:
    """Return the other's mean speed towards where the robot is at the contact, m/s."""
    earlier, place = episode.at(other, np.array([time - CLOSING, time]))
    towards = episode.at(robot, np.array([time]))[0] - place
    return float((place - earlier) @ towards / (CLOSING * np.linalg.norm(towards)))


def _between(episode: Episode, met: FirstContact) -> bool:
    """Whether the robot has less room than its width to a third agent on its far side."""
    log, now = episode.agent(met.robot), np.array([met.time])
    place = episode.at(log, now)[0]
    touched = episode.at(episode.agent(met.other), now)[0] - place
    for one in episode.agents:
        towards = episode.at(one, now)[0] - place
        length = float(np.linalg.norm(towards))
        if one.name in (met.robot, met.other) or not length - one.radius < 3.0 * log.radius:
            continue
        cosine = towards @ touched / (length * np.linalg.norm(touched))
        if cosine <= np.cos(BEHIND):
            return True
    return False


def _planned(episode: Episode, met: FirstContact | None, plan: Plan | None) -> dict[str, Any]:
    """Return what a plan expected of the other at the contact, and what it was itself."""
    found: dict[str, Any] = dict.fromkeys(
        ("forecast_error", "forecast_deviations", "forecast_risk", "plan_gave_way", "plan_clear"),
        np.nan,
    )
    if met is None or plan is None:
        return {**found, "plan_rung": ""}
    gave_way = plan.below_reference
    return {
        **found,
        **_expected(episode, met, plan),
        "plan_gave_way": np.nan if gave_way is None else gave_way,
        "plan_clear": _clear(episode, met, plan),
        "plan_rung": str(plan.rung),
    }


def _expected(episode: Episode, met: FirstContact, plan: Plan) -> dict[str, float]:
    """Return the error of the forecast of the other at the contact, and the risk that it gave.

    The error is from the forecast's mean, of several modes the mixture's, and in deviations of
    it; the risk is that the other touches the robot where it really was at the contact.
    """
    whole, ahead = plan.forecast, met.time - plan.stamp
    if whole is None or met.other not in plan.tracked or ahead > whole.steps * whole.dt:
        return {}
    row, other = plan.tracked.index(met.other), episode.agent(met.other)
    some, robot = slice(row, row + 1), episode.agent(met.robot)
    one = Forecast(
        whole.mean[some],
        whole.covariance[some],
        whole.weight[some],
        whole.dt,
        (whole.fallback[row],),
    )
    seen = episode.at(other, np.array([plan.stamp]))
    then = resample(one, seen, one.covariance[:, 0, 0], np.array([ahead]))
    mean, covariance, weight = then.mean, then.covariance, then.weight
    truth, place = (episode.at(body, np.array([met.time])) for body in (other, robot))
    centre = np.einsum("km,kmnd->knd", weight, mean)
    apart = mean - centre[:, None]
    spread = np.einsum(
        "km,kmnij->knij", weight, covariance + apart[..., None] * apart[..., None, :]
    )
    radii = np.array([robot.radius + other.radius])
    return {
        "forecast_error": float(displacement(mean, weight, truth[None])[0, 0]),
        "forecast_deviations": float(np.sqrt(squared_mahalanobis(centre, spread, truth))[0, 0]),
        "forecast_risk": float(plan_risk(place, mean, covariance, weight, radii)[0, 0]),
    }


def _clear(episode: Episode, met: FirstContact, plan: Plan) -> bool:
    """Whether the robot, had it driven the plan, would have touched none of the others' discs."""
    log = episode.agent(met.robot)
    times = plan.stamp + plan.dt * np.arange(len(plan.positions), dtype=np.float64)
    times = times[times <= episode.duration + _SAME]
    body = BodyMotion(log.radius, plan.positions[: len(times)], np.zeros(len(times)))
    others = (
        BodyMotion(one.radius, episode.at(one, times), np.zeros(len(times)))
        for one in episode.agents
        if one is not log
    )
    return all(np.nanmin(gaps(body, one), initial=np.inf) >= 0.0 for one in others)

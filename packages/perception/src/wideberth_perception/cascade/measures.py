"""Perception of an episode: how far what the robots believed was from what was."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from wideberth.framework.numerics.chi_square import content_bound
from wideberth.framework.numerics.geometry import wrapped
from wideberth.framework.values.arrays import Array
from wideberth.framework.values.errors import WideberthError
from wideberth.metrics.statistics import known_mean
from wideberth.simulation.log.episode_log import Episode
from wideberth.simulation.log.frames import RigidMotion
from wideberth.simulation.log.perception_log import Glance

from ..tracking_scores import nees
from .naming import named


def perception_row(episode: Episode, since: float = 0.0) -> dict[str, Any]:
    """One row for all robots of an episode; a column that has nothing to measure is NaN.

    ``own_error`` is the distance between believed and true place at the end, m, and ``drift`` its
    share of the way driven; ``own_nees`` the mean of e' P^-1 e over the pose (3 where P is
    honest). ``detection_error`` and ``detection_nees`` (2) are those of positions in a scan,
    ``track_error`` and ``speed_error`` root mean squares over tracked obstacles, m and m/s, and
    ``track_nees`` (4) that of their states. A ``_coverage`` is the share of these errors that lie
    in their nominal regions of 95 %. ``identities`` counts the identities that one body
    had, ``false_tracks`` the share of tracked obstacles that match no body. ``stopped`` is the
    time in s for which a robot was stopped for its own safety, and ``stop_reason`` the first
    reason, "" where none was.

    Parameters
    ----------
    episode : of robots with sensors.
    since : s, before which nothing counts.

    Raises
    ------
    WideberthError : no robot perceives anything.
    """
    if not episode.perception:
        raise WideberthError("the episode has no perception; run it in a WheeledWorld")
    logs = episode.perception.values()
    rows = [_of_robot([one for one in log.glances if one.truth.time > since]) for log in logs]
    stops = [stop for log in logs for stop in log.stops if stop.end > since]
    return {
        **{name: known_mean([row[name] for row in rows]) for name in rows[0]},
        "stopped": sum(one.end - max(one.begin, since) for one in stops) / len(rows),
        "stop_reason": min(stops).reason if stops else "",
    }


def _of_robot(glances: Sequence[Glance]) -> dict[str, float]:
    owns = [_own(one) for one in glances]
    found = [pair for one in glances for pair in _sighted(one)]
    tracked = [pair for one in glances for pair in _tracked(one)]
    names: dict[str, set[str]] = {}
    for one in glances:
        for ident, name in one.names.items():
            names.setdefault(name, set()).add(ident)
    ghosts = sum(not name for one in glances for name in one.names.values())
    places = np.array([one.truth.pose[:2] for one in glances]).reshape(-1, 2)
    way = float(np.linalg.norm(np.diff(places, axis=0), axis=1).sum())
    last = float(np.linalg.norm(owns[-1][0][:2])) if owns else float("nan")
    errors = np.array([error for error, _ in tracked]).reshape(-1, 4)
    return {
        "own_error": last,
        "drift": last / way if way > 0.0 else float("nan"),
        **_judged("own", owns, 3),
        "detection_error": _root(np.array([error for error, _ in found]).reshape(-1, 2)),
        **_judged("detection", found, 2),
        "track_error": _root(errors[:, :2]),
        "speed_error": _root(errors[:, 2:]),
        **_judged("track", tracked, 4),
        "identities": known_mean([len(some) for name, some in names.items() if name]),
        "false_tracks": ghosts / max(ghosts + len(tracked), 1),
    }


def _judged(name: str, pairs: Sequence[tuple[Array, Array]], size: int) -> dict[str, float]:
    """Return the mean of e' P^-1 e, and the share of it within the nominal 95 %."""
    squares = np.array([nees(error, spread) for error, spread in pairs])
    squares = squares[~np.isnan(squares)]
    inside = squares <= content_bound(size, 0.05)
    return {f"{name}_nees": known_mean(squares), f"{name}_coverage": known_mean(inside)}


def _own(one: Glance) -> tuple[Array, Array]:
    error = one.own.pose - one.truth.pose
    error[2] = wrapped(error[2])
    return error, one.own.covariance[:3, :3]


def _sighted(one: Glance) -> list[tuple[Array, Array]]:
    """Error and covariance of what was found in a scan, of bodies that have not moved since."""
    to_world, sightings = one.to_world, one.sightings
    places = to_world.points(sightings.positions)
    found = named(list(places), [str(i) for i in range(len(places))], one.truth.bodies)
    bodies = {body.name: body for body in one.truth.bodies}
    pairs = []
    for i, place in enumerate(places):
        if (body := bodies.get(found[str(i)])) is not None:
            lag = one.truth.time - sightings.times[i]
            error = place - (body.position - lag * body.velocity)
            pairs.append((error, to_world.covariances(sightings.covariance[i])))
    return pairs


def _tracked(one: Glance) -> list[tuple[Array, Array]]:
    """Error and covariance of position and velocity of what is tracked."""
    to_world = one.to_world
    turn = RigidMotion(to_world.angle, np.zeros(2))
    bodies = {body.name: body for body in one.truth.bodies}
    pairs = []
    for obstacle in one.obstacles:
        body = bodies.get(one.names[obstacle.ident])
        if body is not None:
            lag = one.truth.time - obstacle.time
            place = to_world.points(obstacle.state[:2]) - (body.position - lag * body.velocity)
            speed = turn.points(obstacle.state[2:]) - body.velocity
            if not obstacle.covariance[2:, 2:].any():  # no velocity was measured
                speed = np.full(2, np.nan)
            rotation = np.kron(np.eye(2), turn.points(np.eye(2)).T)
            joint = rotation @ obstacle.covariance @ rotation.T
            pairs.append((np.concatenate([place, speed]), joint))
    return pairs


def _root(errors: Array) -> float:
    known = errors[np.isfinite(errors).all(axis=1)]
    return float(np.sqrt((known**2).sum(axis=1).mean())) if len(known) else float("nan")

"""How the perception of an episode is written to its file: one array per quantity and robot."""

from collections.abc import Callable, Iterable, Sequence
from itertools import accumulate
from typing import Any

import numpy as np

from ...framework.values.arrays import Array
from ..sensing.perceived import MotionEstimate, Segments, Sightings, TrackedObstacle
from .perception_log import GRAIN, Glance, PerceptionLog, PipelineStop, TrueBody, TrueStage

Put = Callable[[Any], dict[str, Any]]
"""Stores an array and returns its place."""
Get = Callable[[dict[str, Any]], Array]
"""Returns the array of a place."""


def packed(put: Put, log: PerceptionLog) -> dict[str, Any]:
    """Return a log as JSON, with the places of its arrays."""
    words = sorted({word for one in log.glances for word in _words(one)})
    number = {word: index for index, word in enumerate(words)}
    columns = {**_whole(log.glances, number), **_parts(log.glances, number)}
    return {
        "words": words,
        "notes": log.notes,
        "stops": [[put((stop.begin, stop.end)), stop.reason] for stop in log.stops],
        "columns": {name: put(values) for name, values in columns.items()},
    }


def _whole(glances: Sequence[Glance], number: dict[str, int]) -> dict[str, Array]:
    """Return the columns that have one row per glance."""
    return {
        "truth": _rows([(one.truth.time, *one.truth.pose, *one.truth.twist) for one in glances]),
        "own": _rows([
            (one.own.time, number[one.own.frame], *one.own.mean, *one.own.covariance.ravel())
            for one in glances
        ]),
        "scans": _rows([
            (one.time, number[one.note], *((np.nan,) * 2 if one.origin is None else one.origin))
            for one in (glance.sightings for glance in glances)
        ]),
        "counts": _rows([
            (
                len(one.truth.bodies), len(one.sightings.positions), len(one.obstacles),
                len(one.sightings.static), len(one.points), len(one.sightings.segments),
            )
            for one in glances
        ]),
    }  # fmt: skip


def _parts(glances: Sequence[Glance], number: dict[str, int]) -> dict[str, Array]:
    """Return the columns of which each glance has as many rows as its counts say."""
    return {
        "bodies": _rows([
            (number[body.name], *body.position, *body.velocity, body.radius)
            for one in glances
            for body in one.truth.bodies
        ]),
        "sightings": _joined([
            np.column_stack([
                one.times, one.radius, one.positions, one.covariance.reshape(-1, 4)
            ])
            for one in (glance.sightings for glance in glances)
        ]),
        "obstacles": _rows([
            (
                number[track.ident], number[one.names[track.ident]], track.time, track.seen,
                track.radius, *track.state, *track.covariance.ravel(),
            )
            for one in glances
            for track in one.obstacles
        ]),
        "static": _grains(one.sightings.static for one in glances),
        "points": _grains(one.points for one in glances),
        "segments": _joined([
            np.column_stack([one.ends.reshape(-1, 4), one.covariance.reshape(-1, 4)])
            for one in (glance.sightings.segments for glance in glances)
        ]),
    }  # fmt: skip


def unpacked(get: Get, stored: dict[str, Any]) -> PerceptionLog:
    """Return the log that `packed` has written."""
    columns = {name: get(place) for name, place in stored["columns"].items()}
    words, counts = stored["words"], columns["counts"].astype(np.int64)
    ends = [list(accumulate(column, initial=0)) for column in counts.T.tolist()]
    parts = ("bodies", "sightings", "obstacles", "static", "points", "segments")
    glances = []
    for row in range(len(counts)):
        own = {
            name: columns[name][ends[k][row] : ends[k][row + 1]] for k, name in enumerate(parts)
        }
        whole = {name: columns[name][row] for name in ("truth", "own", "scans")}
        glances.append(_glance({**own, **whole}, words))
    stops = []
    for place, reason in stored["stops"]:
        begin, end = get(place).tolist()
        stops.append(PipelineStop(begin, end, reason))
    return PerceptionLog(tuple(glances), dict(stored["notes"]), tuple(stops))


def _glance(rows: dict[str, Array], words: Sequence[str]) -> Glance:
    """Return one glance from its rows."""
    truth, own, scan, seen = rows["truth"], rows["own"], rows["scans"], rows["sightings"]
    bodies = tuple(
        TrueBody(words[int(row[0])], row[1:3].copy(), row[3:5].copy(), float(row[5]))
        for row in rows["bodies"]
    )
    obstacles, names = [], {}
    for row in rows["obstacles"]:
        time, last, radius = row[2:5].tolist()
        ident = words[int(row[0])]
        names[ident] = words[int(row[1])]
        state, covariance = row[5:9].copy(), row[9:].reshape(4, 4).copy()
        obstacles.append(TrackedObstacle(ident, time, state, covariance, radius, last))
    return Glance(
        TrueStage(float(truth[0]), truth[1:4].copy(), truth[4:].copy(), bodies),
        MotionEstimate(
            float(own[0]), own[2:8].copy(), own[8:].reshape(6, 6).copy(), words[int(own[1])]
        ),
        Sightings(
            float(scan[0]),
            seen[:, 2:4].copy(),
            seen[:, 4:].reshape(-1, 2, 2).copy(),
            seen[:, 1].copy(),
            rows["static"] * GRAIN,
            words[int(scan[1])],
            seen[:, 0].copy(),
            None if np.isnan(scan[2:]).any() else scan[2:].copy(),
            segments=_segments(rows["segments"]),
        ),
        tuple(obstacles),
        names,
        rows["points"] * GRAIN,
    )


def _segments(rows: Array) -> Segments:
    return Segments(rows[:, :4].reshape(-1, 2, 2).copy(), rows[:, 4:].reshape(-1, 2, 2).copy())


def _words(one: Glance) -> Iterable[str]:
    yield from (one.own.frame, one.sightings.note, *one.names, *one.names.values())
    yield from (body.name for body in one.truth.bodies)


def _rows(rows: Sequence[Sequence[float]]) -> Array:
    return np.array(rows, dtype=np.float64).reshape(len(rows), -1 if rows else 0)


def _joined(parts: Sequence[Array]) -> Array:
    return np.concatenate(parts) if parts else np.zeros((0, 0))


def _grains(points: Iterable[Array]) -> Array:
    """Return points as whole numbers of `GRAIN`, which are small when they are deflated."""
    return np.rint(np.concatenate([np.zeros((0, 2)), *points]) / GRAIN)

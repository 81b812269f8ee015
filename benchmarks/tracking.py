"""Detectors and trackers on scans of people whose places are known: GOSPA, switches and NEES."""

import sys
from argparse import Namespace
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from itertools import product
from time import process_time
from typing import Any

import numpy as np
from joint_probabilistic import JointProbabilistic
from measuring import Row, Tables
from scipy.interpolate import CubicSpline

from wideberth.experiments.studies.prediction_data import PredictionData
from wideberth.framework.plugins.config import build
from wideberth.framework.values.arrays import Array
from wideberth.framework.values.sensing import Scan
from wideberth.predictors.data.recordings import Recording
from wideberth.simulation.sensing.perceived import TrackedObstacle
from wideberth_perception.detector import Detector
from wideberth_perception.tracker import Tracker
from wideberth_perception.tracking_scores import track_scores

BEAMS, RATE, TURN = 360, 10.0, 0.2
"""Beams, scans per second, and rad/s that the sensor turns at."""
RADIUS, REACH, DEVIATION, LOST = 0.25, 8.0, 0.01, 0.01
"""m of a person, m that count, m of noise of a range, and share of lost beams."""
ENOUGH, RECENT, GONE = 3, 1.0, 2.0
"""Beams that make a person seen, s for which that counts, and s after a track's end."""
UNDECIDED = 0.5
"""m. A track as near as this only to people who do not count does not count either."""


DETECTORS: dict[str, Any] = {"discs": {"type": "discs", "shape": [RADIUS]}, "chords": "chords"}
TRACKERS = ("nearest", "obstacle_tracker", "kf_hungarian")
JPDA = "JPDA of Stone Soup"
"""Follows the sightings of the first detector, where the library is installed."""


@dataclass(frozen=True, eq=False)
class Look:
    """One scan, and who is truly there at its end.

    Attributes
    ----------
    scan, poses : as a detector gets them.
    truth : name -> (4,), position and velocity, of those who were seen within `RECENT`.
    others : (n, 2), m, of those who were not, or whose recording ended within `GONE`.
    """

    scan: Scan
    poses: Array
    truth: dict[str, Array]
    others: Array


@dataclass(frozen=True, eq=False)
class Walk:
    """A stretch of one person's track, on a cubic spline through the recorded places."""

    name: str
    first: float
    last: float
    spline: CubicSpline

    def state(self, time: float) -> Array:
        """Position and velocity, (4,); straight on after the end."""
        within = min(time, self.last)
        velocity = self.spline(within, 1)
        return np.concatenate([self.spline(within) + (time - within) * velocity, velocity])


def walks(recording: Recording) -> list[Walk]:
    """Return every stretch of at least three rows in which a person was seen throughout."""
    found = []
    for name, track in zip(recording.ids, recording.positions, strict=True):
        rows = np.flatnonzero(np.isfinite(track).all(axis=1))
        for part in np.split(rows, np.flatnonzero(np.diff(rows) > 1) + 1):
            if len(part) >= 3:
                times = recording.times[part]
                spline = CubicSpline(times, track[part])
                found.append(Walk(f"{name}@{part[0]}", times[0], times[-1], spline))
    return found


def busiest(people: Sequence[Walk], seconds: float) -> float:
    """Begin of the stretch of so many seconds in which most people walk, s."""
    begin, end = min(one.first for one in people), max(one.last for one in people)
    starts = np.arange(begin, max(end - seconds, begin) + 1e-9, 5.0)
    crowd = [
        sum(min(one.last, at + seconds) > max(one.first, at) for one in people) for at in starts
    ]
    return float(starts[int(np.argmax(crowd))])


def stand(people: Sequence[Walk], first: float, last: float) -> Array:
    """Return the place nearest to the middle that no person comes closer to than 0.6 m, (2,)."""
    points = np.concatenate([
        one.spline(np.arange(max(one.first, first), min(one.last, last), 0.1)) for one in people
    ])  # fmt: skip
    middle = np.median(points, axis=0)
    grid = np.arange(-6.0, 6.01, 0.25)
    places = middle + np.stack(np.meshgrid(grid, grid), axis=-1).reshape(-1, 2)
    nearest = np.array([np.linalg.norm(points - place, axis=1).min() for place in places])
    away = np.linalg.norm(places - middle, axis=1)
    away[nearest < 0.6] += 1e3 - nearest[nearest < 0.6]
    return np.asarray(places[int(away.argmin())])


def ranges_to_disc(origin: Array, unit: Array, centre: Array) -> Array:
    """Distance to a person's disc along rays, (B,), m; infinite where they miss it."""
    away = centre - origin
    along = (away * unit).sum(axis=-1)
    squared = RADIUS**2 - ((away**2).sum(axis=-1) - along**2)
    found = along - np.sqrt(np.maximum(squared, 0.0))
    return np.where((squared >= 0.0) & (found > 0.0), found, np.inf)


def looks(recording: Recording, seconds: float, rng: np.random.Generator) -> Iterator[Look]:
    """Yield the scans of the busiest stretch of a recording."""
    people = walks(recording)
    first = busiest(people, seconds)
    here = [one for one in people if one.last > first and one.first < first + seconds]
    place = stand(here, first, first + seconds)
    bearings = -np.pi + 2.0 * np.pi * np.arange(BEAMS) / BEAMS
    met_last: dict[str, float] = {}
    for number in range(round(seconds * RATE)):
        times = first + (number + np.arange(1.0, BEAMS + 1.0) / BEAMS) / RATE
        now, heading = float(times[-1]), TURN * (times - first)
        poses = np.column_stack([np.tile(place, (BEAMS, 1)), heading])
        unit = np.stack([np.cos(heading + bearings), np.sin(heading + bearings)], axis=-1)
        there = [one for one in here if one.first <= times[0] and now <= one.last]
        ranges = np.full((len(there) + 1, BEAMS), np.inf)
        for row, one in enumerate(there):
            ranges[row] = ranges_to_disc(place, unit, one.spline(times))
        who, nearest = ranges.argmin(axis=0), ranges.min(axis=0)
        nearest = nearest + DEVIATION * rng.standard_normal(BEAMS)
        nearest[rng.random(BEAMS) < LOST] = np.nan
        scan = Scan("lidar", times, bearings, nearest, DEVIATION)
        counted = who[scan.met]
        met_last |= {
            one.name: now for row, one in enumerate(there) if (counted == row).sum() >= ENOUGH
        }
        truth, others = {}, [np.zeros((0, 2))]
        for one in here:
            if one.first <= now <= one.last + GONE:
                state = one.state(now)
                seen = one in there and now - met_last.get(one.name, -np.inf) <= RECENT
                if seen and np.hypot(*(state[:2] - place)) <= REACH:
                    truth[one.name] = state
                else:
                    others.append(state[None, :2])
        yield Look(scan, poses, truth, np.concatenate(others))


def followed(look: Look, tracks: Sequence[TrackedObstacle]) -> list[TrackedObstacle]:
    """Return the tracks that count: within reach, and not of a person who does not."""
    here = look.poses[-1, :2]
    true = np.reshape([state[:2] for state in look.truth.values()], (-1, 2))
    found = []
    for one in tracks:
        place = one.state[:2]
        if np.hypot(*(place - here)) <= REACH:
            real = np.linalg.norm(true - place, axis=1).min(initial=np.inf)
            other = np.linalg.norm(look.others - place, axis=1).min(initial=np.inf)
            if real <= UNDECIDED or other > UNDECIDED:
                found.append(one)
    return found


def scored(run: Sequence[Look], detector: Detector, tracker: Tracker) -> Row:
    """Return the scores of a detector with a tracker over the scans of a scene."""
    steps, spent = [], 0.0
    for look in run:
        began = process_time()
        tracker.update(detector.detect(look.scan, look.poses))
        found = tracker.at(look.scan.stamp)
        spent += process_time() - began
        steps.append((look.scan.stamp, look.truth, followed(look, found)))
    scores = track_scores(steps)
    return {
        "people": scores.obstacles,
        "gospa_m": scores.gospa,
        "located_m": scores.located,
        "speed_error_mps": scores.speed_error,
        "missed": scores.missed,
        "false_per_scan": scores.false,
        "switches": scores.switches,
        "latency_s": scores.latency,
        "never_found": 1.0 - scores.followed,
        "nees": scores.nees,
        "inside_95": scores.inside,
        "ms_per_scan": 1e3 * spent / len(run),
    }


def tables(options: Namespace) -> Tables:
    """Return one row per scene, detector and tracker."""
    data, rows = PredictionData(options.people), []
    for scene, files in data.found().items():
        recording, seconds = data.read(files)[0], 1.5 if options.quick else 30.0
        run = list(looks(recording, seconds, np.random.default_rng(0)))
        joint = [("discs", JPDA)] if find_spec("stonesoup") else []
        for detector, tracker in [*product(DETECTORS, TRACKERS), *joint]:
            print(f"{scene}: {detector}, {tracker}", file=sys.stderr)
            follower = JointProbabilistic() if tracker == JPDA else build("trackers", tracker)
            found = scored(run, build("detectors", DETECTORS[detector]), follower)
            rows.append({"scene": scene, "detector": detector, "tracker": tracker, **found})
    return {"tracking": ("Detectors and trackers among people", rows)}

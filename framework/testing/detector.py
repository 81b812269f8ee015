"""The laws of `Detector`, as a check that any detector can be put through."""

from collections.abc import Callable, Sequence
from copy import deepcopy
from dataclasses import replace
from functools import partial
from typing import TypeAlias

import numpy as np

from ..detector import Detector
from ..values.arrays import Array
from ..values.errors import WideberthError
from ..values.sensing import Scan, Sightings
from .laws import Law, require

BEAMS, RATE, SCANS = 360, 10.0, 40
"""Of the scans that a detector is shown: beams, scans per second, and their number."""
ABSURD = (1e12, 1e154, -1e300, 1.7e308, np.inf)
"""m and rad, of poses that are of no use."""
NEAR = 1e-6
"""m. Positions are the same to this."""
Run: TypeAlias = list[tuple[Scan, Array]]


def check_detector(
    detector: Detector, *, radius: float = 0.3, rng: np.random.Generator | None = None
) -> None:
    """Hold a detector to its laws, on scans of walking cylinders and on scans of no use.

    The laws: as many positions as covariances, radii and times, which lie within the scan; no
    sightings and a note from a scan that is empty, blind, lost, of ranges that are none or beyond
    `FARTHEST`, without poses, or with absurd ones; some absurd poses cost their own beams alone;
    turning and shifting the poses turns and shifts what is found; the same scans
    give the same again after `reset`; a clock that goes back raises nothing; one pose per beam, or
    a `WideberthError`.

    Parameters
    ----------
    detector : to be checked; it is reset.
    radius : m, of the cylinders.
    rng : of their paths and the noise; seeded with 0 by default.

    Raises
    ------
    AssertionError : names every law that does not hold, and where.

    Examples
    --------
    >>> from wideberth.perception.detection import DiscDetector
    >>> check_detector(DiscDetector())
    """
    require(laws(detector, radius=radius, rng=rng))


def laws(
    detector: Detector, *, radius: float = 0.3, rng: np.random.Generator | None = None
) -> tuple[Law, ...]:
    """Return the laws of a detector; the arguments are those of `check_detector`."""
    generator = np.random.default_rng(0) if rng is None else rng
    run = _walk(radius, generator)
    angle, shift = generator.uniform(-3.0, 3.0), generator.uniform(-50.0, 50.0, 2)
    checks: dict[str, Callable[[Detector], None]] = {
        "shapes and instants": partial(_check_shapes, run=run),
        "useless scans": partial(_check_useless, run=run),
        "absurd poses": partial(_check_absurd, run=run),
        "turning and shifting": partial(_check_moved, run=run, angle=angle, shift=shift),
        "reset": partial(_check_reset, run=run),
        "clock": partial(_check_clock, run=run),
        "one pose per beam": partial(_check_poses, run=run),
    }
    return tuple(Law(name, partial(check, detector)) for name, check in checks.items())


def _walk(radius: float, rng: np.random.Generator) -> Run:
    """Return scans of a turning, driving sensor among three cylinders that walk."""
    bearings = -np.pi + 2.0 * np.pi * np.arange(BEAMS) / BEAMS
    start = np.array([[4.0, 1.0], [-3.0, 5.0], [1.0, -6.0]]) + rng.uniform(-0.5, 0.5, (3, 2))
    speed = rng.uniform(-1.0, 1.0, (3, 2))
    run = []
    for number in range(SCANS):
        times = (number + np.arange(1.0, BEAMS + 1.0) / BEAMS) / RATE
        poses = np.stack([0.3 * times, 0.1 * times, 0.2 * times], axis=-1)
        unit = poses[:, 2] + bearings
        ranges = np.full(BEAMS, np.inf)
        for centre, velocity in zip(start, speed, strict=True):
            place = centre + velocity * times[:, None]
            ranges = np.minimum(ranges, _range(place - poses[:, :2], unit, radius))
        ranges = ranges + 0.01 * rng.standard_normal(BEAMS)
        ranges[rng.random(BEAMS) < 0.01] = np.nan
        run.append((Scan("lidar", times, bearings, ranges), poses))
    return run


def _range(away: Array, direction: Array, radius: float) -> Array:
    """Distance to a circle along rays, m; infinite where they miss it."""
    along = away[:, 0] * np.cos(direction) + away[:, 1] * np.sin(direction)
    inside = radius**2 - (away**2).sum(axis=1) + along**2
    met = (inside > 0.0) & (along > 0.0)
    return np.where(met, along - np.sqrt(np.maximum(inside, 0.0)), np.inf)


def _all(detector: Detector, run: Run) -> list[Sightings]:
    detector.reset()
    return [detector.detect(scan, poses) for scan, poses in run]


def _same(one: Sequence[Sightings], other: Sequence[Sightings]) -> bool:
    """Tell whether two runs found the same, to the bit."""
    return all(
        np.array_equal(a, b)
        for pair in zip(one, other, strict=True)
        for a, b in zip(*map(_arrays, pair), strict=True)
    )


def _arrays(one: Sightings) -> tuple[Array, ...]:
    still = one.static, one.segments.ends, one.segments.covariance
    return (one.positions, one.covariance, one.radius, one.times, *still)


def _check_shapes(detector: Detector, run: Run) -> None:
    found = _all(detector, run)
    if not any(len(one.positions) for one in found):
        raise AssertionError(f"nothing was found in {len(run)} scans of three cylinders")
    for one, (scan, _) in zip(found, run, strict=True):
        if one.time != scan.stamp:
            raise AssertionError(f"the sightings are of {one.time} s; the scan of {scan.stamp} s")
        if (one.times < scan.times.min()).any() or (one.times > scan.times.max()).any():
            raise AssertionError(f"times {one.times.tolist()} lie outside of the scan")
        if (one.radius < 0.0).any():
            raise AssertionError(f"radius holds {one.radius.min()} m")
        if one.note:
            raise AssertionError(f"a sound scan gave the note {one.note!r}")


def _check_useless(detector: Detector, run: Run) -> None:
    scan, poses = run[-1]
    cases = {
        "empty": (Scan("lidar", np.zeros(0), np.zeros(0), np.zeros(0)), np.zeros((0, 3))),
        "one beam that met nothing": (
            Scan("lidar", np.zeros(1), np.zeros(1), np.full(1, np.inf)),
            np.zeros((1, 3)),
        ),
        "without poses": (scan, np.full((BEAMS, 3), np.nan)),
        "of absurd ranges": (replace(scan, ranges=np.full(BEAMS, 1e200), longest=1e300), poses),
    }
    for value in ABSURD:
        cases[f"at {value:g} m"] = scan, np.full((BEAMS, 3), value)
    for name, value in (("blind", np.inf), ("lost", np.nan), ("negative", -1.0), ("zero", 0.0)):
        cases[name] = (replace(scan, ranges=np.full(BEAMS, value)), poses)
    for name, (useless, places) in cases.items():
        detector.reset()
        found = detector.detect(useless, places)
        if len(found.positions) or not found.note:
            raise AssertionError(
                f"a scan that is {name} gave {len(found.positions)} sightings and the note "
                f"{found.note!r}; wanted none, and a reason"
            )


def _check_absurd(detector: Detector, run: Run) -> None:
    """Spoil the poses of the first half of the beams: they count as not known."""
    scan, poses = run[-1]
    half, found = BEAMS // 2, []
    for value in (np.nan, *ABSURD):
        spoilt = poses.copy()
        spoilt[:half] = value
        detector.reset()
        found.append(detector.detect(scan, spoilt))
    if not all(_same(found[:1], [one]) for one in found[1:]):
        raise AssertionError(f"poses of {ABSURD} gave something else than poses that are none")


def _check_moved(detector: Detector, run: Run, angle: float, shift: Array) -> None:
    cosine, sine = np.cos(angle), np.sin(angle)
    turn = np.array([[cosine, -sine], [sine, cosine]])
    moved = [
        (scan, np.column_stack([poses[:, :2] @ turn.T + shift, poses[:, 2] + angle]))
        for scan, poses in run
    ]
    for one, other in zip(_all(detector, run), _all(detector, moved), strict=True):
        counts = [(len(seen.positions), len(seen.segments)) for seen in (one, other)]
        if counts[0] != counts[1]:
            raise AssertionError(
                f"{counts[0]} sightings and segments at {one.time:.3g} s, {counts[1]} when "
                f"the poses are turned by {angle:.3g} rad and shifted"
            )
        gap = np.abs(one.positions @ turn.T + shift - other.positions).max(initial=0.0)
        ends = one.segments.ends @ turn.T + shift
        gap = max(gap, np.abs(ends - other.segments.ends).max(initial=0.0))
        bend = np.abs(turn @ one.covariance @ turn.T - other.covariance).max(initial=0.0)
        if max(gap, bend) > NEAR:
            raise AssertionError(
                f"turned and shifted by {angle:.3g} rad, positions differ by {gap:.3g} m and "
                f"covariances by {bend:.3g} m^2 at {one.time:.3g} s"
            )


def _check_reset(detector: Detector, run: Run) -> None:
    kept = deepcopy(run)
    first, second = _all(detector, run), _all(detector, run)
    if not _same(first, second):
        raise AssertionError("after reset the same scans gave something else")
    for (scan, poses), (was, where) in zip(run, kept, strict=True):
        if not np.array_equal(scan.ranges, was.ranges, equal_nan=True):
            raise AssertionError("detect changed the ranges that it was given")
        if not np.array_equal(poses, where):
            raise AssertionError("detect changed the poses that it was given")


def _check_clock(detector: Detector, run: Run) -> None:
    """Show later scans before earlier ones: nothing may be raised."""
    _all(detector, run[SCANS // 2 :] + run[: SCANS // 2])


def _check_poses(detector: Detector, run: Run) -> None:
    scan, poses = run[0]
    try:
        detector.detect(scan, poses[1:])
    except WideberthError:
        return
    raise AssertionError(f"{len(poses) - 1} poses for {len(poses)} beams were accepted")

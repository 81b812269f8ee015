"""The laws of `Detector`, as a check that any detector can be put through."""

from collections.abc import Iterator, Sequence
from copy import deepcopy
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np

from wideberth.framework.numerics.geometry import plane_turn
from wideberth.framework.testing.laws import Contract, Law, law, refusing, stated
from wideberth.framework.values.arrays import Array
from wideberth.framework.values.sensing import Scan
from wideberth.simulation.sensing.perceived import Sightings

from ..detector import Detector

BEAMS, RATE, SCANS = 360, 10.0, 40
"""Of the scans that a detector is shown: beams, scans per second, and their number."""
ABSURD = (1e12, 1e154, -1e300, 1.7e308, np.inf)
"""m and rad, of poses that are of no use."""
NEAR = 1e-6
"""m. Positions are the same to this."""
Run: TypeAlias = list[tuple[Scan, Array]]


@Contract
def check_detector(
    detector: Detector, *, radius: float = 0.3, rng: np.random.Generator | None = None
) -> Iterator[Law]:
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
    >>> from wideberth_perception.detection import DiscDetector
    >>> check_detector(DiscDetector())
    """
    generator = np.random.default_rng(0) if rng is None else rng
    walk = _Walk(detector, _scans(radius, generator))
    return stated(_Walk, detector, lambda: [walk], generator)


@dataclass(frozen=True, eq=False)
class _Walk:
    """A detector, and scans of three cylinders that walk."""

    detector: Detector
    run: Run

    def seen(self, run: Run) -> list[Sightings]:
        """Return what the detector finds after a reset."""
        self.detector.reset()
        return [self.detector.detect(scan, poses) for scan, poses in run]

    @law("shapes and instants")
    def check_shapes(self) -> None:
        found = self.seen(self.run)
        assert any(len(seen.positions) for seen in found), (
            f"nothing was found in {len(self.run)} scans of three cylinders"
        )
        for seen, (scan, _) in zip(found, self.run, strict=True):
            assert seen.time == scan.stamp, (
                f"the sightings are of {seen.time} s; the scan of {scan.stamp} s"
            )
            early, late = seen.times < scan.times.min(), seen.times > scan.times.max()
            assert not (early | late).any(), f"times {seen.times.tolist()} lie outside of the scan"
            assert not (seen.radius < 0.0).any(), f"radius holds {seen.radius.min()} m"
            assert not seen.note, f"a sound scan gave the note {seen.note!r}"

    @law("useless scans")
    def check_useless(self) -> None:
        for name, useless in _useless(*self.run[-1]).items():
            (seen,) = self.seen([useless])
            assert not len(seen.positions) and seen.note, (
                f"a scan that is {name} gave {len(seen.positions)} sightings and the note "
                f"{seen.note!r}; wanted none, and a reason"
            )

    @law("absurd poses")
    def check_absurd(self) -> None:
        """Spoil the poses of the first half of the beams: they count as not known."""
        scan, poses = self.run[-1]
        found = []
        for value in (np.nan, *ABSURD):
            spoilt = poses.copy()
            spoilt[: BEAMS // 2] = value
            found.append(self.seen([(scan, spoilt)]))
        assert all(_same(found[0], other) for other in found[1:]), (
            f"poses of {ABSURD} gave something else than poses that are none"
        )

    @law("turning and shifting")
    def check_moved(self, rng: np.random.Generator) -> None:
        angle, shift = rng.uniform(-3.0, 3.0), rng.uniform(-50.0, 50.0, 2)
        turn = plane_turn(angle)
        moved = [
            (scan, np.column_stack([poses[:, :2] @ turn.T + shift, poses[:, 2] + angle]))
            for scan, poses in self.run
        ]
        for here, there in zip(self.seen(self.run), self.seen(moved), strict=True):
            counts = [(len(seen.positions), len(seen.segments)) for seen in (here, there)]
            assert counts[0] == counts[1], (
                f"{counts[0]} sightings and segments at {here.time:.3g} s, {counts[1]} when "
                f"the poses are turned by {angle:.3g} rad and shifted"
            )
            gap = np.abs(here.positions @ turn.T + shift - there.positions).max(initial=0.0)
            ends = here.segments.ends @ turn.T + shift
            gap = max(gap, np.abs(ends - there.segments.ends).max(initial=0.0))
            bend = np.abs(turn @ here.covariance @ turn.T - there.covariance).max(initial=0.0)
            assert max(gap, bend) <= NEAR, (
                f"turned and shifted by {angle:.3g} rad, positions differ by {gap:.3g} m and "
                f"covariances by {bend:.3g} m^2 at {here.time:.3g} s"
            )

    @law("reset")
    def check_reset(self) -> None:
        kept = deepcopy(self.run)
        assert _same(self.seen(self.run), self.seen(self.run)), (
            "after reset the same scans gave something else"
        )
        for (scan, poses), (was, where) in zip(self.run, kept, strict=True):
            same = np.array_equal(scan.ranges, was.ranges, equal_nan=True)
            assert same, "detect changed the ranges that it was given"
            assert np.array_equal(poses, where), "detect changed the poses that it was given"

    @law("clock")
    def check_clock(self) -> None:
        """Show later scans before earlier ones: nothing may be raised."""
        self.seen(self.run[SCANS // 2 :] + self.run[: SCANS // 2])

    @law("one pose per beam")
    def check_poses(self) -> None:
        scan, poses = self.run[0]
        with refusing(f"a scan of {len(poses)} beams with {len(poses) - 1} poses"):
            self.detector.detect(scan, poses[1:])


def _scans(radius: float, rng: np.random.Generator) -> Run:
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


def _useless(scan: Scan, poses: Array) -> dict[str, tuple[Scan, Array]]:
    """Return scans in which nothing can be seen, by what is wrong with them."""
    none, one = np.zeros(0), np.zeros(1)
    cases = {
        "empty": (Scan("lidar", none, none, none), np.zeros((0, 3))),
        "one beam that met nothing": (Scan("lidar", one, one, one + np.inf), np.zeros((1, 3))),
        "of absurd ranges": (replace(scan, ranges=np.full(BEAMS, 1e200), longest=1e300), poses),
        "without poses": (scan, np.full((BEAMS, 3), np.nan)),
    }
    for value in ABSURD:
        cases[f"at {value:g} m"] = scan, np.full((BEAMS, 3), value)
    for name, value in (("blind", np.inf), ("lost", np.nan), ("negative", -1.0), ("zero", 0.0)):
        cases[name] = (replace(scan, ranges=np.full(BEAMS, value)), poses)
    return cases


def _same(first: Sequence[Sightings], second: Sequence[Sightings]) -> bool:
    """Whether two runs found the same, to the bit."""
    return all(
        np.array_equal(a, b)
        for pair in zip(first, second, strict=True)
        for a, b in zip(*map(_arrays, pair), strict=True)
    )


def _arrays(seen: Sightings) -> tuple[Array, ...]:
    still = seen.static, seen.segments.ends, seen.segments.covariance
    return (seen.positions, seen.covariance, seen.radius, seen.times, *still)

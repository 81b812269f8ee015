"""Beams that end where something has long stood are left out before anything is detected."""

from dataclasses import dataclass, field, replace
from functools import partial
from typing import ClassVar, NamedTuple, final

import numpy as np

from wideberth.framework.plugins.config import build
from wideberth.framework.values.arrays import Array, BoolArray
from wideberth.framework.values.sensing import Scan
from wideberth.simulation.sensing.perceived import Sightings

from ..detector import Detector
from .hits import without
from .segments import with_static

STEEP = 1.0
"""m; between two beams whose ranges differ by more, nothing is known of what lies between."""
FREE = 0.2
"""Share of the earlier scans that saw a place free, above which what stands there has come."""
TOUCH = 0.5
"""m. A point as close as this to its static neighbour is of the same wall."""


class _Look(NamedTuple):
    """An earlier scan.

    Attributes
    ----------
    time : s.
    origin : (2,), m.
    azimuths : (B,), rad, increasing within [0, 2 pi).
    ranges : (B,), m from the origin; infinite where the beam met nothing, NaN where it was lost.
    """

    time: float
    origin: Array
    azimuths: Array
    ranges: Array

    def at(self, points: Array, tolerance: float) -> tuple[BoolArray, BoolArray]:
        """Tell which points, (n, 2), were met then, and which places were seen free.

        The two beams beside a point decide. It was met where its distance lies between their
        ranges, or is near one of them; free where both ended beyond it.
        """
        away = points - self.origin
        distance = np.linalg.norm(away, axis=1)
        azimuth = np.mod(np.arctan2(away[:, 1], away[:, 0]), 2.0 * np.pi)
        after = np.searchsorted(self.azimuths, azimuth) % len(self.azimuths)
        pair = self.ranges[np.stack([after - 1, after])]
        turn = np.abs(np.mod(self.azimuths[after] - self.azimuths[after - 1], 2.0 * np.pi))
        sighted = np.isfinite(azimuth) & (turn < 3.0 * np.median(turn) + 1e-9)
        nearest, farthest = np.fmin(*pair), np.fmax(*pair)
        with np.errstate(invalid="ignore"):
            near = (np.abs(pair - distance) <= tolerance).any(axis=0)
            between = (nearest - tolerance <= distance) & (distance <= farthest + tolerance)
            met = near | (between & (farthest - nearest <= STEEP))
            free = ~met & (distance < nearest - tolerance)
        return np.asarray(met & sighted), np.asarray(free & sighted)


def _spread(points: Array, static: BoolArray, may: BoolArray) -> BoolArray:
    """Extend what is static, (n,), to points that may be and touch it, one after the other."""
    found = static.copy()
    for step in (1, -1):
        order = np.arange(len(points))[::step]
        for here, there in zip(np.roll(order, 1), order, strict=True):
            if found[here] and may[there] and not found[there]:
                found[there] = np.linalg.norm(points[there] - points[here]) < TOUCH
    return found


SCANS = 30
"""Earlier scans that are remembered."""
SPAN = 3.0
"""s; nothing is static before that much time has been seen."""
SHARE = 0.5
"""Of the scans, from which on what stood there is static."""
TOLERANCE = 0.2
"""m, between a point and what was met before."""


@final
@dataclass(eq=False)
class OverTime(Detector):
    """Detects what has not stood there all the time.

    A point is static if more than `SHARE` of the last `SCANS` scans, over `SPAN` s at least,
    met something there (within `TOLERANCE`), unless a good part of them saw the place free:
    then a body has come and stands still, and counts as one that may move until it leaves. Beside
    static points a place that was never seen free is static too: the rest of a wall that comes
    out of a shadow. Static points take no part in the detection of ``detector``. The poses must
    be in a frame that does not jump (odometry): errors of the pose over `SPAN` count.

    A body that has stood there since before the first scan counts as static until it moves.

    Parameters
    ----------
    detector : finds bodies in what is left.
    """

    reference: ClassVar[str] = ""

    detector: Detector = field(default_factory=partial(build, "detectors", "discs"))
    _looks: list[_Look] = field(init=False, repr=False)
    _come: list[tuple[float, Array]] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        self._looks, self._come = [], []

    def reset(self) -> None:
        """Forget all scans, and what the inner detector remembers."""
        self._looks, self._come = [], []
        self.detector.reset()

    def detect(self, scan: Scan, poses: Array) -> Sightings:
        """Find what has not stood there all the time; see `Detector.detect`."""
        beams, now = scan.beams(poses), scan.stamp
        note = ""
        if self._looks and now < self._looks[-1].time:
            note = (
                f"clock went back by {self._looks[-1].time - now:.3g} s: what stood is forgotten"
            )
            self.reset()
        static = beams.met
        static[static] = self._stood(now, beams.ends[static])
        if beams.known.any():
            self._remember(now, scan, beams.origins, beams.directions)
        found = self.detector.detect(without(scan, static), poses)
        notes = "; ".join(filter(None, (note, found.note)))
        return replace(with_static(found, scan, poses, static), note=notes)

    def _stood(self, now: float, points: Array) -> BoolArray:
        """Tell which points something has long stood at, (n,)."""
        nothing = np.zeros(len(points), dtype=np.bool_)
        if not len(points) or not self._looks:
            return nothing
        if now - self._looks[0].time < SPAN * (1.0 - 1e-6):
            return nothing
        met, free = np.zeros(len(points)), np.zeros(len(points))
        for look in self._looks:
            was_met, was_free = look.at(points, TOLERANCE)
            met += was_met
            free += was_free
        count = len(self._looks)
        stood, was_empty = met > SHARE * count, free >= max(FREE * count, 1.0)
        come = stood & was_empty
        self._come = [one for one in self._come if now - one[0] <= SPAN]
        for _, places in self._come:
            apart = np.linalg.norm(points[:, None] - places[None], axis=2)
            come |= stood & (apart.min(axis=1, initial=np.inf) <= TOLERANCE)
        if come.any():
            self._come.append((now, points[come]))
        return _spread(points, np.asarray(stood & ~come), np.asarray(~was_empty & ~come))

    def _remember(self, now: float, scan: Scan, origins: Array, directions: Array) -> None:
        """Keep the scan, and drop those before the last `SCANS` within reach of `SPAN`."""
        known = np.isfinite(directions)
        azimuth = np.mod(directions[known], 2.0 * np.pi)
        order = np.argsort(azimuth, kind="stable")
        ranges = np.where(scan.met | np.isinf(scan.ranges), scan.ranges, np.nan)
        ranges = np.where(scan.ranges > scan.longest, np.inf, ranges)[known][order]
        self._looks.append(_Look(now, origins[known].mean(axis=0), azimuth[order], ranges))
        while len(self._looks) > SCANS and now - self._looks[1].time >= SPAN:
            del self._looks[0]

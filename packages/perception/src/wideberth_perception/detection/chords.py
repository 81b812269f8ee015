"""The published rule of obstacle_detector: lines, and a disc on each short one."""

from dataclasses import dataclass, replace
from math import hypot, sqrt
from typing import ClassVar, final

import numpy as np

from wideberth.framework.values.arrays import Array, positive, whole
from wideberth.framework.values.sensing import Scan
from wideberth.simulation.sensing.perceived import Sightings

from ..detector import Detector
from .groups import by_gap
from .hits import Hits, IntArray, hits_of
from .segments import segments_of


@dataclass(frozen=True, eq=False)
class _Line:
    """A straight piece of outline.

    Attributes
    ----------
    index : of its points, by bearing.
    ends : (2, 2), m, the first and the last one on the line.
    """

    index: IntArray
    ends: Array

    @property
    def length(self) -> float:
        return hypot(*(self.ends[1] - self.ends[0]))

    def off(self, points: Array) -> Array:
        """Distance of points from the endless line, (...), m."""
        along = self.ends[1] - self.ends[0]
        away = points - self.ends[0]
        cross = along[0] * away[..., 1] - along[1] * away[..., 0]
        return np.asarray(np.abs(cross) / max(hypot(*along), 1e-9))

    def apart(self, points: Array) -> Array:
        """Distance of points from the piece itself, (...), m."""
        along = self.ends[1] - self.ends[0]
        share = (points - self.ends[0]) @ along / max(float(along @ along), 1e-18)
        nearest = self.ends[0] + np.clip(share, 0.0, 1.0)[..., None] * along
        return np.asarray(np.linalg.norm(points - nearest, axis=-1))


@dataclass(frozen=True, eq=False)
class _Disc:
    centre: Array
    radius: float
    index: IntArray


@final
@dataclass(eq=False)
class Chords(Detector):
    """Finds discs as the ROS package obstacle_detector does, with its numbers.

    Points are grouped where neighbours are closer than ``gap`` + ``proportion`` r, r the range. A
    line is laid through each group (total least squares) and split at the point farthest from it
    while that is farther than ``split`` + ``proportion`` r and both parts keep ``fewest`` points.
    Lines that touch and agree are joined. A line of length l then stands for a disc around an
    equilateral triangle on it:

    radius = l / sqrt(3) + ``enlargement``,   centre = middle - n l / (2 sqrt(3))

    with n the normal towards the sensor. Discs of at least ``largest`` m are dropped and their
    lines are static; discs that overlap are joined where the result is small enough.

    It stands here to be compared with. With its numbers a robot of 0.75 m is never a disc, and
    ``proportion`` belongs to a scanner with 1000 beams: with 360 it splits bodies at a range. The
    visibility test of the package is left out; it never applies to 360 beams.

    Parameters
    ----------
    gap, split : m.
    proportion : m per m of range.
    fewest : points of a group or part.
    separation, collinear : m, between the ends of lines that are joined, and of their ends from
        the joint one.
    enlargement, largest : m.
    deviation : m, standard deviation of a centre along each axis. The package states none.

    Raises
    ------
    WideberthError : a number that is not positive.
    """

    reference: ClassVar[str] = "przybyla2017detection"

    gap: float = 0.1
    proportion: float = 0.00628
    fewest: int = 5
    split: float = 0.2
    separation: float = 0.2
    collinear: float = 0.2
    enlargement: float = 0.25
    largest: float = 0.6
    deviation: float = 0.1

    def __post_init__(self) -> None:
        for name in ("gap", "proportion", "split", "separation", "collinear", "largest"):
            positive(f"chords.{name}", getattr(self, name))
        positive("chords.enlargement", self.enlargement, zero=True)
        positive("chords.deviation", self.deviation)
        whole("chords.fewest", self.fewest)

    def reset(self) -> None:
        """Do nothing: each scan stands for itself."""

    def detect(self, scan: Scan, poses: Array) -> Sightings:
        """Find discs and lines; see `Detector.detect`."""
        hits, note = hits_of(scan, poses)
        lines: list[_Line] = []
        for index in by_gap(hits, self.gap, self.proportion):
            if len(index) >= self.fewest:
                lines += self._lines(hits, index)
        lines = self._joined_lines(hits, lines)
        discs: list[_Disc] = []
        static: list[IntArray] = [np.zeros(0, dtype=np.int64)]
        for line in lines:
            disc = self._disc(hits, line)
            if disc.radius < self.largest:
                discs.append(disc)
            else:
                static.append(line.index)
        discs = self._joined_discs(discs)
        count = len(discs)
        still = hits.select(np.unique(np.concatenate(static)))  # neighbours share a point
        return Sightings(
            scan.stamp,
            np.reshape([disc.centre for disc in discs], (count, 2)),
            np.tile(self.deviation**2 * np.eye(2), (count, 1, 1)),
            np.reshape([disc.radius for disc in discs], count),
            still.points,
            note,
            np.reshape([hits.times[disc.index].mean() for disc in discs], count),
            hits.sensor,
            segments=segments_of(still, scan.deviation),
        )

    def _lines(self, hits: Hits, index: IntArray) -> list[_Line]:
        """Lay lines through a group, split until they fit."""
        line = _through(hits, index)
        off = line.off(hits.points[index])
        limit = self.split + self.proportion * hits.ranges[index]
        far = np.where(off > limit, off, 0.0)
        at = int(far.argmax()) + 1
        if far.max() > 0.0 and self.fewest < at < len(index) - self.fewest:
            return self._lines(hits, index[:at]) + self._lines(hits, index[at - 1 :])
        return [line]

    def _joined_lines(self, hits: Hits, lines: list[_Line]) -> list[_Line]:
        """Join lines that touch and lie on one, until none do."""
        for i, one in enumerate(lines):
            for j in range(i + 1, len(lines)):
                other = lines[j]
                touch = min(one.apart(other.ends).min(), other.apart(one.ends).min())
                if touch >= self.separation:
                    continue
                both = _through(hits, np.concatenate([one.index, other.index]))
                if both.off(np.concatenate([one.ends, other.ends])).max() < self.collinear:
                    rest = [line for k, line in enumerate(lines) if k not in (i, j)]
                    return self._joined_lines(hits, [both, *rest])
        return lines

    def _disc(self, hits: Hits, line: _Line) -> _Disc:
        """Return the disc that stands for a line."""
        middle, along = line.ends.mean(axis=0), line.ends[1] - line.ends[0]
        normal = np.array([-along[1], along[0]]) / max(line.length, 1e-9)
        if normal @ (hits.origins[line.index].mean(axis=0) - middle) < 0.0:
            normal = -normal
        radius = line.length / sqrt(3.0)
        return _Disc(middle - 0.5 * radius * normal, radius + self.enlargement, line.index)

    def _joined_discs(self, discs: list[_Disc]) -> list[_Disc]:
        """Join discs that overlap, until none do that give a small one."""
        for i, one in enumerate(discs):
            for j in range(i + 1, len(discs)):
                both = self._both(one, discs[j])
                if both is not None:
                    rest = [disc for k, disc in enumerate(discs) if k not in (i, j)]
                    return self._joined_discs([both, *rest])
        return discs

    def _both(self, one: _Disc, other: _Disc) -> _Disc | None:
        """Return a disc for two; None where they lie apart or it would be too large."""
        apart = hypot(*(other.centre - one.centre))
        index = np.concatenate([one.index, other.index])
        if abs(one.radius - other.radius) >= apart:
            larger = one if one.radius >= other.radius else other
            return replace(larger, index=index)
        total = one.radius + other.radius
        if total < apart:
            return None
        centre = one.centre + (other.centre - one.centre) * one.radius / total
        radius = hypot(*(one.centre - centre)) + one.radius + max(one.radius, other.radius)
        return _Disc(centre, radius, index) if radius < self.largest else None


def _through(hits: Hits, index: IntArray) -> _Line:
    """Lay a line through points by total least squares, from the first to the last one."""
    points = hits.points[index]
    middle = points.mean(axis=0)
    _, vectors = np.linalg.eigh((points - middle).T @ (points - middle))
    along = vectors[:, 1]
    share = (points - middle) @ along
    ends = middle + np.array([share.min(), share.max()])[:, None] * along
    return _Line(index, ends)

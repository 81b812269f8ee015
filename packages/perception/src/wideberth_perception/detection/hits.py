"""Where the beams of a scan met something, in the frame of the robot's poses."""

from dataclasses import dataclass, replace
from typing import Any, TypeAlias

import numpy as np

from wideberth.framework.values.arrays import Array, BoolArray
from wideberth.framework.values.sensing import Scan

IntArray: TypeAlias = np.ndarray[Any, np.dtype[np.int64]]
DRIFT, TURN = 0.001, 0.0005
"""m and rad, by which the poses within a scan err against each other; see `Discs`."""
EMPTY, BLIND = "the scan is empty", "no beam met anything"


@dataclass(frozen=True, eq=False)
class Hits:
    """Points that a scan met, by increasing bearing.

    Attributes
    ----------
    points : (n, 2), m.
    origins : (n, 2), m, where the sensor was when it cast each beam.
    ranges : (n,), m.
    times : (n,), s.
    beams : (n,), number of the beam, counted by bearing over all beams of the scan.
    lost : (n,), beams since the point before, in the whole scan, whose range is none: something
        may have stood there. The others met nothing.
    total : B, beams of the scan.
    spacing : rad between two beams.
    sensor : (2,), m, its mean place; None where no beam has a pose.
    """

    points: Array
    origins: Array
    ranges: Array
    times: Array
    beams: IntArray
    lost: IntArray
    total: int
    spacing: float
    sensor: Array | None

    def __len__(self) -> int:
        """Count the points."""
        return len(self.points)

    @property
    def closed(self) -> bool:
        """Whether the last beam lies beside the first one."""
        return self.total * self.spacing > 2.0 * np.pi - 0.5 * self.spacing

    def select(self, chosen: BoolArray | IntArray) -> "Hits":
        """Return some of the points."""
        return replace(
            self,
            points=self.points[chosen],
            origins=self.origins[chosen],
            ranges=self.ranges[chosen],
            times=self.times[chosen],
            beams=self.beams[chosen],
            lost=self.lost[chosen],
        )


def hits_of(scan: Scan, poses: Array) -> tuple[Hits, str]:
    """Return what the beams met, and why that is less than it should be; "" where it is not.

    Parameters and errors are those of `Scan.beams`.
    """
    beams = scan.beams(poses)
    known = beams.known
    bearing = np.mod(scan.bearings, 2.0 * np.pi)
    order = np.argsort(bearing, kind="stable")
    gaps = np.mod(bearing[order] - bearing[np.roll(order, 1)], 2.0 * np.pi)
    if len(order) > 1:  # begin after the part that the scan does not cover
        order = np.roll(order, -int(gaps.argmax()))
    place = np.flatnonzero(beams.met[order])
    chosen = order[place]
    spacing = float(np.median(gaps)) if len(order) > 1 else 0.0
    none = np.cumsum(~(scan.ranges[order] > 0.0))  # NaN is not either
    lost = np.diff(none[place], prepend=none[place[-1]] - none[-1]) if len(place) else place
    found = Hits(
        points=beams.ends[chosen],
        origins=beams.origins[chosen],
        ranges=scan.ranges[chosen],
        times=scan.times[chosen],
        beams=place.astype(np.int64),
        lost=lost.astype(np.int64),
        total=len(order),
        spacing=spacing,
        sensor=beams.origins[known].mean(axis=0) if known.any() else None,
    )
    if not len(order):
        return found, EMPTY
    if not known.all():
        return found, f"{int((~known).sum())} of {len(known)} beams have no pose"
    return found, "" if len(found) else BLIND


def without(scan: Scan, lost: BoolArray) -> Scan:
    """Return the scan as if some of its beams, (B,), had been lost."""
    return replace(scan, ranges=np.where(lost, np.nan, scan.ranges))

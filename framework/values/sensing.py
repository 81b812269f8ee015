"""Scans of a planar LiDAR."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from .arrays import FARTHEST, LATEST, Array, BoolArray, checked, positive, settle
from .errors import WideberthError


@dataclass(frozen=True, eq=False)
class Scan:
    """One turn of a planar LiDAR.

    Ranges that are no measurement are accepted: a reader of the scan leaves them out.

    Attributes
    ----------
    sensor : its name.
    times : (B,), s, instant of each beam, in the order in which they were cast.
    bearings : (B,), rad, direction of each beam in the sensor's frame, counter-clockwise.
    ranges : (B,), m. Infinite where nothing stands within the longest range, NaN where the beam
        was lost.
    deviation : m, standard deviation of a range.
    longest : m, beyond which the sensor sees nothing.
    mount : (3,), x, y in m and heading in rad of the sensor in the robot's frame.

    Raises
    ------
    WideberthError : shapes that do not fit, times or bearings that are not finite, times beyond
        `LATEST`, a deviation or longest range that is not positive.
    """

    sensor: str
    times: Array
    bearings: Array
    ranges: Array
    deviation: float
    longest: float
    mount: Array

    def __init__(
        self,
        sensor: str,
        times: ArrayLike,
        bearings: ArrayLike,
        ranges: ArrayLike,
        deviation: float = 0.01,
        longest: float = 15.0,
        mount: ArrayLike = (0.0, 0.0, 0.0),
    ) -> None:
        times = checked("scan.times", times, (None,))
        if (latest := float(np.abs(times).max(initial=0.0))) > LATEST:
            raise WideberthError(f"scan.times holds {latest:.3g} s; wanted at most {LATEST:g}")
        shape = (len(times),)
        bearings = checked("scan.bearings", bearings, shape)
        ranges = checked("scan.ranges", ranges, shape, finite=False)
        mount = checked("scan.mount", mount, (3,))
        positive("scan.deviation", deviation)
        positive("scan.longest", longest)
        settle(self, sensor=sensor, times=times, bearings=bearings, ranges=ranges)
        settle(self, deviation=deviation, longest=longest, mount=mount)

    @property
    def stamp(self) -> float:
        """Instant of the last beam, s; NaN for an empty scan."""
        return float(self.times.max()) if len(self.times) else float("nan")

    @property
    def met(self) -> BoolArray:
        """Which beams met something, at most `FARTHEST` away, (B,)."""
        with np.errstate(invalid="ignore"):
            farthest = min(self.longest, FARTHEST)
            return np.asarray((self.ranges > 0.0) & (self.ranges <= farthest))

    def beams(self, poses: Array) -> "Beams":
        """Place each beam by the pose of its own instant, which takes the robot's motion out.

        o = p + Rot(psi) m,   phi = psi + psi_m + bearing,   end = o + r (cos phi, sin phi)

        with the mount m, psi_m and the range r of each of the B beams.

        Parameters
        ----------
        poses : (B, 3), (p, psi), see `Detector.detect`. A pose that is not finite loses its beam,
            as does one beyond `FARTHEST`, in m or rad; so do bearings and a mount beyond it.

        Raises
        ------
        WideberthError : not one pose per beam.
        """
        poses = checked(
            "poses", poses, (len(self.times), 3), finite=False, reason=", one per beam"
        )
        mount = np.broadcast_to(self.mount, poses.shape)
        numbers = np.column_stack([poses, mount, self.bearings])
        numbers[~(np.abs(numbers) <= FARTHEST).all(axis=1)] = np.nan  # NaN is not either
        x, y, heading, along, aside, turn, bearings = numbers.T
        cosine, sine = np.cos(heading), np.sin(heading)
        shift = np.stack([cosine * along - sine * aside, sine * along + cosine * aside], axis=-1)
        origins, directions = np.stack([x, y], axis=-1) + shift, heading + turn + bearings
        ranges = np.where(self.met, self.ranges, np.nan)
        unit = np.stack([np.cos(directions), np.sin(directions)], axis=-1)
        ends = origins + ranges[:, None] * unit
        ends[~(np.abs(ends) <= FARTHEST).all(axis=1)] = np.nan
        return Beams(origins, directions, ends)


@dataclass(frozen=True, eq=False)
class PlacedScan:
    """A scan, and where the robot stood when its last beam was cast.

    Attributes
    ----------
    scan : as it was measured.
    pose : (3,), x, y in m and heading in rad of the robot, as it believes.

    Raises
    ------
    WideberthError : a pose of another shape, or one that is not finite.
    """

    scan: Scan
    pose: Array

    def __init__(self, scan: Scan, pose: ArrayLike) -> None:
        settle(self, scan=scan, pose=checked("placed_scan.pose", pose, (3,)))


@dataclass(frozen=True, eq=False)
class Beams:
    """All beams of a scan in the frame of the poses; NaN where a beam has no pose.

    Attributes
    ----------
    origins : (B, 2), m, where each began.
    directions : (B,), rad.
    ends : (B, 2), m, where each ended; NaN where it met nothing, or beyond `FARTHEST`.
    """

    origins: Array
    directions: Array
    ends: Array

    @property
    def known(self) -> BoolArray:
        """Which have a pose, (B,)."""
        return np.asarray(np.isfinite(self.directions))

    @property
    def met(self) -> BoolArray:
        """Which ended somewhere, (B,)."""
        return np.asarray(np.isfinite(self.ends[:, 0]))

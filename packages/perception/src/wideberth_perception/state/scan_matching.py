"""Matching of scans to a map of polygons, which bounds the drift of another estimator."""

from dataclasses import dataclass, field
from functools import partial
from math import cos, sin
from typing import ClassVar, final

import numpy as np

from wideberth.framework.numerics.chi_square import content_bound
from wideberth.framework.numerics.geometry import wrapped
from wideberth.framework.plugins.config import ADVICE, build
from wideberth.framework.values.arrays import Array, BoolArray, assembled
from wideberth.framework.values.errors import WideberthError
from wideberth.framework.values.polygon import Polygon, edge_normals
from wideberth.framework.values.sensing import Scan
from wideberth.simulation.sensing.perceived import MotionEstimate

from ..state_estimator import Sample, StateEstimator, checked_start, poses_at

_GRAZING = 0.1
"""Sine of the angle at which a beam still counts as a measurement of the wall."""
_BEYOND = 0.02
"""m, by which a point may lie past the end of a wall."""
_FAR = 1.0
"""m from a wall beyond which a point is never of it."""
_DOUBT = (0.05**2, 0.05**2, 0.02**2)
"""m^2, m^2, rad^2, by which the pose is less sure after a scan that does not fit the map."""
_LOST = 0.3
"""m, deviation up to which it is doubted: scans find no pose that is further off."""
_ROUNDS = 8
_STILL = 1e-5
"""m and rad: a step as small ends the search."""
_WALLS = "the outlines of the map, such as [{vertices: [[0, 0], [8, 0], [8, 0.2], [0, 0.2]]}]"

_BEAMS = 120
"""Most of a scan that are used, evenly chosen."""
_MAP_DEVIATION = 0.01
"""m, how far the faces are from where the map has them."""
_GATE = 1e-3
"""Probability with which a point of a wall is left out."""
_LEAST = 0.3
"""Of the beams that met something, the share that has to fit the map."""


@final
@dataclass(eq=False)
class ScanMatching(StateEstimator):
    """Keeps the pose in a map: another estimator's motion, corrected by every scan.

    Between scans the pose x = (x, y, heading) moves with the odometry, p_0 to p_1, and its
    covariance C grows by what the odometry's own covariance P has grown since::

        x <- x (+) (p_1 (-) p_0)        C <- F C F^T + T (P_1 - F_0 P_0 F_0^T)_+ T^T

    with F, F_0 the derivatives of the motion in either frame, T the turn from one to the other
    and (.)_+ without negative eigenvalues. Without scans C is thus what P is.

    Each beam that met something is laid into the map from where the robot was at its instant. A
    point q_i belongs to the nearest face that looks at the robot, with normal n_i and a point a_i
    on it; one outside the gate belongs to nothing (people, other robots, a changed map). Then
    Gauss-Newton, with the faces chosen anew in every round::

        min over x  sum_i (n_i . (R q_i + t - a_i))^2 / s_i^2  +  (x - x_0)^T C^-1 (x - x_0)

    with s_i^2 = (deviation of the range along n_i)^2 + `_MAP_DEVIATION`^2; the new C is the
    inverse of the information matrix, sum_i J_i^T J_i / s_i^2 + C^-1. Where the walls leave a
    direction open (a corridor), the matrix says so and the odometry decides. A scan that does not
    fit the map is left out, and the pose less sure after it, so that after a push or a slip the
    gate opens until scans fit again.

    Parameters
    ----------
    walls : what stands still, polygons in the map's frame.
    odometry : estimates the motion; it is given every sample but the scans.

    Raises
    ------
    WideberthError : no walls.
    """

    reference: ClassVar[str] = "thrun2005probabilistic"

    walls: tuple[Polygon, ...] = field(metadata={ADVICE: _WALLS})
    odometry: StateEstimator = field(default_factory=partial(build, "state_estimators", "ekf"))

    def __post_init__(self) -> None:
        self._farthest = content_bound(1, _GATE)
        if not self.walls:
            raise WideberthError(
                "scan_matching.walls is empty; wanted the polygons of a map: without one use the "
                "odometry alone"
            )
        self._faces = _Faces(self.walls)
        self._anchor: _Anchor | None = None

    def reset(self, pose: Array, time: float) -> None:
        """Begin at a known pose (3,) in the map, m and rad, at rest."""
        pose, time = checked_start(pose, time)
        self.odometry.reset(pose, time)
        found = self.odometry.at(time)
        self._anchor = _Anchor(found, found.mean[:3], found.covariance[:3, :3])
        self._newest = -np.inf

    def take(self, sample: Sample) -> str:
        """Use a sample; return why it, or a part of it, was left out."""
        anchor = self._started()
        if not isinstance(sample, Scan):
            return self.odometry.take(sample)
        met = sample.met
        if not met.any():
            return "no beam met anything"
        stamp = sample.stamp
        now = self.odometry.at(stamp)
        if now.time != stamp:
            return f"it is of {stamp:.6g} s, of which the odometry cannot speak"
        if stamp <= self._newest:
            return f"it is of {stamp:.6g} s; one of {self._newest:.6g} s is matched already"
        points, directions = self._points(sample, met, now)
        pose, covariance = anchor.moved(now)
        fitted = self._fitted(points, directions, pose, covariance, sample.deviation)
        self._newest = stamp
        if isinstance(fitted, str):
            if np.trace(covariance[:2, :2]) < _LOST**2:
                self._anchor = _Anchor(now, pose, covariance + np.diag(_DOUBT))
            return fitted
        self._anchor = _Anchor(now, *fitted)
        return ""

    def at(self, time: float) -> MotionEstimate:
        """Return the estimate of a time, s: the pose in the map, the speeds of the odometry."""
        anchor = self._started()
        found = self.odometry.at(time)
        pose, covariance = anchor.moved(found)
        whole_covariance = np.zeros((6, 6))
        whole_covariance[:3, :3] = covariance
        whole_covariance[3:, 3:] = found.covariance[3:, 3:]
        return assembled(
            MotionEstimate,
            time=found.time, mean=np.concatenate([pose, found.mean[3:]]),
            covariance=whole_covariance, frame="map",
        )  # fmt: skip

    def _started(self) -> "_Anchor":
        if self._anchor is None:
            raise WideberthError("an estimator starts from a known pose: call reset first")
        return self._anchor

    def _points(self, scan: Scan, met: BoolArray, now: MotionEstimate) -> tuple[Array, Array]:
        """Return what the beams met, (K, 2) m, and their unit directions, both seen from now."""
        chosen = np.flatnonzero(met)
        if len(chosen) > _BEAMS:
            chosen = chosen[np.linspace(0, len(chosen) - 1, _BEAMS).round().astype(int)]
        poses = poses_at(self.odometry, scan.times[chosen])
        from_now = _between(now.pose, poses)
        heading = from_now[:, 2]
        cosine, sine = np.cos(heading), np.sin(heading)
        x, y, turn = scan.mount.tolist()
        bearing = heading + turn + scan.bearings[chosen]
        directions = np.stack([np.cos(bearing), np.sin(bearing)], axis=1)
        lever = np.stack([cosine * x - sine * y, sine * x + cosine * y], axis=1)
        points = from_now[:, :2] + lever + scan.ranges[chosen, None] * directions
        return points, directions

    def _fitted(
        self, points: Array, directions: Array, start: Array, spread: Array, noise: float
    ) -> tuple[Array, Array] | str:
        """Return pose and covariance that fit points best, or why there is none."""
        known = np.linalg.inv(spread)
        pose, information = start, known
        for _ in range(_ROUNDS):
            cosine, sine = cos(pose[2]), sin(pose[2])
            turn = np.array([[cosine, -sine], [sine, cosine]])
            laid, looking = points @ turn.T, directions @ turn.T
            off, normals = self._faces.nearest(laid + pose[:2], looking)
            lever = normals[:, 1] * laid[:, 0] - normals[:, 0] * laid[:, 1]
            slopes = np.column_stack([normals, lever])
            across = (noise * (looking * normals).sum(axis=1)) ** 2 + _MAP_DEVIATION**2
            allowed = across + np.einsum("ki,ij,kj->k", slopes, spread, slopes)
            fits = off * off < self._farthest * allowed
            if fits.sum() < max(3.0, _LEAST * len(points)):
                return f"{int(fits.sum())} of {len(points)} beams fit the map"
            slopes, off, weights = slopes[fits], off[fits], 1.0 / across[fits]
            information = (slopes.T * weights) @ slopes + known
            pull = slopes.T @ (weights * off) + known @ (pose - start)
            step = np.linalg.solve(information, pull)
            pose = pose - step
            if np.abs(step).max() < _STILL:
                break
        found = np.linalg.inv(information)
        return np.array([pose[0], pose[1], wrapped(pose[2])]), 0.5 * (found + found.T)


@dataclass(frozen=True, eq=False)
class _Anchor:
    """Where the odometry was when the pose in the map was known last, and that pose."""

    odometry: MotionEstimate
    pose: Array
    covariance: Array

    def moved(self, now: MotionEstimate) -> tuple[Array, Array]:
        """Return pose and covariance in the map when the odometry has come to ``now``."""
        before = self.odometry
        step = _between(before.pose, now.pose[None])[0]
        turned = self.pose[2] - before.mean[2]
        cosine, sine = cos(self.pose[2]), sin(self.pose[2])
        shift = np.array([
            cosine * step[0] - sine * step[1], sine * step[0] + cosine * step[1]
        ])  # fmt: skip
        pose = np.array([*(self.pose[:2] + shift), wrapped(self.pose[2] + step[2])])
        if now.time == before.time:
            return pose, self.covariance
        there = _lever(now.mean[:2] - before.mean[:2])
        grown = now.covariance[:3, :3] - there @ before.covariance[:3, :3] @ there.T
        values, vectors = np.linalg.eigh(0.5 * (grown + grown.T))
        values = np.maximum(values, 0.0)
        turn = np.eye(3)
        turn[:2, :2] = [[cos(turned), -sin(turned)], [sin(turned), cos(turned)]]
        vectors = turn @ vectors
        here = _lever(shift)
        covariance = here @ self.covariance @ here.T + (vectors * values) @ vectors.T
        return pose, 0.5 * (covariance + covariance.T)


class _Faces:
    """The edges of polygons: their normals, and how far points are from them."""

    def __init__(self, walls: tuple[Polygon, ...]) -> None:
        starts = [wall.points for wall in walls]
        ends = [np.roll(points, -1, axis=0) for points in starts]
        self._start, along = np.concatenate(starts), np.concatenate(ends) - np.concatenate(starts)
        self._length = np.hypot(along[:, 0], along[:, 1])
        self._along = along / self._length[:, None]
        self._normal = np.concatenate([edge_normals(points) for points in starts])
        self._offset = (self._normal * self._start).sum(axis=1)
        self._place = (self._along * self._start).sum(axis=1)

    def nearest(self, points: Array, directions: Array) -> tuple[Array, Array]:
        """Return signed distances (K,) from the nearest face that is looked at, and its normal.

        The distance is infinite where there is none within a metre.
        """
        off = points @ self._normal.T - self._offset
        place = points @ self._along.T - self._place
        fits = (place > -_BEYOND) & (place < self._length + _BEYOND)
        fits &= directions @ self._normal.T < -_GRAZING
        size = np.where(fits, np.abs(off), np.inf)
        best = size.argmin(axis=1)
        rows = np.arange(len(points))
        found = np.where(size[rows, best] < _FAR, off[rows, best], np.inf)
        return found, self._normal[best]


def _between(pose: Array, others: Array) -> Array:
    """Return poses (..., 3) as seen from one pose (3,)."""
    cosine, sine = cos(pose[2]), sin(pose[2])
    off = others[..., :2] - pose[:2]
    return np.stack([
        cosine * off[..., 0] + sine * off[..., 1],
        cosine * off[..., 1] - sine * off[..., 0],
        wrapped(others[..., 2] - pose[2]),
    ], axis=-1)  # fmt: skip


def _lever(shift: Array) -> Array:
    """Return the derivative of a pose by the pose a shift before, (3, 3)."""
    found = np.eye(3)
    found[:2, 2] = -shift[1], shift[0]
    return found

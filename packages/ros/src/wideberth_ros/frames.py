"""Frames of a robot in the plane, and the motions between them over time (tf)."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from math import inf, pi
from typing import final

import numpy as np
from numpy.typing import ArrayLike

from wideberth.framework.values.arrays import FARTHEST, Array
from wideberth.framework.values.errors import WideberthError, nearest

SLACK = 0.5
"""s, for which a motion is taken to stay as it was before its first and after its last report."""
TILT = 0.1
"""rad, of the vertical axis; a frame of the plane is upright or upside down within this."""
MIRROR = np.array([1.0, -1.0, -1.0])
"""Turns a motion into the same one as a frame that is upside down states it."""


def yaw_of(x: ArrayLike, y: ArrayLike, z: ArrayLike, w: ArrayLike) -> Array:
    """Return the yaw of unit quaternions, rad: atan2(2 (w z + x y), 1 - 2 (y^2 + z^2))."""
    x, y, z, w = (np.asarray(one, dtype=np.float64) for one in (x, y, z, w))
    return np.asarray(np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z)))


def quaternion_of(turn: Array) -> tuple[float, float, float, float]:
    """Return the unit quaternion x, y, z, w of a rotation, (3, 3), whose largest part is above 0.

    A row of 4 q q^T, which is linear in the matrix: that of the largest part.
    """
    (a, b, c), (d, e, f), (g, h, i) = turn.tolist()
    rows = np.array(
        [
            [1.0 + a - e - i, b + d, c + g, h - f],
            [b + d, 1.0 - a + e - i, f + h, c - g],
            [c + g, f + h, 1.0 - a - e + i, d - b],
            [h - f, c - g, d - b, 1.0 + a + e + i],
        ]
    )
    row = rows[np.diagonal(rows).argmax()]
    x, y, z, w = (row / np.linalg.norm(row)).tolist()
    return x, y, z, w


def tilt_of(x: float, y: float) -> float:
    """Return the angle between the vertical axes of two frames, rad: arccos(1 - 2 (x^2 + y^2)).

    x and y are the quaternion's; a sensor that hangs upside down has pi.
    """
    return float(np.arccos(np.clip(1.0 - 2.0 * (x * x + y * y), -1.0, 1.0)))


def composed(outer: Array, inner: Array) -> Array:
    """Return the motion ``outer`` after ``inner``, (..., 3) each: x, y in m and yaw in rad."""
    cosine, sine = np.cos(outer[..., 2]), np.sin(outer[..., 2])
    x = outer[..., 0] + cosine * inner[..., 0] - sine * inner[..., 1]
    y = outer[..., 1] + sine * inner[..., 0] + cosine * inner[..., 1]
    return np.stack([x, y, outer[..., 2] + inner[..., 2]], axis=-1)


def inverted(motion: Array) -> Array:
    """Return the motion back, (..., 3): x, y in m and yaw in rad."""
    cosine, sine = np.cos(motion[..., 2]), np.sin(motion[..., 2])
    x = -cosine * motion[..., 0] - sine * motion[..., 1]
    y = sine * motion[..., 0] - cosine * motion[..., 1]
    return np.stack([x, y, -motion[..., 2]], axis=-1)


@dataclass(eq=False)
class _Edge:
    """Reports of the pose of one frame in another."""

    parent: str
    static: bool
    rows: list[tuple[float, float, float, float, float]] = field(default_factory=list)
    table: Array | None = None
    tilt: float = inf
    """Least tilt of all reports against upright and upside down, rad."""

    @property
    def mirrors(self) -> bool:
        """Whether the frame is upside down in its parent."""
        return self.rows[-1][4] > 0.5 * pi

    def at(self, times: Array) -> Array:
        """Poses at these times, (T, 3); NaN where nothing is known, and where the frame tilts."""
        if self.table is None:
            rows = np.array(sorted(self.rows))
            rows[:, 3] = np.unwrap(rows[:, 3])
            rows[[_tilt(row) > TILT for row in rows], 1:] = np.nan
            self.table = rows
        if self.static:
            return np.broadcast_to(self.table[-1, 1:4], (len(times), 3))
        clock = self.table[:, 0]
        found = np.stack(
            [np.interp(times, clock, column) for column in self.table.T[1:4]], axis=-1
        )
        found[(times < clock[0] - SLACK) | (times > clock[-1] + SLACK)] = np.nan
        return found


def _tilt(row: Sequence[float]) -> float:
    """Return by how much the frame of a report is neither upright nor upside down, rad."""
    return min(row[4], pi - row[4])


@final
class FrameTree:
    """A tree of frames, each with its pose in its parent over time.

    Between two reports a pose is interpolated, the yaw the shorter way round. Of a static frame
    the last report holds at all times, and no other is kept. Frames are upright or upside down,
    within `TILT`; one that tilts otherwise has no pose.

    Examples
    --------
    >>> tree = FrameTree()
    >>> tree.add("odom", "base", 0.0, (0.0, 0.0, 0.0))
    >>> tree.add("odom", "base", 1.0, (2.0, 0.0, 0.0))
    >>> tree.add("base", "lidar", 0.0, (0.1, 0.0, 0.0), static=True)
    >>> tree.motion("odom", "lidar", [0.5]).tolist()
    [[1.1, 0.0, 0.0]]
    """

    def __init__(self) -> None:
        self._edges: dict[str, _Edge] = {}
        self.notes: dict[str, int] = {}
        """What was wrong with reports -> how often."""

    def add(
        self,
        parent: str,
        child: str,
        time: float,
        pose: Iterable[float],
        static: bool = False,
        tilt: float = 0.0,
    ) -> None:
        """Take a report of a frame's pose in its parent: x, y in m, yaw in rad, at a time in s.

        A report that is not finite, is beyond `FARTHEST`, or would close a circle, is left out;
        of two parents the later one counts. `notes` says so. ``tilt`` is the angle between the
        vertical axes of the two, rad.
        """
        row = (float(time), *map(float, pose), float(tilt))
        if not np.isfinite(row).all():
            return self._note(f"a pose of {child!r} is not finite")
        if not (np.abs(row[1:]) <= FARTHEST).all():
            return self._note(f"a pose of {child!r} is beyond {FARTHEST:g}")
        if child == parent or child in self.above(parent):
            return self._note(f"{child!r} in {parent!r} closes a circle of frames")
        edge = self._edges.get(child)
        if edge is None or edge.parent != parent:
            if edge is not None:
                self._note(f"{child!r} has two parents, {edge.parent!r} and {parent!r}")
            edge = self._edges[child] = _Edge(parent, static)
        edge.static, edge.table = static, None
        if static:
            edge.rows.clear()
            edge.tilt = inf
        edge.rows.append(row)  # type: ignore[arg-type]
        edge.tilt = min(edge.tilt, _tilt(row))
        if _tilt(row) > TILT:
            self._note(f"{child!r} tilts by more than {TILT:g} rad against {parent!r}")
        return None

    @property
    def names(self) -> tuple[str, ...]:
        """All frames, sorted."""
        parents = {edge.parent for edge in self._edges.values()}
        return tuple(sorted(parents | set(self._edges)))

    def root(self, name: str) -> str:
        """Return the frame at the top of the tree that a frame belongs to."""
        return ([name, *self.above(name)])[-1]

    def motion(self, target: str, source: str, times: ArrayLike) -> Array:
        """Return the poses of one frame in another, (T, 3): x, y in m, yaw in rad.

        NaN at times for which some pose between the two was not reported.

        Parameters
        ----------
        target : frame in which the result is. source : frame whose pose is wanted.
        times : (T,), s.

        Raises
        ------
        WideberthError : no transform connects the two, or one tilts or is upside down against the
            other.
        """
        poses, mirrored = self.placement(target, source, times)
        if mirrored:
            raise WideberthError(
                f"{source!r} is upside down against {target!r}; only a LiDAR may be: let the "
                f"sender state its messages in {target!r}"
            )
        return poses

    def placement(self, target: str, source: str, times: ArrayLike) -> tuple[Array, bool]:
        """Return the poses of `motion`, and whether the one frame is upside down in the other.

        A place (u, v) of a frame that is upside down, with the pose (x, y, yaw), is at::

            (x, y) + Rot(yaw) (u, -v)

        Raises
        ------
        WideberthError : no transform connects the two, or one tilts against the other.
        """
        clock = np.asarray(times, dtype=np.float64)
        up, down = ([one, *self.above(one)] for one in (source, target))
        if up[-1] != down[-1]:
            near = nearest(source, {*self.names} - {source})
            raise WideberthError(f"no frame connects {source!r} with {target!r}{near}")
        common = next(one for one in up if one in down)
        outer, turned = self._chain(down, common, clock)
        inner, mirrored = self._chain(up, common, clock)
        back = inverted(outer)
        if turned:
            back, inner = back * MIRROR, inner * MIRROR
        return composed(back, inner), turned != mirrored

    def _chain(self, names: list[str], top: str, times: Array) -> tuple[Array, bool]:
        """Poses of the first frame in the one called ``top``, and whether it is upside down."""
        found, mirrored = np.zeros((len(times), 3)), False
        for name in names[: names.index(top)]:
            edge = self._edges[name]
            if edge.tilt > TILT:
                raise WideberthError(
                    f"{name!r} tilts by {edge.tilt:.2g} rad against {edge.parent!r}; a frame of "
                    f"the plane is upright or upside down, within {TILT:g} rad"
                )
            found = composed(edge.at(times), found * MIRROR if edge.mirrors else found)
            mirrored ^= edge.mirrors
        return found, mirrored

    def above(self, name: str) -> list[str]:
        """Return the frames above one, up to the top of its tree."""
        found = []
        while (edge := self._edges.get(name)) is not None:
            name = edge.parent
            found.append(name)
        return found

    def _note(self, text: str) -> None:
        self.notes[text] = self.notes.get(text, 0) + 1

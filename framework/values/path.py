"""A reference path: a polyline measured by its arc length."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from .arrays import FARTHEST, Array, checked, settle
from .errors import WideberthError

OPPOSITE, BESIDE = -0.5, 0.1
"""Cosine and m, see `Path.way_back`."""
SAME = 0.1
"""m, see `Path.resembles`."""


@dataclass(frozen=True, eq=False)
class Path:
    """An ordered list of points that the robot should follow.

    Attributes
    ----------
    points : (P, D), m, P >= 2, no two neighbours equal.

    Raises
    ------
    WideberthError : fewer than two points, repeated points, not finite, beyond `FARTHEST`.
    """

    points: Array

    def __init__(self, points: ArrayLike) -> None:
        points = checked(
            "path.points", points, (None, None), reason=": a row of coordinates per point"
        )
        if len(points) < 2:
            raise WideberthError(
                f"path.points holds {len(points)} point(s); a path needs at least two: "
                "give the start and the goal"
            )
        if points.shape[1] not in (2, 3):
            raise WideberthError(f"path.points has {points.shape[1]} columns; wanted 2 or 3")
        if (largest := np.abs(points).max()) > FARTHEST:
            raise WideberthError(
                f"path.points reach {largest:.3g} m from the origin; wanted at most {FARTHEST:g} m"
            )
        repeated = np.flatnonzero(np.linalg.norm(np.diff(points, axis=0), axis=1) == 0)
        if repeated.size:
            raise WideberthError(
                f"path.points[{repeated[0] + 1}] repeats the point before it; remove it"
            )
        settle(self, points=points)

    def __repr__(self) -> str:
        """Rebuild a path of a few points; say length and ends of a longer one."""
        if len(self.points) <= 8:
            return f"Path({[tuple(point) for point in self.points.tolist()]})"
        ends = " to ".join(str(tuple(self.points[i].round(3).tolist())) for i in (0, -1))
        return f"Path({len(self.points)} points, {self.length:.4g} m, from {ends})"

    @cached_property
    def arc(self) -> Array:
        """Arc length at each point, (P,), m; the first is 0."""
        steps = np.linalg.norm(np.diff(self.points, axis=0), axis=1)
        return np.concatenate([[0.0], np.cumsum(steps)])

    @cached_property
    def _pieces(self) -> tuple[Array, Array, Array]:
        """Steps from point to point, (P - 1, D), m, their lengths and their unit tangents."""
        step = np.diff(self.points, axis=0)
        return step, np.diff(self.arc), step / np.linalg.norm(step, axis=-1, keepdims=True)

    @property
    def length(self) -> float:
        """Length of the whole path, m."""
        return float(self.arc[-1])

    @property
    def goal(self) -> Array:
        """The last point, (D,), m."""
        return np.asarray(self.points[-1])

    def resembles(self, other: "Path") -> bool:
        """Whether no coordinate of its points is more than `SAME` from the other path's."""
        if self.points.shape != other.points.shape:
            return False
        return bool(np.abs(self.points - other.points).max() <= SAME)

    def at(self, arc: Array) -> Array:
        """Points at the given arc lengths (...,) -> (..., D), m; clamped to the ends."""
        arc = np.asarray(arc, dtype=np.float64)
        found = np.empty((*arc.shape, self.points.shape[1]))
        for axis, column in enumerate(self.points.T):
            found[..., axis] = np.interp(arc, self.arc, column)
        return found

    def direction(self, arc: Array) -> Array:
        """Return unit tangents at the given arc lengths (...,) -> (..., D)."""
        last = len(self.points) - 2
        index = np.minimum(np.maximum(self.arc.searchsorted(arc, side="right") - 1, 0), last)
        return np.asarray(self._pieces[2][index])

    def project(
        self, point: Array, *, start: float = 0.0, window: float = np.inf, early: float = 0.0
    ) -> float:
        """Arc length of the nearest path point within [start, start + window], m.

        ``early`` (m) prefers the first stretch whose nearest point is no more than this
        farther off than the nearest of all: at the start of a loop, its start.

        A window keeps a self-crossing path from being cut short: the controller
        searches forward from where it last was.
        """
        reach, distance = self._nearest_of_each(point, start, window)
        best = int((distance <= distance.min() + early).argmax())
        return min(max(float(reach[best]), 0.0), self.length)

    def way_back(self, point: Array, arc: float, window: float) -> float:
        """Arc length at which the path comes back over itself, m; ``arc`` if it does not.

        The first stretch within [arc, arc + window] counts that runs against the path at ``arc``
        and is no more than `BESIDE` farther from the point than the nearest one.
        """
        reach, distance = self._nearest_of_each(point, arc, window)
        against = self._pieces[2] @ self.direction(np.array(arc)) < OPPOSITE
        near = distance <= distance.min() + BESIDE
        back = np.flatnonzero(against & near)
        return float(reach[back[0]]) if back.size else arc

    def _nearest_of_each(self, point: Array, start: float, window: float) -> tuple[Array, Array]:
        """Arc length and distance of the nearest point of each piece in a window, (P - 1,), m.

        The distance of a piece outside the window is infinite.
        """
        begin, (step, length, _) = self.points[:-1], self._pieces
        along = np.einsum("sd,sd->s", point - begin, step) / length
        before = self.arc[:-1]
        low, high = np.minimum(np.maximum([[start], [start + window]] - before, 0.0), length)
        along = np.minimum(np.maximum(along, low), high)
        gap = begin + step * (along / length)[:, None] - point
        distance = np.sqrt(np.add.reduce(gap * gap, axis=1))
        reach = before + along
        distance[(reach < start - 1e-12) | (reach > start + window + 1e-12)] = np.inf
        return reach, distance

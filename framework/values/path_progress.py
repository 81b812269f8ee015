"""How far along its path a robot has come."""

from dataclasses import dataclass, replace
from math import dist
from typing import Self

import numpy as np

from .arrays import Array
from .path import Path

SHORTEST = 1e-6
"""m; a piece of a path that is shorter is none."""
EARLY = 0.5
"""m; on a new path the first stretch is taken that comes this close to the nearest point, and
between two calls the search reaches at least as far."""
GROWN, LONGER, LONGEST = 0.01, 0.25, 5.0
"""m, see `ReferenceProgress`."""
PATIENCE, CUT = 8, 6.0
"""Calls without progress after which a way back counts, and m of the path that it may cut off
where it is not known how far the robot looks ahead."""


@dataclass(frozen=True, eq=False)
class PathProgress:
    """How far along its path the robot has come.

    A path may come back over itself. What looks ahead along it meets the way back before the tip,
    where both are equally near, and the robot stands there. After `PATIENCE` calls without
    progress the robot is on the way back where that is as near as the way there: the tip is cut.

    Attributes
    ----------
    path : that it follows.
    last : arc length, m, and place (D,), m, at the last call; None before the first.
    farthest : largest arc length, m; None before it has grown.
    waited : calls since it has grown.
    begin : arc length, m, behind which the search does not go: the last way back that was taken.
    """

    path: Path
    last: tuple[float, Array] | None = None
    farthest: float | None = None
    waited: int = 0
    begin: float = 0.0

    @property
    def rest(self) -> Path:
        """The path from where the robot was at the last call on; all of it before the first."""
        if self.last is None:
            return self.path
        arc = min(self.last[0], self.path.length - min(GROWN, 0.5 * self.path.length))
        left = self.path.points[self.path.arc > arc + SHORTEST]
        return Path(np.concatenate([self.path.at(np.array([arc])), left]))

    def on(self, path: Path) -> Self:
        """Return the progress along another path: the same one where the path has only moved."""
        if path is self.path:
            return self
        return replace(self, path=path) if path.resembles(self.path) else type(self)(path)

    def advanced(self, place: Array, ahead: float | None = None) -> tuple[Self, float]:
        """Return the progress at a place, and the arc length of the nearest path point, m.

        The search reaches as far as the robot may have come since the last call, so that a
        path that crosses itself or comes back is not cut short. At first all of it is
        searched, and its earliest stretch preferred.

        Parameters
        ----------
        place : (D,), m.
        ahead : m of the path that the robot's controller looks ahead; None where that is not
            known. Then the robot has to have driven back by `EARLY` for a way back to count.
        """
        if self.last is None:
            arc = self.path.project(place, early=EARLY)
            return replace(self, last=(arc, place)), arc
        arc = self._nearest(place, *self.last)
        back = self._back(place, arc, ahead)
        if back > arc:
            return replace(self, last=(back, place), farthest=back, waited=0, begin=back), back
        before = self.last[0] if self.farthest is None else self.farthest
        if arc > before + GROWN:
            return replace(self, last=(arc, place), farthest=arc, waited=0), arc
        waited = self.waited + (self.farthest is not None)
        return replace(self, last=(arc, place), waited=waited), arc

    def _nearest(self, place: Array, before: float, where: Array) -> float:
        """Return the arc length of the nearest path point, m."""
        reach = EARLY + 2.0 * dist(place, where)
        low = max(before - reach, self.begin)
        window = before + reach + self._farther - low
        return self.path.project(place, start=low, window=max(window, 0.0))

    @property
    def _farther(self) -> float:
        """How much farther ahead the search reaches, m."""
        return 0.0

    def _back(self, place: Array, arc: float, ahead: float | None) -> float:
        """Return the arc length on the way back, m; ``arc`` where the robot is on none."""
        if self.waited < PATIENCE or self.farthest is None:
            return arc
        driven = max(self.farthest - arc, 0.0)
        if ahead is None and driven < EARLY:
            return arc
        return self.path.way_back(place, arc, (CUT if ahead is None else ahead) + 2.0 * driven)


@dataclass(frozen=True, eq=False)
class ReferenceProgress(PathProgress):
    """How far along its path a robot has come that follows a timed reference.

    One that has cut a corner, or waits beside a spike, would never be past it: its reference
    begins before the corner with each call, and the best plan is to wait for that. So the search
    reaches farther ahead by `LONGER` with each call in which the arc length has not grown by
    `GROWN`, up to `LONGEST`.
    """

    @property
    def _farther(self) -> float:
        return min(LONGER * self.waited, LONGEST)

"""How far along its path a robot has come."""

from dataclasses import dataclass
from math import dist

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


@dataclass(frozen=True, eq=False)
class PathProgress:
    """How far along its path the robot has come.

    Attributes
    ----------
    path : that it follows.
    last : arc length, m, and place (D,), m, at the last call; None before the first.
    """

    path: Path
    last: tuple[float, Array] | None = None

    @property
    def rest(self) -> Path:
        """The path from where the robot was at the last call on; all of it before the first."""
        if self.last is None or self.last[0] >= self.path.length - SHORTEST:
            return self.path
        arc = self.last[0]
        left = self.path.points[self.path.arc > arc + SHORTEST]
        return Path(np.concatenate([self.path.at(np.array([arc])), left]))

    def advanced(self, place: Array) -> tuple["PathProgress", float]:
        """Return the progress at a place, and the arc length of the nearest path point, m.

        The search reaches as far as the robot may have come since the last call, so that a
        path that crosses itself or comes back is not cut short. At first all of it is
        searched, and its earliest stretch preferred.
        """
        arc = self._nearest(place)
        return PathProgress(self.path, (arc, place)), arc

    def _nearest(self, place: Array, farther: float = 0.0) -> float:
        """Return the arc length of the nearest path point, m; the search reaches ``farther`` m."""
        if self.last is None:
            return self.path.project(place, early=EARLY)
        before, where = self.last
        reach = EARLY + 2.0 * dist(place, where)
        low = max(before - reach, 0.0)
        return self.path.project(place, start=low, window=before + reach + farther - low)


@dataclass(frozen=True, eq=False)
class ReferenceProgress(PathProgress):
    """How far along its path a robot has come that follows a timed reference.

    One that has cut a corner, or waits beside a spike, would never be past it: its reference
    begins before the corner with each call, and the best plan is to wait for that. So the search
    reaches farther ahead by `LONGER` with each call in which the arc length has not grown by
    `GROWN`, up to `LONGEST`.

    Attributes
    ----------
    waited : calls since the arc length has grown.
    """

    waited: int = 0

    def advanced(self, place: Array) -> tuple["ReferenceProgress", float]:
        """Return the progress at a place, and the arc length of the nearest path point, m."""
        arc = self._nearest(place, min(LONGER * self.waited, LONGEST))
        grown = self.last is None or arc > self.last[0] + GROWN
        waited = 0 if grown else self.waited + 1
        return ReferenceProgress(self.path, (arc, place), waited), arc

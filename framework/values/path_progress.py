"""How far along its path a robot has come."""

from dataclasses import dataclass

import numpy as np

from .arrays import Array
from .path import Path

SHORTEST = 1e-6
"""m; a piece of a path that is shorter is none."""
EARLY = 0.5
"""m; on a new path the first stretch is taken that comes this close to the nearest point, and
between two calls the search reaches at least as far."""
GROWN, LONGER, LONGEST = 0.01, 0.25, 5.0
"""m; with each call in which the arc length has not grown by the first, the search reaches farther
ahead by the second, up to the third."""


@dataclass(frozen=True, eq=False)
class PathProgress:
    """How far along its path the robot has come.

    Attributes
    ----------
    path : that it follows.
    last : arc length, m, and place (D,), m, at the last call; None before the first.
    waited : calls since the arc length has grown.
    """

    path: Path
    last: tuple[float, Array] | None = None
    waited: int = 0

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
        path that crosses itself or comes back is not cut short. For a robot that waits it reaches
        farther ahead with each call: else one that has cut a corner would never be past it, since
        its reference begins before the corner and it waits for that. At first all of it is
        searched, and its earliest stretch preferred.
        """
        if self.last is None:
            arc = self.path.project(place, early=EARLY)
            return PathProgress(self.path, (arc, place)), arc
        before, where = self.last
        reach = EARLY + 2.0 * float(np.linalg.norm(place - where))
        ahead = reach + min(LONGER * self.waited, LONGEST)
        low = max(before - reach, 0.0)
        arc = self.path.project(place, start=low, window=before + ahead - low)
        waited = 0 if arc > before + GROWN else self.waited + 1
        return PathProgress(self.path, (arc, place), waited), arc

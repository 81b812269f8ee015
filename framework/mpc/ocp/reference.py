"""What the plan tracks: positions, directions and speeds laid along the path."""

from dataclasses import dataclass

import numpy as np

from ...values.arrays import Array
from ...values.path import Path

SHORTEST = 1e-6
"""m; a piece of a path that is shorter is none."""
EARLY = 0.5
"""m; on a new path the first stretch is taken that comes this close to the nearest point, and
between two calls the search reaches at least as far."""


@dataclass(frozen=True, eq=False)
class Reference:
    """What the plan tracks, at steps 1..N.

    Attributes
    ----------
    position : (N, D), m.
    direction : (N, D), unit tangents.
    speed : (N,), m/s.
    curve : (N, C), numbers of the path that some costs need; C is 0 for the others.
    """

    position: Array
    direction: Array
    speed: Array
    curve: Array


def lay_reference(path: Path, start: float, speed: float, steps: int, dt: float) -> Reference:
    """Lay the reference along the path from arc length ``start`` at a constant speed.

    Position i is the path at start + i * speed * dt; at the end of the path it stays at the goal
    and the reference speed drops to what is left to go, so that the robot stops there. The paper
    gives "an ordered sequence of points" and a constant speed to the end; it does not say how
    the points are chosen at each call. We lay them anew from the path point nearest to the robot.
    """
    arcs = np.minimum(start + speed * dt * np.arange(steps + 1), path.length)
    begin, end = arcs[:-1], arcs[1:]
    direction = path.direction(0.5 * (end + begin))
    return Reference(path.at(end), direction, (end - begin) / dt, np.zeros((steps, 0)))


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
        if self.last is None:
            arc = self.path.project(place, early=EARLY)
        else:
            before, where = self.last
            reach = EARLY + 2.0 * float(np.linalg.norm(place - where))
            low = max(before - reach, 0.0)
            arc = self.path.project(place, start=low, window=before + reach - low)
        return PathProgress(self.path, (arc, place)), arc

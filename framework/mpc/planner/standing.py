"""How long a robot has stood, and what is nearest to one that stands before its path's end."""

from dataclasses import dataclass
from typing import final

import numpy as np

from ...tracking.stand_ins import sound
from ...values.arrays import Array
from ...values.motion import Observation
from ...values.passage import BESIDE, passable
from ...values.path import Path
from ...values.polygon import separation

BLOCKED = "blocked"
"""First word of the reason of a plan of a robot that stands before its goal."""
STANDS, STILL = 5.0, 0.15
"""s, and m that a robot has moved at most in this time, which stands."""
ARRIVED = 0.3
"""m from the last point of its path, within which a robot stands because it has arrived."""
NEAR = 3.0
"""m between the surfaces; what is farther away does not block."""


@final
@dataclass(frozen=True, eq=False)
class Standing:
    """Where and since when a robot has moved by no more than `STILL`.

    Attributes
    ----------
    since : s. place : (D,), m.
    """

    since: float
    place: Array

    def at(self, stamp: float, place: Array) -> "Standing":
        """Return where and since when it has stood, at a later time and a place, (D,), m."""
        stays = stamp >= self.since and np.linalg.norm(place - self.place) <= STILL
        return self if stays else Standing(stamp, place)

    def lasted(self, stamp: float) -> float:
        """Return for how long the robot has stood, s."""
        return stamp - self.since

    def blocked(
        self, stamp: float, path: Path, arc: float, seen: Observation, radius: float, room: float
    ) -> str:
        """Return the reason of plans of a robot that has stood for `STANDS` s before its goal.

        It states the time and the nearest obstacle, and is empty for other robots.

        Parameters
        ----------
        stamp : s. path : whose end is the goal. arc : m along it.
        seen : bodies and polygons. radius : m, of the robot.
        room : m, that it needs to either side of its middle.
        """
        lasted = self.lasted(stamp)
        if lasted < STANDS or np.linalg.norm(path.goal - self.place) <= ARRIVED:
            return ""
        gaps = []
        bodies = sound(seen, len(path.goal), here=self.place).detections
        for body in bodies:
            away = float(np.linalg.norm(body.position - self.place))
            gaps.append((away - body.radius - radius, repr(body.ident)))
        for polygon in seen.polygons:
            away = min(float(separation(self.place[None], part)[0]) for part in polygon.parts)
            gaps.append((away - radius, repr(polygon.name) if polygon.name else "a wall"))
        gap, name = min(gaps, default=(np.inf, ""))
        before = f"nearest is {name}, {gap:.2f} m away" if gap <= NEAR else "nothing is near it"
        words = f"{BLOCKED}: it has stood for {lasted:.0f} s before its goal; {before}"
        if len(path.goal) != 2:
            return words
        discs = [(body.position, body.radius) for body in bodies]
        ahead = min(arc + 2.0 * radius + NEAR, path.length)
        fits = passable(path, arc, ahead, room, discs, seen.polygons)
        return words if fits else f"{words}; {misfit(room)}"


def misfit(room: float) -> str:
    """Return the words for a robot that is too wide; ``room``, m, is half of what it needs."""
    return f"it does not fit: no way within {BESIDE:g} m of its path is {2.0 * room:.2f} m wide"

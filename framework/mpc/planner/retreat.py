"""The way back of a car that stands where its turning circle leads no further."""

from dataclasses import dataclass, replace
from math import cos, sin
from typing import final

import numpy as np

from ...control.end_of_path import LEFT, EndLimits
from ...values.motion import Pose
from ...values.path import Path
from .standing import STANDS, Standing

REACHED = 0.2
"""m from the end of its path, within which a car that stands need not back off."""
PAUSE, ASIDE = 2.0, 1.0
"""s that a car stands near the end of its path before it backs off; m that it has to go aside to
drive round what it stands before elsewhere."""
DRIVEN = 0.1
"""m before the end of the way back, where it has been driven."""


@final
@dataclass(frozen=True, eq=False)
class Retreat:
    """A straight way back, driven once.

    Attributes
    ----------
    path : from where the car stood. begun : s. ended : s; infinite while it is being driven.
    """

    path: Path
    begun: float
    ended: float = np.inf

    @property
    def driving(self) -> bool:
        """Whether it is being driven."""
        return self.ended == np.inf

    @property
    def words(self) -> str:
        """Reason of plans while the car backs off; empty at other times."""
        return f"backs off by {self.path.length:.1f} m to turn" if self.driving else ""

    def at(self, stamp: float, pose: Pose, stood: float) -> "Retreat":
        """Return the same at a later time, ended where the car is through, or stands."""
        left = self.path.length - self.path.project(np.array(pose.position, dtype=np.float64))
        stuck = min(stood, stamp - self.begun) >= STANDS
        return replace(self, ended=stamp) if left <= DRIVEN or stuck else self


def retreat(
    before: Retreat | None, limits: EndLimits, standing: Standing, stamp: float, pose: Pose,
    path: Path, arc: float,
) -> Retreat | None:  # fmt: skip
    """Return the way back of a car, begun or gone on with; None where it has driven none.

    A car that stands `PAUSE` s at the end of its path but not within `REACHED` of it, or `STANDS`
    s elsewhere, has no plan that leads on: one that does begins by driving back, and costs more
    than standing over the time that the car looks ahead.

    Parameters
    ----------
    before : the last one. limits : of the car.
    standing : where and since when it stands. stamp : s. pose : of the car.
    path : that it follows. arc : m along it.
    """
    stood = standing.lasted(stamp)
    if before is not None and before.driving:
        return before.at(stamp, pose, stood)
    near = path.length - arc <= LEFT
    place = np.array(pose.position, dtype=np.float64)
    resumed = -np.inf if before is None else before.ended
    wait = PAUSE if near else STANDS
    there = float(np.linalg.norm(path.goal - place)) <= REACHED
    if not (limits.circle and limits.reverses) or there or min(stood, stamp - resumed) < wait:
        return before
    heading = float(pose.heading)  # type: ignore[arg-type]
    way = np.array([cos(heading), sin(heading)])
    ahead, aside = 0.0, ASIDE
    if near:
        east, north = path.goal - place
        ahead, aside = way[0] * east + way[1] * north, way[0] * north - way[1] * east
    back = limits.backing(float(ahead), float(aside))
    return Retreat(Path(np.stack([place, place - back * way])), stamp)

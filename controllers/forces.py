"""What the social forces share: walls, and the way from a force to a velocity."""

from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..framework.mpc.instance.polygons import padded
from ..framework.values.arrays import Array
from ..framework.values.motion import Observation
from ..framework.values.polygon import MOST_CORNERS, Polygon, separation
from .reactive import Steered
from .steering import top_speed, velocity_of

LARGEST = 50.0
"""Exponents are held below this: the speed is at its limit long before, and exp stays finite."""


@dataclass(eq=False)
class ForceModel(Steered):
    """A walker who is pushed: v <- v + period a, shortened to the highest speed.

    v is the velocity that was wanted last, at first that of the robot. A robot that can do what it
    is told moves exactly so; another one is `steer` ed along, and what it could not do does not
    act on the forces.

    A subclass gives `acceleration` and ``haste``, the highest speed over ``reference_speed``.
    """

    haste: float = 1.0

    def forget_more(self) -> None:
        """Forget the velocity."""
        self._velocity: Array | None = None

    def velocity(self, observation: Observation, place: Array) -> Array:
        """Velocity one period later."""
        if self._velocity is None:
            known = velocity_of(self.robot, observation.state)
            self._velocity = np.zeros(2) if known is None else known
        wanted = self._guide.velocity(place, self.look_ahead, self.reference_speed)
        force = self.acceleration(observation, place, self._velocity, wanted)
        pushed = self._velocity + self.period * force
        fastest = min(self.haste * self.reference_speed, top_speed(self.robot, observation.state))
        speed = float(np.hypot(*pushed))
        self._velocity = pushed * (fastest / speed if speed > fastest else 1.0)
        return self._velocity

    @abstractmethod
    def acceleration(
        self, observation: Observation, place: Array, velocity: Array, wanted: Array
    ) -> Array:
        """Sum of the forces on a unit of mass, (2,), m/s^2.

        Parameters
        ----------
        observation : what is seen now; neighbours have been taken note of.
        place, velocity : (2,), m and m/s, of the walker.
        wanted : (2,), m/s, towards the goal.
        """


def away_from_walls(place: Array, polygons: Sequence[Polygon]) -> tuple[Array, Array]:
    """Distance of a point from each polygon, (W,), m, and the unit vectors away from it, (W, 2).

    From its nearest point; negative inside. (Inside a polygon that is not convex they are those
    of the convex part that the point is in.)
    """
    distance, away = np.zeros(len(polygons)), np.zeros((len(polygons), 2))
    for i, polygon in enumerate(polygons):
        parts = np.stack([padded(part, MOST_CORNERS) for part in polygon.parts])
        gaps, normals = separation(place[None], parts)
        nearest = int(gaps.argmin())
        distance[i], away[i] = gaps[nearest], normals[nearest]
    return distance, away


def exponential(values: Array) -> Array:
    """Exp of exponents that may be absurd, see `LARGEST`."""
    return np.asarray(np.exp(np.minimum(values, LARGEST)))

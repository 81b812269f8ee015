"""The circular social force: neighbours push by their distance alone."""

from dataclasses import dataclass
from typing import ClassVar, final

import numpy as np

from ..framework.values.arrays import Array
from ..framework.values.motion import Command, Observation
from ..people.models import CircularForce, circular_force, exponential
from ..people.walls import away_from_walls
from .forces import pushed
from .reactive import Reactive
from .steering import steer


@final
@dataclass(eq=False)
class SocialForceController(Reactive):
    """Helbing's force in its circular form, as CrowdSimPlus has it.

    ::

        a = K (v* - v) + sum_j A exp((r + r_j + GAP - d_j) / B) n_j
                       + sum_w A_w exp((r + GAP - d_w) / B_w) n_w

    v* is the wanted velocity, n_j points from neighbour j to the robot, d_j is the distance of the
    centres, d_w that from polygon w and n_w away from its nearest point. The speed is at most
    ``reference_speed``. Velocities of others play no part, so that the force comes late and does
    not know who is going away; contacts are not ruled out.

    CrowdSimPlus heads for the goal at full speed until it is there; here the wanted velocity
    falls in the last second, and polygons with their nearest point stand for its wall segments.

    Parameters
    ----------
    robot, period, reference_speed, look_ahead : as in `Reactive`.
    stiffness : K, 1/s.
    strength, reach : A, m/s^2, and B, m, of neighbours.
    wall_strength, wall_reach : A_w and B_w, of polygons.

    Raises
    ------
    WideberthError : a number out of range, or a robot that moves in space.

    References
    ----------
    D. Helbing and P. Molnar, Social force model for pedestrian dynamics, Phys. Rev. E 51 (1995);
    the circular form and its numbers from the code of S. Samavi et al., SICNav (2024).
    """

    zero_allowed: ClassVar[frozenset[str]] = frozenset({"strength", "wall_strength"})
    reference: ClassVar[str] = "helbing1995social,samavi2024sicnav"
    GAP: ClassVar[float] = CircularForce.GAP
    """m, added to the radii, as there."""

    stiffness: float = CircularForce.stiffness
    strength: float = CircularForce.strength
    reach: float = CircularForce.reach
    wall_strength: float = CircularForce.wall_strength
    wall_reach: float = CircularForce.wall_reach

    def decide(self, observation: Observation, place: Array) -> Command:
        """Steer along the velocity that the forces leave after one period."""
        wanted = self._guide.velocity(place, self.look_ahead, self.reference_speed)
        self._velocity = pushed(
            self.robot,
            observation.state,
            self._velocity,
            lambda velocity: self.acceleration(observation, place, velocity, wanted),
            self.period,
            self.reference_speed,
        )
        return steer(self.robot, observation.state, self._velocity)

    def acceleration(
        self, observation: Observation, place: Array, velocity: Array, wanted: Array
    ) -> Array:
        """Sum of the forces on a unit of mass, (2,), m/s^2; arguments (2,), m and m/s."""
        _, others, _, radii = self._neighbours.now()
        touch = self.robot.radius + radii + self.GAP
        push = circular_force(place - others, touch, self.strength, self.reach)
        room, from_wall = away_from_walls(place, observation.polygons)
        wall = self.wall_strength * exponential(
            (self.robot.radius + self.GAP - room) / self.wall_reach
        )
        total = self.stiffness * (wanted - velocity) + push + wall @ from_wall
        return np.asarray(total)

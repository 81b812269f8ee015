"""The social force measured on people: it depends on how the neighbours move."""

from dataclasses import dataclass
from typing import ClassVar, final

import numpy as np

from ..framework.values.arrays import Array
from ..framework.values.motion import Command, Observation
from ..metrics.social_force import interaction_force
from ..people.models import exponential
from ..people.walls import away_from_walls
from .forces import pushed
from .reactive import Reactive
from .steering import steer


@final
@dataclass(eq=False)
class MoussaidForce(Reactive):
    """Moussaïd's force with the numbers of PySocialForce.

    ::

        a = (v* - v) / tau + A sum_j f_j + A_w sum_w exp(-(d_w - r) / SIGMA) n_w
        D = lambda (v - v_j) + e,    t = D / |D|,    B = gamma |D|
        f_j = -exp(-d / B) (exp(-(n' B theta)^2) t + sign(theta) exp(-(n B theta)^2) left(t))

    with e the unit vector from the robot to neighbour j, d their distance and theta the angle
    from t to e: the first term slows down, the second one turns to the side that the neighbour
    is not on. Exactly head-on it has no side. A polygon w pushes where d_w - r is below
    `WALL_RANGE` + r; n_w points away from its nearest point. The speed is at most ``haste`` times
    ``reference_speed``.

    The distance is that of the centres: radii of others play no part, and people of 0.3 m were
    measured. It does not promise to avoid contacts.

    PySocialForce drives towards 1.3 times a walker's first speed, its limit too; here v* has
    ``reference_speed`` and only the limit is 1.3 times that. It does not wrap theta, which
    turns the force round where the two angles lie on both sides of pi; here it is in [-pi, pi).
    It sums over points every 0.1 m along a wall; here one nearest point stands for a polygon.
    Its groups are left out.

    Parameters
    ----------
    robot, period, reference_speed, look_ahead : as in `Reactive`.
    haste : highest speed over ``reference_speed``.
    relaxation : tau, s.
    strength : A, m/s^2.
    velocity_weight : lambda, s/m.
    range_factor : gamma, m.
    turning, slowing : n and n', 1/(m rad): how fast the two terms fall with the angle.
    wall_strength : A_w, m/s^2.

    Raises
    ------
    WideberthError : a number out of range, or a robot that moves in space.

    References
    ----------
    M. Moussaïd et al., Experimental study of the behavioural mechanisms underlying
    self-organization in human crowds, Proc. R. Soc. B 276 (2009); numbers from the code of Y. Gao,
    PySocialForce.
    """

    zero_allowed: ClassVar[frozenset[str]] = frozenset(
        {"strength", "velocity_weight", "turning", "slowing", "wall_strength"}
    )
    reference: ClassVar[str] = "moussaid2009experimental"
    SIGMA: ClassVar[float] = 0.2
    """m, in which a wall's force falls to 1/e."""
    WALL_RANGE: ClassVar[float] = 0.2
    """m, beside the radius: the reach of a wall, from the robot's surface."""

    haste: float = 1.3
    relaxation: float = 0.5
    strength: float = 5.1
    velocity_weight: float = 2.0
    range_factor: float = 0.35
    turning: float = 2.0
    slowing: float = 3.0
    wall_strength: float = 10.0

    def decide(self, observation: Observation, place: Array) -> Command:
        """Steer along the velocity that the forces leave after one period."""
        wanted = self._guide.velocity(place, self.look_ahead, self.reference_speed)
        self._velocity = pushed(
            self.robot,
            observation.state,
            self._velocity,
            lambda velocity: self.acceleration(observation, place, velocity, wanted),
            self.period,
            self.haste * self.reference_speed,
        )
        return steer(self.robot, observation.state, self._velocity)

    def acceleration(
        self, observation: Observation, place: Array, velocity: Array, wanted: Array
    ) -> Array:
        """Sum of the forces on a unit of mass, (2,), m/s^2; arguments (2,), m and m/s."""
        pull = (wanted - velocity) / self.relaxation
        room, away = away_from_walls(place, observation.polygons)
        gap = room - self.robot.radius
        wall = np.where(
            gap < self.WALL_RANGE + self.robot.radius, exponential(-gap / self.SIGMA), 0.0
        )
        _, others, moving, _ = self._neighbours.now()
        pushes = interaction_force(
            others - place,
            velocity - moving,
            self.velocity_weight,
            self.range_factor,
            self.turning,
            self.slowing,
        )
        total = pull + self.strength * pushes.sum(axis=0) + self.wall_strength * wall @ away
        return np.asarray(total)

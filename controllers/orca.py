"""ORCA: each of two takes half of the smallest velocity change that avoids a collision."""

from dataclasses import dataclass
from math import hypot
from typing import Any, ClassVar, final

import numpy as np

from ..framework.plugins.extras import from_extra
from ..framework.values.arrays import Array, whole
from ..framework.values.motion import Command, Observation
from ..people.models import Reciprocal
from .reactive import Reactive
from .steering import steer, top_speed, velocity_of


def _pyrvo() -> Any:
    """Return the library RVO2 for Python."""
    return from_extra("pyrvo", "arenas", "orca needs the library pyrvo")


@final
@dataclass(eq=False)
class Orca(Reactive):
    """Optimal reciprocal collision avoidance, by the RVO2 library (``pyrvo``).

    Of neighbour j only position, velocity and radius are known. The velocity obstacle over tau::

        VO = {v : |p_j - p + t (v_j - v)| < r + r_j  for some t in [0, tau]}

    is left by the smallest change u of the relative velocity, of which each of the two takes half:

        (v' - (v + u / 2)) . n >= 0

    with n the outward normal there. Of the velocities v' with |v'| <= v_max that keep every
    such half-plane, the nearest to the wanted one is taken; where there is none, the one that
    enters them least. A neighbour that makes no way (an invisible robot's crowd) leaves its half
    undone: ORCA then collides.

    As CrowdNav runs it: each agent has a simulator of its own, made anew for each decision, in
    which the others want to stand; the wanted velocity is the way to the goal, at most
    ``reference_speed``. The library counts in single precision. A robot with heading follows
    the velocity by `steering.steer`, which ORCA does not know of: what it promises holds for
    robots that take any velocity at once. Forecasts of people have the same rule in double
    precision, `wideberth.people.models.Reciprocal`. Walls are obstacles on their
    outline, counter-clockwise, which do not give way.

    Parameters
    ----------
    robot, period, reference_speed, look_ahead : see `Reactive`; the goal itself is headed
        for by default.
    neighbour_distance : m within which others count.
    most_neighbours : how many of them, nearest first.
    time_horizon : tau, s, of others.
    obstacle_horizon : s, of walls.
    safety_space : m, added to every radius, own and others'. CrowdNav has 0.01, and more as it
        is set.

    Raises
    ------
    WideberthError : as `Reactive`; the library is not installed.
    """

    reference: ClassVar[str] = "vandenberg2011reciprocal,chen2019crowd"
    zero_allowed: ClassVar[frozenset[str]] = frozenset({"safety_space"})

    period: float = 0.25
    reference_speed: float = 1.0
    look_ahead: float = np.inf
    neighbour_distance: float = Reciprocal.neighbour_distance
    most_neighbours: int = Reciprocal.most_neighbours
    time_horizon: float = Reciprocal.time_horizon
    obstacle_horizon: float = Reciprocal.obstacle_horizon
    safety_space: float = Reciprocal.safety_space

    def __post_init__(self) -> None:
        whole("orca.most_neighbours", self.most_neighbours)
        _pyrvo()
        super().__post_init__()

    def decide(self, observation: Observation, place: Array) -> Command:
        """Return the best velocity outside all half-planes."""
        if self._velocity is None:  # the first decision after `reset`
            self._limit = top_speed(self.robot, observation.state)
            self._velocity = np.zeros(2)
        now = velocity_of(self.robot, observation.state)
        own = self._velocity if now is None else now
        wanted = self._guide.velocity(place, self.look_ahead, self.reference_speed)
        best = self._solve(observation, place, own, wanted)
        command = steer(self.robot, observation.state, best)
        if now is None:  # a robot without inertia moves as commanded
            self._velocity = np.array(command.linear)
        return command

    def _solve(self, observation: Observation, place: Array, own: Array, wanted: Array) -> Array:
        """Ask the library, (2,), m/s."""
        _, places, velocities, radii = self._neighbours.now()
        horizons = self.time_horizon, self.obstacle_horizon
        world = _pyrvo().RVOSimulator(
            self.period, self.neighbour_distance, self.most_neighbours, *horizons, 0.0, self._limit
        )
        sight = self.neighbour_distance, self.most_neighbours, *horizons
        radius = self.robot.radius + self.safety_space
        world.add_agent(tuple(place), *sight, radius, self._limit, tuple(own))
        blind = self.neighbour_distance, 0, *horizons  # what the others would do is not asked
        for position, velocity, size in zip(
            places.tolist(), velocities.tolist(), radii.tolist(), strict=True
        ):
            around = size + self.safety_space
            speed = hypot(*velocity)
            world.add_agent(tuple(position), *blind, around, speed, tuple(velocity))
        for polygon in observation.polygons:
            world.add_obstacle(list(polygon.vertices))
        if observation.polygons:
            world.process_obstacles()
        world.set_agent_pref_velocity(0, tuple(wanted))
        world.do_step()
        found = world.get_agent_velocity(0)
        return np.array([found.x, found.y])

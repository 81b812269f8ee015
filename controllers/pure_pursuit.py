"""Pure pursuit that stops: along the path, and no further while something is in the way."""

from dataclasses import dataclass
from typing import ClassVar, final

import numpy as np

from ..framework.control.command_limits import attained, turns_on_the_spot
from ..framework.numerics.geometry import wrapped
from ..framework.values.arrays import Array
from ..framework.values.motion import Command, Observation, Twist
from .arcs import free_way
from .reactive import Reactive
from .steering import SLOWING, limited, steer, yaw_rate

STOP_HORIZON = 1.0
"""s of driving for which the arc must be free."""
TIGHT = 0.9
"""m, radius of a curve from which on the speed falls."""
LEAST_SHARE = 0.25
"""Share of the speed that tight curves leave."""
TURN_FROM = 0.785
"""rad between heading and the point ahead from which a robot turns on the spot."""


@final
@dataclass(eq=False)
class PurePursuit(Reactive):
    """Regulated pure pursuit of the path, which stops rather than touch what is on its arc.

    With (x, y) the point ahead on the path in the robot's frame, the arc through it has

        kappa = 2 y / (x^2 + y^2),    omega = v kappa.

    v is min(v_ref, way to the goal / 1 s), times 1 / (`TIGHT` |kappa|) in tighter curves (but
    `LEAST_SHARE` at least), and what the robot's yaw rate allows. Where the point ahead is more
    than `TURN_FROM` off its heading, a robot that can turns on the spot. Where the arc of the
    next `STOP_HORIZON` seconds at that speed touches an obstacle or a polygon, the command is
    to stand; the robot goes on once the arc is free. Nothing is driven round.

    Obstacles are taken as standing where they are seen. No standing obstacle is touched, provided
    that `STOP_HORIZON` is longer than v / (2 a) and a period and that the robot stays on its
    arc as it brakes; who moves can run into the robot.

    Of regulated pure pursuit the slowing near obstacles (by the cost of a costmap) is left out.
    A robot without heading goes straight to the point ahead.

    Parameters
    ----------
    robot, period, reference_speed, look_ahead : as in `Reactive`.
    margin : m, added to the radius of the robot.

    Raises
    ------
    WideberthError : a number that is not above 0, or a robot that moves in space.

    References
    ----------
    R. C. Coulter, Implementation of the pure pursuit path tracking algorithm (1992); S. Macenski,
    S. Singh, F. Martin and J. Gines, Regulated pure pursuit for robot path tracking, Autonomous
    Robots 47 (2023).
    """

    zero_allowed: ClassVar[frozenset[str]] = frozenset({"margin"})
    reference: ClassVar[str] = "coulter1992implementation,macenski2023regulated"

    margin: float = 0.1

    def decide(self, observation: Observation, place: Array) -> Command:
        """Follow the arc, turn, or stand."""
        found = self._guide.ahead(place, self.look_ahead)
        assert found is not None  # seen to by `command`
        carrot, way = found
        state, apart = observation.state, carrot - place
        heading = self.robot.pose(tuple(state)).heading
        fastest = min(self.reference_speed, way / SLOWING)
        distance = float(np.hypot(*apart))
        if not distance:
            return Command((0.0, 0.0))
        if heading is None:
            straight = fastest / distance * apart
            if self._blocked(observation, place, apart / distance, 0.0, fastest):
                return Command((0.0, 0.0))
            return steer(self.robot, state, straight)
        error = wrapped(float(np.arctan2(apart[1], apart[0])) - float(heading))
        if abs(error) > TURN_FROM and turns_on_the_spot(self.robot, state):
            turning = yaw_rate(self.robot, state, error)
            return limited(self.robot, state, Twist((0.0, 0.0), turning))
        # 2 y / (x^2 + y^2); a car turns towards what is behind it as towards what is beside it.
        curvature = 2.0 * float(np.sin(np.clip(error, -np.pi / 2, np.pi / 2))) / distance
        twist = self.regulated(state, fastest, curvature)
        along = np.array([np.cos(heading), np.sin(heading)])
        speed, rate = float(twist.linear[0]), float(twist.angular)
        if self._blocked(observation, place, along, rate / speed if speed else 0.0, speed):
            return Command((0.0, 0.0))
        return limited(self.robot, state, twist)

    def regulated(self, state: Array, fastest: float, curvature: float) -> Twist:
        """Twist on an arc, as fast as the curve and the robot's yaw rate allow."""
        share = min(1.0, 1.0 / (TIGHT * abs(curvature))) if curvature else 1.0
        speed = fastest * max(share, LEAST_SHARE)
        wanted = Twist((speed, 0.0), speed * curvature)
        reached = attained(self.robot, state, [wanted])[0]
        if abs(reached[2]) < abs(wanted.angular):
            speed *= float(abs(reached[2]) / abs(wanted.angular))
        return Twist((speed, 0.0), speed * curvature)

    def _blocked(
        self, observation: Observation, place: Array, along: Array, curvature: float, speed: float
    ) -> bool:
        """Whether the arc of the next seconds touches anything."""
        _, others, _, radii = self._neighbours.now()
        free = free_way(
            place,
            along[None],
            np.array([curvature]),
            self.robot.radius + self.margin,
            (others, radii),
            observation.polygons,
        )
        return bool(free[0] < speed * STOP_HORIZON)

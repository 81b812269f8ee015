"""Driving straight to the goal without avoiding anything."""

from dataclasses import dataclass
from typing import ClassVar, final

from ..framework.values.arrays import Array
from ..framework.values.motion import Command, Observation
from .reactive import Reactive
from .steering import steer


@final
@dataclass(eq=False)
class ConstantVelocityController(Reactive):
    """Drives to the goal at its speed and ignores obstacles and polygons.

    v* = min(v_ref, way to the goal / 1 s) towards the goal, straight there by default (with a
    finite ``look_ahead``, along the path). The walker of a crowd who never gives way, and the
    row of a comparison that says how many encounters would have been collisions.

    Parameters
    ----------
    robot, period, reference_speed, look_ahead : as in `Reactive`.

    Raises
    ------
    WideberthError : a number that is not above 0, or a robot that moves in space.
    """

    look_ahead: float = float("inf")

    reference: ClassVar[str] = ""

    def decide(self, observation: Observation, place: Array) -> Command:
        """Steer along the velocity towards the goal."""
        wanted = self._guide.velocity(place, self.look_ahead, self.reference_speed)
        return steer(self.robot, observation.state, wanted)

"""Straight to the goal, whoever is in the way."""

from dataclasses import dataclass
from typing import ClassVar, final

from ..framework.values.arrays import Array
from ..framework.values.motion import Observation
from .reactive import Steered


@final
@dataclass(eq=False)
class ConstantVelocity(Steered):
    """Goes to the goal at its speed and looks neither at obstacles nor at polygons.

    v* = min(v_ref, way to the goal / 1 s) towards the goal, straight there by default (with a
    finite ``look_ahead``, along the path). The walker of a crowd who gives way to nobody, and the
    row of a comparison that says how many encounters would have been collisions.

    Parameters
    ----------
    robot, period, reference_speed, look_ahead, forget, turn_gain : as in `Steered`.

    Raises
    ------
    WideberthError : a number that is not above 0, or a robot that moves in space.
    """

    look_ahead: float = float("inf")

    reference: ClassVar[str] = ""

    def velocity(self, observation: Observation, place: Array) -> Array:
        """Velocity towards the goal."""
        return self._guide.velocity(place, self.look_ahead, self.reference_speed)

"""Worlds in which robots are moved by a formula, seen by the same sensors."""

from typing import final

from .world import PhysicsWorld


@final
class KinematicWorld(PhysicsWorld):
    """The same bodies and sensors, without wheels that slip.

    Each robot moves with the forward speed and the yaw rate of its command, at once and
    exactly; its wheels turn as if they did not slip. Nothing stops it at a wall, and contacts are
    not noted.
    """

    def _move(self, duration: float) -> None:
        for robot in self._robots.values():
            robot.carry(duration)


@final
class SlippingWorld(PhysicsWorld):
    """The same bodies, sensors and yaw-rate loop, on wheels that slip as `SlipModel` says.

    That is the physics without the jitter of the contacts. Nothing stops a robot at a wall, and
    contacts are not noted. A body without a fitted model is refused by the first `advance`.
    """

    def _move(self, duration: float) -> None:
        for robot in self._robots.values():
            robot.slide(duration)

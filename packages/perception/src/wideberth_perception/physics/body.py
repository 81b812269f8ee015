"""The mechanics of a four-wheel skid-steered robot."""

from dataclasses import dataclass, fields
from math import hypot
from typing import Literal, TypeVar, final

from wideberth.framework.values.arrays import Array, positive
from wideberth.framework.values.errors import WideberthError

HULL_BOTTOM, HULL_TOP = 0.12, 0.52
"""m above the ground: between these a LiDAR of another robot sees the hull."""
Number = TypeVar("Number", float, Array)
HULLS = ("cylinder", "box")


@final
@dataclass(frozen=True)
class SkidSteerBody:
    """A box on four driven wheels, the two of a side at one speed; it turns by skidding.

    The default weighs 17 kg; `LARGE` has the radius of the paper's robots, 0.75 m.

    The wheels follow their speeds through a proportional servo, torque = ``servo_gain`` (wanted
    - measured speed). A body that turns drags its wheels sideways, which takes up to friction
    x load x wheel radius per wheel. A soft servo gives way by torque / ``servo_gain``, and a
    wheel without ``armature`` creeps; either makes the robot turn at a fraction of what it is
    commanded. The defaults avoid both.

    Parameters
    ----------
    mass : kg; 85 % of it in the box, the rest in the wheels.
    wheel_radius, wheel_half_width : m.
    track : m, between the left and the right wheels.
    wheel_base : m, between the front and the rear axle.
    half_length, half_width : m, of the box.
    armature : kg m^2, inertia of a motor as it appears at its wheel.
    servo_gain : N m s/rad.
    torque_limit : N m, of a wheel.
    yaw_gain : yaw rate that the robot reaches, over that of a differential drive with the same
        wheel speeds. The wheels are driven faster by its inverse.
    hull : what others touch and see: "cylinder", the disc around the box, or "box".

    Raises
    ------
    WideberthError : a number that is not above 0, an unknown hull.
    """

    mass: float = 17.0
    wheel_radius: float = 0.10
    wheel_half_width: float = 0.04
    track: float = 0.44
    wheel_base: float = 0.40
    half_length: float = 0.25
    half_width: float = 0.215
    armature: float = 0.2
    servo_gain: float = 100.0
    torque_limit: float = 20.0
    yaw_gain: float = 0.54
    hull: Literal["cylinder", "box"] = "cylinder"

    def __post_init__(self) -> None:
        for entry in fields(self):
            if entry.name != "hull":
                zero = entry.name == "armature"
                positive(f"skid_steer_body.{entry.name}", getattr(self, entry.name), zero=zero)
        if self.hull not in HULLS:
            raise WideberthError(
                f"skid_steer_body.hull is {self.hull!r}; wanted one of {', '.join(HULLS)}"
            )

    @property
    def radius(self) -> float:
        """Radius of the disc around the box, m."""
        return hypot(self.half_length, self.half_width)

    @property
    def theoretical_yaw_gain(self) -> float:
        """Yaw gain of wheels that keep their speed, B^2 / (B^2 + L^2), B the track, L the base.

        On the spot a right wheel with rim speed s slips by s - omega B / 2 along the ground and
        by omega L / 2 across it. Friction has the direction of the slip; with equal loads its
        moment is nought where (B / 2) (s - omega B / 2) = (L / 2) (omega L / 2).
        """
        return self.track**2 / (self.track**2 + self.wheel_base**2)

    def rim_speeds(self, forward: float, yaw_rate: Number) -> tuple[Number, Number]:
        """Return the speeds of the left and right rims that give this motion, m/s.

        Parameters
        ----------
        forward : m/s.
        yaw_rate : rad/s.
        """
        aside = 0.5 * self.track * yaw_rate / self.yaw_gain
        return forward - aside, forward + aside


LARGE = SkidSteerBody(
    mass=80.0, wheel_radius=0.165, wheel_half_width=0.06, track=0.90, wheel_base=0.70,
    half_length=0.60, half_width=0.45, armature=1.0, servo_gain=1000.0, torque_limit=150.0,
    yaw_gain=0.60,
)  # fmt: skip
"""80 kg and a radius of 0.75 m, as the paper's robots have."""

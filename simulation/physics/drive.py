"""The controller of a robot's wheels: from a velocity to the speeds of the wheels."""

from math import isfinite
from typing import final

from ...framework.values.motion import Twist
from .body import SkidSteerBody

PROPORTIONAL, INTEGRAL, MOST = 0.5, 1.0, 0.3
"""Gains of the yaw-rate loop, 1 and 1/s, and the largest |integral|, rad/s."""


@final
class WheelDrive:
    """Turns a wanted velocity into wheel speeds, with a loop on the yaw rate.

    With e = omega - (gyroscope - its bias) the wheels are driven as for the yaw rate

        omega_c = omega + 0.5 e + I,   dI/dt = e,   |I| <= 0.3 rad/s.

    The loop takes away what the constant ``body.yaw_gain`` leaves. It needs a gyroscope and rests
    without one. For the velocity 0 the wheels stand and the integral starts anew.

    Parameters
    ----------
    body : of the robot.
    """

    def __init__(self, body: SkidSteerBody) -> None:
        self._body = body
        self._integral = 0.0
        self.wanted: tuple[float, float] = (0.0, 0.0)
        """Forward speed, m/s, and yaw rate, rad/s, of the last command."""
        self._bias = 0.0
        self.flaw: str = ""
        """Why the last command cannot be driven; "" for one that can."""

    def command(self, twist: Twist, gyro_bias: float) -> None:
        """Take a velocity; one that is not finite stops the robot and sets `flaw`."""
        wanted = float(twist.linear[0]), float(twist.angular)
        good = isfinite(wanted[0]) and isfinite(wanted[1]) and isfinite(gyro_bias)
        self.flaw = "" if good else f"the command {wanted}, gyro bias {gyro_bias}, is not finite"
        self.wanted = wanted if good else (0.0, 0.0)
        self._bias = gyro_bias if good else 0.0

    def wheel_speeds(self, gyro: float | None, duration: float) -> tuple[float, float]:
        """Return the speeds of the left and right wheels, rad/s.

        Parameters
        ----------
        gyro : newest reading, rad/s; None without a gyroscope.
        duration : s, since the last call.
        """
        forward, turn = self.wanted
        if forward == 0.0 and turn == 0.0:
            self._integral = 0.0
            return 0.0, 0.0
        if gyro is not None:
            error = turn - (gyro - self._bias)
            self._integral += INTEGRAL * error * duration
            self._integral = min(max(self._integral, -MOST), MOST)
            turn += PROPORTIONAL * error + self._integral
        left, right = self._body.rim_speeds(forward, turn)
        return left / self._body.wheel_radius, right / self._body.wheel_radius

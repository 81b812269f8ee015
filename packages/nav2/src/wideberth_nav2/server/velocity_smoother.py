"""What stands between Nav2's controller and the wheels: bounds on velocity and acceleration."""

from collections import deque
from dataclasses import dataclass
from typing import Literal, final

import numpy as np

from wideberth.framework.values.arrays import Array
from wideberth.framework.values.errors import WideberthError

from ..parameters import NonNegative, Positive, Triple, check_parameters

Velocity = Triple
"""vx, vy, m/s, and yaw rate, rad/s."""

_ZERO: Velocity = (0.0, 0.0, 0.0)
LATEST = 9.0e9
"""s, before or after the clock's zero: what 64 bits hold of nanoseconds, nearly."""


@final
@dataclass(eq=False)
class Nav2VelocitySmoother:
    """Nav2's velocity smoother, called at a fixed rate of its own.

    Each axis moves from its current velocity c towards the command u by

        c + clip(eta (u - c), -b, b),    b = max_accel / frequency    where |u| >= |c| and u c >= 0
                                         b = -max_decel / frequency   otherwise.

    eta is 1; with `scale_velocities` it is common to all axes, such that the direction is kept.
    Without commands for longer than `velocity_timeout` the target is to stand.

    Parameters
    ----------
    smoothing_frequency : Hz.
    feedback : "OPEN_LOOP": c is the last output; "CLOSED_LOOP": c is measured.
    scale_velocities : slow all axes alike.
    max_velocity, min_velocity : of vx, vy, m/s, and yaw rate, rad/s.
    max_accel, max_decel : m/s^2 and rad/s^2; of the latter none is above zero.
    deadband_velocity : outputs below it become 0; the smoother itself goes on with them.
    velocity_timeout : s.
    odom_duration : s, over which measured speeds are averaged.

    Raises
    ------
    WideberthError : a parameter of the wrong sign, length or name.
    """

    smoothing_frequency: Positive = 20.0
    feedback: Literal["OPEN_LOOP", "CLOSED_LOOP"] = "OPEN_LOOP"
    scale_velocities: bool = False
    max_velocity: Velocity = (0.5, 0.0, 2.5)
    min_velocity: Velocity = (-0.5, 0.0, -2.5)
    max_accel: Velocity = (2.5, 0.0, 3.2)
    max_decel: Velocity = (-2.5, 0.0, -3.2)
    deadband_velocity: Velocity = _ZERO
    velocity_timeout: NonNegative = 1.0
    odom_duration: NonNegative = 0.1

    def __post_init__(self) -> None:
        check_parameters(self, "velocity_smoother")
        for i, axis in enumerate(("vx", "vy", "yaw rate")):
            if self.min_velocity[i] > self.max_velocity[i]:
                raise WideberthError(f"velocity_smoother: the least {axis} exceeds the largest")
            if self.max_accel[i] < 0.0 or self.max_decel[i] > 0.0:
                raise WideberthError(
                    f"velocity_smoother: of {axis} max_accel is {self.max_accel[i]:g} and "
                    f"max_decel {self.max_decel[i]:g}; wanted one of at least 0, one of at most 0"
                )
        self.reset()

    def reset(self) -> None:
        """Forget all commands and measurements."""
        self._command: Velocity | None = None
        self._arrival = 0
        self._last, self._stopped = _ZERO, True
        self._measured: deque[tuple[int, Velocity]] = deque()

    def take(self, command: Velocity, time: float) -> None:
        """Take a command that was stamped at ``time``, s."""
        self._command, self._arrival = command, _nanoseconds(time)

    def measure(self, velocity: Velocity, time: float) -> None:
        """Take a measured velocity; a closed loop needs them."""
        now = _nanoseconds(time)
        self._measured.append((now, velocity))
        while now - self._measured[0][0] > _nanoseconds(self.odom_duration):
            self._measured.popleft()

    def output(self, time: float) -> Velocity | None:
        """Return the velocity to send at ``time``, s; None where nothing is to be sent."""
        if self._command is None:
            return None
        if _nanoseconds(time) - self._arrival > _nanoseconds(self.velocity_timeout):
            if self._last == _ZERO or self._stopped:
                self._stopped = True
                return None
            self._command = _ZERO
        self._stopped = False
        now = self._current()
        wanted = np.clip(self._command, self.min_velocity, self.max_velocity)
        faster = (np.abs(wanted) >= np.abs(now)) & (now * wanted >= 0.0)
        rates = np.where(faster, self.max_accel, -np.array(self.max_decel))
        most = rates / self.smoothing_frequency
        change = wanted - now
        share = self._share(np.abs(change), most) if self.scale_velocities else 1.0
        out = now + np.clip(share * change, -most, most)
        self._last = _as_velocity(out)
        return _as_velocity(np.where(np.abs(out) < self.deadband_velocity, 0.0, out))

    def _current(self) -> Array:
        """Velocity from which the axes move on, (3,)."""
        if self.feedback == "OPEN_LOOP" or not self._measured:
            return np.array(self._last)
        count = len(self._measured)
        return np.array([
            sum(velocity[i] for _, velocity in self._measured) / count for i in range(3)
        ])  # fmt: skip

    @staticmethod
    def _share(changes: Array, most: Array) -> float:
        """Share of the changes (3,) that all axes can make, with the largest ones of a period."""
        slowed = (changes > most) & (most > 0.0)
        return float((most[slowed] / changes[slowed]).min(initial=1.0))


def _as_velocity(axes: Array) -> Velocity:
    return float(axes[0]), float(axes[1]), float(axes[2])


def _nanoseconds(time: float) -> int:
    """Turn seconds into the whole numbers that ROS compares.

    Raises
    ------
    WideberthError : a time that 64 bits do not hold.
    """
    if not abs(time) <= LATEST:
        raise WideberthError(
            f"the time is {time:g} s; Nav2 counts nanoseconds in 64 bits, which hold {LATEST:g} s"
        )
    return round(time * 1e9)

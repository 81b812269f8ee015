"""What stands between Nav2's controller and the wheels: bounds on velocity and acceleration."""

from collections import deque
from dataclasses import dataclass
from typing import Literal, final

from ...framework.values.errors import WideberthError
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
        wanted = [
            min(max(u, low), high)
            for u, low, high in zip(
                self._command, self.min_velocity, self.max_velocity, strict=True
            )
        ]
        bounds = [self._bound(i, now[i], wanted[i]) for i in range(3)]
        share = self._share(now, wanted, bounds) if self.scale_velocities else 1.0
        out = [
            c + min(max(share * (u - c), -b), b)
            for c, u, b in zip(now, wanted, bounds, strict=True)
        ]
        self._last = (out[0], out[1], out[2])
        sent = [
            0.0 if abs(v) < least else v
            for v, least in zip(out, self.deadband_velocity, strict=True)
        ]
        return (sent[0], sent[1], sent[2])

    def _current(self) -> Velocity:
        """Velocity from which the axes move on."""
        if self.feedback == "OPEN_LOOP" or not self._measured:
            return self._last
        count = len(self._measured)
        mean = [sum(velocity[i] for _, velocity in self._measured) / count for i in range(3)]
        return (mean[0], mean[1], mean[2])

    def _bound(self, axis: int, now: float, wanted: float) -> float:
        """Return the largest change of an axis in one period."""
        faster = abs(wanted) >= abs(now) and now * wanted >= 0.0
        rate = self.max_accel[axis] if faster else -self.max_decel[axis]
        return rate / self.smoothing_frequency

    @staticmethod
    def _share(now: Velocity, wanted: list[float], bounds: list[float]) -> float:
        """Share of the changes that all axes can make, the one farthest from 1."""
        share = 1.0
        for c, u, b in zip(now, wanted, bounds, strict=True):
            apart = u - c
            if abs(apart) > b:
                found = b / abs(apart)
                if found > 0.0 and abs(1.0 - found) > abs(1.0 - share):
                    share = found
        return share


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

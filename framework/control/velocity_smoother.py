"""The velocity smoother between the planner and the low-level controller."""

from dataclasses import dataclass
from typing import final

from ..values.arrays import positive
from ..values.errors import WideberthError
from ..values.motion import Command, Twist


@final
@dataclass(frozen=True)
class VelocitySmoother:
    """A linear ramp from one commanded velocity to the next.

    Within the ``ramp`` seconds after a command arrived at t_0::

        c(t) = c_0 + min(1, (t - t_0) / ramp) * (c_1 - c_0)

    c_1 is the command, c_0 what the smoother put out when it arrived. The paper's planner
    returns (v, omega) of step k+1 and its smoother starts at "(v, omega)_{k+1} of the
    previous cycle". The two are the same number when the previous ramp has ended, which is
    so whenever commands arrive one period apart; when a command arrives early or late,
    starting at the present output keeps the velocity continuous, and the paper's rule
    would make it jump.

    Attributes
    ----------
    start : (D + 1,) linear components, m/s, and yaw rate, rad/s, at the start of the ramp.
    target : (D + 1,) at its end.
    since : s, when the ramp began.
    ramp : s, how long it takes; 0 means at once.

    Examples
    --------
    >>> smoother = VelocitySmoother.at_rest(Twist((0.0, 0.0)))
    >>> smoother.aim(Command((0.5, 0.0), ramp=0.5), time=1.0).at(1.25).linear
    (0.25, 0.0)
    """

    start: tuple[float, ...]
    target: tuple[float, ...]
    since: float = 0.0
    ramp: float = 0.0

    def __post_init__(self) -> None:
        if len(self.start) != len(self.target):
            raise WideberthError(
                f"the smoother's start has {len(self.start)} entries and its target "
                f"{len(self.target)}; both need the linear components and the yaw rate"
            )
        positive("smoother.ramp", self.ramp, zero=True)

    @classmethod
    def at_rest(cls, twist: Twist, time: float = 0.0) -> "VelocitySmoother":
        """Return a smoother that holds this velocity."""
        values = (*(float(v) for v in twist.linear), float(twist.angular))
        return cls(values, values, time)

    def aim(self, command: Command, time: float) -> "VelocitySmoother":
        """Return the smoother after a command that arrives at ``time``, s."""
        target = (*(float(v) for v in command.linear), float(command.omega))
        return VelocitySmoother(self.values(time), target, time, command.ramp)

    def values(self, time: float) -> tuple[float, ...]:
        """Linear components and yaw rate at ``time``, (D + 1,)."""
        elapsed = time - self.since
        if self.ramp == 0.0 or elapsed >= self.ramp:
            return self.target
        share = max(elapsed, 0.0) / self.ramp
        return tuple(a + share * (b - a) for a, b in zip(self.start, self.target, strict=True))

    def at(self, time: float) -> Twist:
        """Velocity that the low-level controller should have at ``time``."""
        values = self.values(time)
        return Twist(values[:-1], values[-1])

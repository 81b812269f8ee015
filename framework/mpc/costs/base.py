"""The Cost interface, and what costs are written on."""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

from ...numerics.symbolic import ca
from ...values.arrays import positive
from ...values.motion import Pose, Twist
from ...values.path import Path
from ..ocp.reference import Reference
from ..ocp.stage import ReferenceSymbols


@dataclass(frozen=True)
class Weights:
    """Weights of the paper's cost.

    Parameters
    ----------
    position : w_p, 1/m^2.
    speed : w_v, s^2/m^2.
    acceleration : w_a, s^4/m^2.
    yaw_acceleration : w_alpha, s^4/rad^2.
    """

    position: float = 100.0
    speed: float = 10.0
    acceleration: float = 1e4
    yaw_acceleration: float = 500.0

    def __post_init__(self) -> None:
        for name in ("position", "speed", "acceleration", "yaw_acceleration"):
            positive(f"weights.{name}", getattr(self, name), zero=True)

    def scaled(self, k: float) -> "Weights":
        """Return the weights for a robot that is k times as fast.

        It drives the same way in 1/k of the time: each weight is divided by the power of k that
        its unit has of time.
        """
        return Weights(
            self.position,
            self.speed / k**2,
            self.acceleration / k**4,
            self.yaw_acceleration / k**4,
        )


@dataclass(frozen=True, eq=False)
class Moment:
    """Symbols of one stage: how the robot moves, and where it is along its path.

    Attributes
    ----------
    pose, twist, acceleration : of the robot.
    progress : m, arc length theta that is carried along as a state; None where none is.
    rate : m/s, its time derivative, an input; None likewise.
    """

    pose: Pose
    twist: Twist
    acceleration: Twist
    progress: Any = None
    rate: Any = None


class Cost(ABC):
    """Prices each stage of a plan.

    A cost is a frozen dataclass; its fields are its config. Laws, checked by
    `wideberth.framework.testing.check_cost`: terms are finite and not negative, with gradients
    that agree with differences; driving along a straight path at the reference speed is free;
    the reference has as many numbers as ``curve_width`` says.
    """

    reference: ClassVar[str] = ""

    @abstractmethod
    def lay(self, path: Path, arc: float, speed: float, steps: int, dt: float) -> Reference:
        """Lay what the plan is held against along the path from arc length ``arc``."""

    @abstractmethod
    def terms(self, moment: Moment, reference: ReferenceSymbols) -> Sequence[Any]:
        """Terms of one stage, whose sum is its price.

        Those that depend on the input are paid at (x_i, u_i), i = 0..N-1, against the reference
        of step i + 1; all others at x_i, i = 1..N, against that of step i.
        """

    def curve_width(self, dimension: int) -> int:
        """How many numbers of the path a stage needs beside position, direction and speed."""
        return 0


class ProgressCost(Cost):
    """Prices the arc length theta along the path: a state of the problem, its rate an input.

    The robot of its problem is a `wideberth.framework.mpc.ocp.progress_robot.ProgressRobot`, and
    `Moment.progress` and `Moment.rate` are given.
    """


class CommandCost(Cost):
    """Prices how the command changes: the input of the step before is a state of the problem.

    The robot of its problem is a `wideberth.framework.mpc.ocp.command_robot.CommandRobot`, and
    `Moment.acceleration` is that over a step, jumps of the velocity included.
    """


def effort(weights: Weights, acceleration: Twist) -> Any:
    """w_a |a|^2 + w_alpha alpha^2."""
    linear = weights.acceleration * ca.sumsqr(ca.vertcat(*acceleration.linear))
    return linear + weights.yaw_acceleration * acceleration.angular**2


def speed_error(moment: Moment, speed: Any, velocity: Any) -> Any:
    """Squared error of the speed: forward speed where there is a heading, else velocity.

    Parameters
    ----------
    moment : of the robot.
    speed : forward speed wanted of a robot with a heading, m/s.
    velocity : (D,), velocity wanted of one without, m/s.
    """
    actual = ca.vertcat(*moment.twist.linear)
    if moment.pose.heading is not None:
        velocity = ca.vertcat(speed, ca.SX.zeros(actual.numel() - 1))
    return ca.sumsqr(actual - velocity)

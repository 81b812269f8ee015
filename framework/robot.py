"""The Robot interface: how a robot can move."""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from math import atan2
from typing import ClassVar, Protocol, runtime_checkable

from .numerics.integration import runge_kutta
from .values.arrays import Scalar, positive, whole
from .values.footprint import Footprint, checked_footprint
from .values.motion import Pose, Twist


@dataclass(frozen=True)
class Quantity:
    """Name and SI unit of one state or input component."""

    name: str
    unit: str


@dataclass(frozen=True)
class Bounds:
    """Lower and upper limits, one entry per component; infinite where free."""

    lower: tuple[float, ...]
    upper: tuple[float, ...]

    @staticmethod
    @lru_cache(maxsize=64)
    def symmetric(*upper: float) -> "Bounds":
        """Limits -u <= value <= u."""
        return Bounds(tuple(-u for u in upper), upper)

    def with_lower(self, index: int, lower: float) -> "Bounds":
        """Return limits that have another lower one at one place."""
        return Bounds((*self.lower[:index], lower, *self.lower[index + 1 :]), self.upper)


class Robot(ABC):
    """A robot model, written once for NumPy and CasADi.

    ``state`` and ``control`` arrive as sequences of scalars: floats, NumPy arrays (a batch)
    or CasADi expressions; use NumPy functions (``np.cos``), which serve all three. A robot
    is a frozen dataclass with a field ``radius``. Laws, checked by
    `wideberth.framework.testing.check_robot`: NumPy and CasADi agree; ``pose`` changes as
    ``twist`` says; ``twist`` changes as ``acceleration`` says; turning the start turns the
    motion; ``drive`` keeps the limits and reaches the twist when it can.
    """

    states: ClassVar[tuple[Quantity, ...]]
    inputs: ClassVar[tuple[Quantity, ...]]
    dimension: ClassVar[int] = 2
    reference: ClassVar[str] = ""

    radius: float
    """m, of the disc that encloses the robot: what others see of it."""

    footprint: Footprint | None = None
    """What ground it covers, within that disc; None for the whole disc."""

    @abstractmethod
    def derivative(self, state: Sequence[Scalar], control: Sequence[Scalar]) -> tuple[Scalar, ...]:
        """Time derivative of the state."""

    def after(
        self, state: Sequence[Scalar], control: Sequence[Scalar], dt: Scalar, substeps: int = 1
    ) -> tuple[Scalar, ...]:
        """State ``dt`` seconds later under a constant input."""
        return runge_kutta(self.derivative, state, control, dt, substeps)

    @abstractmethod
    def state_bounds(self) -> Bounds:
        """Limits of the state."""

    @abstractmethod
    def input_bounds(self) -> Bounds:
        """Limits of the input."""

    def constraints(
        self, state: Sequence[Scalar], control: Sequence[Scalar]
    ) -> tuple[Scalar, ...]:
        """Limits that bounds cannot say, each >= 0 when kept; none unless a robot states some."""
        return ()

    @abstractmethod
    def pose(self, state: Sequence[Scalar]) -> Pose:
        """Position and heading."""

    @abstractmethod
    def twist(self, state: Sequence[Scalar], control: Sequence[Scalar]) -> Twist:
        """Velocity: body frame, or world frame for a robot without heading."""

    @abstractmethod
    def acceleration(self, state: Sequence[Scalar], control: Sequence[Scalar]) -> Twist:
        """Time derivative of the twist's components."""

    @abstractmethod
    def state_at(self, pose: Pose, twist: Twist) -> tuple[Scalar, ...]:
        """State of the robot at this pose with this twist."""

    @abstractmethod
    def drive(self, state: Sequence[float], twist: Twist, duration: float) -> tuple[float, ...]:
        """Input that brings the twist to the wanted one within ``duration`` s, in the limits.

        This is the low-level velocity controller: the plant, the braking manoeuvre and
        every rival controller use it.
        """


class SymbolicDrive(Robot):
    """A robot whose `drive` takes CasADi expressions of state and twist as well.

    Roll-outs of many manoeuvres are then compiled. Such a robot is hashable, as frozen
    dataclasses are.
    """

    @abstractmethod
    def drive(self, state: Sequence[Scalar], twist: Twist, duration: float) -> tuple[Scalar, ...]:
        """Input that brings the twist to the wanted one, see `Robot.drive`."""


@runtime_checkable
class SpeedLimited(Protocol):
    """A robot with a largest speed among its settings.

    Law, checked by `wideberth.framework.testing.check_robot`: between two states within the limits
    its position moves at most ``max_speed`` times the duration of the step.
    """

    @property
    @abstractmethod
    def radius(self) -> float:
        """Radius of the enclosing disc, m."""

    @property
    @abstractmethod
    def max_speed(self) -> float:
        """Largest speed, m/s."""


def checked_limits(name: str, robot: Robot) -> None:
    """Refuse settings of a robot that drives ahead, called ``name``, which it cannot have.

    All are numbers above 0, but for ``footprint``, see `checked_footprint`, and
    ``max_reverse_speed``, see `least_speed`.

    Raises
    ------
    WideberthError : it has one.
    """
    settings = vars(robot)
    for key, value in settings.items():
        if key not in ("footprint", "max_reverse_speed"):
            positive(f"{name}.{key}", value)
    checked_footprint(name, robot.footprint, robot.radius)
    if (back := settings["max_reverse_speed"]) is not None:
        positive(f"{name}.max_reverse_speed", back, zero=True, most=settings["max_speed"])


def least_speed(max_speed: float, max_reverse_speed: float | None) -> float:
    """Return the lower limit of the speed ahead, m/s: backwards without one as fast as ahead."""
    return 0.0 - (max_speed if max_reverse_speed is None else max_reverse_speed)


def start_state(
    robot: Robot, position: Sequence[float], direction: Sequence[float], speed: float
) -> tuple[tuple[float, ...], Twist]:
    """Return state and twist of a robot that drives along a unit vector at ``speed``.

    A robot with a heading looks that way; one without has the world components.
    """
    probe = robot.pose(tuple(0.0 for _ in robot.states))
    place = tuple(float(value) for value in position)
    if probe.heading is None:
        twist = Twist(tuple(speed * float(d) for d in direction))
        pose = Pose(place)
    else:
        twist = Twist((speed, 0.0))
        pose = Pose(place, atan2(direction[1], direction[0]))
    return tuple(float(value) for value in robot.state_at(pose, twist)), twist


def step(
    robot: Robot,
    state: Sequence[Scalar],
    control: Sequence[Scalar],
    dt: float,
    substeps: int = 1,
) -> tuple[Scalar, ...]:
    """State of the robot ``dt`` seconds later under a constant input.

    Raises
    ------
    WideberthError : dt not above 0, or substeps not a whole number of at least 1.
    """
    positive("dt", dt)
    whole("substeps", substeps)
    return robot.after(state, control, dt, substeps)

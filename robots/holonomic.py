"""Holonomic robot with acceleration as input: a double integrator in the plane."""

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import ClassVar, final

from ..framework.robot import Quantity
from ..framework.values.arrays import Scalar, positive
from ..framework.values.motion import Pose
from .double_integrator import DoubleIntegrator


@final
@dataclass(frozen=True)
class Holonomic(DoubleIntegrator):
    """A disc that accelerates in any direction; it has no heading.

    State (x, y, vx, vy), input (ax, ay), all in the world frame::

        p' = v    v' = a    with    |v| <= max_speed    |a| <= max_acceleration

    Parameters
    ----------
    radius : m, of the disc.
    max_speed : m/s, on the Euclidean norm.
    max_acceleration : m/s^2, on the Euclidean norm.

    Raises
    ------
    WideberthError : a parameter that is not above 0.
    """

    states: ClassVar[tuple[Quantity, ...]] = (
        Quantity("x", "m"),
        Quantity("y", "m"),
        Quantity("vx", "m/s"),
        Quantity("vy", "m/s"),
    )
    inputs: ClassVar[tuple[Quantity, ...]] = (Quantity("ax", "m/s^2"), Quantity("ay", "m/s^2"))

    radius: float = 0.75
    max_speed: float = 0.7
    max_acceleration: float = 0.7

    def __post_init__(self) -> None:
        for entry in fields(self):
            positive(f"holonomic.{entry.name}", getattr(self, entry.name))

    def derivative(self, state: Sequence[Scalar], control: Sequence[Scalar]) -> tuple[Scalar, ...]:
        """Time derivative of the state."""
        return state[2], state[3], control[0], control[1]

    def pose(self, state: Sequence[Scalar]) -> Pose:
        """Position; no heading."""
        return Pose((state[0], state[1]))

"""Holonomic robot in space with acceleration as input: a small multicopter, seen from far."""

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import ClassVar, final

from ..framework.robot import Quantity
from ..framework.values.arrays import Scalar, positive
from ..framework.values.motion import Pose
from .double_integrator import DoubleIntegrator


@final
@dataclass(frozen=True)
class Holonomic3D(DoubleIntegrator):
    """A ball that accelerates in any direction of space; it has no attitude.

    State (x, y, z, vx, vy, vz), input (ax, ay, az), all in the world frame, z upwards::

        p' = v    v' = a    with    |v| <= max_speed    |a| <= max_acceleration

    The usual model for planning with a multicopter whose attitude loop is much faster than
    the plan's steps. Gravity is taken as compensated, the air as still, and climbing as
    free as sinking; a real one has limits that differ by direction.

    Parameters
    ----------
    radius : m, of the ball.
    max_speed : m/s, on the Euclidean norm.
    max_acceleration : m/s^2, on the Euclidean norm.

    Raises
    ------
    WideberthError : a parameter that is not above 0.
    """

    states: ClassVar[tuple[Quantity, ...]] = (
        *(Quantity(name, "m") for name in ("x", "y", "z")),
        *(Quantity(name, "m/s") for name in ("vx", "vy", "vz")),
    )
    inputs: ClassVar[tuple[Quantity, ...]] = tuple(
        Quantity(name, "m/s^2") for name in ("ax", "ay", "az")
    )
    dimension: ClassVar[int] = 3

    radius: float = 0.35
    max_speed: float = 1.5
    max_acceleration: float = 1.5

    def __post_init__(self) -> None:
        for entry in fields(self):
            positive(f"holonomic_3d.{entry.name}", getattr(self, entry.name))

    def derivative(self, state: Sequence[Scalar], control: Sequence[Scalar]) -> tuple[Scalar, ...]:
        """Time derivative of the state."""
        return (*state[3:], *control)

    def pose(self, state: Sequence[Scalar]) -> Pose:
        """Position; no heading."""
        return Pose(tuple(state[:3]))

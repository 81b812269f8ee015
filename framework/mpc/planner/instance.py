"""The instance of one planning cycle: the problem with its numbers, and all around it."""

from dataclasses import dataclass
from functools import cached_property

from ...robot import Robot
from ...values.arrays import Array
from ..levels.base import LevelPolicy
from ..ocp.problem import Parameters, Problem
from ..slots.base import ActiveObstacles, shared_target
from .in_contact import InContact


@dataclass(frozen=True, eq=False)
class Instance:
    """One problem with its numbers, and all that plans are verified against.

    Attributes
    ----------
    problem, parameters : the instance.
    around : all that the bodies could touch.
    level : the policy that the levels come from.
    last_inputs : (N, m), inputs of the last plan from now on; None without one.
    in_contact : who is in contact as plans begin; None for none.
    posed : what the solver is given, where it holds more than plans are verified against, see
        `SlotAssignment.at_end`; None for ``parameters``.
    """

    problem: Problem
    parameters: Parameters
    around: ActiveObstacles
    level: LevelPolicy
    last_inputs: Array | None = None
    in_contact: InContact | None = None
    posed: Parameters | None = None

    @property
    def asked(self) -> Parameters:
        """The numbers that the solver is given."""
        return self.parameters if self.posed is None else self.posed

    @cached_property
    def robot(self) -> Robot:
        """The robot of the problem."""
        return self.around.robot

    @property
    def names(self) -> tuple[str, ...]:
        """Names of all slots of the problem, "?" where empty."""
        return self.around.names(self.problem)

    @property
    def note(self) -> str:
        """Who is in contact, in words; "" for none."""
        return "" if self.in_contact is None else str(self.in_contact)

    @cached_property
    def target(self) -> float:
        """s_ref, the level that a shared level is drawn to; nan where none is shared."""
        return shared_target(self.around.kinds, self.level, self.robot.dimension)

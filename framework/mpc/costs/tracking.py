"""The paper's cost: follow a reference that moves along the path at a constant speed."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar, Self, final

from ...numerics.symbolic import ca
from ...values.path import Path
from ..ocp.reference import Reference, lay_reference
from ..ocp.stage import ReferenceSymbols
from .base import Cost, Moment, Weights, effort, speed_error


@dataclass(frozen=True)
class TimedTracking:
    """Methods of both costs whose points move along the path at the reference speed.

    Parameters
    ----------
    weights : the paper's by default.
    """

    reference: ClassVar[str] = "schoeneberg2025trajectory"

    weights: Weights = field(default_factory=Weights)

    def scaled(self, k: float) -> Self:
        """Return the cost for a robot that is k times as fast, see `Weights.scaled`."""
        return replace(self, weights=self.weights.scaled(k))

    def lay(self, path: Path, arc: float, speed: float, steps: int, dt: float) -> Reference:
        """Lay the reference at a constant speed; it stops at the goal."""
        return lay_reference(path, arc, speed, steps, dt)

    def terms(self, moment: Moment, reference: ReferenceSymbols) -> Sequence[Any]:
        """Position, effort and speed."""
        weights = self.weights
        place = ca.vertcat(*moment.pose.position)
        wanted = reference.speed * reference.direction
        return (
            weights.position * ca.sumsqr(place - reference.position),
            effort(weights, moment.acceleration),
            weights.speed * speed_error(moment, reference.speed, wanted),
        )


@final
@dataclass(frozen=True)
class Tracking(TimedTracking, Cost):
    """Track points that leave the robot's place on the path at the reference speed.

    ::

        w_p |p - p_ref|^2 + w_v (v - v_ref)^2 + w_a |a|^2 + w_alpha alpha^2

    p_ref is laid anew at every call from where the robot is, so that a robot that waits does
    not fall behind for good. Within the horizon the points go on without it: to stand from now on
    costs w_p (i v_ref dt)^2 at step i, 7750 in all at the paper's numbers, and a plan that waits
    and then goes makes up for it by driving faster than the reference.

    Parameters
    ----------
    weights : the paper's by default.
    """

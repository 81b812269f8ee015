"""The paper's cost for a robot whose velocity acts at once: its change is priced."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar, final

from ...values.path import Path
from ..ocp.reference import Reference
from ..ocp.stage import ReferenceSymbols
from .base import CommandCost, Moment, Weights
from .tracking import Tracking


@final
@dataclass(frozen=True)
class SmoothTracking(CommandCost):
    """Track points on the path as `Tracking` does, and price jumps of the velocity.

    ::

        w_p |p - p_ref|^2 + w_v (v - v_ref)^2 + w_a |a|^2 + w_alpha alpha^2

    with a_i and alpha_i the change of the velocity from step i - 1 to step i over dt, that of the
    first step from the last command on. `Tracking` prices the accelerations within a step alone:
    a robot whose velocity is its input has none there, and its plans turn at once, which no
    forecast of those who meet it expects. For a robot whose velocity is part of its state both
    costs are equal.

    Parameters
    ----------
    weights : the paper's by default.
    """

    reference: ClassVar[str] = "schoeneberg2025trajectory"

    weights: Weights = field(default_factory=Weights)

    def scaled(self, k: float) -> "SmoothTracking":
        """Return the cost for a robot that is k times as fast, see `Weights.scaled`."""
        return SmoothTracking(self.weights.scaled(k))

    def lay(self, path: Path, arc: float, speed: float, steps: int, dt: float) -> Reference:
        """Lay the reference of `Tracking`."""
        return Tracking(self.weights).lay(path, arc, speed, steps, dt)

    def terms(self, moment: Moment, reference: ReferenceSymbols) -> Sequence[Any]:
        """Position, effort and speed."""
        return Tracking(self.weights).terms(moment, reference)

"""The paper's cost for a robot whose velocity acts at once: its change is priced."""

from dataclasses import dataclass
from typing import final

from ...framework.mpc.costs.base import CommandCost
from ...framework.mpc.costs.tracking import TimedTracking


@final
@dataclass(frozen=True)
class SmoothTracking(TimedTracking, CommandCost):
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

"""Plan: what the planner decided, how it got there, and why if it could not."""

from dataclasses import dataclass, field
from enum import StrEnum

import numpy as np

from .arrays import Array
from .forecast import Forecast


class Status(StrEnum):
    """How the solver ended."""

    SOLVED = "solved"
    LIMIT = "iteration limit"
    DEADLINE = "deadline"
    INFEASIBLE = "infeasible"
    FAILED = "failed"
    NOT_RUN = "not run"


class Rung(StrEnum):
    """Rung of the fallback ladder that the plan stands on, best first."""

    OPTIMAL = "optimal"
    FEASIBLE = "feasible iterate"
    SHIFTED = "shifted last plan"
    LEAST = "least violation"
    BRAKE = "brake"


@dataclass(frozen=True, eq=False)
class Plan:
    """States and inputs over the horizon with all that is known about them.

    Attributes
    ----------
    stamp : s, time of the first state.
    dt : s between states.
    states : (N + 1, n), the first is where the plan starts.
    inputs : (N, m).
    positions : (N + 1, D), m, of the states.
    reference : (N, D), m, what the plan tracked.
    auxiliaries : (N, O, A) of the regions, for the warm start.
    level : (N, O), the level that each constraint was held at.
    target : (N, O), the level aimed at.
    content : (N, O), the content that those levels stand for.
    ids : identities of the O obstacles.
    status : how the solver ended.
    rung : which rung of the fallback ladder this is.
    reason : why it is not the optimal plan; empty when it is.
    iterations : of the solver.
    seconds : wall time of the solve.
    violation : largest violated constraint, re-checked in NumPy (unit-free, 0 if none; nan
        where an emergency left nothing to check against).
    cost : value of the objective, nan where there is none.
    left_out : obstacles that did not fit into the problem, or forecast modes, and polygons
        with a part that did not.
    forecast : what was assumed of all obstacles, left-out ones too, on the plan's grid.
    tracked : identities of the forecast's obstacles, in its order.
    fallbacks : per obstacle, why the named predictor was not used, or None.
    """

    stamp: float
    dt: float
    states: Array
    inputs: Array
    positions: Array
    reference: Array
    auxiliaries: Array
    level: Array
    target: Array
    content: Array
    ids: tuple[str, ...]
    status: Status
    rung: Rung
    reason: str = ""
    iterations: int = 0
    seconds: float = 0.0
    violation: float = 0.0
    cost: float = float("nan")
    left_out: tuple[str, ...] = ()
    forecast: Forecast | None = field(default=None, repr=False)
    tracked: tuple[str, ...] = ()

    @property
    def fallbacks(self) -> tuple[str | None, ...]:
        """Per obstacle, why the named predictor was not used, or None."""
        return () if self.forecast is None else self.forecast.fallback

    @property
    def below_reference(self) -> bool | None:
        """Whether a constraint is held at less than was aimed at, or not kept at all.

        None where the plan held no constraint.
        """
        if self.violation > 1e-4:
            return True
        return bool((self.level < self.target - 1e-4).any()) if self.level.size else None

    @property
    def lowest_content(self) -> float:
        """Smallest content that any constraint of the plan stands for; nan without any."""
        return float(self.content.min()) if self.content.size else float(np.nan)

"""The planner: a planning cycle behind the Controller interface."""

from collections.abc import Sequence, Set
from copy import copy
from dataclasses import dataclass, field, replace
from typing import Any, final

import numpy as np

from ...control.rate_limited_warnings import WARNINGS
from ...controller import Controller, WrapsController, checked_path
from ...plugins.config import IMPLEMENTED
from ...plugins.registry import named
from ...values.errors import WideberthError, short
from ...values.motion import Command, Observation
from ...values.path import Path
from ...values.path_progress import ReferenceProgress
from ...values.plan import Plan, Rung
from .cycle import (
    Decision,
    PlannerState,
    Services,
    joined,
    remember,
    situation_of,
    step,
    warm_up,
)
from .recorder import SOLVE_FILES, SOLVE_RECORD, Recorder
from .settings import PlannerSettings, check_settings, doubts
from .standing import ARRIVED

SOON = 2.0
"""s ahead within which a level that gives way is a warning; far more than robots need to stop."""


@dataclass(eq=False)
class _Memory:
    """What a planner holds between two calls: the only thing in it that changes."""

    state: PlannerState
    decision: Decision | None = None
    plan: Plan | None = None


@final
@dataclass(frozen=True, eq=False)
class Planner(PlannerSettings, Controller):
    """Plans by MPC and commands the velocity of the plan's next step.

    Each call forecasts the obstacles, lays the reference along the path, solves the MPC
    from the shifted last plan and hands out the twist of step k + 1, to be reached over
    one MPC step: the paper's velocity smoother. When a solve fails, the rungs of
    `wideberth.framework.mpc.planner.rungs` are tried in order; the command is always safe to
    execute, and the plan says why it is not the optimal one.

    The cycle itself is `wideberth.framework.mpc.planner.cycle.step`; this class holds its state.
    All parameters but `record` are those of `PlannerSettings`.

    Parameters
    ----------
    record : where solves that failed or took long are kept for `wideberth explain`.

    Raises
    ------
    WideberthError : a value out of range, or robot and region of different dimensions.
    """

    record: Recorder | None = field(default=None, metadata={IMPLEMENTED: SOLVE_FILES})
    _services: Services = field(init=False, repr=False)
    _memory: _Memory = field(init=False, repr=False)

    def __post_init__(self) -> None:
        check_settings(self)
        object.__setattr__(self, "_services", Services.of(self))
        object.__setattr__(self, "_memory", _Memory(PlannerState.initial(self)))

    def __deepcopy__(self, memo: dict[int, Any]) -> "Planner":
        """Return a planner that goes on as this one does; they share what changes no result."""
        twin = copy(self)
        object.__setattr__(twin, "_memory", copy(self._memory))
        return twin

    def __repr__(self) -> str:
        """Say which parts it has and what it does, a line each."""
        parts = ("robot", "predictor", "region", "level", "solver", "cost")
        lines = [f"  {name:<10}{short(getattr(self, name), 110)}" for name in parts]
        reach = f"{self.horizon} steps of {self.dt:.4g} s, every {self.period:.4g} s"
        lines.append(f"  {'horizon':<10}{reach}, at {self.reference_speed:g} m/s")
        plan = self.last_plan
        words = "none yet" if plan is None else f"{plan.rung} at {plan.stamp:g} s"
        lines.append(f"  {'plan':<10}{words}")
        return "\n".join(["Planner", *lines])

    def reset(self) -> None:
        """Forget obstacles, plan and progress; the path stays."""
        progress = self._memory.state.progress
        path = None if progress is None else progress.path
        self._memory.state = PlannerState.initial(self, path)
        self._memory.decision = self._memory.plan = None

    def set_path(self, path: Path) -> None:
        """Follow this path from now on; the first one warns of settings that look like a slip.

        Where it is the path of before, or has only moved a little, see `PathProgress.on`, the
        robot goes on from where it is along it; `reset` begins it anew.
        """
        path, memory = checked_path(self.robot, path), self._memory
        before = memory.state.progress
        progress = (before or ReferenceProgress(path)).on(path)
        same = before is not None and np.linalg.norm(before.path.goal - path.goal) <= ARRIVED
        memory.state = replace(memory.state, progress=progress)
        if not same:
            memory.state = replace(memory.state, standing=None, retreat=None)
        if not self._services.problems:
            warm_up(self, self._services, path)
        for words in doubts(self) if before is None else ():
            WARNINGS.warn(type(self).__name__, words.split()[0], words)

    @property
    def last_plan(self) -> Plan | None:
        """The plan behind the last command, with all that a picture of it shows."""
        memory = self._memory
        if memory.plan is None or memory.decision is None or memory.plan.situation is not None:
            return memory.plan
        situation = situation_of(self, memory.decision)
        if situation is not None:
            memory.plan = replace(memory.plan, situation=situation)
        return memory.plan

    def remember(self, observation: Observation) -> None:
        """Take note of what is seen without planning."""
        self._memory.state = remember(self, self._memory.state, observation)

    def command(self, observation: Observation) -> Command:
        """Plan from this observation; raises nothing but what wrong use deserves, see `step`.

        Raises
        ------
        WideberthError : no path is set, or something else than an observation of this robot.
        """
        memory = self._memory
        memory.state, decision = step(self, memory.state, observation, self._services)
        plan, solved = decision.plan, decision.solved
        if self.record is not None and solved is not None and self.record.wants(solved):
            note = self.record.keep(self, solved)
            plan = replace(plan, reason=joined(plan.reason, note))
        _warn(type(self).__name__, plan, decision.notes, self.judging.usual)
        memory.decision = decision
        if decision.notes:
            plan = replace(plan, reason=joined(plan.reason, *decision.notes))
        memory.plan = plan
        return decision.command

    def explain(self) -> Any:
        """Return what the last call solved: to be read, saved, and solved again.

        Returns
        -------
        SolveRecord : of `wideberth.controllers.diagnosis.explain`.

        Raises
        ------
        WideberthError : it solved nothing.
        """
        decision = self._memory.decision
        if decision is None or decision.solved is None:
            raise WideberthError(
                "the last call solved no problem, so that there is none to explain; its plan's "
                "reason says why"
            )
        return named(SOLVE_RECORD, (SOLVE_RECORD,)).of(self, decision.solved)


def _warn(
    name: str, plan: Plan, notes: Sequence[str], usual: Set[Rung] = frozenset({Rung.OPTIMAL})
) -> None:
    """Warn of a plan that is not the one that was asked for, and of what was refused.

    A level that gives way later than `SOON` is no warning: decisions until then may still keep it.
    ``usual`` are the rungs of plans that need none: a manoeuvre is no failure of the solver.
    """
    if plan.rung not in usual:
        WARNINGS.warn(name, str(plan.rung), plan.reason)
    elif plan.given_way is not None and plan.given_way.step * plan.dt <= SOON:
        WARNINGS.warn(name, "gave way", str(plan.given_way))
    if plan.left_out:
        WARNINGS.warn(name, "no room in the problem", ", ".join(plan.left_out))
    for note in notes:
        WARNINGS.warn(name, note.split()[0].rstrip(":"), note)  # its first word is its kind


def planner_behind(controller: Controller | None) -> Planner | None:
    """Return the planner that a controller is or wraps; None for one that plans otherwise."""
    if isinstance(controller, WrapsController):
        return planner_behind(controller.controller)
    return controller if isinstance(controller, Planner) else None

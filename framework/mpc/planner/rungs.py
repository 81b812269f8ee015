"""The fallback ladder: rungs, best first, each of which offers a plan or says why it has none.

1. `Optimal`: the solver converged and the plan keeps every constraint, regions at the level that
   it holds: one that may give way holds less than asked where that is cheaper (`Plan.given_way`);
2. `FeasibleIterate`: the solver did not converge, but its last point keeps every constraint;
3. `ShiftedPlan`: the last plan, while it still keeps every constraint against the new forecast;
4. `LeastViolation`: the last point of a solve that the robot can drive, where that enters regions
   less than any way to stop;
5. `Brake`: the way to stop within the limits, straight on or after getting out of the way, that
   enters regions least.

`choose` takes the first rung of a tuple that holds. A planner's setting ``fallback`` names
that tuple: put a rung of your own where it belongs.

In contact every rung is held to one more rule: the robot stops or leaves, and speeds up for
neither, see `in_contact`. Braking straight on always keeps it.

The paper has no such ladder: it leaves late and failed solves to Nav2. Every setting has it here,
those called ``paper`` too.
"""

from abc import ABC, abstractmethod
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from functools import cache, cached_property
from typing import ClassVar, final

import numpy as np

from ...plugins.registry import named, unknown
from ...values.arrays import Array, whole
from ...values.errors import WideberthError, short
from ...values.plan import TOLERANCE, Plan, Rung
from ..ocp.transcription import Guess
from .giving_way import PlanLevels
from .instance import Instance
from .judge import CostJudge, Judge
from .multistart import MultiStartResult
from .rollout import follow
from .starts import suited_each
from .stopping import stops
from .verify import Candidate, contact, verify_each

SWITCHING_MARGIN = 0.05
"""Share of 1 + |cost| that another start has to save before the last plan is given up for it. Head
on, 2 cm of noise on the obstacle are worth 2 % to 4 %; the wrong side of one that stands 0.3 m off
the middle, 70 %."""


@final
@dataclass(frozen=True)
class NotHeld:
    """A rung has no plan to offer.

    Attributes
    ----------
    reasons : why not, in words; they become part of the plan's reason.
    """

    reasons: tuple[str, ...] = ()


@final
@dataclass(frozen=True, eq=False)
class LadderInput:
    """What the rungs choose from in one planning cycle.

    Attributes
    ----------
    instance : that plans are verified against.
    outcome : of the solver: its re-checked solutions.
    judge : what plans are judged by.
    """

    instance: Instance
    outcome: MultiStartResult
    judge: Judge = field(default_factory=CostJudge)

    @cached_property
    def near(self) -> tuple[Candidate, ...]:
        """Solutions that keep every constraint and cost at most `SWITCHING_MARGIN` too much."""
        feasible = [one for one in self.outcome.candidates if one.feasible]
        least = min((one.cost for one in feasible), default=0.0)
        within = SWITCHING_MARGIN * (1.0 + abs(least))
        return tuple(one for one in feasible if one.cost - least <= within)

    def cheapest(self, candidates: Sequence[Candidate]) -> Candidate:
        """Return the cheapest of some solutions.

        While something stays in the way, the one that continues the last plan is kept, so that
        the side is not changed for noise.
        """
        loyal = self.outcome.before and self.instance.last_inputs is not None
        if loyal and self.judge.loyal and candidates[0] is self.outcome.candidates[0]:
            return candidates[0]
        return min(candidates, key=lambda one: one.cost)

    @cached_property
    def drivable(self) -> tuple[Candidate, ...]:
        """Solutions that keep the limits of motion, held against the lowest level."""
        moving = [one for one in self.outcome.candidates if one.found.motion.max() <= TOLERANCE]
        points = self._points((one.point.states, one.point.inputs) for one in moving)
        if not self.instance.problem.shared and self.instance.problem.no_auxiliaries:
            every = [one.found for one in moving]  # the re-check asked the same
        else:
            # what is touched on the way is the same at every level
            every = verify_each(self.instance, points, [one.found.touch for one in moving])
        return tuple(
            Candidate(point, found, one.solution, cost=one.cost)
            for point, found, one in zip(points, every, moving, strict=True)
        )

    @cached_property
    def least_harmful(self) -> Candidate:
        """Of drivable solutions and ways to stop, the one that enters regions least."""
        return self.gentlest(self.drivable)

    def gentlest(self, others: Sequence[Candidate]) -> Candidate:
        """Return what enters regions least: a way to stop, or one of ``others``.

        A candidate that touches a body before it has stopped comes last, whatever else it
        keeps. Braking straight on wins a tie. In contact only what keeps the rule of
        `in_contact` takes part.
        """
        instance, rule = self.instance, self.instance.in_contact
        given = (
            instance.robot,
            instance.parameters.initial,
            instance.problem.horizon,
            instance.problem.dt,
        )
        ways = stops(*given) if rule is None else stops(*given, rule.fastest)
        name, states, inputs = next(ways)
        straight = replace(self.at_lowest_level(states, inputs), way=name)
        window = int((np.abs(states - states[-1]).max(axis=1) > 1e-3).sum()) + 1
        depth = contact(instance, straight, window)
        if self.judge.loyal and max(depth, straight.found.total) == 0.0:
            return straight
        names, trajectories = [], []
        for name, states, inputs in ways:
            names.append(name)
            trajectories.append((states, inputs))
        points = self._points(trajectories)
        checked = zip(names, points, verify_each(instance, points), strict=True)
        named = [Candidate(point, found, way=name) for name, point, found in checked]
        every = [straight, *(one for one in (*others, *named) if one.found.leaves)]
        order = np.argsort(self.judge.harm(every), kind="stable")
        looked_at: list[tuple[Candidate, float]] = []
        for one in (every[k] for k in order):
            looked_at.append((one, depth if one is straight else contact(instance, one, window)))
            if looked_at[-1][1] == 0.0:
                break  # what touches nothing beats all that enter regions more
        least = min(depth for _, depth in looked_at) + TOLERANCE
        return next(one for one, depth in looked_at if depth <= least)

    def at_lowest_level(self, states: Array, inputs: Array) -> Candidate:
        """Re-check a trajectory at the lowest level that the policy allows."""
        points = self._points([(states, inputs)])
        return Candidate(points[0], verify_each(self.instance, points)[0])

    def _points(self, trajectories: Iterable[tuple[Array, Array]]) -> list[Guess]:
        """Wrap trajectories at the lowest level that the policy allows."""
        problem = self.instance.problem
        level = max(problem.minimum, 0.0) if problem.shared else float("nan")
        bare = [Guess.bare(*driven, level) for driven in trajectories]
        return suited_each(self.instance, bare)


class FallbackRung(ABC):
    """One rung of the fallback ladder.

    A rung is a frozen dataclass without fields that must be given. It must not raise: a plan
    from a rung that does is an emergency stop.
    """

    name: ClassVar[str]
    """Stands in plans, reasons and logs."""

    @abstractmethod
    def attempt(self, trial: LadderInput) -> Candidate | NotHeld:
        """Return the plan that this rung offers, or why it does not hold."""


@final
@dataclass(frozen=True)
class Optimal(FallbackRung):
    """A converged plan that keeps every constraint, unless an iterate is clearly cheaper."""

    name: ClassVar[str] = Rung.OPTIMAL

    def attempt(self, trial: LadderInput) -> Candidate | NotHeld:
        """Take the cheapest converged plan within `SWITCHING_MARGIN` of the cheapest of all."""
        converged = [one for one in trial.near if one.optimal]
        if converged:
            return trial.cheapest(converged)
        if trial.judge.reason and trial.near:
            return NotHeld((trial.judge.reason,))
        reasons = [f"solver: {trial.outcome.message}"]
        if not trial.near and trial.outcome.candidates:
            first = trial.outcome.candidates[0]
            reasons.append(f"its plan: {first.found.where(trial.instance.names)}")
        return NotHeld(tuple(reasons))


@final
@dataclass(frozen=True)
class FeasibleIterate(FallbackRung):
    """The last point of a solve that did not converge, and keeps every constraint.

    Where none does, a solution that keeps the lowest level of the policy is feasible after all.
    """

    name: ClassVar[str] = Rung.FEASIBLE

    def attempt(self, trial: LadderInput) -> Candidate | NotHeld:
        """Take the cheapest feasible point."""
        if trial.near:
            return trial.cheapest(trial.near)
        return next((one for one in trial.drivable if one.feasible), NotHeld())


@final
@dataclass(frozen=True)
class ShiftedPlan(FallbackRung):
    """The last plan from now on, while it keeps the lowest level against the new forecast."""

    name: ClassVar[str] = Rung.SHIFTED

    def attempt(self, trial: LadderInput) -> Candidate | NotHeld:
        """Drive the last plan's inputs from the present state, and check that."""
        instance, inputs = trial.instance, trial.instance.last_inputs
        if inputs is None or instance.in_contact is not None:  # it might stay there
            return NotHeld()
        states = follow(instance.robot, instance.parameters.initial, inputs, instance.problem.dt)
        shifted = trial.at_lowest_level(states, inputs)
        if shifted.feasible:
            return shifted
        return NotHeld((f"{self.name}: {shifted.found.where(instance.names)}",))


@final
@dataclass(frozen=True)
class LeastViolation(FallbackRung):
    """A drivable solution that enters regions less than any way to stop."""

    name: ClassVar[str] = Rung.LEAST

    def attempt(self, trial: LadderInput) -> Candidate | NotHeld:
        """Compare drivable solutions with all ways to stop."""
        best = trial.least_harmful
        return best if any(best is one for one in trial.drivable) else NotHeld()


@final
@dataclass(frozen=True)
class Brake(FallbackRung):
    """The way to stop that enters regions least; it always holds."""

    name: ClassVar[str] = Rung.BRAKE

    def attempt(self, trial: LadderInput) -> Candidate | NotHeld:
        """Compare all ways to stop."""
        best = trial.least_harmful
        return trial.gentlest(()) if any(best is one for one in trial.drivable) else best


RUNGS: dict[str, type[FallbackRung]] = {
    str(one.name): one for one in (Optimal, FeasibleIterate, ShiftedPlan, LeastViolation, Brake)
}
"""The built-in rungs by name, best first."""


@final
@dataclass(frozen=True)
class Fallback:
    """What a planner drives where a solve fails.

    Parameters
    ----------
    rungs : of the ladder, best first: names of built-in ones, or "module:Class" of a
        `FallbackRung` of your own.
    stop_at_end : whether every plan ends at rest. Then the last one, continued by standing,
        is there to fall back on for as long as the forecast it was made for comes true.
    steps_at_rest : M, steps after a plan's end, N + 1..N + M, at which the robot that stands there
        is to be outside of the regions too, see `wideberth.framework.mpc.slots.at_rest`. Needs
        ``stop_at_end``.

    Raises
    ------
    WideberthError : no rung, or a name that is none; steps at rest of plans that do not end so.
    """

    rungs: tuple[str, ...] = tuple(RUNGS)
    stop_at_end: bool = False
    steps_at_rest: int = 0

    def __post_init__(self) -> None:
        rungs_of(self.rungs)
        if whole("fallback.steps_at_rest", self.steps_at_rest, least=0) and not self.stop_at_end:
            raise WideberthError(
                f"fallback.steps_at_rest is {self.steps_at_rest}, and plans need not end at rest: "
                "set fallback.stop_at_end to true"
            )

    @cached_property
    def ladder(self) -> tuple[FallbackRung, ...]:
        """The rungs."""
        return rungs_of(self.rungs)


def rungs_of(names: Sequence[str]) -> tuple[FallbackRung, ...]:
    """Return the rungs of their names, in the same order.

    Parameters
    ----------
    names : built-in ones, or "module:Class" of a `FallbackRung`.

    Raises
    ------
    WideberthError : none, an unknown name, a class that is no rung, or one that cannot be made.
    """
    if isinstance(names, str) or not names:
        raise WideberthError(
            f"fallback.rungs is {names!r}; wanted some of {list(RUNGS)}, or 'module:Class'"
        )
    return tuple(_made(name) for name in names)


def _made(name: str) -> FallbackRung:
    found = _rung(name)
    try:
        return found()
    except Exception as error:  # a third party's class may fail in any way
        raise WideberthError(
            f"fallback.rungs names {name!r}, which cannot be made without arguments ({error})"
        ) from error


@cache
def _rung(name: str) -> type[FallbackRung]:
    if ":" not in name:
        if name not in RUNGS:
            raise WideberthError(f"fallback.rungs: {unknown('rung', name, RUNGS)}")
        return RUNGS[name]
    try:
        found = named(name)
    except WideberthError as error:
        raise WideberthError(f"fallback.rungs: {error}; wanted 'module:Class'") from error
    if not (isinstance(found, type) and issubclass(found, FallbackRung)):
        raise WideberthError(f"fallback.rungs names {name!r}, which is no FallbackRung")
    return found


def choose(rungs: Sequence[FallbackRung], trial: LadderInput, stamp: float) -> tuple[Plan, Guess]:
    """Take the first rung that holds, and write down why no better one does.

    Parameters
    ----------
    rungs : best first.
    trial : what they choose from.
    stamp : s, time of the plan's first state.

    Returns
    -------
    The plan, and its point as the problem states it.

    Raises
    ------
    WideberthError : no rung holds, or one returns something else.
    """
    words: list[str] = []
    for rung in rungs:
        found = rung.attempt(trial)
        if isinstance(found, Candidate):
            return _plan(rung.name, found, words, trial, stamp), found.point
        if not isinstance(found, NotHeld):
            raise WideberthError(
                f"the rung {str(rung.name)!r} returned {short(found)}; wanted NotHeld(reasons), "
                "or what trial.at_lowest_level returned"
            )
        words += found.reasons
    raise WideberthError(
        f"no rung of {[str(rung.name) for rung in rungs]} holds ({'; '.join(words)}); end the "
        f"tuple with {str(Rung.BRAKE)!r}, which always does"
    )


def _plan(rung: str, best: Candidate, words: list[str], trial: LadderInput, stamp: float) -> Plan:
    """Write down the plan of a rung with all that is known about it."""
    instance, outcome = trial.instance, trial.outcome
    levels = PlanLevels.of(instance, best, optimal=rung == Rung.OPTIMAL)
    breach = None if best.feasible else best.found.breach(instance.names)
    if breach is not None:
        words = [*words, f"{best.named(rung)} taken: {breach}"]
    words = [] if rung == Rung.OPTIMAL else words
    if levels.given_way is not None:
        words = [str(levels.given_way), *words]
    runs, point = outcome.solutions, best.point
    own = best.solution or (runs[0] if runs else None)
    return Plan(
        stamp=stamp,
        dt=instance.problem.dt,
        states=point.states,
        inputs=point.inputs,
        positions=instance.robot.pose(tuple(point.states.T)).points(),
        reference=instance.parameters.reference,
        auxiliaries=levels.auxiliaries,
        level=levels.level,
        target=levels.target,
        content=levels.content,
        ids=levels.ids,
        status=outcome.status if own is None else own.status,
        rung=rung,
        reason="; ".join(words),
        iterations=sum(one.iterations for one in runs),
        seconds=sum(one.seconds for one in runs),
        violation=best.found.worst,
        cost=best.cost,
        left_out=instance.around.left_out,
        breach=breach,
        given_way=levels.given_way,
        risk=instance.around.risk if breach is None and levels.given_way is None else np.nan,
    )

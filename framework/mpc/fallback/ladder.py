"""The fallback ladder: the best plan that can be had, and why it is not a better one.

Rungs, best first:

1. ``optimal``: the solver converged and the plan keeps every constraint;
2. ``feasible iterate``: it did not converge, but its last point keeps every constraint;
3. ``shifted last plan``, while it still keeps every constraint against the new forecast;
4. ``least violation``: the last point of a solve that can be driven, where that enters regions
   less than any way to stop;
5. ``brake``: the way to stop within the limits, straight on or after getting out of the way, that
   enters regions least.

The paper has no such ladder: it leaves late and failed solves to Nav2. Every setting has it here,
those called ``paper`` too.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...robot import Robot
from ...values.arrays import Array
from ...values.plan import Plan, Rung, Status
from ..levels.base import LevelPolicy, SharedLevel
from ..ocp.problem import Parameters
from ..ocp.transcription import Guess
from ..slots.base import SlotKind, level_at_first, with_auxiliaries
from ..solvers.base import Solution
from .giving_way import aimed, held
from .instance_check import TOLERANCE, Candidate, InstanceCheck, Outcome, contact
from .rollout import clip, follow, shift, stand, steer, sweep
from .stopping import stops
from .verify import price

SWITCHING_MARGIN = 0.05
"""Share of 1 + |cost| that another start has to save before the last plan is given up for it. Head
on, 2 cm of noise on the obstacle are worth 2 % to 4 %; the wrong side of one that stands 0.3 m off
the middle, 70 %."""


@dataclass(frozen=True, eq=False)
class Ladder:
    """Chooses among plans from one start.

    Attributes
    ----------
    robot, level : the plug-ins.
    kinds : of things that the plan keeps clear of.
    stamp : s, time of the first state.
    dt, horizon : of the plan.
    start : (n,), the first state.
    inputs : (N, m), the last plan's inputs from now on, or None.
    """

    robot: Robot
    kinds: tuple[SlotKind, ...]
    level: LevelPolicy
    stamp: float
    dt: float
    horizon: int
    start: Array
    inputs: Array | None = None

    def guess(self, states: Array, inputs: Array) -> Guess:
        """Wrap a trajectory as a starting point; auxiliaries are filled in later."""
        target = float("nan")
        if isinstance(self.level, SharedLevel):
            target = level_at_first(self.kinds, self.level, self.robot.dimension)
        return Guess.bare(states, inputs, target)

    def suited(self, parameters: Parameters, guess: Guess) -> Guess:
        """Fill in the auxiliaries that suit the guess's poses best."""
        return with_auxiliaries(self.robot, self.kinds, parameters, guess)

    def shifted(self, plan: Plan, *, standing: bool) -> "Ladder":
        """Return the ladder with what is left of the last plan at this one's stamp.

        Beyond its end the plan goes on without input, or ``standing``: braked to a stop and kept.
        """
        share = min((self.stamp - plan.stamp) / plan.dt, len(plan.inputs))
        if share < 0.0:
            return self
        inputs = shift(plan.inputs, share)
        if standing:
            inputs = stand(self.robot, self.start, inputs, share, self.dt)
        return replace(self, inputs=inputs)

    def first(self) -> Guess:
        """Return what to solve from first: the shifted last plan, or coasting."""
        if self.inputs is not None:
            return self.guess(follow(self.robot, self.start, self.inputs, self.dt), self.inputs)
        twist = sweep(self.robot, self.start, "coast", 0.0)
        return self.guess(*steer(self.robot, self.start, twist, self.horizon, self.dt))

    def assess(self, check: InstanceCheck, solution: Solution) -> Candidate:
        """Re-check a solution; one that did not converge is first made drivable."""
        point = solution.point
        if check.problem.shared:  # the last iterate of a solver may lie below the bound
            point = replace(point, level=max(point.level, check.problem.minimum))
        if solution.status is not Status.SOLVED:
            inputs = clip(self.robot, point.inputs)
            states = follow(self.robot, self.start, inputs, self.dt)
            point = self.suited(check.parameters, replace(point, states=states, inputs=inputs))
        found = check.check(point)
        if found.worst > TOLERANCE:
            rung = Rung.LEAST
        else:
            rung = Rung.OPTIMAL if solution.status is Status.SOLVED else Rung.FEASIBLE
        cost = solution.cost
        if rung is Rung.FEASIBLE:  # the solver's is that of its last iterate, not yet drivable
            cost = price(check.problem, check.parameters, point)
        return Candidate(point, rung, found, solution, cost=cost)

    def choose(self, check: InstanceCheck, outcome: Outcome) -> tuple[Plan, Guess]:
        """Take the best rung and write down why it is not a better one.

        Returns the plan, and its point as the problem states it.

        Parameters
        ----------
        case : what plans are held against.
        outcome : of solving.
        """
        solved = outcome.candidates
        names = check.names
        best, words = self._best(outcome), [f"solver: {outcome.message}"]
        if best is None:
            if solved and solved[0].found.worst > TOLERANCE:
                words.append(f"its plan: {solved[0].found.where(names)}")
            best, refused = self._fall_back(check, solved, names)
            words += refused
        level, given_way = held(self, check, best)
        plan = self._plan(best, check, level)
        breach = best.found.breach(names) if best.found.worst > TOLERANCE else None
        if breach is not None:
            words.append(f"{best} taken: {breach}")
        words = [] if best.rung is Rung.OPTIMAL else words
        if given_way is not None:
            words.insert(0, str(given_way))
        own = best.solution or (solved[0].solution if solved else None)
        runs = [one.solution for one in solved if one.solution is not None]
        plan = replace(
            plan,
            reason="; ".join(words),
            breach=breach,
            given_way=given_way,
            left_out=check.around.left_out,
            status=outcome.status if own is None else own.status,
            iterations=sum(one.iterations for one in runs),
            seconds=sum(one.seconds for one in runs),
            cost=best.cost,
        )
        return plan, best.point

    def _best(self, outcome: Outcome) -> Candidate | None:
        """Return the cheapest feasible plan.

        One that converged is kept unless an iterate saves more than `SWITCHING_MARGIN`; so is,
        while something stays in the way, the one that continues the last plan, so that the side is
        not changed for noise.
        """
        rungs = (Rung.OPTIMAL, Rung.FEASIBLE)
        feasible = [one for one in outcome.candidates if one.rung in rungs]
        if not feasible:
            return None
        least = min(one.cost for one in feasible)
        near = [
            one for one in feasible if one.cost - least <= SWITCHING_MARGIN * (1.0 + abs(least))
        ]
        sound = [one for one in near if one.rung is Rung.OPTIMAL] or near
        loyal = outcome.before and self.inputs is not None
        if loyal and sound[0] is outcome.candidates[0]:
            return sound[0]
        return min(sound, key=lambda one: one.cost)

    def _fall_back(
        self, check: InstanceCheck, solved: Sequence[Candidate], names: tuple[str, ...]
    ) -> tuple[Candidate, list[str]]:
        """Shifted last plan, else the least violation of what is drivable; and what was refused.

        All are held against the lowest level that the policy allows; a solution that keeps
        it is feasible after all.
        """
        drivable = [
            replace(
                self._lowest(check, one.point.states, one.point.inputs, one.rung),
                solution=one.solution,
                cost=one.cost,
            )
            for one in solved
            if one.found.motion.max() <= TOLERANCE
        ]
        for one in drivable:
            if one.found.worst <= TOLERANCE:
                return replace(one, rung=Rung.FEASIBLE), []
        refused = []
        if self.inputs is not None:
            states = follow(self.robot, self.start, self.inputs, self.dt)
            shifted = self._lowest(check, states, self.inputs, Rung.SHIFTED)
            if shifted.found.worst <= TOLERANCE:
                return shifted, []
            refused = [f"{shifted}: {shifted.found.where(names)}"]
        return self._least(check, drivable), refused

    def _least(self, check: InstanceCheck, drivable: Sequence[Candidate]) -> Candidate:
        """Of solutions and of all ways to stop, take the one with the least violation.

        What touches somebody before a stop ends comes last, whatever else it keeps. Braking
        straight on wins a tie.
        """
        ways = (
            replace(self._lowest(check, states, inputs, Rung.BRAKE), way=name)
            for name, states, inputs in stops(self.robot, self.start, self.horizon, self.dt)
        )
        straight = next(ways)
        states = straight.point.states
        window = int((np.abs(states - states[-1]).max(axis=1) > 1e-3).sum()) + 1
        depth = contact(check, straight, window)
        if max(depth, straight.found.total) == 0.0:
            return straight
        every = [(straight, depth)]
        every += [(one, contact(check, one, window)) for one in (*drivable, *ways)]
        least = min(depth for _, depth in every) + TOLERANCE
        return min(
            (one for one, depth in every if depth <= least), key=lambda one: one.found.total
        )

    def _lowest(self, check: InstanceCheck, states: Array, inputs: Array, rung: Rung) -> Candidate:
        """Re-check a trajectory at the lowest level that the policy allows."""
        shared = check.problem.shared
        level = max(check.problem.minimum, 0.0) if shared else float("nan")
        guess = replace(self.guess(states, inputs), level=level)
        point = self.suited(check.parameters, guess)
        return Candidate(point, rung, check.check(point))

    def _plan(self, best: Candidate, check: InstanceCheck, level: Array) -> Plan:
        point, places = best.point, check.around.levelled()
        return Plan(
            stamp=self.stamp,
            dt=self.dt,
            states=point.states,
            inputs=point.inputs,
            positions=self._positions(point.states),
            reference=check.parameters.reference,
            auxiliaries=_auxiliaries(check, point),
            level=level,
            target=aimed(check),
            content=content(check, level, self.robot.dimension),
            ids=tuple(name for *_, name in places),
            status=Status.NOT_RUN,
            rung=best.rung,
            violation=best.found.worst,
        )

    def _positions(self, states: Array) -> Array:
        return np.stack(self.robot.pose(tuple(states.T)).position, axis=-1)


def content(check: InstanceCheck, level: Array, dimension: int) -> Array:
    """Content that each level stands for; 0 for the paper's unbounded level below 0, (N, O)."""
    found = np.zeros_like(level)
    for column, (kind, *_) in enumerate(check.around.levelled()):
        values, place = np.unique(level[:, column], return_inverse=True)
        known = [1.0 - kind.tail(v, "content", dimension) if v > 0 else 0.0 for v in values]
        found[:, column] = np.array(known)[place]
    return found


def _auxiliaries(check: InstanceCheck, point: Guess) -> Array:
    """Auxiliaries of all used slots with a level, (N, O, A); nan where one has fewer than A."""
    columns = [point.auxiliaries[k][:, place] for _, k, place, _ in check.around.levelled()]
    wide = max((own.shape[1] for own in columns), default=0)
    found = np.full((check.problem.horizon, len(columns), wide), np.nan)
    for column, own in enumerate(columns):
        found[:, column, : own.shape[1]] = own
    return found

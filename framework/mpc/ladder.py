"""The fallback ladder: the best plan that can be had, and why it is not a better one.

Rungs, best first:

1. ``optimal``: the solver converged and the plan keeps every constraint;
2. ``feasible iterate``: it did not converge, but its last point keeps every constraint;
3. ``shifted last plan``, while it still keeps every constraint against the new forecast;
4. ``least violation``: a plan that enters a region less than braking would;
5. ``brake``: stop within the limits.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..arrays import Array
from ..forecast import Forecast
from ..plan import Plan, Rung, Status
from ..region import Region
from ..robot import Robot
from ..static_region import StaticRegion
from .bodies import with_auxiliaries
from .contact import Surroundings
from .instance import Obstacles
from .levels.base import LevelPolicy
from .problem import Parameters, Problem
from .rollout import brake, clip, follow, starting_points
from .solvers.base import Solution
from .transcription import Guess
from .verify import Violation, violation

TOLERANCE = 1e-4
"""Largest violation of a plan that counts as feasible (m, m/s or unit-free)."""


@dataclass(frozen=True, eq=False)
class Candidate:
    """A plan that could be taken, with what the re-check says of it."""

    point: Guess
    rung: Rung
    found: Violation
    solution: Solution | None = None


@dataclass(frozen=True, eq=False)
class Case:
    """What plans are held against: the instance, and all that the bodies could touch."""

    problem: Problem
    parameters: Parameters
    around: Surroundings

    def check(self, point: Guess) -> Violation:
        """Evaluate every constraint, and what is touched on the way."""
        found = violation(self.problem, self.parameters, point)
        return replace(found, touch=self.around.touched(point.states))


@dataclass(frozen=True, eq=False)
class Ladder:
    """Chooses among plans from one start.

    Attributes
    ----------
    robot, region, level : the plug-ins.
    stamp : s, time of the first state.
    dt, horizon : of the plan.
    start : (n,), the first state.
    inputs : (N, m), the last plan's inputs from now on, or None.
    static_region : what keeps clear of static polygons.
    """

    robot: Robot
    region: Region
    level: LevelPolicy
    stamp: float
    dt: float
    horizon: int
    start: Array
    inputs: Array | None
    static_region: StaticRegion | None = None

    def guess(self, states: Array, inputs: Array) -> Guess:
        """Wrap a trajectory as a starting point; auxiliaries are filled in later."""
        target = float("nan")
        if self.level.shared:
            target = self.level.levels(self.region, 1, 1, self.robot.dimension)[0, 0]
        return Guess.bare(states, inputs, float(target))

    def guesses(self, names: Sequence[str], speed: float) -> list[Guess]:
        """Return the points to solve from: the shifted last plan, or coasting, and the named."""
        points = starting_points(
            self.robot, self.start, self.inputs, names, speed, self.horizon, self.dt
        )
        return [self.guess(states, inputs) for states, inputs in points]

    def suited(self, parameters: Parameters, guess: Guess) -> Guess:
        """Fill in the auxiliaries that suit the guess's poses best."""
        return with_auxiliaries(self.robot, self.region, parameters, guess, self.static_region)

    def choose(self, case: Case, solutions: Sequence[Solution], forecast: Forecast | None) -> Plan:
        """Take the best rung and write down why it is not a better one."""
        obstacles, walls = case.around.obstacles, case.around.walls
        solved = [self._assess(case, solution) for solution in solutions]
        best = _cheapest(solved, Rung.OPTIMAL) or _cheapest(solved, Rung.FEASIBLE)
        if best is None:
            best = self._fall_back(case, solved)
        empty = ("?",) * (case.problem.capacity - len(obstacles))
        names = (*obstacles.ids, *empty, *walls.names)
        reason = "" if best.rung is Rung.OPTIMAL else self._why(solved, best, names)
        plan = self._plan(best, case.parameters, obstacles, reason)
        first = best.solution or (solutions[0] if solutions else None)
        spent = sum(solution.seconds for solution in solutions)
        return replace(
            plan,
            left_out=obstacles.left_out + walls.left_out,
            forecast=forecast,
            status=Status.NOT_RUN if first is None else first.status,
            iterations=sum(solution.iterations for solution in solutions),
            seconds=spent,
            cost=best.solution.cost if best.solution else float("nan"),
        )

    def _assess(self, case: Case, solution: Solution) -> Candidate:
        """Re-check a solution; one that did not converge is first made drivable."""
        point = solution.point
        if case.problem.shared:  # the last iterate of a solver may lie below the bound
            point = replace(point, level=max(point.level, case.problem.minimum))
        if solution.status is not Status.SOLVED:
            inputs = clip(self.robot, point.inputs)
            states = follow(self.robot, self.start, inputs, self.dt)
            point = self.suited(case.parameters, replace(point, states=states, inputs=inputs))
        found = case.check(point)
        if found.worst > TOLERANCE:
            rung = Rung.LEAST
        else:
            rung = Rung.OPTIMAL if solution.status is Status.SOLVED else Rung.FEASIBLE
        return Candidate(point, rung, found, solution)

    def _fall_back(self, case: Case, solved: Sequence[Candidate]) -> Candidate:
        """Shifted last plan, else the least violation of what is drivable.

        All are held against the lowest level that the policy allows; a solution that keeps
        it is feasible after all.
        """
        candidates = [
            replace(
                self._lowest(case, one.point.states, one.point.inputs, one.rung),
                solution=one.solution,
            )
            for one in solved
            if one.found.motion.max() <= TOLERANCE
        ]
        kept = [
            replace(one, rung=Rung.FEASIBLE) for one in candidates if one.found.worst <= TOLERANCE
        ]
        if kept:
            return kept[0]
        if self.inputs is not None:
            states = follow(self.robot, self.start, self.inputs, self.dt)
            shifted = self._lowest(case, states, self.inputs, Rung.SHIFTED)
            if shifted.found.worst <= TOLERANCE:
                return shifted
        states, inputs = brake(self.robot, self.start, self.horizon, self.dt)
        stop = self._lowest(case, states, inputs, Rung.BRAKE)
        least = min(candidates, key=lambda one: one.found.total, default=stop)
        moving = np.abs(states - states[-1]).max(axis=1) > 1e-3
        window = int(moving.sum()) + 1
        touching = _contact(case, least, window)
        if touching > _contact(case, stop, window) + TOLERANCE:
            return stop
        return least if least.found.total < stop.found.total else stop

    def _lowest(self, case: Case, states: Array, inputs: Array, rung: Rung) -> Candidate:
        """Re-check a trajectory at the lowest level that the policy allows."""
        level = max(self.level.minimum, 0.0) if case.problem.shared else float("nan")
        guess = replace(self.guess(states, inputs), level=level)
        point = self.suited(case.parameters, guess)
        return Candidate(point, rung, case.check(point))

    def _why(self, solved: Sequence[Candidate], best: Candidate, names: tuple[str, ...]) -> str:
        """Say what the solver reported and what the plan taken still breaks."""
        words = [
            f"solver: {one.solution.message}" for one in solved[:1] if one.solution is not None
        ]
        if solved and solved[0].found.worst > TOLERANCE:
            words.append(f"its plan: {solved[0].found.where(names)}")
        if best.found.worst > TOLERANCE and best.rung is not Rung.LEAST:
            words.append(f"{best.rung} taken: {best.found.where(names)}")
        return "; ".join(words)

    def _plan(
        self, best: Candidate, parameters: Parameters, obstacles: Obstacles, reason: str
    ) -> Plan:
        used = len(obstacles)
        point = best.point
        level = parameters.level[:, :used]
        if not np.isnan(point.level):  # one level for all
            level = np.full_like(level, point.level)
        return Plan(
            stamp=self.stamp,
            dt=self.dt,
            states=point.states,
            inputs=point.inputs,
            positions=self._positions(point.states),
            reference=parameters.reference,
            auxiliaries=point.auxiliaries[:, :used],
            level=level,
            target=parameters.level[:, :used],
            content=content(self.region, level, self.robot.dimension),
            ids=obstacles.ids,
            status=Status.NOT_RUN,
            rung=best.rung,
            reason=reason,
            violation=best.found.worst,
            tracked=obstacles.tracked,
        )

    def _positions(self, states: Array) -> Array:
        return np.stack(self.robot.pose(tuple(states.T)).position, axis=-1)


def _contact(case: Case, one: Candidate, window: int) -> float:
    """Return how deep a plan enters polygons or the forecast's means before a stop ends.

    The window is the steps that braking takes and one more: what lies beyond can still be
    braked for when the next plan is made.
    """
    walls = one.found.regions[:, case.problem.capacity :].max(axis=1, initial=0.0)
    depth = np.maximum(case.around.overlap(one.point.states), one.found.touched)
    return float(np.maximum(depth, walls)[:window].max(initial=0.0))


def _cheapest(candidates: Sequence[Candidate], rung: Rung) -> Candidate | None:
    """Return the candidate of this rung with the lowest cost."""
    fitting = [one for one in candidates if one.rung is rung and one.solution is not None]
    return min(fitting, key=lambda one: one.solution.cost if one.solution else 0.0, default=None)


def content(region: Region, level: Array, dimension: int) -> Array:
    """Content that each level stands for; 0 for the paper's unbounded level below 0."""
    values, place = np.unique(level, return_inverse=True)
    known = [1.0 - region.tail(value, dimension) if value > 0 else 0.0 for value in values]
    return np.asarray(known, dtype=np.float64)[place].reshape(level.shape)

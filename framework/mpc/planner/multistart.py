"""Starting points of the solver, and solving from several where it is worth it and there is time.

The first start is the last plan; the others lead round what stands in the way of it.

An interior point method goes on from its start to the nearest local optimum, and on which side
an obstacle is passed is decided there. Measured with fatrop on 420 recorded instances (`tests`
keep a sample), the share that comes within 1e-3 of the best cost that about forty set-ups found:
the shifted last plan alone 94.3 %, with ``along`` 99.8 %, with ``right`` besides 100 %. Of 16
head-on, perfectly symmetric encounters these are 9, 11 and 15; with all of `OTHERS` every one of
136 other hard instances with a known feasible point is solved to its best cost as well.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from time import perf_counter
from typing import Literal, TypeAlias

import numpy as np

from ...robot import Robot
from ...values.arrays import FARTHEST, Array
from ...values.errors import WideberthError
from ...values.motion import Pose, Twist
from ...values.plan import Plan, Status
from ..fallback.instance_check import Candidate, InstanceCheck, MultiStartResult, shared_target
from ..fallback.rollout import (
    SWEEPS,
    RobotMotion,
    clip,
    drive_each,
    shift,
    stand,
    steer,
    steer_each,
    sweep,
)
from ..fallback.verify import entered
from ..ocp.problem import Parameters, Problem
from ..ocp.progress_robot import ProgressRobot
from ..ocp.reference import Reference
from ..ocp.transcription import Guess
from ..solver import Solution, Solver, enters, on_time, pressed, solve_cheapest
from .watchdog import LeftBehind, Refused, watched

Starts: TypeAlias = tuple[str, ...] | Literal["auto"]
"""Names of starting points, or ``auto``: `OTHERS`, where something is in the way."""

OTHERS = ("along", "left", "right", "back-left", "back-right", "wait")
"""What is worth a try beside the last plan, most useful first."""

NAMES = ("along", *SWEEPS)
"""Every starting point that can be named."""

RESERVE = 0.1
"""Share of the deadline that is kept for checking the results and for falling back. A solver that
runs on is waited for during the first half of it."""

PATIENCE = 60.0
"""s that a solve may take where there is no deadline: far more than solvers need."""

COMPILING = 10.0
"""The first use of a problem, which compiles it, may take so many times the planner's patience."""

SAME = 2.0 / 3.0
"""Radii of the robot within which a further start leads to a plan that is known already. On the
other side of something a plan is farther away than the robot is wide."""

STUCK = 0.1
"""Share of its way that a plan has to come along not to be stuck. Between two people who stand, a
plan that waits is optimal among those near it, and stays so for ever."""

DEEP = 0.5
"""Share of what a level may give way from which on every start is tried again. In `blind_corner`
two of 20 episodes ended in a contact after ten decisions at the lowest level, from the last plan
and ``along`` alone, where ``back-right`` led to plans cheaper by 6 to 23 %."""


@dataclass(frozen=True)
class Budget:
    """Time of one call of the planner.

    Attributes
    ----------
    deadline : s, or None for no limit.
    begin : clock reading when the call came.
    """

    deadline: float | None
    begin: float

    @classmethod
    def start(cls, deadline: float | None) -> "Budget":
        """Begin to count."""
        return cls(deadline, perf_counter())

    def spent(self) -> float:
        """Return how long the call has taken, s."""
        return perf_counter() - self.begin

    def left(self) -> float:
        """Return what is left for solving, s; infinite without a deadline."""
        if self.deadline is None:
            return np.inf
        return (1.0 - RESERVE) * self.deadline - self.spent()

    def wait(self) -> float:
        """Return how much longer a solver is waited for, s; infinite without a deadline."""
        return self.left() + (0.0 if self.deadline is None else 0.5 * RESERVE * self.deadline)


class Watch:
    """Calls a planner's solver in a thread that is left behind where it does not return.

    Parameters
    ----------
    solver : the plug-in.
    patience : s that one solve may take where there is no deadline.
    """

    def __init__(self, solver: Solver, patience: float = PATIENCE) -> None:
        self._solver, self._patience = solver, patience
        self._name = type(solver).__name__
        self._used: set[str] = set()

    @property
    def name(self) -> str:
        """What reasons call the solver."""
        return self._name

    def solve(
        self, check: InstanceCheck, guesses: Sequence[Guess], budget: Budget
    ) -> list[Solution]:
        """Solve from each guess.

        With a deadline all of it, compilation included, may take what the budget has left.
        Without one the planner's patience counts, and more of it at the first use of a problem.

        Raises
        ------
        LeftBehind, Refused : there is no solution, see `watchdog.watched`.
        """
        call = partial(self._solver.solve, check.problem, check.parameters, guesses)
        return self._watched(check, call, len(guesses), budget)

    def solve_cheapest(
        self,
        check: InstanceCheck,
        guesses: Sequence[Guess],
        known: Sequence[Solution],
        budget: Budget,
    ) -> list[Solution]:
        """Do the same, but give up what leads to no cheaper plan, see `solver.solve_cheapest`."""
        call = partial(
            solve_cheapest, self._solver, check.problem, check.parameters, guesses, known,
            SAME * check.robot.radius,
        )  # fmt: skip
        return self._watched(check, call, len(guesses), budget)

    def _watched(
        self,
        check: InstanceCheck,
        call: Callable[[float | None], list[Solution]],
        count: int,
        budget: Budget,
    ) -> list[Solution]:
        """Call with what is left of the time for each of ``count`` solves."""
        if budget.deadline is None:
            limit = self._patience * count
            if check.problem.key not in self._used:
                limit *= COMPILING
                self._used.add(check.problem.key)
            return watched(partial(call, None), limit)
        begin, left = budget.spent(), max(budget.left(), 1e-3)

        def compiled_first() -> list[Solution]:
            check.problem.compile_now()
            return call(left)

        found = watched(compiled_first, max(budget.wait(), left))
        return [on_time(one, budget.spent() - begin, left) for one in found]


@dataclass(frozen=True, eq=False)
class MultiStart:
    """Solves one instance from the last plan first, then from other starts.

    A `CheapestSolver` gives those up that lead to no cheaper plan than is known. A plan
    that enters regions counts as known, where they have no variables of their own; no start is too
    dear because of it. A plan that fails the re-check for another reason does not count: what was
    given up because of it is then solved.

    With ``auto`` these are all of `OTHERS` when the first solve gave no feasible plan, when there
    is no last plan, when something has just come into the way, when the plan does not get
    past it (less than `STUCK` of the way), and when its level gives way far (by `DEEP`); as long
    as it stays there else, ``along`` alone. In the way is what the reference enters at the level
    aimed at, or what makes the level give way. With nothing there, or where no region presses on
    the plan, the problem is the tracking problem, and one start is enough.

    The first solve may take all the time there is. The next one begins while as much is left as
    the longest took so far, since not every solver can be stopped. One that does not return in
    time is left behind, and no other start is tried.

    Parameters
    ----------
    watch : calls the solver.
    starts : names, or auto.
    budget : of the call.
    """

    watch: Watch
    starts: Starts
    budget: Budget

    def run(self, check: InstanceCheck, first: Guess, obstacle_in_way: bool) -> MultiStartResult:
        """Solve; ``obstacle_in_way`` is what the last outcome said.

        With a deadline the constraints of the re-check are compiled where the solver is called,
        and until that is done the plans are re-checked without.
        """
        if self.budget.deadline is not None:
            check.problem.compile_later()
        try:
            return self._run(check, first, obstacle_in_way)
        except (LeftBehind, Refused) as error:
            status, message = Status.DEADLINE, f"{self.watch.name} {error}"
        except Exception as error:  # a plug-in's solver may fail in any way; the ladder goes on
            status, message = Status.FAILED, f"{type(error).__name__}: {error}"
        return MultiStartResult((), (first,), obstacle_in_way, obstacle_in_way, status, message)

    def _run(self, check: InstanceCheck, first: Guess, before: bool) -> MultiStartResult:
        parameters = check.parameters
        if self.budget.left() <= 0.0:
            message = "no time was left to solve"
            return MultiStartResult((), (first,), before, before, Status.DEADLINE, message)
        where = np.concatenate([parameters.initial, parameters.reference.ravel()])
        if not np.abs(where).max() <= FARTHEST:
            message = f"state or reference exceed {FARTHEST:g}: nothing was solved"
            return MultiStartResult((), (first,), before, before, Status.FAILED, message)
        solutions = self.watch.solve(check, [first], self.budget)
        candidates = check.assess_each(solutions)
        slots = any(one.active.any() for one in parameters.slots)
        laid = ReferenceGuess.along(check.robot, parameters, check.problem.dt) if slots else None
        there = _in_the_way(check, candidates[0], laid)
        names = self._names(check, candidates[0], there, before)
        target = shared_target(check.around.kinds, check.level, check.robot.dimension)
        aimed = replace(first, level=target)  # a warm start is at the level of the last plan
        found = other_starts(check.robot, check.problem, parameters, aimed, names, laid)
        others = check.suited_each(found)
        known: list[Solution] | None = solutions if candidates[0].optimal else []
        if _refuted(candidates[0]):  # those of other starts will be as well
            known = solutions if _enters(check, candidates[0]) else None
        more, note = self._others(check, others, known, solutions[0].seconds)
        assessed = self._assessed(check, more)
        if any(_refuted(one) and not _enters(check, one) for one in assessed):
            # others may be given up because of it
            dropped = [k for k, one in enumerate(more) if one.status is Status.GIVEN_UP]
            again, why = self._others(check, [others[k] for k in dropped], None, 0.0)
            for k, one in zip(dropped, again, strict=False):
                more[k] = replace(one, iterations=one.iterations + more[k].iterations)
            assessed, note = self._assessed(check, more), note or why
        solutions += more
        guesses = (first, *others[: len(more)])
        status, message = solutions[0].status, solutions[0].message
        return MultiStartResult(
            (*candidates, *assessed), guesses, there, before, status, message, note,
            tuple(solutions),
        )  # fmt: skip

    def _assessed(self, check: InstanceCheck, solutions: Sequence[Solution]) -> list[Candidate]:
        """Re-check what was not given up."""
        return check.assess_each([one for one in solutions if one.status is not Status.GIVEN_UP])

    def _names(
        self, check: InstanceCheck, first: Candidate, there: bool, before: bool
    ) -> Sequence[str]:
        """Return the starts that this situation asks for."""
        if self.starts != "auto":
            return self.starts
        if not first.optimal:
            return OTHERS
        if not there or (first.solution is not None and not pressed(first.solution)):
            return ()
        anew = check.last_inputs is None or not before
        every = anew or _stuck(check, first) or _gives_way_far(check, first)
        return OTHERS if every else ("along",)

    def _others(
        self,
        check: InstanceCheck,
        guesses: Sequence[Guess],
        known: Sequence[Solution] | None,
        longest: float,
    ) -> tuple[list[Solution], str]:
        """Solve from other starts while there is time; say where that was cut off.

        Those that lead to no cheaper plan than ``known``, or than one another, are given up; with
        None they are not.
        """
        solutions: list[Solution] = []
        try:
            if self.budget.deadline is None:
                return (self._solve(check, guesses, known) if guesses else []), ""
            for guess in guesses:
                if self.budget.left() < longest:
                    break
                so_far = None if known is None else [*known, *solutions]
                solutions += self._solve(check, [guess], so_far)
                longest = max(longest, solutions[-1].seconds)
        except (LeftBehind, Refused) as error:
            return solutions, f"from another start {self.watch.name} {error}"
        return solutions, ""

    def _solve(
        self, check: InstanceCheck, guesses: Sequence[Guess], known: Sequence[Solution] | None
    ) -> list[Solution]:
        if known is None:
            return self.watch.solve(check, guesses, self.budget)
        return self.watch.solve_cheapest(check, guesses, known, self.budget)


def _refuted(one: Candidate) -> bool:
    """Whether a solver calls a plan solved that does not pass the re-check."""
    assert one.solution is not None
    return one.solution.status is Status.SOLVED and not one.feasible


def _enters(check: InstanceCheck, one: Candidate) -> bool:
    """Whether a plan enters regions, so that no start which leads near it has to be solved.

    With auxiliaries that is not known: other ones at nearly the same states may keep all regions.
    In `blind_corner` (outline, seed 1) a robot was touched where starts were given up near such a
    plan.
    """
    own = one.solution
    return own is not None and enters(own) and bool(check.problem.no_auxiliaries)


def _stuck(check: InstanceCheck, solved: Candidate) -> bool:
    """Whether a plan ends where it begins, measured by the way to where its reference ends."""
    begin, end = (
        np.array(check.robot.pose(tuple(state)).position, dtype=np.float64)
        for state in (solved.point.states[0], solved.point.states[-1])
    )
    way = np.linalg.norm(check.parameters.reference[-1] - begin)
    return bool(np.linalg.norm(end - begin) < STUCK * way)


def _gives_way_far(check: InstanceCheck, solved: Candidate) -> bool:
    """Whether a plan holds less than half of what lies between lowest level and level asked."""
    if not check.problem.shared:
        return False
    asked, lowest = check.parameters.target, max(check.problem.minimum, 0.0)
    return bool(asked - solved.point.level > DEEP * (asked - lowest) > 0.0)


def _in_the_way(check: InstanceCheck, solved: Candidate, laid: "ReferenceGuess | None") -> bool:
    """Whether something stands on the reference, or makes the level give way.

    ``laid`` are states on the reference; None where there is nothing to stand in the way.
    """
    parameters, problem = check.parameters, check.problem
    if laid is None:
        return False
    point = check.guess(laid.states, np.zeros((problem.horizon, problem.inputs)))
    if entered(problem, parameters, [point]).max(initial=0.0) > 0.0:
        return True
    return problem.shared and solved.point.level < parameters.target - 1e-3


def remaining_inputs(
    robot: Robot, plan: Plan, stamp: float, start: Array, *, standing: bool
) -> Array | None:
    """Return the inputs that are left of a plan at ``stamp``, (N, m); None before it begins.

    Parameters
    ----------
    robot, start : whom, and its state at ``stamp``, (n,).
    plan : the last one.
    stamp : s.
    standing : whether it brakes and stands beyond its end; else it goes on without input.
    """
    share = min((stamp - plan.stamp) / plan.dt, len(plan.inputs))
    if share < 0.0:
        return None
    inputs = shift(plan.inputs, share)
    return stand(robot, start, inputs, share, plan.dt) if standing else inputs


def first_trajectory(
    motion: RobotMotion, start: Array, inputs: Array | None
) -> tuple[Array, Array]:
    """Return what to solve from first: the last plan's inputs driven from here, or coasting.

    Parameters
    ----------
    motion, start : of whom, and from which state (n,).
    inputs : (N, m), of the last plan from now on; None without one.

    Returns
    -------
    states : (N + 1, n). inputs : (N, m).
    """
    if inputs is not None:
        return motion.follow(start, inputs), inputs
    robot = motion.robot
    return steer(robot, start, sweep(robot, start, "coast", 0.0), motion.steps, motion.dt)


def checked_starts(starts: Starts) -> None:
    """Refuse names that are no starting point.

    Raises
    ------
    WideberthError : another word than auto, or unknown names.
    """
    if starts == "auto":
        return
    unknown = [starts] if isinstance(starts, str) else sorted(set(starts) - set(NAMES))
    if unknown:
        raise WideberthError(f"planner.starts holds {unknown}; wanted some of {NAMES}, or auto")


def other_starts(
    robot: Robot,
    problem: Problem,
    parameters: Parameters,
    guess: Guess,
    names: Sequence[str] = OTHERS,
    laid: "ReferenceGuess | None" = None,
) -> list[Guess]:
    """Return further starting points for an instance, in the order of their names.

    ``along`` lies on the reference, through whatever stands there, which leaves the choice of
    side to the solver. Every other holds a twist from x_0 on, see `rollout.sweep`, and is driven
    within the limits. A point equal to an earlier one is left out.

    Parameters
    ----------
    robot : of the problem.
    problem, parameters : the instance.
    guess : what is solved from first; it gives the shared level. Auxiliaries are filled in
        later, see `slots.base.with_auxiliaries`.
    names : of `NAMES`.
    laid : states on the reference, where they are known already.
    """
    if not names:
        return []
    found: list[Guess] = []
    known = {_numbers(guess.states)}
    for states, inputs in _trajectories(robot, problem, parameters, names, laid):
        numbers = _numbers(states)
        if numbers not in known:
            known.add(numbers)
            none = problem.no_auxiliaries
            found.append(Guess(states, inputs, none, guess.level, guess.slack))
    if isinstance(robot, ProgressRobot):
        arc = float(parameters.initial[-1])
        return [add_progress(robot, point, parameters, arc, problem.dt) for point in found]
    return found


def _numbers(states: Array) -> bytes:
    """Return what equal states have in common; -0 is 0."""
    return (states + 0.0).tobytes()


def _trajectories(
    robot: Robot,
    problem: Problem,
    parameters: Parameters,
    names: Sequence[str],
    laid: "ReferenceGuess | None",
) -> list[tuple[Array, Array]]:
    """States (N + 1, n) and inputs (N, m) of each start, see `other_starts`."""
    pace = max(float(np.abs(parameters.speed).max()), 1e-3)
    moving, start = _under_way(robot, parameters, pace), parameters.initial
    once = list(dict.fromkeys(names))
    manoeuvres = [
        [(sweep(robot, start, name, pace, None if name == "coast" else moving), problem.horizon)]
        for name in once
        if name != "along"
    ]
    found = steer_each(robot, start, manoeuvres, problem.dt)
    if "along" in once:
        laid = laid or ReferenceGuess.along(robot, parameters, problem.dt)
        found.insert(once.index("along"), (laid.states, laid.inputs(robot, problem.dt)))
    return found


def _under_way(robot: Robot, parameters: Parameters, pace: float) -> Twist:
    """Return the twist of x_0 if it kept its pace: ahead, or, without a heading, along the path.

    A turn of a robot that stands leads nowhere.
    """
    if robot.pose(tuple(parameters.initial)).heading is not None:
        return Twist((pace, 0.0))
    return Twist(tuple(float(pace * part) for part in parameters.direction[0]))


@dataclass(frozen=True, eq=False)
class ReferenceGuess:
    """States on the reference, whether or not they can be driven.

    Attributes
    ----------
    states : (N + 1, n). twists : N, from each state to the next.
    """

    states: Array
    twists: tuple[Twist, ...]

    @classmethod
    def along(cls, robot: Robot, parameters: Parameters, dt: float) -> "ReferenceGuess":
        """Lay them.

        State i is at the reference's place with the velocity that leads there from the one before;
        the heading, if there is one, looks that way.
        """
        start = parameters.initial
        here = robot.pose(tuple(start))
        begin = np.array(here.position, dtype=np.float64)
        places = np.concatenate([begin[None], parameters.reference])
        velocities = np.diff(places, axis=0) / dt
        headings = None
        if here.heading is None:
            together = Twist(tuple(velocities.T))
            twists = tuple(Twist(tuple(velocity)) for velocity in velocities.tolist())
        else:
            speeds = np.linalg.norm(velocities, axis=1)
            headings = _headings(velocities, speeds, float(here.heading))
            together = Twist((speeds, 0.0))
            twists = tuple(Twist((speed, 0.0)) for speed in speeds.tolist())
        driven = robot.state_at(Pose(tuple(places[1:].T), headings), together)
        bounds = robot.state_bounds()
        states = np.empty((len(places), len(start)))
        states[0] = start
        for k, values in enumerate(driven):
            states[1:, k] = values
        states[1:] = np.minimum(np.maximum(states[1:], bounds.lower), bounds.upper)
        return cls(states, twists)

    def inputs(self, robot: Robot, dt: float) -> Array:
        """Return the inputs that bring each twist to the next, (N, m)."""
        return clip(robot, drive_each(robot, self.states[:-1], self.twists, dt))


def _headings(velocities: Array, speeds: Array, first: float) -> Array:
    """Directions of travel without a jump by a turn; standing keeps the one before."""
    angles = np.arctan2(velocities[:, 1], velocities[:, 0])
    moving = speeds > 1e-6
    last = np.maximum.accumulate(np.where(moving, np.arange(len(speeds)) + 1, 0))
    kept = np.concatenate([[first], angles])[last]
    return np.asarray(np.unwrap(np.concatenate([[first], kept]))[1:])


def add_progress(
    robot: ProgressRobot, guess: Guess, reference: Reference | Parameters, arc: float, dt: float
) -> Guess:
    """Fill in theta and its rate, whether or not a trajectory has them already.

    theta starts at ``arc`` and moves by what each step covers in the direction of the reference
    there.
    """
    states = guess.states[:, : len(robot.robot.states)]
    places = np.stack(robot.pose(tuple(states.T)).position, axis=-1)
    theta, pace = np.full(len(places), arc), max(float(reference.speed.max()) * dt, 1e-9)
    for i, step in enumerate(np.diff(places, axis=0)):
        nearest = int(np.clip((theta[i] - arc) / pace, 0, len(reference.direction) - 1))
        theta[i + 1] = theta[i] + step @ reference.direction[nearest]
    inputs = guess.inputs[:, : len(robot.robot.inputs)]
    return replace(
        guess,
        states=np.column_stack([states, theta]),
        inputs=np.column_stack([inputs, np.diff(theta) / dt]),
    )


def strip_progress(robot: Robot, plan: Plan) -> Plan:
    """Leave the plan with the states and inputs of the robot itself."""
    if plan.states.shape[1] == len(robot.states):
        return plan
    states, inputs = plan.states[:, : len(robot.states)], plan.inputs[:, : len(robot.inputs)]
    return replace(plan, states=states, inputs=inputs)

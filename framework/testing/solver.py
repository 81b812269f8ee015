"""The contract of a Solver, checked on a unicycle with four obstacle slots, two of them used."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numpy as np

from ..mpc.assembly import assemble
from ..mpc.levels.fixed import Fixed
from ..mpc.levels.paper import Paper
from ..mpc.ocp.problem import Parameters, Problem, SlotNumbers
from ..mpc.ocp.reference import lay_reference
from ..mpc.ocp.transcription import Guess
from ..mpc.planner.rollout import steer
from ..mpc.planner.verify import price, violation
from ..mpc.slots.base import with_auxiliaries
from ..mpc.slots.gaussian_discs import GaussianDiscs, ObstacleSet, fill
from ..mpc.solver import Solution, Solver
from ..plugins.registry import load
from ..region import Region
from ..robot import Robot, start_state
from ..values.arrays import Array
from ..values.motion import Twist
from ..values.path import Path
from ..values.plan import Status
from .laws import Contract, Law, law, refusing, serving, stated

_STEPS, _DT, _SPEED, _SLOTS = 10, 0.5, 0.5, 4
_PLACES = ((2.5, 0.03), (2.0, -2.5))
"""m; of the two obstacles: one on the robot's way, one beside it."""
_KEPT = 1e-5
"""Largest violation of a plan that is called solved, in the units of the constraints."""
_SAME_COST, _SAME_STATE = 1e-5, 1e-3
"""Relative difference of costs, and difference of states, of two solves of one problem."""


@Contract
def check_solver(solver: Solver) -> Iterator[Law]:
    """Check the laws of a solver.

    It returns one solution per guess, in order, the same bytes each time. What it calls solved
    keeps dynamics, bounds and regions, costs no more than a feasible guess, and the reported cost
    is that of the point. A deadline that has passed is the status. No number makes it raise: NaN,
    and regions that nothing keeps, are a status. Numbers in unused slots change nothing, nor does
    the order of the obstacles or a full turn of the guessed heading. Soft regions cost nothing
    where they can be kept, and are paid for where not. A shared level keeps its bound. Arrays that
    do not fit the problem are refused with a `WideberthError`.

    Raises
    ------
    AssertionError : names every law that does not hold, and where.
    """
    return stated(_Trial, solver, lambda: [_Trial(solver)])


@dataclass(frozen=True, eq=False)
class _Instance:
    """A problem, the numbers of one instance, and guesses.

    Attributes
    ----------
    guesses : left and right of the obstacle, and braking; the last keeps every constraint.
    """

    problem: Problem
    parameters: Parameters
    guesses: tuple[Guess, ...]

    @property
    def numbers(self) -> SlotNumbers:
        """Numbers of the slots."""
        return self.parameters.slots[0]

    @property
    def level(self) -> Array:
        """Level of every slot."""
        assert self.numbers.level is not None
        return self.numbers.level

    @property
    def brake(self) -> Guess:
        """The guess that stops before the obstacle."""
        return self.guesses[-1]


@cache
def _instance(slots: int = _SLOTS, penalty: float | None = None) -> _Instance:
    """Make the instance: a shared level and two obstacles; without slots, no shared level."""
    robot: Robot = load("robots", "unicycle")()
    region: Region = load("regions", "mahalanobis_ellipse")()
    level = Paper() if slots else Fixed()
    kinds = (GaussianDiscs(region),)
    sizes: dict[str, Any] = {"horizon": _STEPS, "dt": _DT, "rooms": [(slots,)]}
    problem = assemble(robot, kinds, level, **sizes, penalty=penalty)
    path = Path(np.array([[0.0, 0.0], [20.0, 0.0]]))
    reference = lay_reference(path, 0.0, _SPEED, _STEPS, _DT)
    begin, _ = start_state(robot, [0.0, 0.0], [1.0, 0.0], 0.8 * _SPEED)
    start = np.array(begin, dtype=np.float64)
    crowd = _crowd() if slots else ObstacleSet.none(_STEPS, 2)
    discs = fill(reference, crowd, region, level, robot.radius, slots)
    along = reference.position, reference.direction, reference.speed
    parameters = Parameters(start, *along, (discs,), reference.curve)
    guesses = []
    for twist in (Twist((0.4, 0.0), 0.25), Twist((0.4, 0.0), -0.25), Twist((0.0, 0.0), 0.0)):
        states, inputs = steer(robot, start, twist, _STEPS, _DT)
        bare = Guess.bare(states, inputs, parameters.target if problem.shared else float("nan"))
        guesses.append(with_auxiliaries(robot, kinds, parameters, bare))
    return _Instance(problem, parameters, tuple(guesses))


def _crowd() -> ObstacleSet:
    count = len(_PLACES)
    mean = np.broadcast_to(np.array(_PLACES), (_STEPS, count, 2)).copy()
    shape = np.array([[0.002, 0.0005], [0.0005, 0.001]])
    covariance = np.broadcast_to(shape, (_STEPS, count, 2, 2))
    return ObstacleSet(mean, covariance, np.full(count, 0.1), ("ahead", "beside"))


def _blocked(parameters: Parameters) -> Parameters:
    """Let the first obstacle stand on the robot."""
    regions = parameters.slots[0].parameters.copy()
    regions[:, 0, :2] = parameters.initial[:2] + 0.1
    return _with_slots(parameters, parameters=regions)


def _with_slots(given: Parameters, /, **changes: Any) -> Parameters:
    """Change numbers of the slots."""
    (discs,) = given.slots
    return replace(given, slots=(replace(discs, **changes),))


@dataclass(frozen=True, eq=False)
class _Trial:
    """A solver on trial; each method checks one law."""

    solver: Solver

    @law("one solution per guess, in order")
    def check_order(self) -> None:
        own = _instance()
        together = self._solve(own.problem, own.parameters, own.guesses)
        self._solve(own.problem, own.parameters, ())
        for number, guess in enumerate(own.guesses):
            (alone,) = self._solve(own.problem, own.parameters, [guess])
            apart = np.abs(alone.point.states - together[number].point.states).max()
            assert apart <= _SAME_STATE, (
                f"solution {number} is {apart:.2g} from that of its guess alone"
            )
        left, right = (found.point.states[:, 1] for found in together[:2])
        apart = np.abs(left - right).max()
        assert apart > 0.1, f"guesses on two sides end within {apart:.2g} m of each other"

    @law("solved keeps every constraint")
    def check_feasible(self) -> None:
        for own in (_instance(), _instance(0)):
            for number, found in enumerate(self._solved(own)):
                broken = violation(own.problem, own.parameters, found.point).worst
                assert broken <= _KEPT, (
                    f"guess {number} ends solved with a violation of {broken:.2g}"
                )

    @law("no dearer than a feasible guess")
    def check_improves(self) -> None:
        own = _instance()
        known = price(own.problem, own.parameters, own.brake)
        begin = violation(own.problem, own.parameters, own.brake).worst
        assert begin <= _KEPT, f"the guess itself is off by {begin:.2g}"
        cost = self._solved(own)[-1].cost
        dearest = known * (1.0 + _SAME_COST)
        assert cost <= dearest, f"the plan costs {cost:.6g} and the guess {known:.6g}"

    @law("the cost is that of the point")
    def check_cost(self) -> None:
        own = _instance()
        for found in self._solved(own):
            known = price(own.problem, own.parameters, found.point)
            assert _close(found.cost, known), (
                f"the cost says {found.cost:.9g}, the point costs {known:.9g}"
            )

    @law("same input, same bytes")
    def check_repeats(self) -> None:
        own = _instance()
        first, second = (self._solve(own.problem, own.parameters, own.guesses) for _ in range(2))
        for number, (before, after) in enumerate(zip(first, second, strict=True)):
            same = _bytes(before) == _bytes(after) and before.status is after.status
            assert same, f"guess {number} ends otherwise the second time"

    @law("a deadline that has passed is the status")
    def check_deadline(self) -> None:
        own = _instance()
        for found in self._solve(own.problem, own.parameters, own.guesses, 0.0):
            late = found.status is Status.DEADLINE
            assert late, f"0 s are over, and it is {found.status}"
        early = self._solve(own.problem, own.parameters, own.guesses, 3600.0)
        known = self._solve(own.problem, own.parameters, own.guesses)
        same = list(map(_bytes, early)) == list(map(_bytes, known))
        assert same, "a deadline that is far away changes the plan"

    @law("no number makes it raise")
    def check_numbers(self) -> None:
        own = _instance()
        problem, given, guess = own.problem, own.parameters, own.guesses[0]
        nowhere = given.slots[0].parameters.copy()
        nowhere[:, 0] = np.nan
        trials = {
            "a guess of NaN": (given, replace(guess, states=np.full_like(guess.states, np.nan))),
            "a guess far away": (given, replace(guess, states=guess.states + 10.0)),
            "a level of NaN": (given, replace(guess, level=float("nan"))),
            "an initial state of NaN": (replace(given, initial=given.initial * np.nan), guess),
            "a region of NaN": (_with_slots(given, parameters=nowhere), guess),
            "a reference far away": (replace(given, reference=given.reference + 1e4), guess),
        }
        for name, (parameters, start) in trials.items():
            with serving(name):
                (found,) = self._solve(problem, parameters, [start])
            if found.status is Status.SOLVED:
                broken = violation(problem, parameters, found.point).worst
                assert broken <= _KEPT, f"{name} ends solved, and it is off by {broken:.2g}"

    @law("regions that nothing keeps are not solved")
    def check_infeasible(self) -> None:
        own = _instance()
        for found in self._solve(own.problem, _blocked(own.parameters), own.guesses):
            assert found.status is not Status.SOLVED, (
                "an obstacle stands on the robot, its region is hard, and it says solved"
            )

    @law("no slots")
    def check_empty(self) -> None:
        self._solved(_instance(0))

    @law("unused slots change nothing")
    def check_unused(self) -> None:
        own, rng = _instance(), np.random.default_rng(0)
        regions, level = own.numbers.parameters.copy(), own.level.copy()
        unused = own.numbers.active == 0.0
        regions[:, unused] = rng.uniform(0.5, 2.0, regions[:, unused].shape)
        level[:, unused] = rng.uniform(0.5, 2.0, level[:, unused].shape)
        other = _with_slots(own.parameters, parameters=regions, level=level)
        self._same(own, other, own.guesses, "other numbers in unused slots", 1e-9)

    @law("the order of the obstacles changes nothing")
    def check_permuted(self) -> None:
        own, order = _instance(), [3, 1, 2, 0]
        given = own.numbers
        other = _with_slots(
            own.parameters,
            parameters=given.parameters[:, order],
            level=own.level[:, order],
            active=given.active[order],
            auxiliaries=given.auxiliaries[:, order],
        )
        guesses = [
            replace(guess, auxiliaries=(guess.auxiliaries[0][:, order],)) for guess in own.guesses
        ]
        self._same(own, other, guesses, "another order of the obstacles", _SAME_STATE)

    @law("a full turn of the heading changes nothing")
    def check_turned(self) -> None:
        own = _instance()
        turn = np.zeros(own.problem.states)
        turn[own.problem.heading] = 2.0 * np.pi
        turned = [replace(guess, states=guess.states + turn) for guess in own.guesses]
        self._same(own, own.parameters, turned, "a guess turned by 2 pi", _SAME_STATE)

    @law("soft regions")
    def check_soft(self) -> None:
        price_of_slack = 1e4
        hard, soft = _instance(), _instance(penalty=price_of_slack)
        (kept,), (found,) = (
            self._solve(own.problem, own.parameters, own.guesses[:1]) for own in (hard, soft)
        )
        assert found.status is Status.SOLVED, f"regions that can be kept end {found.status}"
        # the slack of solvers that relax bounds falls to -1e-8 each
        gain = _STEPS * 2e-8 * price_of_slack
        assert abs(found.cost - kept.cost) <= gain + 1e-4 * (1.0 + abs(kept.cost)), (
            f"soft regions cost {found.cost:.6g}, hard ones {kept.cost:.6g}"
        )
        blocked = _blocked(soft.parameters)
        (paid,) = self._solve(soft.problem, blocked, soft.guesses[:1])
        broken = violation(soft.problem, blocked, paid.point)
        worst = broken.motion.max()
        assert paid.status is Status.SOLVED, f"paying for a region ends {paid.status}"
        assert worst <= _KEPT, f"a soft region breaks the motion: {worst:.2g}"
        assert paid.cost >= 0.5 * price_of_slack * broken.total, (
            f"regions are entered by {broken.total:.2g} in all, at a cost of {paid.cost:.3g}"
        )

    @law("the level keeps its bound")
    def check_level(self) -> None:
        own = _instance()
        for found in self._solve(own.problem, own.parameters, own.guesses):
            level = found.point.level
            assert np.isfinite(level), "a shared level is a number"
            kept = level >= own.problem.minimum - _KEPT
            assert kept, f"the level is {level:.4g}, below its minimum"
        bare = _instance(0)
        for found in self._solve(bare.problem, bare.parameters, bare.guesses):
            assert np.isnan(found.point.level), "a level that no obstacle shares is NaN"

    @law("refuses what does not fit")
    def check_refuses(self) -> None:
        own = _instance()
        short = replace(own.brake, states=own.brake.states[:-1], inputs=own.brake.inputs[:-1])
        fewer = _with_slots(own.parameters, parameters=own.numbers.parameters[:, :2])
        with refusing("a guess of fewer steps"):
            self._solve(own.problem, own.parameters, [short])
        with refusing("parameters of fewer slots"):
            self._solve(own.problem, fewer, [own.brake])

    def _solve(
        self,
        problem: Problem,
        parameters: Parameters,
        guesses: Sequence[Guess],
        deadline: float | None = None,
    ) -> list[Solution]:
        found = self.solver.solve(problem, parameters, guesses, deadline)
        counts = len(guesses), len(found)
        assert counts[0] == counts[1], f"{counts[0]} guesses and {counts[1]} solutions"
        return found

    def _solved(self, own: _Instance) -> list[Solution]:
        """Solve an instance that is easy enough for every solver."""
        solutions = self._solve(own.problem, own.parameters, own.guesses)
        for number, found in enumerate(solutions):
            solved = found.status is Status.SOLVED
            assert solved, f"guess {number} ends {found.status}: {found.message}"
        return solutions

    def _same(
        self,
        own: _Instance,
        parameters: Parameters,
        guesses: Sequence[Guess],
        what: str,
        tolerance: float,
    ) -> None:
        """Compare with the solutions of the instance itself."""
        known = self._solved(own)
        found = self._solve(own.problem, parameters, guesses)
        for before, after in zip(known, found, strict=True):
            apart = np.abs(before.point.states - after.point.states).max()
            assert apart <= tolerance, f"{what} move the plan by {apart:.2g}"
            assert _close(before.cost, after.cost), (
                f"{what} change the cost from {before.cost:.9g} to {after.cost:.9g}"
            )


def _close(cost: float, other: float) -> bool:
    return abs(cost - other) <= _SAME_COST * (1.0 + abs(other))


def _bytes(solution: Solution) -> bytes:
    """All of a solution but its time."""
    point = solution.point
    arrays: list[Array] = [point.states, point.inputs, *point.auxiliaries]
    numbers = np.array([point.level, solution.cost, solution.iterations], dtype=np.float64)
    return b"".join(np.ascontiguousarray(one).tobytes() for one in (*arrays, numbers))

"""The structured solver on problems drawn at random, against IPOPT from the same guess."""

from dataclasses import dataclass, fields, replace
from types import ModuleType
from typing import Any, cast

import numpy as np
import pytest
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st

from wideberth.controllers.costs.contouring import Contouring
from wideberth.controllers.levels.discounted import Discounted
from wideberth.framework import Path, names
from wideberth.framework.mpc.costs.base import Cost, ProgressCost
from wideberth.framework.mpc.costs.tracking import Tracking
from wideberth.framework.mpc.levels.base import LevelPolicy, SharedLevel
from wideberth.framework.mpc.levels.fixed import Fixed
from wideberth.framework.mpc.levels.relaxed import Relaxed
from wideberth.framework.mpc.ocp.problem import Parameters, Problem
from wideberth.framework.mpc.ocp.progress_robot import progress_robot_of, with_progress
from wideberth.framework.mpc.ocp.transcription import Guess
from wideberth.framework.mpc.planner.rollout import steer
from wideberth.framework.mpc.planner.verify import Violation, violation
from wideberth.framework.mpc.slots.static_polygons import NONE, choose_walls
from wideberth.framework.mpc.solver import Solution
from wideberth.framework.plugins.registry import load
from wideberth.framework.robot import Robot, start_state
from wideberth.framework.values.footprint import Discs
from wideberth.framework.values.plan import Status
from wideberth.framework.values.polygon import Polygon
from wideberth.solvers.ipopt import Ipopt
from wideberth.solvers.riccati.solver import Riccati
from wideberth.tests.helpers.problems import among, assemble, slots_of, with_auxiliaries

DT, PACE, ARC = 0.5, 0.5, 1.0
KEPT = 1e-6
"""Violation that counts as none: the tolerance of both solvers."""
LARGE = {"risk_contour"}
"""Regions too large to be compiled: fatrop solves, see test_riccati.py."""
TWO_DISCS = Discs(((0.2, 0.0), (-0.2, 0.0)), 0.3)
LEVELS: tuple[LevelPolicy, ...] = (
    Fixed(), Discounted(), Relaxed(weight=10.0, minimum=0.0), Relaxed(weight=300.0, minimum=1.0),
)  # fmt: skip
KINDS = ("driven", "standing", "noisy")


def pairs() -> list[tuple[str, str]]:
    """Every robot with every region of its dimension."""
    return [
        (robot, region)
        for robot in names("robots")
        for region in names("regions")
        if load("robots", robot)().dimension in load("regions", region).dimensions
        and region not in LARGE
    ]


@dataclass(frozen=True)
class Draw:
    """What a problem is made of; ``repr`` reproduces it.

    ``free`` leaves out the obstacles that a driven trajectory meets; without, many of these
    problems have no feasible point.
    """

    pair: tuple[str, str]
    level: LevelPolicy
    obstacles: int
    steps: int
    penalty: float | None
    walls: str | None
    cost: Cost
    discs: bool
    stop: bool
    kind: str
    free: bool
    seed: int

    def robot(self) -> Robot:
        """The robot, of two discs where it can be."""
        plain: Robot = load("robots", self.pair[0])()
        if self.discs and "footprint" in {own.name for own in fields(cast(Any, plain))}:
            plain = load("robots", self.pair[0])(footprint=TWO_DISCS)
        return plain

    def made(self, instances: ModuleType) -> tuple[Problem, Parameters, Guess]:
        """Make the problem, its numbers and the guess."""
        rng = np.random.default_rng(self.seed)
        robot, region, steps = self.robot(), load("regions", self.pair[1])(), self.steps
        size = robot.dimension
        along = np.eye(size)[0]
        start, twist = start_state(robot, 0.0 * along, along, 0.4)
        path = Path(np.stack([-along, 2.0 * (PACE * DT * steps + 5.0) * along]))
        reference = self.cost.lay(path, ARC, PACE, steps, DT)
        obstacles = instances.drift(self.obstacles, self.obstacles, reference.position, rng)
        static = load("static_regions", self.walls)() if self.walls and size == 2 else None
        walls = (
            NONE if static is None else choose_walls(_blocks(rng), static, path.points, 50.0, 5)
        )
        own = np.zeros((steps, size, size))
        plugs = robot, region, self.level, 0.0, static
        first = np.array(start, dtype=float)
        parameters = among(first, reference, obstacles, walls, own, plugs)
        discs, *polygons = parameters.slots
        problem = assemble(
            robot, region, self.level, horizon=steps, dt=DT, capacity=len(discs.active),
            cost=self.cost, penalty=self.penalty, static_region=static,
            statics=len(polygons[0].active) if polygons else 0, corners=walls.parts.shape[1],
            stop_at_end=self.stop,
        )  # fmt: skip
        states, inputs = instances.winding(robot, start, twist, steps, rng)
        if self.free:  # leave out whom this trajectory meets
            place = np.stack(robot.pose(tuple(states[1:].T)).position, axis=-1)
            met = region.contains(place[:, None], discs.parameters, discs.level)
            parameters = slots_of(parameters, active=discs.active * ~met.any(axis=0))
        if self.kind == "standing":
            states, inputs = steer(
                robot, states[0], replace(twist, linear=(0.0,) * size), steps, DT
            )
        if self.kind == "noisy":
            states[1:] += rng.normal(scale=0.3, size=states[1:].shape)
            inputs += rng.normal(scale=0.02, size=inputs.shape)
        target = parameters.target if isinstance(self.level, SharedLevel) else float("nan")
        bare = Guess.bare(states, inputs, target)
        guess = with_auxiliaries(robot, region, parameters, bare, static)
        if isinstance(self.cost, ProgressCost):
            guess = with_progress(progress_robot_of(robot), guess, reference, ARC, DT)
            parameters = replace(parameters, initial=guess.states[0])
        return problem, guess.pull(parameters), guess


def _blocks(rng: np.random.Generator) -> list[Polygon]:
    """Two turned squares beside the path."""
    found = []
    for side in (-1.0, 1.0):
        middle = np.array([rng.uniform(1.0, 4.0), side * rng.uniform(1.8, 2.6)])
        angle = rng.uniform(0.0, 1.5) + 0.5 * np.pi * np.arange(4)
        corners = middle + 0.7 * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
        found.append(Polygon(tuple((float(x), float(y)) for x, y in corners), str(side)))
    return found


@dataclass(frozen=True)
class Verdict:
    """Both solutions of one problem, as an independent check sees them."""

    ours: Solution
    theirs: Solution
    checked: tuple[Violation, Violation]
    hard: bool

    @classmethod
    def of(cls, draw: Draw, instances: ModuleType) -> "Verdict":
        problem, parameters, guess = draw.made(instances)
        (ours,) = Riccati().solve(problem, parameters, [guess])
        (theirs,) = Ipopt(tolerance=1e-6).solve(problem, parameters, [guess], 20.0)
        first, second = (violation(problem, parameters, one.point) for one in (ours, theirs))
        return cls(ours, theirs, (first, second), draw.penalty is None)

    @property
    def moves(self) -> tuple[bool, bool]:
        """Whether ours and theirs keep dynamics, bounds and robot limits."""
        ours, theirs = (float(one.motion.max()) for one in self.checked)
        return ours <= KEPT, theirs <= KEPT

    @property
    def kept(self) -> bool:
        """Whether ours moves as it can and enters hard regions no more than theirs."""
        ours, theirs = self.checked
        if not self.moves[0]:
            return False
        if not self.hard or not self.moves[1] or ours.worst <= 10.0 * KEPT:
            return True
        return ours.total <= 1.01 * theirs.total + KEPT

    @property
    def comparable(self) -> bool:
        """Whether IPOPT found a plan to compare the cost with."""
        return self.theirs.status is Status.SOLVED and self.moves[1]

    @property
    def cheap(self) -> bool:
        """Whether ours is a solution that costs at most 1 % more."""
        ours, theirs = self.ours.cost, self.theirs.cost
        return self.ours.status is Status.SOLVED and ours - theirs <= 0.01 * (1.0 + abs(theirs))


QUICK: dict[str, Any] = {
    "pair": st.sampled_from(
        [("unicycle", "mahalanobis_ellipse"), ("holonomic", "separating_line"),
         ("bicycle", "minkowski_sum")]
    ),
    "level": st.sampled_from(LEVELS),
    "obstacles": st.sampled_from((0, 1, 2, 3, 5, 8)),
    "steps": st.sampled_from((3, 8, 15, 20)),
    "penalty": st.sampled_from((None, 1e4)),
    "walls": st.none(),
    "cost": st.just(Tracking()),
    "discs": st.just(value=False),
    "stop": st.just(value=False),
    "kind": st.sampled_from(KINDS),
    "free": st.just(value=True),
    "seed": st.integers(0, 10**6),
}  # fmt: skip
"""Strategies of a `Draw`; these need few compiled kernels."""
FULL: dict[str, Any] = {
    **QUICK,
    "pair": st.sampled_from(pairs()),
    "obstacles": st.sampled_from((0, 1, 2, 3, 5, 8, 20)),
    "steps": st.sampled_from((3, 8, 15, 20, 30)),
    "walls": st.sampled_from((None, None, "separating_line", "dual")),
    "cost": st.sampled_from((Tracking(), Contouring())),
    "discs": st.booleans(),
    "stop": st.booleans(),
}


def compare(strategies: dict[str, Any], examples: int, instances: ModuleType) -> list[Verdict]:
    """Solve so many problems; each answer has to break no more than IPOPT's."""
    verdicts: list[Verdict] = []

    @settings(
        max_examples=examples, derandomize=True, deadline=None, database=None,
        phases=[Phase.generate], suppress_health_check=[HealthCheck.too_slow],
    )  # fmt: skip
    @given(st.builds(Draw, **strategies))
    def solve(draw: Draw) -> None:
        found = Verdict.of(draw, instances)
        assert found.kept, (found.ours.message, found.theirs.message)
        verdicts.append(found)

    solve()
    return verdicts


def share(verdicts: list[Verdict]) -> float:
    """Of those that IPOPT solves, how many cost at most 1 % more."""
    return float(np.mean([one.cheap for one in verdicts if one.comparable]))


def test_a_few_random_problems(instances: ModuleType) -> None:
    assert share(compare(QUICK, 25, instances)) >= 0.95


@pytest.mark.slow
def test_many_random_problems(instances: ModuleType) -> None:
    assert share(compare(FULL, 300, instances)) >= 0.95


def one_of(pair: tuple[str, str], **changes: Any) -> Draw:
    """A problem that has a feasible point."""
    plain = Draw(
        pair,
        Relaxed(weight=10.0, minimum=0.0),
        3,
        15,
        None,
        None,
        Tracking(),
        False,
        False,
        "driven",
        True,
        1,
    )
    return replace(plain, **changes)


def agree(draw: Draw, instances: ModuleType) -> None:
    found = Verdict.of(draw, instances)
    assert found.ours.status is Status.SOLVED, found.ours.message
    assert found.checked[0].worst <= 10.0 * KEPT
    assert found.cheap or not found.comparable


@pytest.mark.parametrize("number", range(len(names("robots"))))
def test_each_robot_with_a_region(number: int, instances: ModuleType) -> None:
    robot = names("robots")[number]
    mine = [pair for pair in pairs() if pair[0] == robot]
    agree(one_of(mine[2 * number % len(mine)]), instances)


@pytest.mark.slow
@pytest.mark.parametrize("pair", pairs(), ids="-".join)
def test_every_robot_with_every_region(pair: tuple[str, str], instances: ModuleType) -> None:
    agree(one_of(pair), instances)


@pytest.mark.parametrize("walls", ["separating_line", "dual"])
@pytest.mark.parametrize("penalty", [None, 1e4])
def test_static_polygons_for_two_discs(
    walls: str, penalty: float | None, instances: ModuleType
) -> None:
    pair = ("unicycle", "mahalanobis_ellipse")
    agree(one_of(pair, walls=walls, penalty=penalty, discs=True), instances)


def test_contouring(instances: ModuleType) -> None:
    pair = ("unicycle", "mahalanobis_ellipse")
    agree(one_of(pair, cost=Contouring(), level=Fixed(), stop=True), instances)


@pytest.mark.parametrize("name", ["bicycle", "holonomic_3d"])
def test_a_stop_at_the_end(name: str, instances: ModuleType) -> None:
    draw = one_of((name, "mahalanobis_ellipse"), stop=True)
    agree(draw, instances)
    problem, parameters, guess = draw.made(instances)
    (found,) = Riccati().solve(problem, parameters, [guess])
    assert float(problem.terminal_constraints(found.point.states[-1])) >= -KEPT

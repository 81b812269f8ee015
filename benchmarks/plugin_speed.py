"""Every registered region with every registered robot, on one fixed instance."""

from dataclasses import dataclass, replace

import numpy as np
from measuring import Row, Tick, brief, rotated, timed

from wideberth.framework import Path, names
from wideberth.framework.config import build
from wideberth.framework.mpc.assembly import assemble
from wideberth.framework.mpc.bodies import with_auxiliaries
from wideberth.framework.mpc.instance import Obstacles, fill
from wideberth.framework.mpc.levels.fixed import Fixed
from wideberth.framework.mpc.problem import Parameters, Problem
from wideberth.framework.mpc.reference import lay_reference
from wideberth.framework.mpc.rollout import steer
from wideberth.framework.mpc.solvers.base import Solution, Solver
from wideberth.framework.mpc.transcription import Guess
from wideberth.framework.mpc.verify import violation
from wideberth.framework.plan import Status
from wideberth.framework.region import Region
from wideberth.framework.robot import Robot, start_state

STEPS, DT = 15, 0.5
SOLVERS = ("ipopt", "fatrop")
REFERENCE = "reference"
"""IPOPT with the paper's unicycle and ellipse, measured again beside each pair."""


@dataclass(frozen=True, eq=False)
class Case:
    """A solver and the instance it is given."""

    solver: Solver
    problem: Problem
    parameters: Parameters
    guess: Guess

    def solve(self) -> Solution:
        """Solve once."""
        return self.solver.solve(self.problem, self.parameters, [self.guess])[0]


def pairs(limit: int | None) -> list[tuple[str, str]]:
    """Name the regions and robots that live in the same number of dimensions."""
    regions, robots = names("regions")[:limit], names("robots")[:limit]
    found = [(region, robot) for region in regions for robot in robots]
    return [(region, robot) for region, robot in found if _fit(region, robot)]


def measure(limit: int | None, rounds: int, tick: Tick) -> list[Row]:
    """Time both solvers on every pair: one row per pair and solver."""
    reference = _case("mahalanobis_ellipse", "unicycle", "ipopt")
    rows = []
    for region, robot in pairs(limit):
        tick(f"{region} x {robot}")
        cases = {name: _case(region, robot, name) for name in SOLVERS} | {REFERENCE: reference}
        solutions = {name: case.solve() for name, case in cases.items()}  # compiles
        times: dict[str, list[float]] = {name: [] for name in cases}
        for turn in range(rounds):
            for name in rotated(list(cases), turn):
                times[name].append(timed(cases[name].solve)[0])
        for name in SOLVERS:
            solution = solutions[name]
            case = cases[name]
            worst = violation(case.problem, case.parameters, solution.point).worst
            row = {"region": region, "robot": robot, "solver": name}
            row |= brief(times[name], times[REFERENCE])
            row |= {"iterations": solution.iterations, "violation": worst}
            rows.append(row | {"converged": solution.status is Status.SOLVED})
    return rows


def _fit(region: str, robot: str) -> bool:
    return build("robots", robot).dimension in build("regions", region).dimensions


def _case(region_name: str, robot_name: str, solver: str) -> Case:
    """Put one obstacle beside the straight path of a robot that drives at 0.4 m/s.

    The level is fixed: a level that gives way would let large regions escape the work.
    """
    region: Region = build("regions", region_name)
    robot: Robot = build("robots", robot_name)
    level, size = Fixed(), robot.dimension
    along = np.eye(size)[0]
    state, twist = start_state(robot, 0.0 * along, along, 0.4)
    start = np.array(state, dtype=np.float64)
    parameters = fill(
        start,
        lay_reference(Path(np.stack([0.0 * along, 20.0 * along])), 0.0, 0.5, STEPS, DT),
        _obstacle(size),
        region,
        level,
        robot.radius,
        1,
    )
    problem = assemble(robot, region, level, horizon=STEPS, dt=DT, capacity=1)
    turning = replace(twist, angular=-0.05 if robot.pose(state).heading is not None else 0.0)
    states, inputs = steer(robot, start, turning, STEPS, DT)
    guess = Guess.bare(states, inputs, float("nan"))
    guess = with_auxiliaries(robot, region, parameters, guess)
    parameters = replace(parameters, auxiliaries=guess.auxiliaries)
    return Case(build("solvers", solver), problem, parameters, guess)


def _obstacle(size: int) -> Obstacles:
    """Stand 4 m ahead, 0.4 m to the left, with a correlated uncertainty."""
    mean = np.zeros((STEPS, 1, size))
    mean[..., :2] = 4.0, 0.4
    covariance = np.tile(0.02 * np.eye(size), (STEPS, 1, 1, 1))
    covariance[..., :2, :2] = [[0.04, 0.01], [0.01, 0.02]]
    return Obstacles(mean, covariance, np.array([0.4]), ("a",))

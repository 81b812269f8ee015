"""The risk that a plan takes as a whole, by Monte Carlo, and what levels do to a plan."""

from itertools import pairwise

import numpy as np
import pytest

from wideberth.controllers.levels.discounted import Discounted
from wideberth.controllers.levels.risk_allocation import RiskAllocation
from wideberth.framework.mpc.levels.base import LevelPolicy, SharedLevel
from wideberth.framework.mpc.levels.fixed import Fixed
from wideberth.framework.mpc.levels.relaxed import Relaxed
from wideberth.framework.mpc.ocp.reference import lay_reference
from wideberth.framework.mpc.ocp.transcription import Guess
from wideberth.framework.mpc.planner.rollout import steer
from wideberth.framework.mpc.planner.verify import violation
from wideberth.framework.mpc.slots.gaussian_discs import ObstacleSet
from wideberth.framework.mpc.solver import Solution, Solver
from wideberth.framework.region import Region
from wideberth.framework.values.motion import Pose, Twist
from wideberth.framework.values.path import Path
from wideberth.framework.values.plan import Status
from wideberth.regions.half_plane import HalfPlane
from wideberth.regions.luetkepohl_rectangle import LuetkepohlRectangle
from wideberth.regions.mahalanobis_ellipse import MahalanobisEllipse
from wideberth.regions.minimum_area import MinimumArea
from wideberth.regions.minkowski_sum import MinkowskiSum
from wideberth.robots.holonomic import Holonomic
from wideberth.solvers.fatrop import Fatrop
from wideberth.solvers.ipopt import Ipopt
from wideberth.tests.helpers.problems import assemble, fill, with_auxiliaries

STEPS, DT, DRAWS = 12, 0.5, 40_000
ROBOT = Holonomic(radius=0.3)
TAIL = 0.1
RADIUS = 0.3


def crowd() -> ObstacleSet:
    """Two obstacles, one of them with two futures; all deviations grow with the time."""
    ahead = DT * np.arange(1, STEPS + 1, dtype=np.float64)[:, None]
    ways = [
        np.array([0.3, 1.3]) + ahead * [0.5, -0.06],
        np.array([4.5, -3.2]) + ahead * [-0.2, 0.05],
        np.array([4.5, -3.2]) + ahead * [-0.3, 0.12],
    ]
    shape = np.array([[1.0, 0.4], [0.4, 0.6]])
    covariance = (0.02 + 0.004 * ahead[:, :, None] ** 2) * shape
    mean = np.stack(ways, axis=1)
    repeated = np.repeat(covariance[:, None], 3, axis=1)
    return ObstacleSet(mean, repeated, np.full(3, RADIUS), ("a", "b", "b"))


def solve(region: Region, level: LevelPolicy, solver: Solver | None = None) -> Solution:
    """Plan through the crowd; the plan keeps every region."""
    start = np.array(ROBOT.state_at(Pose((0.0, 0.0)), Twist((0.4, 0.0))), dtype=float)
    reference = lay_reference(Path(np.array([[0.0, 0.0], [9.0, 0.0]])), 0.0, 0.5, STEPS, DT)
    parameters = fill(start, reference, crowd(), region, level, ROBOT.radius, 5)
    problem = assemble(ROBOT, region, level, horizon=STEPS, dt=DT, capacity=5, penalty=1e4)
    states, inputs = steer(ROBOT, start, Twist((0.3, -0.3)), STEPS, DT)
    scale = region.level(level.tail) if isinstance(level, SharedLevel) else float("nan")
    guess = with_auxiliaries(ROBOT, region, parameters, Guess.bare(states, inputs, scale))
    parameters = guess.pull(parameters)
    (found,) = (solver or Fatrop()).solve(problem, parameters, [guess])
    assert found.status is Status.SOLVED, found.message
    assert violation(problem, parameters, found.point).worst < 1e-4
    return found


def collisions(solution: Solution) -> float:
    """Share of futures, drawn from the forecast, in which the plan touches any obstacle."""
    rng, obstacles = np.random.default_rng(1), crowd()
    way = np.stack(ROBOT.pose(tuple(solution.point.states[1:].T)).position, axis=-1)
    root = np.linalg.cholesky(obstacles.covariance)
    shocks = rng.standard_normal((DRAWS, STEPS, 3, 2))
    drawn = obstacles.mean + np.einsum("tkij,ntkj->ntki", root, shocks)
    apart = np.linalg.norm(drawn - way[:, None], axis=3)
    hit = (apart < ROBOT.radius + RADIUS).any(axis=1)
    second = np.where(rng.random(DRAWS) < 0.3, hit[:, 1], hit[:, 2])  # which of its futures
    return float((hit[:, 0] | second).mean())


def bound(share: float) -> float:
    """Three standard deviations of a share of the draws above it."""
    return share + 3.0 * float(np.sqrt(share * (1.0 - share) / DRAWS))


@pytest.mark.parametrize(
    ("region", "policy"),
    [
        (MinkowskiSum(), RiskAllocation(TAIL, 1.0)),
        (MinkowskiSum(), RiskAllocation(TAIL, 0.0, "risk")),
        (MinimumArea(), RiskAllocation(TAIL, 0.0)),
        (HalfPlane(), RiskAllocation(TAIL, 1.5, "risk")),
        (LuetkepohlRectangle(), RiskAllocation(TAIL, 1.5)),
    ],
    ids=repr,
)
def test_the_plan_as_a_whole_keeps_its_risk(region: Region, policy: LevelPolicy) -> None:
    assert collisions(solve(region, policy)) <= bound(TAIL)


def test_the_bound_is_not_empty_and_levels_step_by_step_do_not_keep_it() -> None:
    """One of two obstacles is in the way, at most steps, so that half of the risk is taken."""
    whole = collisions(solve(MinkowskiSum(), RiskAllocation(TAIL, 1.0, "risk")))
    single = collisions(solve(MinkowskiSum(), Fixed(TAIL, "risk")))
    assert 0.1 * TAIL < whole <= bound(TAIL)
    assert single > bound(TAIL)


POLICIES = [Fixed(), Relaxed(minimum=1.0, weight=10.0), Discounted(), RiskAllocation()]


@pytest.mark.parametrize("policy", POLICIES, ids=repr)
def test_solvers_agree_on_every_policy(policy: LevelPolicy) -> None:
    one, two = (solve(MahalanobisEllipse(), policy, solver) for solver in (Fatrop(), Ipopt()))
    assert one.cost == pytest.approx(two.cost, rel=1e-3)
    assert one.point.states == pytest.approx(two.point.states, abs=2e-2)


def test_what_a_policy_gives_up_makes_the_plan_cheaper() -> None:
    cost = {
        name: solve(MahalanobisEllipse(), policy).cost
        for name, policy in {
            "whole": RiskAllocation(),
            "fixed": Fixed(),
            "late": Discounted(final_tail=0.5, full_steps=6),
            "early": Discounted(final_tail=0.5),
            "all": Fixed(0.5),
        }.items()
    }
    for dearer, cheaper in pairwise(cost.values()):
        assert cheaper <= dearer * (1.0 + 1e-6)
    assert cost["early"] < 0.9 * cost["fixed"]


def test_a_shared_level_keeps_its_bound() -> None:
    held = solve(MahalanobisEllipse(), Relaxed(weight=0.01, minimum=1.5)).point.level
    free = solve(MahalanobisEllipse(), Relaxed(weight=0.01, minimum=-np.inf)).point.level
    assert held == pytest.approx(1.5, abs=1e-3)
    assert free < 1.5

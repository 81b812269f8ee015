"""Regions in the problem of the planner: it is solved, and the plan stays outside."""

import numpy as np
import pytest

from wideberth.framework.mpc.levels.base import LevelPolicy
from wideberth.framework.mpc.levels.fixed import Fixed
from wideberth.framework.mpc.levels.relaxed import Relaxed
from wideberth.framework.mpc.planner.verify import violation
from wideberth.framework.region import Guarantee, Region
from wideberth.framework.risk.collision_probability import collision_probability
from wideberth.framework.values.plan import Status
from wideberth.regions.separating_line import SeparatingLine
from wideberth.robots.unicycle import Unicycle
from wideberth.solvers.fatrop import Fatrop
from wideberth.solvers.ipopt import Ipopt
from wideberth.tests.helpers.problems import set_up
from wideberth.tests.helpers.region_samples import BY_RISK, OUTER, RECTANGLES


@pytest.mark.parametrize(
    "level", [Fixed(0.05), Relaxed(0.05, weight=100.0, minimum=0.0)], ids=repr
)
@pytest.mark.parametrize("region", [*OUTER, *RECTANGLES, SeparatingLine()], ids=repr)
def test_the_planner_solves(region: Region, level: LevelPolicy) -> None:
    costs = []
    for solver in (Ipopt(), Fatrop()):
        problem, parameters, guess = set_up(Unicycle(), region, level, 1)
        (solution,) = solver.solve(problem, parameters, [guess])
        assert solution.status is Status.SOLVED, (solver, solution.message)
        assert violation(problem, parameters, solution.point).worst < 1e-4
        costs.append(solution.cost)
    assert costs[0] == pytest.approx(costs[1], rel=1e-3)


@pytest.mark.parametrize("region", [*BY_RISK, SeparatingLine()], ids=repr)
def test_drives_the_planner(region: Region) -> None:
    problem, parameters, guess = set_up(Unicycle(), region, Fixed(0.05), 1, y=1.3)
    (solution,) = Ipopt().solve(problem, parameters, [guess])
    assert solution.status is Status.SOLVED, solution.message
    assert violation(problem, parameters, solution.point).worst < 1e-4
    place = np.stack(Unicycle().pose(tuple(solution.point.states[1:].T)).position, -1)
    level = parameters.slots[0].level[:, 0] * (1 - 1e-4) - 1e-4
    assert not region.contains(place, parameters.slots[0].parameters[:, 0], level).any()
    if region.guarantee is Guarantee.CONTENT:
        risk = collision_probability(
            place - [4.0, 1.3], [[0.04, 0.01], [0.01, 0.02]], 0.4 + Unicycle().radius
        )
        assert risk.max() <= 0.05 * 1.01

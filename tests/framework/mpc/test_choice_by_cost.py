"""The plan taken is the cheapest feasible one, however its solve ended."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import pytest

from wideberth.framework.mpc.levels.base import LevelPolicy
from wideberth.framework.mpc.levels.fixed import Fixed
from wideberth.framework.mpc.levels.relaxed import Relaxed
from wideberth.framework.mpc.ocp.problem import Parameters, Problem
from wideberth.framework.mpc.ocp.reference import lay_reference
from wideberth.framework.mpc.ocp.transcription import Guess, Transcription
from wideberth.framework.mpc.planner.planner import Planner
from wideberth.framework.mpc.planner.rollout import brake, steer
from wideberth.framework.mpc.planner.verify import price
from wideberth.framework.mpc.slots.gaussian_discs import ObstacleSet
from wideberth.framework.mpc.solver import Solution, Solver
from wideberth.framework.numerics.symbolic import ca
from wideberth.framework.region import Region
from wideberth.framework.values.motion import Detection, Observation, Twist
from wideberth.framework.values.path import Path
from wideberth.framework.values.plan import Rung, Status
from wideberth.predictors.static import Static
from wideberth.regions.mahalanobis_ellipse import MahalanobisEllipse
from wideberth.regions.minkowski_sum import MinkowskiSum
from wideberth.robots.unicycle import Unicycle
from wideberth.tests.helpers.problems import assemble, fill, with_auxiliaries

START = np.array([0.0, 0.0, 0.0, 0.4, 0.0])
WAY = Path(np.array([[0.0, 0.0], [20.0, 0.0]]))
STEPS, DT = 15, 0.5


@pytest.mark.parametrize("region", [MahalanobisEllipse(), MinkowskiSum()], ids=repr)
@pytest.mark.parametrize("level", [Fixed(), Relaxed(weight=15.0, minimum=0.0)], ids=repr)
@pytest.mark.parametrize("penalty", [None, 1e4])
def test_the_price_is_the_objective_that_solvers_are_given(
    region: Region, level: LevelPolicy, penalty: float | None
) -> None:
    robot = Unicycle()
    mean = np.tile([4.0, 2.0], (STEPS, 1, 1))
    covariance = np.tile(0.04 * np.eye(2), (STEPS, 1, 1, 1))
    obstacles = ObstacleSet(mean, covariance, np.array([0.3]), ("a",))
    reference = lay_reference(WAY, 0.0, 0.5, STEPS, DT)
    parameters = fill(START, reference, obstacles, region, level, robot.radius, 2)
    problem = assemble(robot, region, level, horizon=STEPS, dt=DT, capacity=2, penalty=penalty)
    bare = Guess.bare(*steer(robot, START, Twist((0.5, 0.0), 0.1), STEPS, DT), 1.7)
    point = with_auxiliaries(robot, region, parameters, bare)
    parameters = point.pull(parameters)
    if not problem.shared:
        point = replace(point, level=float("nan"))
    point = replace(
        point, auxiliaries=(point.auxiliaries[0] + 0.1,)
    )  # leaves the pull of the guess
    for staged in (False, True):
        form = Transcription(problem, staged=staged, symbol=ca.SX)
        program = form.nlp()
        objective = ca.Function("objective", [program["x"], program["p"]], [program["f"]])
        wanted = float(objective(form.pack(point), form.parameters(parameters)))
        assert price(problem, parameters, point) == pytest.approx(wanted, rel=1e-12)


@dataclass(frozen=True)
class Stopping(Solver):
    """Claims that stopping is optimal; from the last start it drives on, and says ``status``."""

    status: Status

    def solve(
        self,
        problem: Problem,
        parameters: Parameters,
        guesses: Sequence[Guess],
        deadline: float | None = None,
    ) -> list[Solution]:
        robot, found = Unicycle(), []
        for guess in guesses:
            last = guess is guesses[-1] and len(guesses) > 1
            way = steer(robot, START, Twist((0.5, 0.0), 0.0), STEPS, DT)
            states, inputs = way if last else brake(robot, START, STEPS, DT)
            point = replace(guess, states=states, inputs=inputs)
            status = self.status if last else Status.SOLVED
            cost = price(problem, parameters, point)
            cost = 7.0 if last and status is not Status.SOLVED else cost  # of some other iterate
            found.append(Solution(point, status, "stub", cost, 1, 0.0))
        return found


@pytest.mark.parametrize("status", [Status.SOLVED, Status.LIMIT])
def test_a_feasible_iterate_beats_a_dearer_optimum(status: Status) -> None:
    """Driving on costs a tenth of stopping; that its solve did not end is no reason to stop."""
    planner = Planner(
        Unicycle(), MahalanobisEllipse(), Static(), Fixed(), Stopping(status),
        starts=("left", "right"),
    )  # fmt: skip
    planner.set_path(WAY)
    seen = Detection("a", np.array([4.0, 5.0]), 1e-4 * np.eye(2), 0.3)
    planner.command(Observation(0.0, START, (seen,)))
    plan = planner.plan
    assert plan is not None
    assert plan.rung is (Rung.OPTIMAL if status is Status.SOLVED else Rung.FEASIBLE)
    assert plan.positions[-1, 0] > 3.0
    record = planner.explain()
    priced = price(record.problem(), record.parameters, record.point)
    assert plan.cost == pytest.approx(priced)

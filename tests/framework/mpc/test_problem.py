"""The assembled problem: the same meaning for every robot, region, size and form."""

from dataclasses import replace

import numpy as np
import pytest

from wideberth.framework.mpc.costs.base import Weights
from wideberth.framework.mpc.costs.tracking import Tracking
from wideberth.framework.mpc.fallback.rollout import steer
from wideberth.framework.mpc.fallback.verify import violation
from wideberth.framework.mpc.levels.base import LevelPolicy, SharedLevel
from wideberth.framework.mpc.levels.fixed import Fixed
from wideberth.framework.mpc.levels.relaxed import Relaxed
from wideberth.framework.mpc.ocp.reference import lay_reference
from wideberth.framework.mpc.ocp.transcription import Guess, Transcription
from wideberth.framework.mpc.slots.gaussian_discs import Obstacles
from wideberth.framework.mpc.solvers.fatrop import Fatrop
from wideberth.framework.mpc.solvers.ipopt import Ipopt
from wideberth.framework.numerics.symbolic import ca
from wideberth.framework.region import Region
from wideberth.framework.robot import Robot
from wideberth.framework.values.errors import WideberthError
from wideberth.framework.values.motion import Twist
from wideberth.framework.values.path import Path
from wideberth.framework.values.plan import Status
from wideberth.regions.mahalanobis_ellipse import MahalanobisEllipse
from wideberth.regions.minkowski_sum import MinkowskiSum
from wideberth.robots.bicycle import Bicycle
from wideberth.robots.differential_drive import DifferentialDrive
from wideberth.robots.holonomic import Holonomic
from wideberth.robots.unicycle import Unicycle
from wideberth.tests.helpers.problems import DT, STEPS, assemble, fill, set_up
from wideberth.tests.helpers.region_samples import PAPER

ROBOTS = [Unicycle(), DifferentialDrive(), Bicycle(), Holonomic()]


@pytest.mark.parametrize("robot", ROBOTS, ids=lambda robot: type(robot).__name__)
@pytest.mark.parametrize("region", PAPER, ids=repr)
def test_any_robot_and_region_solve(robot: Robot, region: Region) -> None:
    problem, parameters, guess = set_up(robot, region, Fixed(0.05), 1)
    for solver in (Ipopt(), Fatrop()):
        (solution,) = solver.solve(problem, parameters, [guess])
        assert solution.status is Status.SOLVED, (solver, solution.message)
        assert violation(problem, parameters, solution.point).worst < 1e-4
        place = np.stack(robot.pose(tuple(solution.point.states[1:].T)).position, -1)
        (numbers,) = parameters.slots
        assert numbers.level is not None
        inside = region.contains(
            place, numbers.parameters[:, 0], numbers.level[:, 0] * (1 - 1e-4) - 1e-4
        )
        assert not inside.any()


@pytest.mark.parametrize(
    "level", [Fixed(0.05), Relaxed(0.05, weight=100.0, minimum=0.0)], ids=repr
)
def test_empty_slots_change_nothing(level: LevelPolicy) -> None:
    costs = []
    for capacity in (1, 2, 5):
        for solver in (Ipopt(), Fatrop()):
            problem, parameters, guess = set_up(
                Unicycle(), MinkowskiSum(), level, capacity, penalty=1e4
            )
            (solution,) = solver.solve(problem, parameters, [guess])
            assert solution.status is Status.SOLVED
            costs.append(solution.cost)
    assert np.ptp(costs) < 1e-3 * abs(costs[0])


def test_no_obstacle_needs_no_slot() -> None:
    level = Relaxed(weight=1.0, minimum=0.0)
    robot, region = Unicycle(), MahalanobisEllipse()
    start = np.array([0.0, 0.3, 0.0, 0.5, 0.0])
    path = Path(np.array([[0.0, 0.0], [20.0, 0.0]]))
    none = Obstacles(np.zeros((STEPS, 0, 2)), np.zeros((STEPS, 0, 2, 2)), np.zeros(0), ())
    reference = lay_reference(path, 0.0, 0.5, STEPS, DT)
    parameters = fill(start, reference, none, region, level, 0.75, 0)
    problem = assemble(robot, region, level, horizon=STEPS, dt=DT, capacity=0, penalty=1e4)
    states, inputs = steer(robot, start, Twist((0.5, 0.0)), STEPS, DT)
    guess = Guess.bare(states, inputs, 0.0)
    costs = [solver.solve(problem, parameters, [guess])[0].cost for solver in (Ipopt(), Fatrop())]
    assert costs[0] == pytest.approx(costs[1], rel=1e-5)
    assert costs[0] > 0


def test_weights_mean_the_same_for_every_robot() -> None:
    """Straight ahead with the same acceleration costs the same whatever the robot is."""
    totals = []
    for robot in (Unicycle(), DifferentialDrive(), Bicycle(), Holonomic()):
        problem, parameters, _ = set_up(robot, MahalanobisEllipse(), Fixed(), 1)
        states, inputs = steer(robot, parameters.initial, Twist((0.45, 0.0)), STEPS, DT)
        heads = parameters.stages()[:, : problem.head_width]
        cost = 0.0
        for i in range(STEPS):
            cost += float(problem.input_cost(states[i], inputs[i], heads[i]))
            cost += float(problem.state_cost(states[i + 1], heads[i]))
        totals.append(cost)
    assert totals == pytest.approx([totals[0]] * 4, rel=1e-6)


def test_the_key_tells_problems_apart() -> None:
    keys = set()
    for cost in (Tracking(), Tracking(Weights(position=101.0))):
        for dt in (0.5, 0.4):
            for penalty in (None, 1e4):
                problem = assemble(
                    Unicycle(),
                    MahalanobisEllipse(),
                    Fixed(),
                    horizon=3,
                    dt=dt,
                    capacity=1,
                    cost=cost,
                    penalty=penalty,
                )
                keys.add(problem.key)
    assert len(keys) == 8
    again = assemble(Unicycle(), MahalanobisEllipse(), Fixed(), horizon=3, dt=0.5, capacity=1)
    assert again.key in keys


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"horizon": 0}, "horizon is 0"),
        ({"horizon": 2.5}, "horizon is 2.5"),
        ({"dt": 0.0}, "dt is 0"),
        ({"capacity": -1}, "room for each obstacle is -1"),
        ({"penalty": -1.0}, "penalty is -1"),
    ],
)
def test_sizes_that_make_no_problem_are_refused(change: dict[str, float], words: str) -> None:
    sizes = {"horizon": 15, "dt": 0.5, "capacity": 1, **change}
    with pytest.raises(WideberthError, match=words):
        assemble(Unicycle(), MahalanobisEllipse(), Fixed(), **sizes)  # type: ignore[arg-type]


def test_violation_names_obstacle_and_step() -> None:
    problem, parameters, guess = set_up(Unicycle(), MahalanobisEllipse(), Fixed(), 1, y=0.0)
    states, inputs = steer(Unicycle(), parameters.initial, Twist((0.5, 0.0)), STEPS, DT)
    found = violation(problem, parameters, replace(guess, states=states, inputs=inputs))
    assert found.worst > 0.5
    assert "region of 'a'" in found.where(("a",))
    broken = replace(guess, inputs=guess.inputs + 2.0)
    assert "motion limits" in violation(problem, parameters, broken).where(("a",))
    numb = replace(guess, states=guess.states * np.nan)
    assert violation(problem, parameters, numb).worst == np.inf


@pytest.mark.parametrize("level", [Fixed(0.05), Relaxed(weight=1.0)], ids=repr)
def test_every_row_constrains_something(level: LevelPolicy) -> None:
    """One level for all steps needs no rows that hold it constant; levels of steps do."""
    problem, _, _ = set_up(Unicycle(), MinkowskiSum(), level, 1, penalty=10.0)
    rows = {}
    for staged in (False, True):
        program = Transcription(problem, staged=staged, symbol=ca.SX).nlp()
        filled = ca.jacobian(program["g"], program["x"]).sparsity()
        rows[staged] = filled.size1()
        assert set(filled.row()) == set(range(rows[staged]))
    held = STEPS if isinstance(level, SharedLevel) else 0
    assert rows[True] - rows[False] == problem.states + held  # the first state is a variable


def test_what_is_free_needs_no_slack() -> None:
    """Where every region can be kept, a soft problem has the solution of the hard one."""
    found = []
    for penalty in (None, 1e4):
        problem, parameters, guess = set_up(Unicycle(), MinkowskiSum(), Fixed(0.05), 1, penalty)
        (solution,) = Fatrop().solve(problem, parameters, [guess])
        assert solution.status is Status.SOLVED
        found.append(solution)
    assert found[1].point.slack.max() < 1e-6
    assert found[1].cost == pytest.approx(found[0].cost, rel=1e-3)


def test_a_stop_is_one_row_more() -> None:
    """At the end of the horizon alone."""
    rows = [
        Transcription(
            assemble(
                Unicycle(), MahalanobisEllipse(), Fixed(0.05), horizon=5, dt=DT, capacity=1,
                stop_at_end=stop,
            ),
            staged=True, symbol=ca.SX,
        ).nlp()["g"].numel()
        for stop in (False, True)
    ]  # fmt: skip
    assert rows[1] - rows[0] == 1

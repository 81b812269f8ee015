"""Many instances solved at once: fatrop, ipopt, and each instance alone, are the oracles."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path as File

import numpy as np
import pytest

from wideberth.framework.mpc.fallback.rollout import steer
from wideberth.framework.mpc.fallback.verify import violation
from wideberth.framework.mpc.levels.fixed import Fixed
from wideberth.framework.mpc.levels.paper import Paper
from wideberth.framework.mpc.ocp.problem import Parameters, Problem
from wideberth.framework.mpc.ocp.reference import lay_reference
from wideberth.framework.mpc.ocp.transcription import Guess
from wideberth.framework.mpc.slots.gaussian_discs import ObstacleSet
from wideberth.framework.mpc.slots.static_polygons import choose_walls, fill_walls
from wideberth.framework.mpc.solver import solve_many
from wideberth.framework.values.errors import WideberthError
from wideberth.framework.values.forecast import GaussianObstacle
from wideberth.framework.values.motion import Pose, Twist
from wideberth.framework.values.path import Path
from wideberth.framework.values.plan import Status
from wideberth.framework.values.polygon import Polygon
from wideberth.regions.mahalanobis_ellipse import MahalanobisEllipse
from wideberth.regions.minkowski_sum import MinkowskiSum
from wideberth.regions.risk_contour import RiskContour
from wideberth.regions.static.separating_line import StaticSeparatingLine
from wideberth.robots.holonomic import Holonomic
from wideberth.robots.unicycle import Unicycle
from wideberth.solvers.batch import Batch, BatchSolution, solve_batch
from wideberth.solvers.fatrop import Fatrop
from wideberth.solvers.ipopt import Ipopt
from wideberth.solvers.riccati.solver import Riccati
from wideberth.tests.helpers.problems import assemble, fill, slots_of, with_auxiliaries
from wideberth.tests.oracles.recorded_instances import (
    Instance,
    read_instances,
    worst_violation,
)

SAMPLE = File(__file__).parents[1] / "data" / "mpc_instances.npz"
ONE = 1  # obstacle; those of the sample with so many


@pytest.fixture(scope="module")
def recorded() -> list[Instance]:
    found = read_instances(SAMPLE, MahalanobisEllipse())
    return [instance for instance in found if instance.obstacles == ONE][:8]


@pytest.fixture(scope="module")
def paper() -> Problem:
    level = Paper(tail=float(np.exp(-5.991 / 2)))
    return assemble(Unicycle(), MahalanobisEllipse(), level, horizon=15, dt=0.5, capacity=ONE)


@pytest.fixture(scope="module")
def together(paper: Problem, recorded: list[Instance]) -> BatchSolution:
    return solved(paper, recorded)


def solved(
    problem: Problem, instances: Sequence[Instance], width: int | None = None
) -> BatchSolution:
    parameters, guesses = zip(*((one.parameters, one.guess) for one in instances), strict=True)
    return solve_batch(problem, parameters, guesses, width=width)


def test_recorded_instances_reach_the_cost_of_fatrop(
    paper: Problem, recorded: list[Instance], together: BatchSolution
) -> None:
    assert together.status == (Status.SOLVED,) * len(recorded)
    gaps = []
    for i, instance in enumerate(recorded):
        assert worst_violation(instance, together.point(i)) < 1e-6
        assert together.violation[i] < 1e-6
        (other,) = Fatrop().solve(paper, instance.parameters, [instance.guess])
        gaps.append(abs(together.cost[i] - other.cost) / (1.0 + abs(other.cost)))
    # the two may pass an obstacle on different sides
    assert np.mean(np.array(gaps) < 1e-5) >= 0.9


def test_an_instance_ends_alone_as_among_others(
    paper: Problem, recorded: list[Instance], together: BatchSolution
) -> None:
    for i in (0, len(recorded) - 1):
        alone = solved(paper, recorded[i : i + 1])
        np.testing.assert_allclose(alone.states[0], together.states[i], atol=1e-9)
        np.testing.assert_allclose(alone.inputs[0], together.inputs[i], atol=1e-9)
        assert alone.iterations[0] == together.iterations[i]


def test_bad_ones_do_not_spoil_the_others(
    paper: Problem, recorded: list[Instance], together: BatchSolution
) -> None:
    broken = replace(recorded[1].parameters, initial=np.full(5, np.nan))
    first = recorded[3].parameters
    centre = np.broadcast_to(first.initial[:2], (15, 1, 2))
    vast = GaussianObstacle(centre, np.broadcast_to(np.eye(2), (15, 1, 2, 2)))
    within = MahalanobisEllipse().parameters(vast, np.full((15, 1), 9.0))
    caught = slots_of(first, parameters=within)
    cases = list(recorded[:4])
    cases[1] = replace(cases[1], parameters=broken)
    cases[3] = replace(cases[3], parameters=caught)
    found = solved(paper, cases)
    assert found.status[1] is Status.FAILED
    assert found.status[3] is Status.INFEASIBLE and found.violation[3] > 0.1
    point = found.point(3)  # still a plan that keeps dynamics and limits
    assert violation(paper, slots_of(caught, active=np.zeros(1)), point).worst < 1e-6
    for i in (0, 2):
        assert found.status[i] is Status.SOLVED
        np.testing.assert_allclose(found.states[i], together.states[i], atol=1e-9)


STEPS, DT = 6, 0.5
ROBOT, REGION, WALL = Holonomic(radius=0.3), MinkowskiSum(), StaticSeparatingLine()


def passage(shift: float, edge: float) -> tuple[Parameters, Guess]:
    """One obstacle crosses the way, a block stands beside it; the second slot is empty."""
    ahead = DT * np.arange(1, STEPS + 1)[:, None]
    mean = np.array([1.8 + shift, 1.0]) + ahead * [-0.2, -0.3]
    shape = np.array([[0.05, 0.02], [0.02, 0.03]])
    covariance = np.broadcast_to(shape, (STEPS, 1, 2, 2))
    obstacles = ObstacleSet(mean[:, None], covariance, np.full(1, 0.3), ("a",))
    start = np.array(ROBOT.state_at(Pose((0.0, 0.0)), Twist((0.4, 0.0))), dtype=float)
    reference = lay_reference(Path(np.array([[0.0, 0.0], [9.0, 0.0]])), 0.0, 0.5, STEPS, DT)
    moving = fill(start, reference, obstacles, REGION, Fixed(), ROBOT.radius, 2)
    corners = ((0.3, edge), (0.3, edge - 1.0), (1.3, edge - 1.0), (1.3, edge))
    walls = choose_walls([Polygon(corners, "block")], WALL, reference.position, 9.0, 1)
    still = fill_walls(walls, WALL, ROBOT.radius, np.zeros((STEPS, 2, 2)))
    parameters = replace(moving, slots=(*moving.slots, still))
    states, inputs = steer(ROBOT, start, Twist((0.3, 0.1)), STEPS, DT)
    bare = Guess.bare(states, inputs, float("nan"))
    guess = with_auxiliaries(ROBOT, REGION, parameters, bare, WALL)
    return guess.pull(parameters), guess


@pytest.mark.usefixtures("plain_code")
def test_auxiliaries_walls_levels_of_their_own_soft_regions_and_the_end() -> None:
    problem = assemble(
        ROBOT, REGION, Fixed(), horizon=STEPS, dt=DT, capacity=2, penalty=1e4,
        static_region=WALL, statics=1, corners=4, stop_at_end=True,
    )  # fmt: skip
    places = ((0.2, -1.0), (1.0, -0.3), (5.0, -0.2), (5.0, -1.0))
    parameters, guesses = zip(*(passage(*place) for place in places), strict=True)
    found = solve_batch(problem, parameters, guesses)
    assert found.status == (Status.SOLVED,) * len(guesses)
    for i, (own, guess) in enumerate(zip(parameters, guesses, strict=True)):
        # fatrop reaches the third one's cost to 1e-9, and goes on to its limit of iterations
        (other,) = Ipopt().solve(problem, own, [guess])
        assert other.status is Status.SOLVED
        least = violation(problem, own, other.point).worst  # the third begins within the margin
        assert violation(problem, own, found.point(i)).worst < least + 1e-6
        # ipopt lets the slack of each step fall to -1e-8, which saves it 1e-4 each; the
        # tolerance is that of a cost scaled to a gradient of 10
        assert found.cost[i] == pytest.approx(other.cost, rel=2e-6, abs=1e-3)
        np.testing.assert_allclose(found.states[i], other.point.states, atol=2e-4)


def test_more_than_fit_are_solved_in_turn(paper: Problem, recorded: list[Instance]) -> None:
    found = solved(paper, [*recorded, *recorded[:2]], width=8)
    assert len(found) == len(recorded) + 2
    np.testing.assert_allclose(found.states[:2], found.states[-2:], atol=1e-9)


def test_what_is_refused(paper: Problem, recorded: list[Instance]) -> None:
    one = recorded[0]
    with pytest.raises(WideberthError, match=r"got 2 parameters and 1 guesses"):
        solve_batch(paper, [one.parameters] * 2, [one.guess])
    with pytest.raises(WideberthError, match="no instance"):
        solve_batch(paper, [], [])
    with pytest.raises(WideberthError, match="tolerance"):
        solve_batch(paper, [one.parameters], [one.guess], tolerance=0.0)
    long = assemble(Unicycle(), RiskContour(), Fixed(), horizon=15, dt=0.5, capacity=1)
    with pytest.raises(WideberthError, match="operations"):
        solve_batch(long, [one.parameters], [one.guess])


def test_the_caller_s_settings_of_jax_are_left_alone(
    paper: Problem, recorded: list[Instance]
) -> None:
    import jax

    before = jax.config.jax_enable_x64
    found = solved(paper, recorded[:1])
    assert found.states.dtype == np.float64
    assert jax.config.jax_enable_x64 == before


def test_many_instances_have_one_entry_for_every_solver(
    paper: Problem, recorded: list[Instance], together: BatchSolution
) -> None:
    parameters, guesses = zip(*((one.parameters, one.guess) for one in recorded), strict=True)
    for solver in (Batch(), Riccati(), Fatrop()):
        found = solve_many(solver, paper, parameters, guesses)
        assert [one.status for one in found] == [Status.SOLVED] * len(recorded)
        costs = np.array([one.cost for one in found])
        same = np.abs(costs - together.cost) <= 1e-5 * (1.0 + together.cost)
        assert same.mean() >= 0.8, solver  # some pass an obstacle on the other side
        with pytest.raises(WideberthError, match="got 8 parameters and 1 guesses"):
            solve_many(solver, paper, parameters, guesses[:1])

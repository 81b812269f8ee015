"""Solves that start from multipliers: the same plan sooner, and cold where they fail."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from wideberth.benchmarks.recorded_instances import Instance, read_instances
from wideberth.framework.mpc.levels.paper import Paper
from wideberth.framework.mpc.ocp.problem import Problem
from wideberth.framework.mpc.ocp.transcription import Guess, Multipliers
from wideberth.framework.mpc.solver import Solution
from wideberth.framework.region import Region
from wideberth.framework.values.plan import Status
from wideberth.regions.mahalanobis_ellipse import MahalanobisEllipse
from wideberth.regions.minkowski_sum import MinkowskiSum
from wideberth.regions.separating_line import SeparatingLine
from wideberth.robots.unicycle import Unicycle
from wideberth.solvers.riccati.solver import Riccati
from wideberth.tests.helpers.problems import assemble, with_auxiliaries

SAMPLE = Path(__file__).parents[1] / "data" / "mpc_instances.npz"
REGIONS = (MahalanobisEllipse(), MinkowskiSum(), SeparatingLine())


def recorded(region: Region) -> list[Instance]:
    return [ready(one, region) for one in read_instances(SAMPLE, region)]


def ready(one: Instance, region: Region) -> Instance:
    guess = with_auxiliaries(Unicycle(), region, one.parameters, one.guess)
    return replace(one, guess=guess, parameters=guess.pull(one.parameters))


def problem_for(one: Instance, region: Region) -> Problem:
    level = Paper(tail=float(np.exp(-5.991 / 2)))
    return assemble(Unicycle(), region, level, horizon=15, dt=0.5, capacity=one.obstacles)


def solved(one: Instance, guess: Guess, region: Region) -> Solution:
    return Riccati().solve(problem_for(one, region), one.parameters, [guess])[0]


@pytest.mark.parametrize("region", REGIONS[:2], ids=repr)
def test_the_solution_with_its_multipliers_is_kept(region: Region) -> None:
    """From its own solution a solve changes nothing, and needs next to no iteration."""
    needed = []
    for one in recorded(region)[::4]:
        cold = solved(one, one.guess, region)
        if cold.status is not Status.SOLVED:
            continue
        known = cold.point.multipliers
        assert known is not None and np.isfinite(known.steps).all()
        warm = solved(one, cold.point, region)
        bare = solved(one, replace(cold.point, multipliers=None), region)
        assert warm.status is Status.SOLVED
        assert warm.cost == pytest.approx(cold.cost, rel=1e-5, abs=1e-5)
        np.testing.assert_allclose(warm.point.states, cold.point.states, atol=2e-3)
        needed.append((warm.iterations, bare.iterations))
    warm_all, bare_all = np.array(needed).T
    assert len(needed) >= 8
    assert np.median(warm_all) <= 5 and warm_all.sum() < 0.8 * bare_all.sum()


def test_multipliers_balance_the_forces() -> None:
    """Lagrange's condition by hand: the last input's cost, its bounds and the dynamics."""
    region = MahalanobisEllipse()
    for one in recorded(region)[:6]:
        found = solved(one, one.guess, region)
        known, problem = found.point.multipliers, problem_for(one, region)
        assert known is not None
        n, m = problem.states, problem.inputs
        wide = n + m
        lower, upper = known.steps[:, :wide], known.steps[:, wide : 2 * wide]
        motion = known.steps[:, 2 * wide : 2 * wide + n]
        assert (lower >= 0.0).all() and (upper >= 0.0).all()
        x, u = found.point.states, found.point.inputs
        for i in (0, 7, 14):
            head = one.parameters.heads()[i]
            step = 1e-6
            slope = []
            for k in range(m):
                sides = []
                for sign in (1.0, -1.0):
                    moved = u[i].copy()
                    moved[k] += sign * step
                    cost = float(problem.input_cost(x[i], moved, head))
                    end = np.array(problem.dynamics(x[i], moved), dtype=float).ravel()
                    sides.append(cost + motion[i] @ end)
                slope.append((sides[0] - sides[1]) / (2.0 * step))
            force = np.array(slope) - lower[i, n:] + upper[i, n:]
            assert np.abs(force).max() < 1e-3 * (1.0 + np.abs(motion).max())


def spoilt(known: Multipliers, kind: str) -> Multipliers:
    rng = np.random.default_rng(0)
    if kind == "nan":
        return replace(known, steps=np.full_like(known.steps, np.nan))
    if kind == "of another size":
        return replace(known, steps=known.steps[:, :-1])
    if kind == "unknown slots":
        return replace(known, slots=tuple(np.full_like(one, np.nan) for one in known.slots))
    size = {"huge": 1e300, "large": 1e8, "infinite": np.inf, "noise": 1e3}[kind]
    if kind == "infinite":
        return replace(known, slots=tuple(np.full_like(one, size) for one in known.slots))
    return Multipliers(
        size * rng.standard_normal(known.steps.shape),
        tuple(size * rng.standard_normal(one.shape) for one in known.slots),
    )


def test_own_variables_without_bounds_are_started_cold() -> None:
    region = SeparatingLine()
    one = recorded(region)[0]
    found = solved(one, one.guess, region)
    assert found.point.multipliers is not None
    warm = solved(one, found.point, region)
    cold = solved(one, replace(found.point, multipliers=None), region)
    assert warm.iterations == cold.iterations
    np.testing.assert_array_equal(warm.point.states, cold.point.states)


@pytest.mark.parametrize("kind", ["nan", "of another size"])
def test_what_is_no_multiplier_changes_nothing(kind: str) -> None:
    region = MahalanobisEllipse()
    for one in recorded(region)[::8]:
        cold = solved(one, one.guess, region)
        known = cold.point.multipliers
        assert known is not None
        again = solved(one, replace(one.guess, multipliers=spoilt(known, kind)), region)
        assert again.iterations == cold.iterations and again.cost == cold.cost
        np.testing.assert_array_equal(again.point.states, cold.point.states)


@pytest.mark.parametrize("kind", ["huge", "large", "infinite", "noise", "unknown slots"])
@pytest.mark.parametrize("region", REGIONS[:2], ids=repr)
def test_garbage_ends_in_a_plan_as_good_as_the_cold_one(kind: str, region: Region) -> None:
    for one in recorded(region)[::8]:
        cold = solved(one, one.guess, region)
        known = cold.point.multipliers
        assert known is not None
        warm = solved(one, replace(one.guess, multipliers=spoilt(known, kind)), region)
        assert warm.status is Status.SOLVED
        assert np.isfinite(warm.point.states).all()
        assert warm.cost <= 1.1 * cold.cost + 1.0  # another optimum may be near


def test_a_solve_leaves_no_multipliers_behind() -> None:
    """What a solve finds does not depend on what was solved before it."""
    region = MahalanobisEllipse()
    one, other = [x for x in recorded(region) if x.obstacles == 20][:2]
    first = solved(one, one.guess, region)
    warm = solved(other, replace(other.guess, multipliers=first.point.multipliers), region)
    again = solved(one, one.guess, region)
    np.testing.assert_array_equal(first.point.states, again.point.states)
    assert again.iterations == first.iterations
    twice = solved(other, replace(other.guess, multipliers=first.point.multipliers), region)
    np.testing.assert_array_equal(warm.point.states, twice.point.states)
    known, same = warm.point.multipliers, twice.point.multipliers
    assert known is not None and same is not None
    np.testing.assert_array_equal(known.steps, same.steps)
    np.testing.assert_array_equal(known.slots[0], same.slots[0])


def test_no_multipliers_where_no_plan_was_found() -> None:
    region = MahalanobisEllipse()
    one = recorded(region)[0]
    stopped = Riccati(iterations=1).solve(problem_for(one, region), one.parameters, [one.guess])
    assert stopped[0].status is Status.LIMIT and stopped[0].point.multipliers is None

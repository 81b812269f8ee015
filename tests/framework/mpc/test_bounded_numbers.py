"""What reaches a solver is of a size that it can calculate with, whatever was observed."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from wideberth.framework.mpc.planner.rungs import Fallback
from wideberth.framework.mpc.slots.gaussian_discs import (
    FAR,
    WIDE,
    ObstacleSet,
    choose_obstacles,
    not_wider,
)
from wideberth.framework.plugins.config import build
from wideberth.framework.values.arrays import Array
from wideberth.framework.values.forecast import Forecast
from wideberth.framework.values.motion import Detection, Observation
from wideberth.framework.values.plan import Rung, Status
from wideberth.predictors.static import Static
from wideberth.regions.minkowski_sum import MinkowskiSum
from wideberth.tests.helpers.planning import at, planner

SCALES = st.floats(-300.0, 300.0).map(lambda power: 10.0**power)


def turned(first: float, second: float, angle: float) -> Array:
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    made = turn @ np.diag([first, second]) @ turn.T
    return np.asarray(0.5 * (made + made.T))


@settings(max_examples=200, derandomize=True, deadline=None, database=None)
@given(SCALES, SCALES, st.floats(0.0, np.pi))
def test_deviations_are_bounded_along_their_own_axes(
    first: float, second: float, angle: float
) -> None:
    covariance = turned(first, second, angle)
    found = not_wider(covariance[None])[0]
    if max(first, second) <= 0.49 * WIDE**2:
        assert found.tobytes() == covariance.tobytes()
        return
    assert np.linalg.eigvalsh(found).max() <= (1.0 + 1e-9) * WIDE**2
    if min(first, second) < 1e-9 * max(first, second):
        return  # rounding has drowned the smaller one before
    expected = turned(min(first, WIDE**2), min(second, WIDE**2), angle)
    assert np.linalg.eigvalsh(found).min() >= -1e-7 * WIDE**2
    assert found == pytest.approx(expected, rel=1e-6, abs=1e-6 * WIDE**2)


def test_what_cannot_be_decomposed_becomes_round() -> None:
    covariance = np.array([[[np.inf, 0.0], [0.0, 1.0]], [[1.0, 0.0], [0.0, 2.0]]])
    found = not_wider(covariance)
    assert found[0].tolist() == (WIDE**2 * np.eye(2)).tolist()
    assert found[1].tolist() == covariance[1].tolist()


@pytest.mark.parametrize("solver", ["fatrop", "riccati", "ipopt"])
@pytest.mark.parametrize("penalty", [None, 1e5])
def test_covariances_of_any_size_are_solved(solver: str, penalty: float | None) -> None:
    """The planner, robot and region with which a solve by fatrop once did not return."""
    rng = np.random.default_rng(3)
    made = planner(
        solver=build("solvers", solver), region=MinkowskiSum(), predictor=Static(),
        margin=10.0, latency=5.0, fallback=Fallback(stop_at_end=True), horizon=8,
        penalty=penalty, starts=(),
    )  # fmt: skip
    for k in range(4):
        scales = 10.0 ** rng.uniform(-300.0, 200.0, (4, 2))
        seen = tuple(
            Detection(
                f"{i}", 30.0 * rng.standard_normal(2), turned(*scale, rng.uniform(0, 3)), 0.5
            )
            for i, scale in enumerate(scales)
        )
        state = np.array([0.25 * k, 0.0, 0.0, 0.5, 0.0])
        made.command(Observation(0.5 * k, state, seen))
        plan, parameters = made.plan, made.explain().parameters
        assert plan is not None and np.isfinite(plan.states).all()
        assert np.abs(parameters.slots[0].parameters).max() <= 2.0 * max(FAR, WIDE)
        assert plan.status is not Status.FAILED or "no convergence" in plan.reason


@pytest.mark.parametrize("x", [1e12, -1e15])
def test_a_place_beyond_all_scales_is_not_solved(x: float) -> None:
    made = planner()
    made.command(at(0.0, x))
    assert made.plan is not None
    assert (made.plan.rung, made.plan.status) == (Rung.BRAKE, Status.NOT_RUN)
    assert "wanted at most 1e+09" in made.plan.reason


def test_obstacles_of_any_size_and_place() -> None:
    made = planner(predictor=Static())
    values: dict[str, Any] = {"a": 1e60, "b": -1e12, "c": 1e7}
    seen = [Detection(n, np.array([v, 0.0]), 1e-4 * np.eye(2), abs(v)) for n, v in values.items()]
    seen.append(Detection("d", np.array([10.0, 0.0]), 1e-4 * np.eye(2), 1e7))
    made.command(Observation(0.0, np.array([0.0, 0.0, 0.0, 0.5, 0.0]), tuple(seen)))
    parameters = made.explain().parameters
    assert np.abs(parameters.slots[0].parameters).max() <= 2.0 * FAR
    assert made.plan is not None and made.plan.ids == ("d", "c")  # c is out of reach


def test_the_discs_that_come_closest_to_the_route_are_kept() -> None:
    """Nearest over all steps and routes, edge to edge; light modes are named, empty ones not."""
    mean = np.zeros((4, 2, 3, 2))
    mean[:, 0, :, 0] = [[9.0, 5.0, 9.0], [4.0, 4.0, 4.0], [-6.0, -3.0, -9.0], [1.0, 1.0, 1.0]]
    mean[:, 1, :, 1] = [[2.0] * 3, [50.0] * 3, [1.0] * 3, [0.0] * 3]
    weight = np.array([[0.5, 0.5], [1.0, 0.0], [0.999, 0.001], [0.999, 0.001]])
    spread = np.arange(1.0, 9.0).reshape(4, 2, 1, 1, 1) * np.eye(2) * np.ones((4, 2, 3, 1, 1))
    forecast = Forecast(mean, spread, weight, 0.5, (None,) * 4)
    route = np.zeros((2, 3, 2))
    route[0, :, 0] = [-1.0, 0.0, 1.0]
    radius = np.array([0.1, 3.9, 0.2, 0.3])
    # Gaps: a 4.9 and 1.9, b -0.9, c 2.8, d -0.3.
    names = ("a", "b", "c", "d")
    for most, kept, gone in (
        (9, "aabcd", ""), (4, "abcd", "a"), (3, "abd", "ac"), (2, "bd", "aac"), (0, "", "aabcd"),
    ):  # fmt: skip
        found, _ = choose_obstacles(ObstacleSet.of(forecast, names, radius), route, most)
        assert "".join(found.ids) == kept and found.left_out[:2] == ("c", "d")
        assert sorted(found.left_out[2:]) == sorted(gone)
        owner = [names.index(name) for name in found.ids]
        np.testing.assert_array_equal(found.radius, radius[owner])
        assert found.mean.shape == (3, len(kept), 2)
    two, _ = choose_obstacles(ObstacleSet.of(forecast, names, radius), route, 3)
    np.testing.assert_array_equal(two.mean[:, 0], mean[0, 1])
    np.testing.assert_array_equal(two.covariance[:, 2], spread[3, 0])

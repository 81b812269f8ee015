"""Derivatives that the structured solver is given, against finite differences."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

from wideberth.controllers.costs.contouring import Contouring
from wideberth.framework import names
from wideberth.framework.mpc.costs.base import Cost
from wideberth.framework.mpc.costs.tracking import Tracking
from wideberth.framework.mpc.levels.fixed import Fixed
from wideberth.framework.mpc.levels.relaxed import Relaxed
from wideberth.framework.mpc.ocp.problem import Problem
from wideberth.framework.plugins.registry import load
from wideberth.framework.values.arrays import Array
from wideberth.framework.values.forecast import GaussianObstacle
from wideberth.regions.mahalanobis_ellipse import MahalanobisEllipse
from wideberth.robots.unicycle import Unicycle
from wideberth.solvers.riccati.kernels import Kernels, build
from wideberth.tests.helpers.problems import assemble

LARGE = {"risk_contour"}
"""Regions whose derivatives take seconds."""
STEP = 1e-6
COSTS: list[Cost] = [Tracking(), Contouring()]


@dataclass(frozen=True)
class Pieces:
    """Cuts a kernel's result one piece after the other."""

    values: Array

    @classmethod
    def of(cls, function: Any, v: Array, p: Array) -> "Pieces":
        return cls(np.asarray(function(v, p)).ravel())

    def cut(self, *shapes: tuple[int, ...]) -> list[Array]:
        found, at = [], 0
        for shape in shapes:
            size = int(np.prod(shape))
            found.append(self.values[at : at + size].reshape(shape))
            at += size
        assert at == len(self.values)
        return found


def slopes(function: Any, point: Array, wide: int) -> Array:
    """Central differences by the first ``wide`` entries of a point, (.., wide)."""
    columns = []
    for k in range(wide):
        step = np.zeros_like(point)
        step[k] = STEP
        columns.append((function(point + step) - function(point - step)) / (2.0 * STEP))
    return np.stack(columns, axis=-1)


def close(found: Array, wanted: Array) -> None:
    scale = 1.0 + np.abs(wanted).max(initial=0.0)
    np.testing.assert_allclose(found, wanted, rtol=0, atol=3e-8 * scale)


def near(problem: Problem, rng: np.random.Generator) -> tuple[Array, Array]:
    """A state and an input within their bounds, or near zero."""
    found = []
    for bounds in (problem.state_bounds, problem.input_bounds):
        lower, upper = (np.clip(side, -1.0, 1.0) for side in (bounds.lower, bounds.upper))
        found.append(lower + (upper - lower) * rng.uniform(0.2, 0.8, len(lower)))
    return found[0], found[1]


def head(problem: Problem, rng: np.random.Generator) -> Array:
    """Numbers of the reference; those of the curve are a knot spacing, a length, points."""
    numbers = rng.normal(size=problem.head_width)
    if problem.curve:
        numbers[-problem.curve :] = np.abs(numbers[-problem.curve :]) + 0.5
    return np.append(numbers, 0.3)


@pytest.mark.parametrize("cost", COSTS, ids=lambda one: type(one).__name__)
@pytest.mark.parametrize("name", names("robots"))
def test_dynamics_costs_and_limits(name: str, cost: Cost) -> None:
    problem = assemble(
        load("robots", name)(), MahalanobisEllipse(), Fixed(), horizon=3, dt=0.5, capacity=0,
        cost=cost, stop_at_end=True,
    )  # fmt: skip
    made, rng = build(problem), np.random.default_rng(0)
    for _ in range(3):
        x, u = near(problem, rng)
        _check_drive(problem, made, x, u, rng)
        _check_node(problem, made, x, rng)


def _check_drive(
    problem: Problem, made: Kernels, x: Array, u: Array, rng: np.random.Generator
) -> None:
    n, w, rows, p = problem.states, len(x) + len(u), made.input_rows, head(problem, rng)
    v = np.concatenate([x, u, rng.normal(size=n + rows)])
    shapes = (n,), (), (w,), (n, w), (w, w), (rows,), (rows, w)

    def values(at: Array) -> list[Array]:
        f, cost, _, _, _, c, _ = Pieces.of(made.functions["drive"], at, p).cut(*shapes)
        return [f, cost, c]

    def force(at: Array) -> Array:
        _, _, gradient, jacobian, _, _, slope = Pieces.of(made.functions["drive"], at, p).cut(
            *shapes
        )
        return np.asarray(gradient + v[w : w + n] @ jacobian - v[w + n :] @ slope)

    f, cost, gradient, jacobian, hessian, _, slope = Pieces.of(made.functions["drive"], v, p).cut(
        *shapes
    )
    following = np.asarray(problem.dynamics(x, u)).ravel()
    close(f, following)
    close(cost, 0.3 * np.asarray(problem.input_cost(x, u, p[:-1])).squeeze())
    close(jacobian, slopes(lambda at: values(at)[0], v, w))
    close(gradient, slopes(lambda at: values(at)[1], v, w))
    close(slope, slopes(lambda at: values(at)[2], v, w))
    close(hessian, slopes(force, v, w))


def _check_node(problem: Problem, made: Kernels, x: Array, rng: np.random.Generator) -> None:
    n, rows, p = problem.states, made.node_rows + made.final_rows, head(problem, rng)
    v = np.concatenate([x, rng.normal(size=rows)])
    shapes = (), (n,), (n, n), (rows,), (rows, n)

    def values(at: Array) -> list[Array]:
        return Pieces.of(made.functions["node_values"], at, p).cut((), (rows,))

    def force(at: Array) -> Array:
        _, gradient, _, _, slope = Pieces.of(made.functions["node"], at, p).cut(*shapes)
        return np.asarray(gradient - v[n:] @ slope)

    cost, gradient, hessian, g, slope = Pieces.of(made.functions["node"], v, p).cut(*shapes)
    for found, wanted in zip(values(v), (cost, g), strict=True):
        close(found, wanted)
    final = np.asarray(problem.terminal_constraints(x)).ravel()
    close(g[made.node_rows :], final)
    close(gradient, slopes(lambda at: values(at)[0], v, n))
    close(slope, slopes(lambda at: values(at)[1], v, n))
    close(hessian, slopes(force, v, n))


@pytest.mark.parametrize("shared", [False, True], ids=["fixed", "shared"])
@pytest.mark.parametrize("name", sorted(set(names("regions")) - LARGE))
def test_regions(name: str, shared: bool) -> None:
    region = load("regions", name)()
    robot = Unicycle() if 2 in region.dimensions else load("robots", "holonomic_3d")()
    level = Relaxed(weight=1.0, minimum=0.0) if shared else Fixed()
    problem = assemble(robot, region, level, horizon=3, dt=0.5, capacity=1)
    made, rng = build(problem), np.random.default_rng(1)
    for _ in range(3):
        place = rng.normal(size=problem.dimension)
        spread = np.diag(rng.uniform(0.05, 0.1, problem.dimension))
        numbers = region.parameters(GaussianObstacle(place, spread), np.array(0.6))
        target = level.levels(region, 3, 1, problem.dimension)[0, 0]
        own = np.asarray(problem.slots[0].auxiliary.start, dtype=float)
        p = np.concatenate([np.ravel(numbers), [target, 1.0], own])
        state = rng.normal(scale=2.0, size=problem.states)
        state[: problem.dimension] += 1.5
        v = [*state[list(made.slots[0].depends)], *([target * 1.1] * shared), *(own + 0.13)]
        _check_slot(problem, made, 0, np.array(v), p, rng)


@pytest.mark.parametrize("name", names("static_regions"))
def test_static_regions(name: str) -> None:
    region = load("static_regions", name)()
    problem = assemble(
        Unicycle(), MahalanobisEllipse(), Fixed(), horizon=3, dt=0.5, capacity=0,
        static_region=region, statics=1,
    )  # fmt: skip
    made, rng = build(problem), np.random.default_rng(2)
    corners = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    numbers = region.parameters(corners, np.array(0.5), np.zeros((2, 2)))
    own = np.asarray(problem.slots[1].auxiliary.start, dtype=float)
    p = np.concatenate([np.ravel(numbers), [1.0], own])
    for _ in range(3):
        state = rng.normal(scale=2.0, size=5)[list(made.slots[1].depends)]
        v = np.concatenate([state, own + rng.uniform(0.1, 0.5, len(own))])
        _check_slot(problem, made, 1, v, p, rng)


def _check_slot(
    problem: Problem, made: Kernels, k: int, w: Array, p: Array, rng: np.random.Generator
) -> None:
    """One slot; an inactive one is stated as an active one, since it is left out."""
    name, shape, slots = f"slot{k}", made.slots[k], problem.slots[k]
    wide, stated = len(w), shape.inequalities + shape.equalities
    v = np.concatenate([w, rng.uniform(0.5, 1.0, stated)])
    shapes = (stated,), (stated, wide), (wide, wide)

    def values(at: Array) -> Array:
        return Pieces.of(made.functions[f"{name}_values"], at, p).values

    def force(at: Array) -> Array:
        _, slope, _ = Pieces.of(made.functions[name], at, p).cut(*shapes)
        return np.asarray(-v[wide:] @ slope)

    found, slope, hessian = Pieces.of(made.functions[name], v, p).cut(*shapes)
    assert stated == len(found) and slots.guess == len(p) - len(slots.auxiliary)
    close(values(v), found)
    close(slope, slopes(values, v, wide))
    close(hessian, slopes(force, v, wide))
    off = p.copy()
    off[slots.guess - 1] = 0.0
    np.testing.assert_array_equal(
        Pieces.of(made.functions[name], v, off).values,
        Pieces.of(made.functions[name], v, p).values,
    )

"""Collision probabilities per second and core: one by one in NumPy's terms, and in JAX batches."""

from collections.abc import Callable
from functools import partial
from time import process_time
from typing import Any

import numpy as np
from measuring import Row, Tick, brief, rotated, timed
from scipy import special

from wideberth.framework.risk.collision_probability import collision_probability
from wideberth.tests.oracles.risk_batch import (
    collision_probability_batch,
    collision_probability_gradient_batch,
)
from wideberth.tests.oracles.risk_bounds import eigenframe, half_plane_bound

REFERENCE = "numpy, 64 nodes"
TARGET = 1e5
"""Evaluations per second and core, of the batch."""


def gauss_legendre(difference: Any, covariance: Any, radius: Any) -> Any:
    """Evaluate nested quadrature, 64 nodes: what the integral in the complex plane replaced.

    The outer variable along the small deviation, 9 deviations beyond the nearest point of the
    disc; the inner one in closed form. It loses all digits for small deviations.
    """
    local, spread, radius = eigenframe(difference, covariance, radius)
    (x, y), (s1, s2) = local.T, spread.T
    share = np.clip(1.0 - radius / np.hypot(x, y), 0.0, None)
    edge = np.minimum(y, radius)
    rest = np.clip(x - np.sqrt((radius - edge) * (radius + edge)), 0.0, None)
    nearest = np.minimum(share * np.hypot(x / s1, y / s2), np.hypot((y - edge) / s2, rest / s1))
    half = s2 * np.hypot(9.0, nearest)
    low, high = (np.arcsin(np.clip((y + k * half) / radius, -1.0, 1.0)) for k in (-1.0, 1.0))
    points, weights = np.polynomial.legendre.leggauss(64)
    angle = 0.5 * (high + low)[:, None] + 0.5 * (high - low)[:, None] * points
    chord, height = radius[:, None] * np.cos(angle), radius[:, None] * np.sin(angle)
    density = np.exp(-0.5 * ((height - y[:, None]) / s2[:, None]) ** 2) / s2[:, None]
    ends = [special.ndtr((k * chord - x[:, None]) / s1[:, None]) for k in (1.0, -1.0)]
    total = (density * chord * (ends[0] - ends[1]) * weights).sum(axis=1)
    return total * 0.5 * (high - low) / np.sqrt(2.0 * np.pi)


EVALUATORS: dict[str, Callable[..., Any]] = {
    REFERENCE: collision_probability,
    "numpy, Gauss-Legendre": gauss_legendre,
    "numpy, 32 nodes": partial(collision_probability, nodes=32),
    "jax, 64 nodes": collision_probability_batch,
    "jax, 32 nodes": partial(collision_probability_batch, nodes=32),
    "jax, 64 nodes, gradient": collision_probability_gradient_batch,
    "half-plane bound": half_plane_bound,
}


def pairs(count: int, seed: int) -> tuple[Any, Any, Any]:
    """Draw pairs with deviations of 0.05 to 3 m, axis ratios to 30, between near and far."""
    rng = np.random.default_rng(seed)
    first = 10.0 ** rng.uniform(-1.3, 0.5, count)
    second = first * 10.0 ** rng.uniform(-1.5, 0.0, count)
    angle = rng.uniform(0.0, np.pi, count)
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    spread = np.stack([first, second])
    root = np.moveaxis(turn * spread, -1, 0)
    covariance = root @ np.swapaxes(root, -1, -2)
    place = rng.standard_normal((count, 2)) * (first + 1.0)[:, None]
    return place, covariance, rng.uniform(0.3, 2.0, count)


def measure(count: int, rounds: int, tick: Tick) -> list[Row]:
    """Time one call for all pairs together: one row per evaluator.

    ``per_second_per_core`` is pairs over the process's CPU time, so that threads do not count as
    speed; ``difference`` the largest to the reference.
    """
    tick(f"collision probability, {count} pairs")
    given = pairs(count, seed=1)
    exact = collision_probability(*given)
    times: dict[str, list[float]] = {name: [] for name in EVALUATORS}
    work: dict[str, list[float]] = {name: [] for name in EVALUATORS}
    gaps: dict[str, float] = {}
    for turn in range(rounds + 1):
        for name in rotated(list(EVALUATORS), turn):
            begin = process_time()
            time, found = timed(partial(EVALUATORS[name], *given))
            if turn:  # the first call imports and compiles
                times[name].append(time)
                work[name].append(process_time() - begin)
            same = found.shape == exact.shape  # the gradient is another quantity
            gaps[name] = float(np.abs(found - exact).max()) if same else float("nan")
    rows = []
    for name in EVALUATORS:
        rate = count / max(min(work[name]), 1e-9)
        row = {"evaluator": name, "pairs": count, **brief(times[name], times[REFERENCE])}
        row |= {"per_second_per_core": rate, "difference": gaps[name]}
        target = TARGET if name == "jax, 64 nodes" else None
        rows.append(row | {"target": target, "met": None if target is None else rate > target})
    return rows

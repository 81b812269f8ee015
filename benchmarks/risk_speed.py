"""Collision probabilities per second and core, by the number of nodes of the integral."""

from collections.abc import Callable
from functools import partial
from time import process_time
from typing import Any

import numpy as np
from measuring import Row, Tick, brief, rotated, timed

from wideberth.framework.risk.collision_probability import collision_probability

REFERENCE = "numpy, 64 nodes"
TARGET = 1e5
"""Evaluations per second and core, of the reference."""


EVALUATORS: dict[str, Callable[..., Any]] = {
    REFERENCE: collision_probability,
    "numpy, 32 nodes": partial(collision_probability, nodes=32),
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
            gaps[name] = float(np.abs(found - exact).max())
    rows = []
    for name in EVALUATORS:
        rate = count / max(min(work[name]), 1e-9)
        row = {"evaluator": name, "pairs": count, **brief(times[name], times[REFERENCE])}
        row |= {"per_second_per_core": rate, "difference": gaps[name]}
        target = TARGET if name == REFERENCE else None
        rows.append(row | {"target": target, "met": None if target is None else rate > target})
    return rows

"""Quality of a plan, in plain NumPy that shares no code with the MPC."""

from dataclasses import replace

import numpy as np
from measuring import Row
from set_ups import DT, EXACT, unicycle

from wideberth.benchmarks.recorded_instances import Instance, worst_violation
from wideberth.framework.mpc.ocp.transcription import Guess
from wideberth.framework.mpc.planner.rollout import clip, follow
from wideberth.framework.mpc.solver import Solution
from wideberth.framework.values.plan import Status

TIGHT, LOOSE = 1e-6, 1e-4
"""Largest violation (m, m/s or unit-free) of a feasible plan: the solvers' own tolerance, and what
the planner accepts."""
NEAR = 1e-3
"""Largest gap (f - f*) / (1 + |f*|) of a plan that is as good as the best known."""
_SECTIONS = 60
"""Of a golden-section search: 0.618^60 is 3e-13."""


def judged(instance: Instance, region: str, solution: Solution) -> Row:
    """Return what a solver says of its plan, and how far the plan breaks what it has to keep.

    ``motion`` is the largest violation of dynamics, limits and the bound of s, ``entered`` how
    far the plan enters a region, 1 - gauge. ``driven_motion`` and ``driven_entered`` say the same
    of what would be driven.
    """
    motion, entered = broken(instance, region, solution.point)
    driven_motion, driven_entered = motion, entered
    if solution.status is not Status.SOLVED:
        driven_motion, driven_entered = broken(instance, region, driven(instance, solution.point))
    return {
        "iterations": solution.iterations,
        "status": str(solution.status),
        "solved": solution.status is Status.SOLVED,
        "cost": solution.cost,
        "motion": motion,
        "entered": entered,
        "violation": max(motion, entered),
        "driven_motion": driven_motion,
        "driven_entered": driven_entered,
    }


def driven(instance: Instance, point: Guess) -> Guess:
    """Drive by the inputs of a plan, brought within their limits, at s = 0.

    That is what the fallback ladder makes of a solve that did not converge.
    """
    inputs = clip(unicycle(), np.nan_to_num(point.inputs))
    states = follow(unicycle(), instance.parameters.initial, inputs, DT)
    return replace(point, states=states, inputs=inputs, level=0.0)


def broken(instance: Instance, region: str, point: Guess) -> tuple[float, float]:
    """How far a plan breaks the unicycle's motion, and how far it enters a region."""
    mean, axis, deviation, margin = instance.ellipses
    bare = replace(instance, ellipses=(mean[:0], axis[:0], deviation[:0], margin[:0]))
    motion = max(worst_violation(bare, point), 0.0)
    if region == EXACT:
        return motion, max(1.0 - float(sum_gauge(instance, point).min(initial=np.inf)), 0.0)
    worst = worst_violation(instance, point)
    return motion, worst if worst > motion else 0.0


def sum_gauge(instance: Instance, point: Guess) -> np.ndarray:
    """Gauge of ellipse + disc at each step, (K, N): the root of max F(t) over t in (0, 1).

    F(t) = sum_i x_i^2 t (1 - t) / ((1 - t) a_i^2 + t rho^2) is concave (Perram and Wertheim,
    1985), so that a golden-section search finds its maximum.
    """
    mean, axis, deviation, margin = instance.ellipses
    offset = point.states[1:, :2] - mean
    across = np.stack([-axis[..., 1], axis[..., 0]], axis=-1)
    local = np.stack([(offset * axis).sum(-1), (offset * across).sum(-1)], axis=-1)
    squares = np.maximum((point.level * deviation) ** 2, 1e-18)
    disc = margin[:, None] ** 2

    def value(t: np.ndarray) -> np.ndarray:
        length = (1 - t)[..., None] * squares + (t * disc)[..., None]
        return (t * (1 - t))[..., None] * local**2 / length

    low, high = np.zeros(mean.shape[:2]), np.ones(mean.shape[:2])
    step = 0.5 * (np.sqrt(5.0) - 1.0)
    for _ in range(_SECTIONS):
        left, right = high - step * (high - low), low + step * (high - low)
        first = value(left).sum(-1) > value(right).sum(-1)
        low, high = np.where(first, low, left), np.where(first, right, high)
    return np.sqrt(value(0.5 * (low + high)).sum(-1))

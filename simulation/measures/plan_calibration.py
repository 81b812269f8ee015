"""Calibration of plans: their promised risks against the events that followed."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, final

import numpy as np

from ...controllers.slots.between_steps import ENTERED, plan_between
from ...framework.values.arrays import Array, BoolArray
from ...framework.values.plan import TOLERANCE, Plan
from ...metrics import plan as metrics
from ...metrics.statistics import known_mean
from ..log.episode_log import AgentLog, Episode


@final
@dataclass(frozen=True, eq=False)
class Judged:
    """One plan and its outcome.

    Attributes
    ----------
    area : (O, M, N), m^2 (m^3), of the forecast's regions.
    risk : (N,), probability by the forecast that the plan touches anybody at the step.
    touched : (N,), whether it would have; known : (N,), whether the episode went on so long.
    tail : (C,), 1 - content at which the obstacles with one mode were kept clear of at step 1.
    outside : (C,), whether they then were outside the ellipse of that content.
    """

    area: Array
    risk: Array
    touched: BoolArray
    known: BoolArray
    tail: Array
    outside: BoolArray

    @classmethod
    def of(cls, episode: Episode, log: AgentLog, plan: Plan, tail: float) -> "Judged | None":
        """Judge a plan by the agents in its forecast; None where it has none."""
        names, forecast = {one.name for one in episode.agents}, plan.forecast
        real = [o for o, name in enumerate(plan.tracked) if name in names]
        if forecast is None or not real:
            return None
        steps = min(forecast.steps, len(plan.positions) - 1)
        times = plan.stamp + plan.dt * np.arange(1, steps + 1, dtype=np.float64)
        tracked = [plan.tracked[o] for o in real]
        others = [episode.agent(name) for name in tracked]
        truth = np.array([episode.at(other, times) for other in others])
        radii = np.array([log.radius + other.radius for other in others])
        mean, covariance = forecast.mean[real, :, :steps], forecast.covariance[real, :, :steps]
        weight = forecast.weight[real]
        planned = plan.positions[1 : steps + 1]
        risk = metrics.plan_risk(planned, mean, covariance, weight, radii)
        held = [
            (plan.ids.index(name), o)
            for o, name in enumerate(tracked)
            if plan.ids.count(name) == 1 and weight[o].max() > 1.0 - 1e-9
        ]
        held = [(i, o) for i, o in held if np.isfinite(truth[o, 0]).all()]
        rows, who = [i for i, _ in held], [o for _, o in held]
        mode = weight[who].argmax(axis=1)
        content = plan.content[0, rows]
        return cls(
            area=metrics.content_area(covariance, tail),
            risk=metrics.either(risk),
            touched=np.asarray(metrics.touched(planned, truth, radii).any(axis=1), dtype=np.bool_),
            known=np.asarray(times <= episode.duration + 1e-9, dtype=np.bool_),
            tail=1.0 - content,
            outside=metrics.outside_content(
                mean[who, mode, 0], covariance[who, mode, 0], truth[who, 0], content
            ),
        )


def promises(episode: Episode, log: AgentLog, tail: float) -> dict[str, Any]:
    """Consistency of a robot's plans, their risk by their own forecasts, and how both came true.

    NaN for a controller without plans; see docs/metrics.md.
    """
    found = [Judged.of(episode, log, plan, tail) for plan in log.plans]
    judged = [one for one in found if one is not None]
    largest = [float(one.risk.max()) for one in judged]
    driven = [one for one in judged if one.known[0]]
    return {
        "plan_change": known_mean([_change(a, b) for a, b in pairwise(log.plans)]),
        "region_area": known_mean([one.area.mean() for one in judged]),
        "plan_risk_mean": known_mean(largest),
        "plan_risk_max": max(largest, default=float("nan")),
        "step_risk": known_mean(_joined([one.risk[one.known] for one in judged])),
        "step_touched": known_mean(_joined([one.touched[one.known] for one in judged])),
        "episode_risk": float(metrics.either(np.array([one.risk[0] for one in driven])))
        if driven
        else float("nan"),
        "episode_touched": float(any(one.touched[0] for one in driven))
        if driven
        else float("nan"),
        "tail_nominal": known_mean(_joined([one.tail for one in driven])),
        "tail_observed": known_mean(_joined([one.outside for one in driven])),
    }


def between_steps(plans: Sequence[Plan]) -> dict[str, float]:
    """Entries into regions between the steps of plans that enter none at their steps.

    ``between_share`` is the share of these plans with an entry deeper than 1 mm, and
    ``between_depth`` the deepest one, m; NaN where nothing is known of any plan, see
    `wideberth.controllers.slots.between_steps`.
    """
    found = [plan_between(plan) for plan in plans if plan.violation <= TOLERANCE]
    depths = np.array([one.max(initial=0.0) for one in found if one is not None])
    return {
        "between_share": known_mean((depths > ENTERED).astype(np.float64)),
        "between_depth": float(depths.max()) if depths.size else float("nan"),
    }


def successors(plans: Sequence[Plan]) -> dict[str, int]:
    """Count feasible problems that are followed by infeasible ones: recursive feasibility.

    A decision is feasible if its plan keeps every constraint, on whatever rung; one without a
    plan that was checked is not. ``feasible_successors`` counts the decisions that follow a
    feasible one, ``infeasible_successors`` those of them for which no such plan was found. For
    ``aimed_successors`` and ``lowered_successors`` a plan also has to keep every region of the
    level aimed at; where to keep less has a price, as `relaxed` has it, that is a choice.
    """
    kept = [plan.violation <= TOLERANCE for plan in plans]
    aimed = [one and plan.given_way is None for one, plan in zip(kept, plans, strict=True)]
    after, aimed_after = list(pairwise(kept)), list(pairwise(aimed))
    return {
        "feasible_successors": sum(before for before, _ in after),
        "infeasible_successors": sum(before and not now for before, now in after),
        "aimed_successors": sum(before for before, _ in aimed_after),
        "lowered_successors": sum(before and not now for before, now in aimed_after),
    }


def _change(earlier: Plan, later: Plan) -> float:
    return metrics.plan_change(_clock(earlier), earlier.positions, _clock(later), later.positions)


def _clock(plan: Plan) -> Array:
    return plan.stamp + plan.dt * np.arange(len(plan.positions), dtype=np.float64)


def _joined(parts: Sequence[Array | BoolArray]) -> Array:
    return np.concatenate([np.zeros(0), *parts]).astype(np.float64)

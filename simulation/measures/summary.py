"""The metrics of an episode as table rows."""

from collections.abc import Iterable
from itertools import combinations
from typing import Any

import numpy as np

from ...framework.values.arrays import Array
from ...framework.values.plan import Rung
from ...metrics import episode as metrics
from ...metrics.gaps import gaps, wall_gaps
from ..log.episode_log import AgentLog, Episode


def summarise(episode: Episode, tail: float = 0.05) -> dict[str, Any]:
    """One row for the whole episode.

    Each column is defined in `wideberth.metrics.episode`. Pairs count when at least one
    of the two is a robot. ``below_reference`` is the share of plans that hold a constraint
    below the level they aimed at, or enter a region (`Plan.below_reference`);
    ``least_content`` is the least that any plan holds of any region, and ``gave_way`` says it of
    the plan that gave way most (`Plan.given_way`), "" where none did; ``coverage``
    is the share of later positions inside the forecasts' regions of content 1 - tail, at
    the first step, the last one, and over all; ``errors`` counts plans that something thrown
    by a plug-in turned into an emergency stop. ``deadlock`` is true also when the time limit ended
    the episode. Columns that hold for the worst robot end in ``_worst``.
    """
    apart = clearances(episode)
    rows = [_robot_row(episode, log, apart) for log in episode.robots]
    share, _, overall = forecast_coverage(episode, tail)
    fallbacks = [plan.fallbacks for log in episode.robots for plan in log.plans]
    return {
        "ended": episode.ended,
        "duration": episode.duration,
        "success": episode.ended == "goals" and min(apart.values(), default=np.inf) >= 0.0,
        "clearance": min(apart.values(), default=float("inf")),
        "collision": any(gap < 0.0 for gap in apart.values()),
        "deadlock": episode.ended in ("deadlock", "time limit"),
        "time_ratio_worst": _latest(row["time_ratio"] for row in rows),
        "extra_time_worst": _latest(row["extra_time"] for row in rows),
        "length_ratio_worst": max(row["length_ratio"] for row in rows),
        "below_reference": _share_below(episode.robots),
        "least_content": _least_content(episode.robots),
        "gave_way": _gave_way(episode.robots),
        "plans": sum(row["plans"] for row in rows),
        "errors": _errors(episode.robots),
        "fallbacks": sum(row["fallbacks"] for row in rows),
        "deadline_misses": sum(row["deadline_misses"] for row in rows),
        "violation_worst": _worst(row["violation"] for row in rows),
        "named_forecasts": metrics.share_named(fallbacks),
        "coverage": overall,
        "coverage_first": float(share[0]) if share.size else float("nan"),
        "coverage_last": float(share[-1]) if share.size else float("nan"),
        **passing(episode),
    }


def robot_rows(episode: Episode) -> list[dict[str, Any]]:
    """One row per robot; times in s, lengths in m.

    Ratios are to the free time and to the length of the first path; the time ratio of a
    robot that never arrived is inf, as is its extra time (beyond the free time), and all are
    about its first path only (a replaced path makes them meaningless). Both are NaN for a robot
    that arrived and has no reference speed: one that starts from a stand needs it stated.
    """
    apart = clearances(episode)
    return [_robot_row(episode, log, apart) for log in episode.robots]


def _robot_row(
    episode: Episode, log: AgentLog, apart: dict[tuple[str, str], float]
) -> dict[str, Any]:
    path = log.paths[0][1]
    free = metrics.free_time(path, log.speed)
    until = episode.times <= log.reached if log.reached == log.reached else episode.times >= 0
    driven = metrics.path_length(log.positions[until])
    rungs = metrics.tally(plan.rung for plan in log.plans)
    others = [gap for pair, gap in apart.items() if log.name in pair]
    return {
        "robot": log.name,
        "time": log.reached,
        "time_ratio": log.reached / free if log.reached == log.reached else float("inf"),
        "extra_time": log.reached - free if log.reached == log.reached else float("inf"),
        "length": driven,
        "length_ratio": driven / path.length,
        "deviation": metrics.lateral_deviation(log.positions[until], path),
        "clearance": min(others, default=float("inf")),
        "plans": len(log.plans),
        "below_reference": _share_below((log,)),
        "least_content": _least_content((log,)),
        "gave_way": _gave_way((log,)),
        "fallbacks": len(log.plans) - rungs.get(str(Rung.OPTIMAL), 0),
        **{f"rung_{rung.name.lower()}": rungs.get(str(rung), 0) for rung in Rung},
        "violation": _worst(plan.violation for plan in log.plans),
        "iterations": _mean(np.array([plan.iterations for plan in log.plans])),
        "named_forecasts": metrics.share_named(plan.fallbacks for plan in log.plans),
        "deadline_misses": metrics.deadline_misses(
            log.commands.stamp, log.commands.effect, log.period
        ),
        "skipped_ticks": log.skipped,
    }


def time_rows(episode: Episode) -> list[dict[str, Any]]:
    """Measured solve times, one row per robot, s; kept apart from all that is reproducible."""
    return [
        {"agent": log.name, **metrics.time_statistics(episode.plan_seconds.get(log.name, ()))}
        for log in episode.robots
    ]


def clearances(episode: Episode) -> dict[tuple[str, str], float]:
    """Smallest clearance of every pair with a robot in it, polygons included, m."""
    found = {
        (a.name, b.name): gaps(a, b)
        for a, b in combinations(episode.agents, 2)
        if "robot" in (a.kind, b.kind)
    }
    for log in episode.robots:
        found |= {(log.name, one.name): wall_gaps(log, one) for one in episode.polygons}
    return {
        pair: float(np.nanmin(gap)) if np.isfinite(gap).any() else float("inf")
        for pair, gap in found.items()
    }


def forecast_coverage(episode: Episode, tail: float) -> tuple[Array, Array, float]:
    """Share of true positions inside the forecast regions: per step, their number, over all.

    Step i of a plan's forecast is for stamp + i dt. Of a mixture the heaviest mode counts.
    Forecasts that were fallbacks count as well. Steps after the end of the episode do not, nor
    tracks of a robot with sensors that match no agent.
    """
    means, covariances, truths = [], [], []
    bodies = {log.name: log for log in episode.agents}
    for log in episode.robots:
        for plan in log.plans:
            forecast = plan.forecast
            if forecast is None:
                continue
            steps = np.arange(1, forecast.steps + 1, dtype=np.float64)
            times = plan.stamp + forecast.dt * steps
            heaviest = np.argmax(forecast.weight, axis=1)
            for o, name in enumerate(plan.tracked):
                if name not in bodies:
                    continue
                means.append(forecast.mean[o, heaviest[o]])
                covariances.append(forecast.covariance[o, heaviest[o]])
                truths.append(episode.at(bodies[name], times))
    if not means:
        return np.zeros(0), np.zeros(0), float("nan")
    share, number = metrics.coverage(
        np.array(means), np.array(covariances), np.array(truths), tail
    )
    overall = np.nansum(share * number) / number.sum() if number.any() else np.nan
    return share, number, float(overall)


def passing(episode: Episode) -> dict[str, Any]:
    """Who yields, for episodes of two robots; names, or "" where undecided.

    ``first`` passes the crossing of the two paths first, so in front of the other, which
    ``yields``. Where the paths do not cross (head-on), who deviates from its path more
    yields; with less than 0.05 m between the deviations neither does.
    """
    if len(episode.robots) != 2:
        return {"first": "", "yields": ""}
    one, two = episode.robots
    paths = one.paths[0][1], two.paths[0][1]
    crossing = metrics.crossing_point(*paths) if paths[0].points.shape[1] == 2 else None
    if crossing is None:
        aside = [
            metrics.lateral_deviation(log.positions, path)
            for log, path in zip((one, two), paths, strict=True)
        ]
        if abs(aside[0] - aside[1]) < 0.05:
            return {"first": "", "yields": ""}
        return {"first": "", "yields": one.name if aside[0] > aside[1] else two.name}
    passed = [
        metrics.passing_time(episode.times, log.positions, path, arc)
        for log, path, arc in zip((one, two), paths, crossing, strict=True)
    ]
    order = np.where(np.isnan(passed), np.inf, passed)
    if order[0] == order[1]:
        return {"first": "", "yields": ""}
    first, second = (one, two) if order[0] < order[1] else (two, one)
    return {"first": first.name, "yields": second.name}


def _share_below(logs: tuple[AgentLog, ...]) -> float:
    """Share of plans below their reference level, among those that held a constraint."""
    found = [plan.below_reference for log in logs for plan in log.plans]
    return _mean([below for below in found if below is not None])


def _least_content(logs: tuple[AgentLog, ...]) -> float:
    """Least content that any plan holds; nan where none held a constraint."""
    found = [plan.lowest_content for log in logs for plan in log.plans if plan.content.size]
    return min(found, default=float("nan"))


def _gave_way(logs: tuple[AgentLog, ...]) -> str:
    """How the plan gave way that keeps least; the first of several."""
    ways = [p.given_way for log in logs for p in log.plans if p.given_way is not None]
    return str(max(ways, key=lambda way: way.held)) if ways else ""


def _errors(logs: tuple[AgentLog, ...]) -> str:
    """How many plans were emergency stops, and the commonest reason; "" where none was."""
    reasons = [p.reason for log in logs for p in log.plans if p.violation != p.violation]
    if not reasons:
        return ""
    common = max(sorted(set(reasons)), key=reasons.count)
    return f"{len(reasons)} plans: {common}"


def _latest(values: Iterable[float]) -> float:
    """Largest value; inf where a robot never arrived, else NaN where one is unknown."""
    found = list(values)
    return float("inf") if float("inf") in found else float(np.max(found))


def _worst(violations: Iterable[float]) -> float:
    """Largest violation; plans that were held against nothing (nan) do not count."""
    return max((value for value in violations if value == value), default=0.0)


def _mean(values: Any) -> float:
    array = np.asarray(values, dtype=np.float64)
    return float(array.mean()) if array.size else float("nan")

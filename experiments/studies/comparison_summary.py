"""Lines of a comparison: shares with intervals, times, and differences in pairs."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from ...framework.numerics.statistics import (
    bootstrap_interval,
    clopper_pearson,
    known_mean,
    mcnemar,
)
from ...framework.values.arrays import Array
from ..engine.base import Row
from ..engine.closed_loop import column

MEANS = {
    "length_ratio": "length_ratio_worst",
    "intrusion_share": "intrusion_share",
    "freeze_share": "freeze_share",
    "jerk_rms": "jerk_rms",
    "social_work": "social_work",
    "coverage": "coverage",
}
"""Column of the summary -> column of the table whose mean over the episodes it is."""

LABELS = ("scenario", "robot", "settings", "controller", "seed")
"""Columns that say which episode it was."""

_SEED = 0
"""Of the bootstrap's draws: the same table gives the same summary."""


def shares(rows: Sequence[Row]) -> Row:
    """Share of each outcome; of success and collision with intervals of 95 %."""
    line: Row = {}
    outcomes = [row["outcome"] for row in rows]
    for name in ("success", "collision"):
        count = outcomes.count(name)
        low, high = clopper_pearson(count, len(rows))
        line |= {name: count / len(rows), f"{name}_low": low, f"{name}_high": high}
    return line | {name: outcomes.count(name) / len(rows) for name in ("timeout", "deadlock")}


def condensed(rows: Sequence[Row]) -> Row:
    """Condense the episodes of one controller in one place into a line; see docs/metrics.md."""
    times = column(rows, "success_time")
    clearance = column(rows, "clearance")
    plans = column(rows, "plans").sum()
    line = {
        "episodes": len(rows),
        **shares(rows),
        "time_mean_s": known_mean(times),
        "time_median_s": _median(times),
        "time_penalised_s": float(column(rows, "penalised_time").mean()),
        "clearance_min_m": float(clearance.min()),
        "clearance_median_m": float(np.median(clearance)),
        **{name: known_mean(column(rows, source)) for name, source in MEANS.items()},
        "frozen": float(column(rows, "frozen").mean()),
        "fallback_plans": float(column(rows, "fallbacks").sum() / plans) if plans else 0.0,
        "deadline_misses": int(column(rows, "deadline_misses").sum()),
        "errors": next((str(row["errors"]) for row in rows if row["errors"]), ""),
    }
    judged = [name for name in rows[0] if name.startswith("judged_")]
    found = {name: _judgement([row[name] for row in rows]) for name in judged}
    return line | {name: value for name, value in found.items() if value is not None}


def against(rows: Sequence[Row], others: Sequence[Row]) -> Row:
    """Compare a controller with another one, seed by seed.

    ``only_this`` and ``only_baseline`` count the seeds at which one succeeded alone,
    ``p_value`` is McNemar's; ``time_difference_s`` is the mean of this one's time minus the
    other's over the seeds at which both succeeded, with its bootstrap interval of 95 %.
    """
    this, other = paired(rows, others, "success"), paired(others, rows, "success")
    gap = paired(rows, others, "success_time") - paired(others, rows, "success_time")
    low, high = bootstrap_interval(gap[np.isfinite(gap)], np.random.default_rng(_SEED))
    return {
        "only_this": int(np.sum(this > other)),
        "only_baseline": int(np.sum(other > this)),
        "p_value": mcnemar(this, other),
        "time_difference_s": known_mean(gap),
        "time_difference_low_s": low,
        "time_difference_high_s": high,
    }


def paired(rows: Sequence[Row], others: Sequence[Row], name: str) -> Array:
    """One column at the seeds that both played, in order of the seed."""
    common = {row["seed"] for row in rows} & {row["seed"] for row in others}
    kept = sorted((row for row in rows if row["seed"] in common), key=lambda row: row["seed"])
    return column(kept, name)


def means(rows: Sequence[Row]) -> Row:
    """Mean over the episodes of every column of numbers or truths, of what is known."""
    skipped = (*LABELS, "judged")
    numbers = [
        name
        for name in rows[0]
        if not name.startswith(skipped) and not any(isinstance(row[name], str) for row in rows)
    ]
    return {"episodes": len(rows), **{name: known_mean(column(rows, name)) for name in numbers}}


def promised(rows: Sequence[Row]) -> Row:
    """Hold what plans promised against what happened; NaN for controllers without plans.

    Per step the means over the episodes, with bootstrap intervals of 95 % of what happened (the
    episode is the unit: its steps depend on each other); per episode the share in which a first
    step, the one that is driven, would have touched, with its Clopper-Pearson interval.
    """
    line: Row = {"episodes": len(rows)}
    for promise, kept in (("tail_nominal", "tail_observed"), ("step_risk", "step_touched")):
        values = column(rows, kept)
        rng = np.random.default_rng(_SEED)
        low, high = bootstrap_interval(values[np.isfinite(values)], rng)
        line |= {promise: known_mean(column(rows, promise)), kept: known_mean(values)}
        line |= {f"{kept}_low": low, f"{kept}_high": high}
    touched = column(rows, "episode_touched")
    touched = touched[np.isfinite(touched)]
    low, high = clopper_pearson(int(touched.sum()), len(touched))
    line |= {"episode_risk": known_mean(column(rows, "episode_risk"))}
    line |= {"episode_touched": known_mean(touched)}
    return line | {"episode_touched_low": low, "episode_touched_high": high}


def _median(values: Array) -> float:
    known = values[np.isfinite(values)]
    return float(np.median(known)) if known.size else float("nan")


def _judgement(values: Sequence[Any]) -> float | str | None:
    """Mean of numbers and truths; how often each text occurs; None where nothing was judged."""
    if all(value is None for value in values):
        return None
    if any(isinstance(value, str) for value in values):
        words = [str(value) for value in values]
        return ", ".join(f"{word} {words.count(word)}" for word in sorted(set(words)))
    return known_mean(np.array([np.nan if v is None else v for v in values], dtype=np.float64))

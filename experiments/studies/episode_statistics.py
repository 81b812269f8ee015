"""Statistics of the episodes that studies compare: condensed, in pairs, and as promised."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from ...framework.values.arrays import Array
from ...metrics.episode import tally
from ...metrics.statistics import (
    bootstrap_interval,
    clopper_pearson,
    known_mean,
    mcnemar,
    signed_rank,
)
from ..drawing.plotting import ENOUGH
from ..engine.base import Row
from ..engine.closed_loop import column, group

SOURCES = (
    "clopper1934use,mcnemar1947note,wilcoxon1945individual,efron1993introduction,perezhigueras2023hunavsim,"
    "biswas2022socnavbench,balasubramanian2015analysis"
)
"""Keys of what the columns of `measured`, `condensed` and `against` are taken from."""

ANSWERS = (
    *("episodes", "success", "p_success", "collision", "time_mean_s", "time_difference_s"),
    *("clearance_median_m", "intrusion_share", "price_of_uncertainty_s", "judged_outcome"),
    "errors",
)
"""Columns of the summary that say who arrives, who touches, how fast, how near, and by chance."""

MEANS = {
    "length_ratio": "length_ratio_worst",
    "intrusion_share": "intrusion_share",
    "freeze_share": "freeze_share",
    "jerk_rms": "jerk_rms",
    "social_work": "social_work",
    "coverage": "coverage",
}
"""Column of the summary -> column of the table whose mean over the episodes it is."""

COULD = "avoidable_"
"""Beginning of the columns that are shares of the first contacts, where there are any."""

LABELS = ("scenario", "robot", "settings", "controller", "seed")
"""Columns that say which episode it was."""


def with_interval(name: str, values: Array) -> Row:
    """Return the mean of what is known of some values, and its bootstrap interval of 95 %.

    The draws have a seed of their own: the same table gives the same summary.
    """
    low, high = bootstrap_interval(values[np.isfinite(values)], np.random.default_rng(0))
    return {name: known_mean(values), f"{name}_low": low, f"{name}_high": high}


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
        **infeasible(rows),
        "deadline_misses": int(column(rows, "deadline_misses").sum()),
        "errors": next((str(row["errors"]) for row in rows if row["errors"]), ""),
    }
    line |= {name: known_mean(column(rows, name)) for name in rows[0] if name.startswith(COULD)}
    line["contact_kinds"] = _counted([row["contact_kind"] for row in rows if row["contact_kind"]])
    judged = [name for name in rows[0] if name.startswith("judged_")]
    found = {name: _judgement([row[name] for row in rows]) for name in judged}
    return line | {name: value for name, value in found.items() if value is not None}


def infeasible(rows: Sequence[Row]) -> Row:
    """Successors of feasible decisions that are not, per 10 000: as found, and at the level aimed.

    NaN where no decision follows a feasible one; see docs/metrics.md.
    """
    line: Row = {}
    for lost, before in (
        ("infeasible_successors", "feasible_successors"),
        ("lowered_successors", "aimed_successors"),
    ):
        count = column(rows, before).sum()
        share = column(rows, lost).sum() / count if count else float("nan")
        line[f"{lost}_per_10000"] = float(1e4 * share)
    return line


def against(rows: Sequence[Row], others: Sequence[Row]) -> Row:
    """Compare a controller with another one, seed by seed.

    ``only_this`` and ``only_baseline`` count the seeds at which one succeeded alone, ``p_success``
    is McNemar's and ``p_time`` Wilcoxon's, see `signed_rank`; ``time_difference_s`` is the mean of
    this one's time minus the other's over the seeds at which both succeeded, with its bootstrap
    interval of 95 %: NaN of fewer than `ENOUGH` such seeds, as figures have none. A controller is
    not compared with itself: there p value and difference are NaN.
    """
    this, other = paired(rows, others, "success"), paired(others, rows, "success")
    gap = paired(rows, others, "success_time") - paired(others, rows, "success_time")
    if rows is others:
        gap = np.full_like(gap, np.nan)
    difference = with_interval("time_difference", gap)
    if np.isfinite(gap).sum() < ENOUGH:
        difference |= {"time_difference_low": np.nan, "time_difference_high": np.nan}
    return {
        "only_this": int(np.sum(this > other)),
        "only_baseline": int(np.sum(other > this)),
        "p_success": np.nan if rows is others else mcnemar(this, other),
        "p_time": signed_rank(gap),
        **{f"{name}_s": value for name, value in difference.items()},
    }


def by_controller(rows: Sequence[Row]) -> dict[str, list[Row]]:
    """Return the episodes of each controller."""
    return {str(name): own for (name,), own in group(rows, "controller").items()}


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
        line |= {promise: known_mean(column(rows, promise))}
        line |= with_interval(kept, column(rows, kept))
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
        return _counted(values)
    return known_mean(np.array([np.nan if v is None else v for v in values], dtype=np.float64))


def _counted(words: Sequence[Any]) -> str:
    """Write how often each word occurs."""
    return ", ".join(f"{word} {count}" for word, count in tally(words).items())

"""The lines of the prediction benchmark's table, from the scores of one predictor in one scene."""

from collections import Counter
from collections.abc import Mapping
from itertools import pairwise

import numpy as np

from ...framework.metrics.scoring import covered, inside_throughout, last_known, reason_kind
from ...framework.numerics.statistics import known_mean
from ...framework.values.arrays import Array
from ..engine.base import Row
from .prediction_scores import TAIL, Scores
from .region_family import rounded

CONTENTS = (0.5, 0.9, 0.95)
"""Of the regions whose coverage has a column."""
LEVELS = (*(round(0.05 * i, 2) for i in range(1, 20)), 0.99)
"""Contents of the calibration curves."""


def table_rows(scores: Scores, dt: float, speeds: Mapping[str, float]) -> list[Row]:
    """Return the lines of all windows, of those with a stop, and of every class of speed.

    All windows and every class have a line per step and one for all steps together; a class
    without a window has none.

    Parameters
    ----------
    dt : s, between the steps.
    speeds : m/s, least speed of each class, as in `Protocol`.
    """
    rows = _slice(scores, dt, {"slice": "all"})
    stops = scores.chosen(scores.stops > 0)
    if len(stops):
        rows.append(_whole(stops, {"slice": "stops"}))
    bounds = pairwise([*speeds.values(), np.inf])
    for name, (least, beyond) in zip(speeds, bounds, strict=True):
        some = scores.chosen((scores.speed >= least) & (scores.speed < beyond))
        if len(some):
            below = None if beyond == np.inf else beyond
            rows += _slice(some, dt, {"slice": name, "from_mps": least, "below_mps": below})
    return rows


def _slice(scores: Scores, dt: float, head: Row) -> list[Row]:
    """Return one line per step and one for all steps."""
    rows: list[Row] = []
    for step in range(scores.error.shape[1]):
        known = np.isfinite(scores.error[:, step])
        rows.append({
            **head, "step": step + 1, "time_s": rounded((step + 1) * dt),
            "windows": int(known.sum()), **_columns(scores, slice(step, step + 1)),
        })  # fmt: skip
    return [*rows, _whole(scores, head)]


def _columns(scores: Scores, steps: slice) -> Row:
    """Means over windows of the means over some steps, quantiles of the error and the area."""

    def mean(values: Array) -> float:
        return rounded(known_mean(_row_means(values[:, steps])))

    areas = scores.area[:, steps]
    return {
        "error_m": mean(scores.error),
        "median_m": _quantile(_row_means(scores.error[:, steps]), 0.5),
        "nll": mean(scores.nll),
        "energy_m": mean(scores.energy),
        **{
            f"cover_{round(100 * content)}": mean(covered(scores.tail, 1.0 - content))
            for content in CONTENTS
        },
        "area_m2": _quantile(areas, 0.5),
        "area_90_m2": _quantile(areas, 0.9),
        "area_mean_m2": rounded(known_mean(areas)),
    }


def _row_means(values: Array) -> Array:
    """Mean of what is known in each row; NaN where nothing is."""
    known = np.isfinite(values)
    number = known.sum(axis=1)
    share = np.where(known, values, 0.0).sum(axis=1) / np.maximum(number, 1)
    return np.where(number > 0, share, np.nan)


def _quantile(values: Array, share: float) -> float:
    """Quantile of what is known; NaN where nothing is."""
    known = values[np.isfinite(values)]
    return rounded(float(np.quantile(known, share))) if known.size else float("nan")


def _whole(scores: Scores, head: Row) -> Row:
    """Return the line of all steps together."""
    throughout = inside_throughout(scores.tail, TAIL)
    reasons = Counter(reason_kind(one) for one in scores.fallback if one is not None)
    count = len(scores)
    return {
        **head,
        "step": "all",
        "windows": count,
        **_columns(scores, slice(None)),
        "final_m": rounded(known_mean(last_known(scores.error))),
        "trajectory_energy_m": rounded(known_mean(scores.trajectory)),
        "all_95": rounded(known_mean(throughout)),
        "joint_95": rounded(known_mean(covered(scores.joint, TAIL))),
        "fell_back": rounded(sum(reasons.values()) / count),
        "reasons": "; ".join(
            f"{number / count:.1%}: {reason}" for reason, number in reasons.most_common()
        ),
    }


def calibration(scores: Scores) -> list[list[float]]:
    """Coverage at every content of `LEVELS`, one list per step."""
    steps = scores.tail.shape[1]
    at = [covered(scores.tail, 1.0 - content) for content in LEVELS]
    return [[rounded(known_mean(held[:, step])) for held in at] for step in range(steps)]

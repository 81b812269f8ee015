"""Taking times fairly, and boiling them down to a table."""

import gc
from collections.abc import Callable, Hashable, Mapping, Sequence
from time import perf_counter
from typing import Any, TypeAlias

import numpy as np

Row: TypeAlias = dict[str, Any]
Tick: TypeAlias = Callable[[str], None]
"""Called after each piece of work with what comes next, for the progress bar."""
Repeats: TypeAlias = Mapping[Hashable, Sequence[float]]
"""Times of repeats of the same work, ms, by what the work was."""


def timed(work: Callable[[], Any]) -> tuple[float, Any]:
    """Return the wall time of one call in ms, and what it returned.

    The garbage collector waits outside: it would be charged to whoever runs when it wakes.
    """
    gc.disable()
    try:
        begin = perf_counter()
        result = work()
        return 1e3 * (perf_counter() - begin), result
    finally:
        gc.enable()


def rotated(names: Sequence[str], turn: int) -> list[str]:
    """Return the names beginning with another one each turn, so that none always runs first.

    Examples
    --------
    >>> rotated(["a", "b", "c"], 1)
    ['b', 'c', 'a']
    """
    start = turn % len(names)
    return [*names[start:], *names[:start]]


def spread(times: Sequence[float]) -> Row:
    """Median, 95th and 99th percentile and maximum of some times, ms."""
    median, high, higher = np.percentile(times, [50, 95, 99])
    return {
        "median_ms": float(median),
        "p95_ms": float(high),
        "p99_ms": float(higher),
        "max_ms": float(np.max(times)),
    }


def brief(times: Sequence[float], reference: Sequence[float]) -> Row:
    """Median and best of repeats of the same work, ms, and best over the reference's best.

    Whatever else the machine does can only make a repeat longer, so that the best one is
    the least disturbed.
    """
    return {
        "median_ms": float(np.median(times)),
        "best_ms": float(np.min(times)),
        "ratio": float(np.min(times) / np.min(reference)),
    }


def ratio(times: Repeats, reference: Repeats) -> Row:
    """Median and 5th and 95th percentile over works of best / the reference's best."""
    pairs = [min(repeats) / min(reference[work]) for work, repeats in times.items()]
    low, median, high = np.percentile(pairs, [5, 50, 95])
    return {"ratio": float(median), "ratio_p5": float(low), "ratio_p95": float(high)}


def repeat_spread(repeats: Repeats) -> float:
    """How far repeats of the same work differ: median over the works of max / min - 1.

    nan where nothing was repeated.
    """
    ranges = [max(times) / min(times) - 1 for times in repeats.values() if len(times) > 1]
    return float(np.median(ranges)) if ranges else float("nan")


def markdown(title: str, rows: Sequence[Row]) -> str:
    """Return rows as a Markdown table under a heading; the columns are those of the first."""
    columns = list(rows[0])
    lines = ["| " + " | ".join(columns) + " |", "|" + " --- |" * len(columns)]
    lines += ["| " + " | ".join(cell(row[name]) for name in columns) + " |" for row in rows]
    return "\n".join([f"## {title}", "", *lines, ""])


def cell(value: Any) -> str:
    """Write a value for reading: three significant digits, the CSV has them all.

    Examples
    --------
    >>> cell(12.3456), cell(1234.5), cell(0.00012345), cell(7), cell(None)
    ('12.3', '1234', '0.000123', '7', '')
    """
    if value is None:
        return ""
    if isinstance(value, bool) or not isinstance(value, float):
        return str(value)
    return f"{value:.0f}" if abs(value) >= 1000 else f"{value:.3g}"

"""Timing of work in turns, and its tables."""

import gc
from collections.abc import Callable, Hashable, Mapping, Sequence
from time import perf_counter
from typing import Any, TypeAlias

import numpy as np

Row: TypeAlias = dict[str, Any]
Tables: TypeAlias = dict[str, tuple[str, list[Row]]]
"""Name of the file -> title and rows. Without a title the rows are written and not shown."""
Repeats: TypeAlias = Mapping[Hashable, Sequence[float]]
"""Times of repeats of the same work, ms, by what the work was."""


def timed(work: Callable[[], Any]) -> tuple[float, Any]:
    """Return the wall time of one call in ms, and what it returned.

    The garbage collector waits outside: it would be charged to the work that runs when it wakes.
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
    names = ("median_ms", "p95_ms", "p99_ms", "max_ms")
    return dict(zip(names, np.percentile(times, [50, 95, 99, 100]).tolist(), strict=True))


def speedup(times: Repeats, reference: Repeats) -> Row:
    """How many times as fast as the reference: best repeat over best repeat of each work.

    Whatever else the machine does can only make a repeat longer, so that the best one is the least
    disturbed. ``of_medians`` is the ratio of the two medians over the works, ``each`` the median,
    5th and 95th percentile of the ratios of the single works. Only works that both did count.
    """
    shared = [work for work in times if work in reference]
    own = np.array([min(times[work]) for work in shared])
    other = np.array([min(reference[work]) for work in shared])
    low, median, high = np.percentile(other / own, [5, 50, 95])
    return {
        "of_medians": float(np.median(other) / np.median(own)),
        "each": float(median),
        "each_p5": float(low),
        "each_p95": float(high),
    }


def slope(sizes: Sequence[float], times: Sequence[float]) -> float:
    """Exponent b of time = a size^b: the least-squares slope of log time over log size.

    Examples
    --------
    >>> round(slope([1, 10, 100], [2.0, 20.0, 200.0]), 12)
    1.0
    """
    return float(np.polyfit(np.log(sizes), np.log(times), 1)[0])


def repeats(rows: Sequence[Row], label: str, column: str = "ms") -> dict[Hashable, list[float]]:
    """Collect the times of one set-up, ms, by instance; ``column`` is where they stand."""
    found: dict[Hashable, list[float]] = {}
    for row in rows:
        if row["set-up"] == label:
            found.setdefault(row["instance"], []).append(row[column])
    return found


def labels(rows: Sequence[Row]) -> list[str]:
    """Name the set-ups in the order in which they first appear."""
    return list(dict.fromkeys(row["set-up"] for row in rows))


def repeat_spread(times: Repeats) -> float:
    """How far repeats of the same work differ: median over the works of max / min - 1.

    nan where nothing was repeated.
    """
    ranges = [max(found) / min(found) - 1 for found in times.values() if len(found) > 1]
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

"""Taking times fairly, and boiling them down to a table."""

import gc
import subprocess
import sys
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

    The garbage collector waits outside: it would be charged to the work that runs when it wakes.
    """
    gc.disable()
    try:
        begin = perf_counter()
        result = work()
        return 1e3 * (perf_counter() - begin), result
    finally:
        gc.enable()


def bare_loop(processes: int, steps: int) -> None:
    """Do plain arithmetic in so many processes at once: no work gains more from another one."""
    command = [sys.executable, "-S", "-c", f"sum(k * k for k in range({steps}))"]
    started = [subprocess.Popen(command) for _ in range(processes)]
    for process in started:
        process.wait()


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


def speedup(times: Repeats, reference: Repeats) -> Row:
    """How many times as fast as the reference: best repeat over best repeat of each work.

    ``of_medians`` is the ratio of the two medians over the works, ``each`` the median, 5th and
    95th percentile of the ratios of the single works. Only works that both did count.
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
    x, y = np.log(sizes), np.log(times)
    x = x - x.mean()
    return float(x @ y / (x @ x))


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

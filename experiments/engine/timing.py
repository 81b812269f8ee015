"""Measured times of a run, condensed for the reader."""

from collections.abc import Sequence

import numpy as np

from .base import Row

STATISTICS = ("median", "p95", "p99", "max")


def condense_times(times: Sequence[Row]) -> list[Row]:
    """Return one line per kind of task: how long a call of the controller took, ms.

    Over the robots and seeds of a kind: the median of the medians, and the worst of the
    percentiles. Times of other sorts than `wideberth.simulation.measures.summary.time_rows` are
    left
    to the experiment.
    """
    known = [row for row in times if all(name in row for name in STATISTICS)]
    skipped = {"agent", "seed", *STATISTICS}
    groups: dict[tuple[object, ...], list[Row]] = {}
    names = [name for name in (known[0] if known else {}) if name not in skipped]
    names = [name for name in names if len({row[name] for row in known}) > 1] or names[:1]
    for row in known:
        groups.setdefault(tuple(row[name] for name in names), []).append(row)
    lines = []
    for labels, rows in groups.items():
        line: Row = dict(zip(names, labels, strict=True))
        for name in STATISTICS:
            values = np.array([row[name] for row in rows], dtype=np.float64)
            over = np.median(values) if name == "median" else values.max()
            line[f"{name} ms"] = float(1e3 * over)
        lines.append(line)
    return lines

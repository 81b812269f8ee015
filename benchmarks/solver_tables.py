"""Tables of solves: how long, how much faster than the references, how often solved, how good."""

from collections.abc import Sequence

import numpy as np
from judging import LOOSE, NEAR, TIGHT
from measuring import Row, labels, repeat_spread, repeats, speedup, spread
from set_ups import ELLIPSE, HONEST, PAPER


def times(solves: Sequence[Row]) -> list[Row]:
    """One row per set-up: how long, over all repeats, and by the best repeat of each instance."""
    rows = []
    for label in labels(solves):
        own = _of(solves, label)
        best = [min(found) for found in repeats(own, label).values()]
        row = {"set-up": label, "solves": len(own), **spread([one["ms"] for one in own])}
        again = [min(found) for found in repeats(own, label, "again_ms").values()]
        row |= {"best_median_ms": float(np.median(best))}
        rows.append(row | {"again_median_ms": float(np.median(again))})
    return rows


def speedups(solves: Sequence[Row]) -> list[Row]:
    """One row per set-up: how many times as fast as both references on the same instances.

    ``..._again`` are ratios of medians of solves repeated at once.
    ``exact_over_ellipse`` is the time of the exact sum over that of the ellipse, same solver.
    """
    known = {label: repeats(solves, label) for label in labels(solves)}
    again = {label: repeats(solves, label, "again_ms") for label in labels(solves)}
    rows = []
    for label, own in known.items():
        over_paper = speedup(own, known[PAPER])
        over_honest = speedup(own, known[HONEST])
        row: Row = {"set-up": label}
        row |= {f"{PAPER}_{key}": over_paper[key] for key in ("of_medians", "each")}
        row |= {f"{HONEST}_{key}": value for key, value in over_honest.items()}
        row |= {
            f"{name}_again": speedup(again[label], again[name])["of_medians"]
            for name in (PAPER, HONEST)
        }
        plain = known.get(label.removesuffix(", exact"))
        exact = plain is not None and label.endswith(", exact")
        inverse = speedup(plain, own)["of_medians"] if plain is not None and exact else None
        rows.append(row | {"exact_over_ellipse": inverse})
    return rows


def quality(solves: Sequence[Row]) -> list[Row]:
    """One row per set-up: iterations, success, and how good the plans are."""
    best = best_costs(solves)
    rows = []
    for label in labels(solves):
        own = _of(solves, label)
        iterations = np.array([row["iterations"] for row in own])
        median, high = np.percentile(iterations, [50, 99])
        row = {"set-up": label, "iterations": float(median), "iterations_p99": float(high)}
        row |= {"iterations_max": int(iterations.max()), **shares(own)}
        rows.append(row | gaps(own, best))
    return rows


def shares(rows: Sequence[Row]) -> Row:
    """Shares of solves that converged, that are feasible, and that are both, in the two senses."""
    solved = np.array([row["solved"] for row in rows])
    violation = np.array([row["violation"] for row in rows])
    return {
        "converged": float(solved.mean()),
        "feasible_1e-6": float((violation <= TIGHT).mean()),
        "feasible_1e-4": float((violation <= LOOSE).mean()),
        "both_1e-6": float((solved & (violation <= TIGHT)).mean()),
        "both_1e-4": float((solved & (violation <= LOOSE)).mean()),
    }


def gaps(rows: Sequence[Row], best: dict[tuple[str, int], float]) -> Row:
    """Gaps (f - f*) / (1 + |f*|) of feasible plans; the share is of all solves."""
    found = []
    for row in rows:
        least = best.get((row["region"], row["instance"]), float("nan"))
        if row["violation"] <= LOOSE:
            found.append((row["cost"] - least) / (1.0 + abs(least)))
    near = sum(gap < NEAR for gap in found) / len(rows)
    kept = [gap for gap in found if np.isfinite(gap)] or [float("nan")]
    return {
        "gap_below_1e-3": near,
        "gap_median": float(np.median(kept)),
        "gap_max": float(np.max(kept)),
    }


def best_costs(solves: Sequence[Row]) -> dict[tuple[str, int], float]:
    """f* of each region and instance: as recorded, else the lowest of a feasible plan found here.

    What is recorded belongs to the ellipse. A plan counts as feasible here at the tighter bound,
    so that no violation is rewarded.
    """
    best: dict[tuple[str, int], float] = {}
    for row in solves:
        key = row["region"], row["instance"]
        if row["region"] == ELLIPSE and np.isfinite(row["best_known"]):
            best[key] = row["best_known"]
        elif row["violation"] <= TIGHT and np.isfinite(row["cost"]):
            best[key] = min(best.get(key, np.inf), row["cost"])
    return best


def by_obstacles(solves: Sequence[Row]) -> list[Row]:
    """One row per number of obstacles and set-up: time, speed-up, success."""
    rows = []
    for count in sorted({row["obstacles"] for row in solves}):
        here = [row for row in solves if row["obstacles"] == count]
        best = best_costs(here)
        for label in labels(here):
            own = _of(here, label)
            row = {"obstacles": count, "set-up": label, **spread([one["ms"] for one in own])}
            for reference in (PAPER, HONEST):
                ratio = speedup(repeats(own, label), repeats(here, reference))["of_medians"]
                row[f"{reference}_of_medians"] = ratio
            counts = np.array([one["iterations"] for one in own])
            row |= {"iterations": float(np.median(counts)), "iterations_max": int(counts.max())}
            row["both_1e-6"] = shares(own)["both_1e-6"]
            rows.append(row | {"gap_below_1e-3": gaps(own, best)["gap_below_1e-3"]})
    return rows


def reference_spread(solves: Sequence[Row]) -> float:
    """How far repeated solves of one instance by the reference differ."""
    return repeat_spread(repeats(solves, HONEST))


def _of(solves: Sequence[Row], label: str) -> list[Row]:
    return [row for row in solves if row["set-up"] == label]

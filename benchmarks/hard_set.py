"""Hard instances: how many are solved, and what comes back where nothing can be."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from judging import LOOSE, TIGHT
from measuring import Row, labels
from peers import STOPPABLE, peers
from planner_answer import PlannerAnswer
from set_ups import CAP, EXACT, OWN, PERIOD, TOLERANCE, SetUp, registered, set_ups

OTHERWISE = "fatrop"
"""The planner's solver where the own one is not registered."""


def candidates() -> dict[str, SetUp]:
    """Every set-up with the ellipse, and the whole planner, under the paper's deadline.

    Peers that cannot be stopped are left out.
    """
    solvers, endless = registered(), set(peers(TOLERANCE)) - {STOPPABLE}
    planner = PlannerAnswer(solvers.get(OWN, solvers[OTHERWISE]))
    plain = {label: one for label, one in set_ups().items() if one.region != EXACT}
    capped = {label: replace(one, deadline=CAP) for label, one in plain.items()}
    capped = {label: one for label, one in capped.items() if "450 ms" not in label}
    capped = {label: one for label, one in capped.items() if label not in endless}
    return capped | {"planner": SetUp(planner, deadline=CAP)}


def by_kind(solves: Sequence[Row]) -> list[Row]:
    """One row per kind and set-up, of the instances with a known feasible point.

    ``solved`` is the share that converged to a feasible plan, at either tolerance, ``in_time``
    the share of them before the deadline.
    """
    known = feasible(solves)
    rows = []
    for kind in dict.fromkeys(row["kind"] for row in solves):
        here = [row for row in solves if row["kind"] == kind]
        for label in labels(solves):
            all_of = [row for row in here if row["set-up"] == label]
            own = [row for row in all_of if row["instance"] in known]
            row: Row = {"kind": kind, "set-up": label, "instances": _instances(all_of)}
            rows.append(row | {"known": _instances(own), **_solved(own), **_spent(all_of)})
    return rows


def safe(solves: Sequence[Row]) -> list[Row]:
    """One row per set-up and group: whether what comes back can be driven, and how deep it enters.

    See `judging.driven` for what did not converge. ``excess`` is the deepest entry into a region
    less that of the best set-up on the same instance, over plans that keep dynamics and limits.
    """
    known = feasible(solves)
    groups = {
        "feasible point known": [row for row in solves if row["instance"] in known],
        "none known": [row for row in solves if row["instance"] not in known],
    }
    rows = []
    for name, here in groups.items():
        if not here:
            continue
        least = _least(here)
        for label in labels(here):
            own = [row for row in here if row["set-up"] == label]
            drivable = [row for row in own if row["driven_motion"] <= LOOSE]
            excess = [row["driven_entered"] - least[row["instance"]] for row in drivable]
            rows.append(
                {
                    "instances": name,
                    "set-up": label,
                    "solves": len(own),
                    "drivable": len(drivable) / len(own),
                    "excess_median": float(np.median(excess)) if excess else None,
                    "excess_max": float(np.max(excess)) if excess else None,
                    "drivable_within_0.01": sum(value <= 0.01 for value in excess) / len(own),
                    "before_450_ms": float(np.mean([row["ms"] <= 1e3 * CAP for row in own])),
                    "before_50_ms": float(np.mean([row["ms"] <= 1e3 * PERIOD for row in own])),
                }
            )
    return rows


def feasible(solves: Sequence[Row]) -> set[int]:
    """Instances with a known feasible point: recorded as such, or found here by anyone."""
    return {
        row["instance"]
        for row in solves
        if np.isfinite(row["best_known"]) or row["violation"] <= TIGHT
    }


def _least(rows: Sequence[Row]) -> dict[int, float]:
    """Smallest entry of a drivable plan, by instance."""
    found: dict[int, float] = {}
    for row in rows:
        if row["driven_motion"] <= LOOSE:
            before = found.get(row["instance"], np.inf)
            found[row["instance"]] = min(before, row["driven_entered"])
    return found


def _solved(rows: Sequence[Row]) -> Row:
    if not rows:
        return {"solved_1e-6": None, "solved_1e-4": None, "in_time": None}
    tight, loose = (
        [row["solved"] and row["violation"] <= bound for row in rows] for bound in (TIGHT, LOOSE)
    )
    timely = [ok and row["ms"] <= 1e3 * CAP for ok, row in zip(loose, rows, strict=True)]
    return {
        "solved_1e-6": float(np.mean(tight)),
        "solved_1e-4": float(np.mean(loose)),
        "in_time": float(np.mean(timely)),
    }


def _spent(rows: Sequence[Row]) -> Row:
    """Time over all of a kind, solvable or not."""
    taken = [row["ms"] for row in rows]
    return {"median_ms": float(np.median(taken)), "max_ms": float(np.max(taken))}


def _instances(rows: Sequence[Row]) -> int:
    return len({row["instance"] for row in rows})

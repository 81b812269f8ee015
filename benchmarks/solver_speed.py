"""Solver set-ups on recorded instances: every one solves each from the same guess, in turn."""

import sys
from argparse import Namespace
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
from measuring import Row, Tables, labels, repeat_spread, repeats, rotated, speedup, spread, timed
from set_ups import HONEST, PAPER, SetUp, missing, set_ups

from wideberth.benchmarks.recorded_instances import (
    ELLIPSE,
    EXACT,
    Instance,
    paper_problem,
    read_instances,
    unicycle,
    worst_violation,
)
from wideberth.framework.mpc.ocp.transcription import Guess
from wideberth.framework.mpc.slots.base import with_auxiliaries
from wideberth.framework.mpc.slots.gaussian_discs import GaussianDiscs
from wideberth.framework.mpc.solver import Solution
from wideberth.framework.plugins.config import build
from wideberth.framework.values.plan import Status

TIGHT, LOOSE = 1e-6, 1e-4
"""Largest violation (m, m/s or unit-free) of a feasible plan: the solvers' own tolerance, and what
the planner accepts."""
NEAR = 1e-3
"""Largest gap (f - f*) / (1 + |f*|) of a plan that is as good as the best known."""
_SECTIONS = 60
"""Of a golden-section search: 0.618^60 is 3e-13."""


def chosen(path: Path, count: int | None, region: str = ELLIPSE) -> list[Instance]:
    """Read the instances of a file; ``count`` of them, spread over the file, if given."""
    found = list(read_instances(path, build("regions", region)))
    if count is not None and count < len(found):
        found = [found[i] for i in np.linspace(0, len(found) - 1, count).astype(int)]
    return [suited(instance, region) for instance in found]


def suited(instance: Instance, region: str) -> Instance:
    """Fill in the auxiliaries that suit the guess, of regions that have any."""
    own = GaussianDiscs(build("regions", region))
    guess = with_auxiliaries(unicycle(), [own], instance.parameters, instance.guess)
    return replace(instance, guess=guess, parameters=guess.pull(instance.parameters))


def tables(options: Namespace) -> Tables:
    """Solve the instances of a file with every set-up."""
    candidates, count = set_ups(), 1 if options.quick else None
    names = dict.fromkeys(candidate.region for candidate in candidates.values())
    regions = {name: chosen(options.instances, count, name) for name in names}
    solves = measure(candidates, regions, 1 if options.quick else options.rounds)
    again = repeat_spread(repeats(solves, HONEST))
    lacking = [{"peer": name, "why": why} for name, why in missing().items()]
    return {
        "solves": ("", solves),
        "solvers": ("Solver set-ups on recorded instances", times(solves)),
        "speedups": ("How many times as fast as a reference", speedups(solves)),
        "quality": ("What they return", quality(solves)),
        "obstacles": ("The same by number of obstacles", divided(solves, "obstacles")),
        "kinds": ("The same by kind", divided(solves, "kind")),
        "spread": (
            "How far repeats of one instance differ, max over min less one, median",
            [{"set-up": HONEST, "spread": again}],
        ),
        **({"peers": ("Peers without a row", lacking)} if lacking else {}),
    }


def measure(
    candidates: dict[str, SetUp], instances: dict[str, list[Instance]], rounds: int
) -> list[Row]:
    """Solve every instance with every set-up, ``rounds`` times: one row per solve.

    Each solve is repeated at once, ``again_ms``: the first finds the processor's caches filled by
    another set-up, as in a control loop that does other things too; the second finds its own.

    Parameters
    ----------
    candidates : what takes part.
    instances : the same ones for each region.
    rounds : over the instances.
    """
    plain = next(iter(instances.values()))
    for count in sorted({instance.obstacles for instance in plain}):
        first = next(i for i, one in enumerate(plain) if one.obstacles == count)
        for label, candidate in candidates.items():
            print(f"compiling {label}, {count} obstacles", file=sys.stderr)
            _solve(candidate, instances[candidate.region][first])
    rows = []
    for turn in range(rounds):
        print(f"solving, round {turn + 1} of {rounds}", file=sys.stderr)
        for index in range(len(plain)):
            taking = [label for label, one in candidates.items() if turn < (one.rounds or rounds)]
            for label in rotated(taking, turn + index):
                candidate = candidates[label]
                instance = instances[candidate.region][index]
                solve = partial(_solve, candidate, instance)
                time, solution = timed(solve)
                again = timed(solve)[0] if candidate.rounds is None else float("nan")
                row = {"set-up": label, "region": candidate.region, "instance": index}
                row |= {"round": turn, "kind": instance.kind, "obstacles": instance.obstacles}
                row |= {"ms": time, "again_ms": again}
                row |= judged(instance, candidate.region, solution)
                rows.append(row | {"best_known": instance.best_cost})
    return rows


def _solve(candidate: SetUp, instance: Instance) -> Solution:
    problem = paper_problem(candidate.region, instance.obstacles, len(instance.guess.inputs))
    return candidate.solve(problem, instance.parameters, instance.guess)


def judged(instance: Instance, region: str, solution: Solution) -> Row:
    """Return what a solver says of its plan, and its largest violation, in plain NumPy."""
    return {
        "iterations": solution.iterations,
        "status": str(solution.status),
        "solved": solution.status is Status.SOLVED,
        "cost": solution.cost,
        "violation": violation(instance, region, solution.point),
    }


def violation(instance: Instance, region: str, point: Guess) -> float:
    """Return the largest violation of dynamics, limits and regions, which is 1 - gauge."""
    if region != EXACT:
        return max(worst_violation(instance, point), 0.0)
    mean, axis, deviation, margin = instance.ellipses
    bare = replace(instance, ellipses=(mean[:0], axis[:0], deviation[:0], margin[:0]))
    entered = 1.0 - float(sum_gauge(instance, point).min(initial=np.inf))
    return max(worst_violation(bare, point), entered, 0.0)


def sum_gauge(instance: Instance, point: Guess) -> np.ndarray:
    """Gauge of ellipse + disc at each step, (K, N): the root of max F(t) over t in (0, 1).

    F(t) = sum_i x_i^2 t (1 - t) / ((1 - t) a_i^2 + t rho^2) is concave (Perram and Wertheim,
    1985), so that a golden-section search finds its maximum.
    """
    mean, axis, deviation, margin = instance.ellipses
    offset = point.states[1:, :2] - mean
    across = np.stack([-axis[..., 1], axis[..., 0]], axis=-1)
    local = np.stack([(offset * axis).sum(-1), (offset * across).sum(-1)], axis=-1)
    squares = np.maximum((point.level * deviation) ** 2, 1e-18)
    disc = margin[:, None] ** 2

    def value(t: np.ndarray) -> np.ndarray:
        length = (1 - t)[..., None] * squares + (t * disc)[..., None]
        return (t * (1 - t))[..., None] * local**2 / length

    low, high = np.zeros(mean.shape[:2]), np.ones(mean.shape[:2])
    step = 0.5 * (np.sqrt(5.0) - 1.0)
    for _ in range(_SECTIONS):
        left, right = high - step * (high - low), low + step * (high - low)
        first = value(left).sum(-1) > value(right).sum(-1)
        low, high = np.where(first, low, left), np.where(first, right, high)
    return np.sqrt(value(0.5 * (low + high)).sum(-1))


def times(solves: Sequence[Row]) -> list[Row]:
    """One row per set-up: how long, over all repeats, and by the best repeat of each instance."""
    rows = []
    for label in labels(solves):
        own = _of(solves, label)
        row = {"set-up": label, "solves": len(own), **spread([one["ms"] for one in own])}
        for name, column in (("best_median_ms", "ms"), ("again_median_ms", "again_ms")):
            best = [min(found) for found in repeats(own, label, column).values()]
            row[name] = float(np.median(best))
        rows.append(row)
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
        row: Row = {"set-up": label}
        for name in (PAPER, HONEST):
            row |= {f"{name}_{key}": value for key, value in speedup(own, known[name]).items()}
            row[f"{name}_again"] = speedup(again[label], again[name])["of_medians"]
        plain = known.get(label.removesuffix(", exact"), own)
        inverse = speedup(plain, own)["of_medians"] if plain is not own else None
        rows.append(row | {"exact_over_ellipse": inverse})
    return rows


def quality(solves: Sequence[Row]) -> list[Row]:
    """One row per set-up: iterations, success, and how good the plans are."""
    best = best_costs(solves)
    return [{"set-up": label, **_quality(_of(solves, label), best)} for label in labels(solves)]


def divided(solves: Sequence[Row], column: str) -> list[Row]:
    """One row per value of a column and set-up: time, speed-up, success."""
    rows, best = [], best_costs(solves)
    for value in sorted({row[column] for row in solves}):
        here = [row for row in solves if row[column] == value]
        for label in labels(here):
            own = _of(here, label)
            row = {column: value, "set-up": label, **spread([one["ms"] for one in own])}
            for reference in (PAPER, HONEST):
                ratio = speedup(repeats(own, label), repeats(here, reference))["of_medians"]
                row[f"{reference}_of_medians"] = ratio
            rows.append(row | _quality(own, best))
    return rows


def _quality(rows: Sequence[Row], best: dict[tuple[str, int], float]) -> Row:
    """Return iterations, shares of solves that converged and are feasible, and gaps of the latter.

    A gap is (f - f*) / (1 + |f*|); the share is of all solves.
    """
    solved = np.array([row["solved"] for row in rows])
    violated = np.array([row["violation"] for row in rows])
    iterations = np.percentile([row["iterations"] for row in rows], [50, 99, 100]).tolist()
    found = []
    for row in rows:
        least = best.get((row["region"], row["instance"]), float("nan"))
        if row["violation"] <= LOOSE:
            found.append((row["cost"] - least) / (1.0 + abs(least)))
    kept = [gap for gap in found if np.isfinite(gap)] or [float("nan")]
    return {
        **dict(zip(("iterations", "iterations_p99", "iterations_max"), iterations, strict=True)),
        "converged": float(solved.mean()),
        "feasible_1e-6": float((violated <= TIGHT).mean()),
        "feasible_1e-4": float((violated <= LOOSE).mean()),
        "both_1e-6": float((solved & (violated <= TIGHT)).mean()),
        "both_1e-4": float((solved & (violated <= LOOSE)).mean()),
        "gap_below_1e-3": sum(gap < NEAR for gap in found) / len(rows),
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


def _of(solves: Sequence[Row], label: str) -> list[Row]:
    return [row for row in solves if row["set-up"] == label]

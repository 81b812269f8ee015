"""Solver set-ups on recorded instances: how long, how often solved, how good."""

from collections.abc import Hashable
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path

import numpy as np
from measuring import Row, Tick, ratio, repeat_spread, rotated, spread, timed

from wideberth.framework import names
from wideberth.framework.config import build
from wideberth.framework.mpc.assembly import assemble
from wideberth.framework.mpc.levels.relaxed import Relaxed
from wideberth.framework.mpc.problem import Problem
from wideberth.framework.mpc.recorded import LEVEL, Instance, read_instances, worst_violation
from wideberth.framework.mpc.solvers.base import Solution, Solver
from wideberth.framework.plan import Status

REFERENCE = "ipopt sx"
FEASIBLE = 1e-4
"""Largest violation in the independent check (m, m/s or unit-free) of a feasible plan."""
NEAR = 1e-3
"""Largest gap (f - f*) / (1 + |f*|) of a plan that is as good as the best known."""


@dataclass(frozen=True)
class SetUp:
    """A solver and the deadline it works under, s."""

    solver: Solver
    deadline: float | None = None


def set_ups() -> dict[str, SetUp]:
    """Return the reference, the paper's set-up, and every other registered solver."""
    others = {name: SetUp(build("solvers", name)) for name in names("solvers") if name != "ipopt"}
    return {
        REFERENCE: SetUp(build("solvers", {"type": "ipopt", "graph": "sx"})),
        "ipopt mx, 450 ms": SetUp(build("solvers", {"type": "ipopt", "graph": "mx"}), 0.45),
        **others,
    }


def chosen(path: Path, count: int | None) -> list[Instance]:
    """Read the instances of a file; ``count`` of them, spread over the file, if given."""
    found = list(read_instances(path, build("regions", "mahalanobis_ellipse")))
    if count is None or count >= len(found):
        return found
    return [found[i] for i in np.linspace(0, len(found) - 1, count).astype(int)]


def measure(instances: list[Instance], rounds: int, tick: Tick) -> list[Row]:
    """Solve every instance with every set-up, ``rounds`` times: one row per solve."""
    candidates = set_ups()
    problem = cache(_problem)  # one per number of obstacles
    for count in sorted({instance.obstacles for instance in instances}):
        first = next(one for one in instances if one.obstacles == count)
        for label, candidate in candidates.items():
            tick(f"compiling {label}, {count} obstacles")
            _solve(candidate, problem(count), first)
    rows = []
    for turn in range(rounds):
        for index, instance in enumerate(instances):
            tick(f"solving instance {index}, round {turn + 1}")
            for label in rotated(list(candidates), turn + index):
                work = partial(_solve, candidates[label], problem(instance.obstacles), instance)
                time, solution = timed(work)
                rows.append(
                    {
                        "set-up": label,
                        "instance": index,
                        "round": turn,
                        "kind": instance.kind,
                        "obstacles": instance.obstacles,
                        "ms": time,
                        "iterations": solution.iterations,
                        "status": str(solution.status),
                        "violation": worst_violation(instance, solution.point),
                        "gap": instance.gap(solution.cost),
                    }
                )
    return rows


def steps(instances: list[Instance], rounds: int) -> int:
    """Count the ticks of `measure`."""
    counts = {instance.obstacles for instance in instances}
    return len(counts) * len(set_ups()) + rounds * len(instances)


def times(solves: list[Row]) -> list[Row]:
    """One row per set-up: how long."""
    rows = []
    for label in dict.fromkeys(row["set-up"] for row in solves):
        own = [row for row in solves if row["set-up"] == label]
        taken = spread([row["ms"] for row in own])
        rows.append({"set-up": label, "solves": len(own), **taken, **_ratio(solves, own)})
    return rows


def quality(solves: list[Row]) -> list[Row]:
    """One row per set-up: iterations, success, and how good the plans are."""
    rows = []
    for label in dict.fromkeys(row["set-up"] for row in solves):
        own = [row for row in solves if row["set-up"] == label]
        feasible = np.array([row["violation"] < FEASIBLE for row in own])
        gap = np.array([row["gap"] for row in own])
        iterations = [row["iterations"] for row in own]
        rows.append(
            {
                "set-up": label,
                "iterations": float(np.median(iterations)),
                "iterations_max": max(iterations),
                "converged": float(np.mean([row["status"] == Status.SOLVED for row in own])),
                "feasible": float(feasible.mean()),
                "gap_below_1e-3": float(np.mean(gap < NEAR)),
                "both": float(np.mean(feasible & (gap < NEAR))),
                "gap_median": float(np.median(gap)),
                "gap_max": float(gap.max()),
            }
        )
    return rows


def by_obstacles(solves: list[Row]) -> list[Row]:
    """One row per number of obstacles and set-up: time and ratio."""
    rows = []
    for count in sorted({row["obstacles"] for row in solves}):
        for label in dict.fromkeys(row["set-up"] for row in solves):
            own = [row for row in solves if (row["set-up"], row["obstacles"]) == (label, count)]
            taken = spread([row["ms"] for row in own])
            rows.append({"obstacles": count, "set-up": label, **taken, **_ratio(solves, own)})
    return rows


def reference_spread(solves: list[Row]) -> float:
    """How far repeated solves of one instance by the reference differ."""
    return repeat_spread(_repeats(solves, REFERENCE))


def _ratio(solves: list[Row], own: list[Row]) -> Row:
    return ratio(_repeats(own, own[0]["set-up"]), _repeats(solves, REFERENCE))


def _repeats(solves: list[Row], label: str) -> dict[Hashable, list[float]]:
    """Collect the times of one set-up, ms, by instance."""
    found: dict[Hashable, list[float]] = {}
    for row in solves:
        if row["set-up"] == label:
            found.setdefault(row["instance"], []).append(row["ms"])
    return found


def _solve(candidate: SetUp, problem: Problem, instance: Instance) -> Solution:
    guesses = [instance.guess]
    (solution,) = candidate.solver.solve(problem, instance.parameters, guesses, candidate.deadline)
    return solution


def _problem(obstacles: int) -> Problem:
    """Build the paper's problem; its printed s_ref is in the recorded parameters."""
    return assemble(
        build("robots", "unicycle"),
        build("regions", "mahalanobis_ellipse"),
        Relaxed(tail=float(np.exp(-0.5 * LEVEL**2))),
        horizon=15,
        dt=0.5,
        capacity=obstacles,
    )

"""How time grows with the number of obstacles and with the horizon, on instances made for it."""

import sys
from argparse import Namespace
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from instances import Made, Recipe
from measuring import Row, Tables, labels, repeats, rotated, slope, timed
from set_ups import registered
from solver_speed import LOOSE

from wideberth.benchmarks.recorded_instances import ELLIPSE, unicycle
from wideberth.framework.mpc.levels.relaxed import Relaxed
from wideberth.framework.mpc.planner.verify import violation
from wideberth.framework.mpc.solver import Solution, Solver
from wideberth.framework.plugins.config import build
from wideberth.framework.values.plan import Status


@dataclass(frozen=True)
class Sizes:
    """Sizes of the problems.

    Attributes
    ----------
    obstacles : K, at the paper's N = 15.
    steps : N, at each K of ``among``.
    among : K.
    instances : of each size.
    """

    obstacles: tuple[int, ...] = (1, 5, 10, 20, 50, 100)
    steps: tuple[int, ...] = (15, 30, 60, 120)
    among: tuple[int, ...] = (1, 20)
    instances: int = 20

    def all_of(self) -> list[tuple[str, int, int]]:
        """Return (axis, K, N) of every size."""
        found = [("K, N = 15", count, 15) for count in self.obstacles]
        for count in self.among:
            found += [(f"N, K = {count}", count, steps) for steps in self.steps]
        return found


def tables(options: Namespace) -> Tables:
    """Solve instances made in growing sizes with every solver."""
    sizes = Sizes((1, 2), (5, 10), (1,), instances=1) if options.quick else Sizes()
    solves = measure(sizes, 1 if options.quick else options.rounds)
    rows = table(solves)
    return {
        "scaling_solves": ("", solves),
        "scaling": ("Growth with obstacles and horizon", rows),
        "slopes": ("Exponents of growth", slopes(rows)),
    }


def measure(sizes: Sizes, rounds: int) -> list[Row]:
    """Solve every instance of every size with every solver: one row per solve."""
    solvers = registered()
    level = Relaxed(weight=1.0, minimum=0.0)
    rows = []
    for axis, obstacles, steps in sizes.all_of():
        recipe = Recipe(unicycle(), build("regions", ELLIPSE), level, obstacles, steps)
        made = recipe.make(range(sizes.instances))
        print(f"scaling, K = {obstacles}, N = {steps}", file=sys.stderr)
        for solver in solvers.values():  # compiles
            _solve(solver, made[0])
        for turn in range(rounds):
            for index, one in enumerate(made):
                for name in rotated(list(solvers), turn + index):
                    time, solution = timed(partial(_solve, solvers[name], one))
                    row = {"axis": axis, "obstacles": obstacles, "steps": steps, "set-up": name}
                    row |= {"instance": index, "round": turn, "ms": time}
                    rows.append(row | judged(one, solution))
    return rows


def judged(made: Made, solution: Solution) -> Row:
    """Return what a solver says of its plan, and its largest violation by the planner's check."""
    return {
        "iterations": solution.iterations,
        "solved": solution.status is Status.SOLVED,
        "cost": solution.cost,
        "violation": violation(made.problem, made.parameters, solution.point).worst,
    }


def table(solves: Sequence[Row]) -> list[Row]:
    """One row per size and solver: best repeats, iterations, success, and the cost by the best.

    ``near_best`` is the share of solves whose cost is within 0.1 % of the lowest feasible one.
    """
    rows = []
    for axis, obstacles, steps in dict.fromkeys(_size(row) for row in solves):
        here = [row for row in solves if _size(row) == (axis, obstacles, steps)]
        least = _least(here)
        for label in labels(here):
            own = [row for row in here if row["set-up"] == label]
            best = [min(found) for found in repeats(own, label).values()]
            kept = np.array([row["solved"] and row["violation"] <= LOOSE for row in own])
            near = [row["cost"] <= 1e-3 + 1.001 * least[row["instance"]] for row in own]
            row = {"axis": axis, "obstacles": obstacles, "steps": steps, "set-up": label}
            row |= {"best_median_ms": float(np.median(best)), "best_max_ms": float(np.max(best))}
            row["iterations"] = float(np.median([one["iterations"] for one in own]))
            row["iterations_max"] = max(one["iterations"] for one in own)
            row["solved"] = float(kept.mean())
            rows.append(row | {"near_best": float((kept & np.array(near)).mean())})
    return rows


def slopes(rows: Sequence[Row]) -> list[Row]:
    """One row per axis and solver: exponent b of time = a size^b over all sizes of `table`.

    ``per_iteration`` is that of the time over the number of iterations: how the work grows, where
    ``slope`` holds also that larger instances are harder.
    """
    found = []
    for axis in dict.fromkeys(row["axis"] for row in rows):
        for label in labels(rows):
            own = [row for row in rows if (row["axis"], row["set-up"]) == (axis, label)]
            sizes = [row["obstacles" if axis.startswith("K") else "steps"] for row in own]
            if len(set(sizes)) < 2:
                continue
            times = [row["best_median_ms"] for row in own]
            each = [row["best_median_ms"] / max(row["iterations"], 1) for row in own]
            row = {"axis": axis, "set-up": label, "from": min(sizes), "to": max(sizes)}
            found.append(row | {"slope": slope(sizes, times), "per_iteration": slope(sizes, each)})
    return found


def _solve(solver: Solver, made: Made) -> Solution:
    return solver.solve(made.problem, made.parameters, [made.guess])[0]


def _size(row: Row) -> tuple[str, int, int]:
    return row["axis"], row["obstacles"], row["steps"]


def _least(rows: Sequence[Row]) -> dict[int, float]:
    """Lowest cost of a feasible plan, by instance; infinite where there is none."""
    found: dict[int, float] = {}
    for row in rows:
        cost = row["cost"] if row["violation"] <= LOOSE else np.inf
        found[row["instance"]] = min(found.get(row["instance"], np.inf), cost)
    return found

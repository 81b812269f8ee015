"""Every registered region with every registered robot, on instances made for the pair."""

from collections.abc import Sequence
from functools import partial

import numpy as np
from instances import Made, Recipe
from judging import LOOSE
from measuring import Row, Tick, rotated, timed
from scaling import judged
from set_ups import registered

from wideberth.framework import names
from wideberth.framework.mpc.levels.fixed import Fixed
from wideberth.framework.mpc.solver import Solver
from wideberth.framework.plugins.config import build

OBSTACLES, STEPS = 2, 15
ORACLE = "ipopt"
"""Whose cost the others' is compared with."""
REFERENCE = "reference"
"""IPOPT with the paper's unicycle and ellipse, measured again beside each pair."""
AGREE = 1e-4
"""Largest relative difference of two costs of the same optimum."""


def pairs(limit: int | None) -> list[tuple[str, str]]:
    """Name the regions and robots that live in the same number of dimensions."""
    regions, robots = names("regions")[:limit], names("robots")[:limit]
    found = [(region, robot) for region in regions for robot in robots]
    return [(region, robot) for region, robot in found if _fit(region, robot)]


def measure(limit: int | None, count: int, rounds: int, tick: Tick) -> list[Row]:
    """Time every solver on every pair, over several instances: one row per pair and solver."""
    solvers = registered()
    reference = _made("mahalanobis_ellipse", "unicycle", count)
    rows = []
    for region, robot in pairs(limit):
        tick(f"{region} x {robot}")
        made = _made(region, robot, count)
        work = {name: (solver, made) for name, solver in solvers.items()}
        work[REFERENCE] = (solvers[ORACLE], reference)
        solves = {
            name: [_first(solver, one) for one in given] for name, (solver, given) in work.items()
        }
        times: dict[str, list[list[float]]] = {name: [[] for _ in made] for name in work}
        for turn in range(rounds):
            for index in range(count):
                for name in rotated(list(work), turn + index):
                    solver, given = work[name]
                    taken = timed(partial(_solve, solver, given[index]))[0]
                    times[name][index].append(taken)
        rows += [
            {"region": region, "robot": robot, "solver": name}
            | _row(times[name], times[REFERENCE], solves[name], solves[ORACLE])
            for name in solvers
        ]
    return rows


def totals(rows: Sequence[Row]) -> list[Row]:
    """One row per solver: over all pairs."""
    found = []
    for name in dict.fromkeys(row["solver"] for row in rows):
        own = [row for row in rows if row["solver"] == name]
        agree = [row["agree"] for row in own if row["agree"] is not None]
        found.append(
            {
                "solver": name,
                "pairs": len(own),
                "median_ms": float(np.median([row["median_ms"] for row in own])),
                "slowest_ms": float(np.max([row["median_ms"] for row in own])),
                "solved": float(np.mean([row["solved"] for row in own])),
                "all_solved": sum(row["solved"] == 1.0 for row in own),
                "agree": float(np.mean(agree)) if agree else None,
            }
        )
    return found


def _row(
    times: list[list[float]], reference: list[list[float]], solves: list[Row], oracle: list[Row]
) -> Row:
    """Boil one pair's solves by one solver down.

    ``solved`` is the share that converged and keeps every constraint; ``agree`` the share, of
    instances that IPOPT solves too, whose cost is no higher than its.
    """
    best = [min(taken) for taken in times]
    kept = [one["solved"] and one["violation"] <= LOOSE for one in solves]
    both = [
        one["cost"] <= other["cost"] + AGREE * (1.0 + abs(other["cost"]))
        for one, other, ok in zip(solves, oracle, kept, strict=True)
        if ok and other["solved"] and other["violation"] <= LOOSE
    ]
    return {
        "median_ms": float(np.median([value for taken in times for value in taken])),
        "best_ms": float(np.median(best)),
        "ratio": float(np.median(best) / np.median([min(taken) for taken in reference])),
        "iterations": float(np.median([one["iterations"] for one in solves])),
        "iterations_max": max(one["iterations"] for one in solves),
        "solved": float(np.mean(kept)),
        "agree": float(np.mean(both)) if both else None,
        "violation": max(one["violation"] for one in solves),
    }


def _fit(region: str, robot: str) -> bool:
    return build("robots", robot).dimension in build("regions", region).dimensions


def _made(region: str, robot: str, count: int) -> list[Made]:
    """Make the pair's instances.

    The level is fixed: one that gives way would let large regions escape the work.
    """
    recipe = Recipe(build("robots", robot), build("regions", region), Fixed(), OBSTACLES, STEPS)
    return recipe.make(range(count))


def _first(solver: Solver, made: Made) -> Row:
    """Compile, and judge what is returned."""
    return judged(made, solver.solve(made.problem, made.parameters, [made.guess])[0])


def _solve(solver: Solver, made: Made) -> None:
    solver.solve(made.problem, made.parameters, [made.guess])

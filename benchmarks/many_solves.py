"""Many solves at once: solves per second against batch size and cores."""

import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from time import process_time
from typing import TypeAlias

import numpy as np
from judging import LOOSE, judged
from measuring import Row, Tick, bare_loop, rotated, timed
from set_ups import ELLIPSE, OWN, paper_problem, registered

from wideberth.benchmarks.recorded_instances import Instance
from wideberth.framework.mpc.ocp.problem import Problem
from wideberth.framework.mpc.solver import Solution, Solver, solve_many

ROUNDS = 5
_STEPS = 2_000_000
"""Of the bare loop beside each round: a tenth of a second."""
Entry: TypeAlias = Callable[[Problem, Sequence[Instance], int], list[Solution]]
"""(problem, instances, cores) -> one solution each."""


@dataclass(frozen=True)
class Way:
    """A way to solve a batch.

    Attributes
    ----------
    name : of it.
    solve : does it.
    cores : that it can be given.
    """

    name: str
    solve: Entry
    cores: tuple[int, ...]


def ways() -> list[Way]:
    """Return what solves batches."""
    solvers = registered()
    every = _counts()
    found = [
        Way(f"{name}, one by one", partial(_alone, one), (1,)) for name, one in solvers.items()
    ]
    if OWN in solvers:
        found.append(Way(f"{OWN}, threads", partial(_together, solvers[OWN]), every))
    return found


def measure(sizes: Sequence[int], instances: list[Instance], tick: Tick) -> list[Row]:
    """Solve batches of recorded instances, best of the rounds: one row per size, way and cores.

    Those with the median number of obstacles are taken, and repeated where a batch is larger than
    they are many. ``processor_us`` is processor time of the whole process for each solve.
    ``gain`` is the time with one core over that with several, and ``loop_gain`` that of bare loops
    in as many processes, medians of the rounds, in which all of these stand beside each other.
    """
    count = sorted(instance.obstacles for instance in instances)[len(instances) // 2]
    pool = [instance for instance in instances if instance.obstacles == count]
    problem = paper_problem(ELLIPSE, count)
    trials = [(way, cores) for way in ways() for cores in way.cores]
    rows = []
    for size in sizes:
        tick(f"batches of {size}")
        batch = [pool[i % len(pool)] for i in range(size)]
        found = {}
        times: dict[int, list[float]] = {}
        spent: dict[int, list[float]] = {}
        loops: dict[int, list[float]] = {cores: [] for cores in _counts()}
        for number, (way, cores) in enumerate(trials):
            found[number] = way.solve(problem, batch, cores)  # compiles
        for turn in range(ROUNDS):
            for cores in loops:
                loops[cores].append(timed(partial(bare_loop, cores, _STEPS))[0])
            for number in rotated(list(range(len(trials))), turn):
                way, cores = trials[number]
                begin = process_time()
                time, _ = timed(partial(way.solve, problem, batch, cores))
                spent.setdefault(number, []).append(process_time() - begin)
                times.setdefault(number, []).append(time)
        for number, (way, cores) in enumerate(trials):
            rate = 1e3 * size / min(times[number])
            row = {"way": way.name, "batch": size, "cores": cores, "obstacles": count}
            row |= {"solves_per_second": rate, "per_core": rate / cores}
            row["processor_us"] = 1e6 * min(spent[number]) / size
            alone = times.get(number - 1) if way.cores[0] == 1 < cores else None
            row["gain"] = np.nan if alone is None else _gain(alone, times[number])
            row["loop_gain"] = cores * _gain(loops[1], loops[cores])
            rows.append(row | {"solved": _solved(batch, found[number])})
    return rows


def _counts() -> tuple[int, ...]:
    """One core, and all of them."""
    return tuple(sorted({1, os.cpu_count() or 1}))


def _gain(alone: Sequence[float], together: Sequence[float]) -> float:
    return float(np.median(np.divide(alone, together)))


def ticks(sizes: Sequence[int]) -> int:
    """Count the ticks of `measure`."""
    return len(sizes)


def _solved(batch: Sequence[Instance], found: Sequence[Solution]) -> float:
    """Share that converged to a feasible plan."""
    rows = [judged(one, ELLIPSE, solution) for one, solution in zip(batch, found, strict=True)]
    return float(np.mean([row["solved"] and row["violation"] <= LOOSE for row in rows]))


def _alone(
    solver: Solver, problem: Problem, batch: Sequence[Instance], cores: int
) -> list[Solution]:
    return [_one(solver, problem, instance) for instance in batch]


def _together(
    solver: Solver, problem: Problem, batch: Sequence[Instance], cores: int
) -> list[Solution]:
    parameters, guesses = [one.parameters for one in batch], [one.guess for one in batch]
    return solve_many(solver, problem, parameters, guesses, cores)


def _one(solver: Solver, problem: Problem, instance: Instance) -> Solution:
    return solver.solve(problem, instance.parameters, [instance.guess])[0]

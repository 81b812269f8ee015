"""Solver set-ups on recorded instances: every one solves each from the same guess, in turn."""

from functools import partial
from pathlib import Path

import numpy as np
from judging import judged
from measuring import Row, Tick, rotated, timed
from set_ups import ELLIPSE, SetUp, paper_problem, suited

from wideberth.benchmarks.recorded_instances import Instance, read_instances
from wideberth.framework.mpc.solver import Solution
from wideberth.framework.plugins.config import build

SAMPLE = Path(__file__).resolve().parents[1] / "tests" / "data" / "mpc_instances.npz"


def chosen(path: Path, count: int | None, region: str = ELLIPSE) -> list[Instance]:
    """Read the instances of a file; ``count`` of them, spread over the file, if given."""
    found = list(read_instances(path, build("regions", region)))
    if count is not None and count < len(found):
        found = [found[i] for i in np.linspace(0, len(found) - 1, count).astype(int)]
    return [suited(instance, region) for instance in found]


def by_region(
    path: Path, count: int | None, candidates: dict[str, SetUp]
) -> dict[str, list[Instance]]:
    """Read the same instances once for each region that takes part."""
    regions = dict.fromkeys(candidate.region for candidate in candidates.values())
    return {region: chosen(path, count, region) for region in regions}


def measure(
    candidates: dict[str, SetUp], instances: dict[str, list[Instance]], rounds: int, tick: Tick
) -> list[Row]:
    """Solve every instance with every set-up, ``rounds`` times: one row per solve.

    Each solve is repeated at once, ``again_ms``: the first finds the processor's caches filled by
    another set-up, as in a control loop that does other things too; the second finds its own.

    Parameters
    ----------
    candidates : what takes part.
    instances : the same ones for each region.
    rounds : over the instances.
    tick : called before each piece of work.
    """
    plain = next(iter(instances.values()))
    for count in sorted({instance.obstacles for instance in plain}):
        first = next(i for i, one in enumerate(plain) if one.obstacles == count)
        for label, candidate in candidates.items():
            tick(f"compiling {label}, {count} obstacles")
            _solve(candidate, instances[candidate.region][first])
    rows = []
    for turn in range(rounds):
        for index in range(len(plain)):
            tick(f"solving instance {index}, round {turn + 1}")
            taking = [label for label, one in candidates.items() if turn < (one.rounds or rounds)]
            for label in rotated(taking, turn + index):
                candidate = candidates[label]
                instance = instances[candidate.region][index]
                solve = partial(_solve, candidate, instance)
                time, solution = timed(solve)
                again = timed(solve)[0] if candidate.rounds is None else float("nan")
                row = {"set-up": label, "region": candidate.region, "instance": index}
                row |= {"round": turn, "kind": instance.kind, "obstacles": instance.obstacles}
                row |= {
                    "ms": time,
                    "again_ms": again,
                    **judged(instance, candidate.region, solution),
                }
                rows.append(row | {"best_known": instance.best_cost})
    return rows


def steps(candidates: dict[str, SetUp], instances: list[Instance], rounds: int) -> int:
    """Count the ticks of `measure`."""
    counts = {instance.obstacles for instance in instances}
    return len(counts) * len(candidates) + rounds * len(instances)


def _solve(candidate: SetUp, instance: Instance) -> Solution:
    problem = paper_problem(candidate.region, instance.obstacles, len(instance.guess.inputs))
    return candidate.solve(problem, instance.parameters, instance.guess)

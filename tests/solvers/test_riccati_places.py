"""The structured solver gives the same bytes wherever its arrays happen to lie in memory.

Results of a core that worked on many small arrays depended on how close these lay to each other,
in the last digits: 8 KiB between them and nothing differed. (Compiled loops go one column after
the other where what they write may overlap what they read, which is most likely judged by
distance, and then sums are rounded in another order.) Where arrays lie, and what new memory
holds, depends on all that the process did before.
"""

import os
import subprocess
import sys
from functools import cache
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from wideberth.benchmarks.recorded_instances import Instance, read_instances
from wideberth.framework.mpc.levels.paper import Paper
from wideberth.framework.mpc.ocp.problem import Problem
from wideberth.framework.values.arrays import Array
from wideberth.regions.mahalanobis_ellipse import MahalanobisEllipse
from wideberth.robots.unicycle import Unicycle
from wideberth.solvers.riccati.solver import Riccati
from wideberth.tests.helpers.problems import assemble

SAMPLE = Path(__file__).parents[1] / "data" / "mpc_instances.npz"
REPEATS = 400
"""With a core of many small arrays one repeat in sixty differed."""
OTHER = """
import sys
from importlib import import_module
sys.path.insert(0, sys.argv[1])
own = import_module("test_riccati_places")
print(*[own.digest(one) for one in own.recorded_instances()])
"""
"""Solves some recorded instances in a new process."""


def recorded_instances() -> list[Instance]:
    return list(read_instances(SAMPLE, MahalanobisEllipse()))[::5]


@pytest.fixture(scope="module")
def recorded() -> list[Instance]:
    return recorded_instances()


@cache
def problem_for(obstacles: int) -> Problem:
    level = Paper(tail=float(np.exp(-5.991 / 2)))
    sizes: Any = {"horizon": 15, "dt": 0.5, "capacity": obstacles}
    return assemble(Unicycle(), MahalanobisEllipse(), level, **sizes)


def digest(one: Instance) -> str:
    """Solve; hash of the solution."""
    problem = problem_for(one.obstacles)
    (found,) = Riccati().solve(problem, one.parameters, [one.guess])
    arrays = (found.point.states, found.point.inputs, found.point.slack)
    numbers = np.array([found.point.level, found.cost, found.iterations], dtype=np.float64)
    return sha256(b"".join(part.tobytes() for part in (*arrays, numbers))).hexdigest()


def test_the_same_bytes_wherever_arrays_lie(recorded: list[Instance]) -> None:
    expected = [digest(one) for one in recorded]
    rng, held = np.random.default_rng(0), list[Array]()
    for turn in range(REPEATS):
        sizes = rng.integers(1, rng.choice([64, 2048]), size=rng.integers(6))
        held += [np.full(size, np.nan) for size in sizes]
        while len(held) > 60:  # leaves a gap somewhere, full of NaN
            held.pop(int(rng.integers(len(held))))
        which = turn % len(recorded)
        assert digest(recorded[which]) == expected[which], f"turn {turn}, instance {which}"


def test_the_same_bytes_whatever_new_memory_holds(recorded: list[Instance]) -> None:
    # glibc fills memory with this byte when it is freed, and its complement when it is handed out
    environment = {**os.environ, "MALLOC_PERTURB_": "85", "PYTHONHASHSEED": "7"}
    command = [sys.executable, "-c", OTHER, str(Path(__file__).parent)]
    run = subprocess.run(command, capture_output=True, text=True, env=environment, check=False)
    assert run.returncode == 0, run.stderr
    assert run.stdout.split() == [digest(one) for one in recorded]

"""The exported solver against Python's call: the same problems, and how long both take."""

from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from time import thread_time
from typing import Any

import numpy as np
from measuring import Row, Tick

from wideberth.benchmarks.exported_folder import (
    CLOSE,
    COMPILER,
    FAST,
    Folder,
    exported,
    of_instances,
    on_disk,
    run,
)

COUNTS = (1, 5, 10, 20)
"""Obstacles of the recorded instances."""
REPEATS = 15
"""Of one problem in a round; the median counts."""


def missing() -> str:
    """Say why nothing is measured here; empty where it can be."""
    return "" if COMPILER else "there is no C compiler (cc)"


def ticks() -> int:
    """Count the ticks of `measure`."""
    return 0 if missing() else 1 + len(COUNTS)


def measure(rounds: int, tick: Tick) -> list[Row]:
    """Solve an episode and the recorded instances in C and in Python, in turn.

    ``ratio`` is the median over the problems of C over Python, each by its best round;
    processor time of the thread. ``equal`` says whether all inputs are the same to `CLOSE`.
    """
    rows = []
    with TemporaryDirectory(prefix="exported-") as place:
        tick("exported solver, an episode")
        rows.append({"problems": "an episode", **_both(*_episode(Path(place) / "loop"), rounds)})
        for count in COUNTS:
            tick(f"exported solver, {count} obstacles")
            folder, problems = of_instances(count, Path(place) / str(count), str(COMPILER), FAST)
            rows.append({"problems": f"recorded, K = {count}", **_both(folder, problems, rounds)})
    return rows


def _episode(place: Path) -> tuple[Folder, list[Any]]:
    """Drive the example's loop and return its problems."""
    folder = on_disk(exported(), place, str(COMPILER), FAST)
    done = run(folder.compiled(place / "loop.c"), "record")
    if done.returncode:
        raise RuntimeError(done.stderr)
    both = np.dtype([("problem", folder.given), ("result", folder.result)])
    return folder, list(np.frombuffer((place / "record").read_bytes(), dtype=both)["problem"])


def _both(folder: Folder, problems: Sequence[Any], rounds: int) -> Row:
    compiled, called = [], []
    given = [folder.instance(problem) for problem in problems]
    settings, problem = folder.solver.settings, folder.problem
    for _ in range(max(rounds, 2)):
        results, _, times = folder.replayed(problems, REPEATS)
        compiled.append(times)
        called.append([])
        for parameters, guess in given:
            spent = []
            for _ in range(REPEATS):
                begin = thread_time()
                settings.solve(problem, parameters, [guess])
                spent.append(1e6 * (thread_time() - begin))
            called[-1].append(float(np.median(spent)))
    c, python = np.min(compiled, axis=0), np.min(called, axis=0)
    plans = [folder.by_python(problem).point for problem in problems]
    equal = all(
        np.abs(result["inputs"] - plan.inputs).max() <= CLOSE
        for result, plan in zip(results, plans, strict=True)
    )
    return {
        "solves": len(problems), "c_median_us": float(np.median(c)),
        "python_median_us": float(np.median(python)), "ratio": float(np.median(c / python)),
        "equal": equal,
    }  # fmt: skip

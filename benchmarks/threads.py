"""Processor time of an episode of `crossing`, with one and with more threads of BLAS.

Threads that wait for work spin for a while after each piece of it, so that a loop whose matrices
wake them pays for a second core that does nothing. ``wideberth run`` has one thread; a script that
imports the package has as many as its BLAS likes. Processor time counts all of them.
"""

import os
import subprocess
import sys
from collections.abc import Mapping
from time import process_time

from measuring import Row, Tick, rotated

from wideberth.experiments.engine.shipped_configs import read_experiment
from wideberth.experiments.studies.encounter import Encounter

TARGET = 1.1
"""Processor time with the default number of threads over that with one, at most."""
NAMES = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


def environments() -> Mapping[str, Mapping[str, str]]:
    """Return the environment of each number of threads."""
    default = {name: value for name, value in os.environ.items() if name not in NAMES}
    return {"one": default | dict.fromkeys(NAMES, "1"), "default": default}


def ticks(rounds: int) -> int:
    """Count the ticks of `measure`."""
    return rounds * len(environments())


def measure(rounds: int, tick: Tick) -> list[Row]:
    """Play the episode ``rounds`` times with each number of threads, in a process each.

    Returns
    -------
    A row for each number of threads: the least processor time of an episode, s, its ratio to that
    with one thread, and whether it meets the target.
    """
    table = environments()
    seconds: dict[str, list[float]] = {threads: [] for threads in table}
    for turn in range(rounds):
        for threads in rotated(list(table), turn):
            tick(f"crossing, threads: {threads}, round {turn + 1}")
            seconds[threads].append(_in_a_process(table[threads]))
    least = {threads: min(values) for threads, values in seconds.items()}
    return [
        {
            "threads": threads,
            "cores": os.cpu_count(),
            "best_s": value,
            "ratio": value / least["one"],
            "target": TARGET,
            "met": value <= TARGET * least["one"],
        }
        for threads, value in least.items()
    ]


def _in_a_process(environment: Mapping[str, str]) -> float:
    command = [sys.executable, __file__]
    episode = subprocess.run(command, check=True, capture_output=True, text=True, env=environment)
    return float(episode.stdout)


def played() -> float:
    """Return the processor time of an episode, s; an earlier one imports and compiles."""
    study, _ = read_experiment("crossing", [])
    assert isinstance(study, Encounter)
    task = next(iter(study.tasks()))
    controller = study.planners[task.settings["planner"]]
    study.played(task, controller)
    begin = process_time()
    study.played(task, controller)
    return process_time() - begin


if __name__ == "__main__":
    print(played())

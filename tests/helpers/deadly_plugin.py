"""An experiment whose tasks may end the process that does them, for the tests of sweeps."""

import os
import signal
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar, Self, final

from wideberth.experiments.engine.base import Experiment, Result, Row, Task, TaskOutcome


@final
@dataclass(frozen=True)
class Deadly(Experiment):
    """Squares numbers; ``deadly`` is the seed of the task that ends its process.

    It does so ``lives`` times: ``folder`` holds a file for each time.
    """

    claim: ClassVar[str] = "A worker may be lost."
    reference: ClassVar[str] = ""

    folder: str
    seeds: int = 40
    deadly: int = -1
    lives: int = 1
    pause: float = 0.0

    def tasks(self) -> Sequence[Task]:
        return [Task(f"seed {seed}", seed) for seed in range(self.seeds)]

    def measure(self, task: Task) -> TaskOutcome:
        time.sleep(self.pause)
        deaths = len(list(Path(self.folder).glob("death-*")))
        if task.seed == self.deadly and deaths < self.lives:
            (Path(self.folder) / f"death-{deaths}").touch()
            os.kill(os.getpid(), signal.SIGKILL)
        threads = os.environ.get("OMP_NUM_THREADS", "")
        return TaskOutcome([{"seed": task.seed, "square": task.seed**2, "threads": threads}])

    def summary(self, rows: list[Row]) -> list[Row]:
        return [{"tasks": len(rows)}]

    def figures(self, result: Result, folder: Path) -> list[Path]:
        return []

    def quick(self) -> Self:
        return self

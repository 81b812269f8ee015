"""An experiment of a user's own, for the tests of runner, configs and command line."""

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import ClassVar, Literal, Self, final

import numpy as np

from wideberth.experiments.drawing.plotting import paper_style, save
from wideberth.experiments.engine.base import Experiment, Result, Row, Task, TaskOutcome
from wideberth.framework.predictor import Predictor
from wideberth.framework.values.arrays import positive
from wideberth.framework.values.errors import WideberthError


@dataclass(frozen=True)
class Die:
    """Part of a config that is no plug-in."""

    faces: int = 6
    loaded: tuple[float, ...] = ()


@final
@dataclass(frozen=True)
class Coins(Experiment):
    """Throws coins."""

    claim: ClassVar[str] = "A coin falls on either side equally often."
    reference: ClassVar[str] = ""

    seeds: int = 3
    throws: int = 100
    bias: float = 0.5
    pause: float = 0.0
    side: Literal["heads", "tails"] = "heads"
    die: Die = Die()
    predictor: Predictor | None = None
    rivals: tuple[Predictor, ...] = ()
    fails: bool = False

    def __post_init__(self) -> None:
        positive("coins.bias", self.bias)

    def tasks(self) -> Sequence[Task]:
        return [Task(f"seed {seed}", seed, {"bias": self.bias}) for seed in range(self.seeds)]

    def measure(self, task: Task) -> TaskOutcome:
        started = time.perf_counter()
        time.sleep(self.pause)
        if self.fails:
            raise WideberthError("the coin fell on its edge")
        rng = np.random.default_rng(task.seed)
        square = rng.standard_normal((200, 200))
        share = float((rng.random(self.throws) < task.settings["bias"]).mean())
        product = np.float64((square @ square).sum())
        rows: list[Row] = [{"seed": task.seed, "share": share, "product": product, "none": None}]
        seconds = time.perf_counter() - started
        files = {f"seed/{task.seed}.bin": square[:2].tobytes()}
        return TaskOutcome(rows, [{"seed": task.seed, "seconds": seconds}], files)

    def summary(self, rows: list[Row]) -> list[Row]:
        return [{"seeds": len(rows), "share": float(np.mean([row["share"] for row in rows]))}]

    def figures(self, result: Result, folder: Path) -> list[Path]:
        from matplotlib import pyplot

        with paper_style():
            figure, axes = pyplot.subplots()
            axes.plot([row["seed"] for row in result.rows], [row["share"] for row in result.rows])
            axes.set(xlabel="seed", ylabel="share of heads")
            return save(figure, folder, "share")

    def quick(self) -> Self:
        return replace(self, seeds=2)

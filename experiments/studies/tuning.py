"""One factor at a time: what each setting of our planner does to clearance and time."""

from collections.abc import Mapping, Sequence
from copy import deepcopy
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, ClassVar, Self, final

import numpy as np

from ...framework.controller import Controller
from ...framework.plugins.config import build, describe
from ...framework.plugins.yamlfile import assign
from ...framework.robot import Robot
from ...framework.values.arrays import Array, BoolArray, probability, whole
from ...framework.values.errors import WideberthError
from ...simulation.engine.settings import Settings
from ...simulation.scenarios.base import Scenario
from ..engine.base import Experiment, Outcome, Result, Row, Task
from ..engine.closed_loop import check_starts, group, inputs_of
from ..engine.showing import shown
from .comparison import SOURCES, check_robots, driving, measured
from .comparison_summary import against, condensed

BASE = "base"
"""Name of the setting that is varied."""


@final
@dataclass(frozen=True)
class Tuning(Experiment):
    """A planner with one setting changed at a time, on the same seeds.

    ``pareto`` marks the settings that none beats: no other one has at least their share of
    success, their median least clearance and their median time to the goal, and more (less) of
    one. The changes are held against the unchanged planner in pairs, seed by seed.

    Parameters
    ----------
    scenario : drawn from each seed.
    robot : model of the plant.
    planner : the base setting, any controller.
    factors : dotted key of the planner's config, as for ``--set``, and the values it takes; its
        value in the base is left out where it stands among them.
    settings : clock, noise and end of the episodes.
    seeds : number of episodes per setting, seeds 0 to seeds - 1.
    tail : 1 - content that forecasts and regions are measured against.
    """

    claim: ClassVar[str] = (
        "Which settings of the planner buy clearance with time, and which buy it for nothing?"
    )
    reference: ClassVar[str] = SOURCES

    scenario: Scenario
    robot: Robot
    planner: Controller
    factors: dict[str, tuple[Any, ...]]
    settings: Settings = field(default_factory=Settings)
    seeds: int = 20
    tail: float = 0.05

    def __post_init__(self) -> None:
        whole("seeds", self.seeds)
        probability("tail", self.tail)
        if not self.factors:
            raise WideberthError("factors is empty; name a key of the planner and its values")
        if not all(self.factors.values()):
            empty = sorted(key for key, values in self.factors.items() if not values)
            raise WideberthError(f"factors {empty} have no values")
        check_robots({"scenario": self.scenario}, {"robot": self.robot}, {"planner": self.planner})
        for key in self.variants():
            self.variant(*key)

    def variants(self) -> dict[tuple[str, str], dict[str, Any]]:
        """Factor and value -> config of the planner with it; the base first."""
        base = describe(driving(self.planner, self.robot))
        found = {(BASE, ""): base}
        for key, values in self.factors.items():
            for value in values:
                changed = deepcopy(base)
                assign(changed, key, value, f"factors.{key}")
                if changed != base:
                    found[key, worded(value)] = changed
        return found

    def variant(self, factor: str, value: str) -> Controller:
        """Return the planner with one setting changed."""
        made: Controller = build(
            "controllers", self.variants()[factor, value], f"factors.{factor}"
        )
        return made

    def tasks(self) -> list[Task]:
        """One per setting and seed."""
        return [
            Task(f"{factor} {value} {seed}", seed, {"factor": factor, "value": value})
            for factor, value in self.variants()
            for seed in range(self.seeds)
        ]

    def inputs(self) -> list[Path]:
        """Return the files that the scenario reads."""
        return inputs_of([self.scenario])

    def check(self) -> None:
        """Begin an episode with every setting of the planner."""
        variants = {" ".join(key).strip(): self.variant(*key) for key in self.variants()}
        check_starts({"": self.scenario}, self.robot, variants)

    def measure(self, task: Task) -> Outcome:
        """Play one episode."""
        planner = self.variant(task.settings["factor"], task.settings["value"])
        return measured(self.scenario, self.robot, planner, self.settings, task, self.tail)

    def summary(self, rows: list[Row]) -> list[Row]:
        """One line per setting, paired with the base."""
        played = group(rows, "factor", "value")
        base = next(iter(played.values()))
        lines = [
            {"factor": factor, "value": "" if value is None else shown(value), **condensed(own)}
            | against(own, base)
            for (factor, value), own in played.items()
        ]
        best = pareto(
            np.array(
                [
                    (-line["success"], -line["clearance_median_m"], line["time_median_s"])
                    for line in lines
                ]
            )
        )
        return [
            {"factor": line["factor"], "value": line["value"], "pareto": bool(good), **line}
            for line, good in zip(lines, best, strict=True)
        ]

    def figures(self, result: Result, folder: Path) -> list[Path]:
        """Draw the clearance-against-time front, a panel per factor."""
        from ..drawing.plotting import paper_style, save
        from .tuning_figure import draw_fronts

        with paper_style():
            return save(draw_fronts(self.summary(result.rows), result.rows), folder, "tuning")

    def quick(self) -> Self:
        """Play one seed to its end with the first value of the first factor."""
        (key, values), *_ = self.factors.items()
        return replace(self, factors={key: values[:1]}, seeds=1)


def worded(value: Any) -> str:
    """Return a value as a label: numbers short, a plug-in by its type and settings."""
    if isinstance(value, Mapping):
        return " ".join(f"{key} {worded(entry)}" for key, entry in value.items())
    return f"{value:g}" if isinstance(value, float) else str(value)


def pareto(costs: Array | Sequence[Sequence[float]]) -> BoolArray:
    """Whether no other row is at least as low in every column and lower in one, (K, M) -> (K,).

    A row with something unknown (NaN) is beaten by all and beats none.

    Examples
    --------
    >>> pareto([[1.0, 2.0], [2.0, 1.0], [2.0, 2.0]]).tolist()
    [True, True, False]
    """
    table = np.asarray(costs, dtype=np.float64)
    below = (table[:, None] <= table).all(axis=2) & (table[:, None] < table).any(axis=2)
    return np.asarray(~below.any(axis=0) & np.isfinite(table).all(axis=1), dtype=np.bool_)

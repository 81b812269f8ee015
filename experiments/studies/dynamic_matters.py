"""The paper's headline: treating obstacles as moving beats treating them as static."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar, Self, final

from ...framework import Controller, Predictor
from ..drawing.strips import strips
from ..engine.closed_loop import condense, group, outcome, pick
from .episodes import PlacesStudy
from .grid import Axes, Pictures, Result, Row, Task, TaskOutcome, reduced
from .variants import exchanged

COLUMNS = (
    *("episodes", "collisions", "deadlocks", "goals_in_time", "clearance_min_m"),
    *("clearance_median_m", "time_ratio", "extra_time_s", "length_ratio", "named_forecasts"),
    "coverage",
)
PANELS = {
    "clearance": "least clearance (m)",
    "time_ratio_worst": "slower robot's time\n/ free time",
}
"""Column of the table -> label of its panels."""


@final
@dataclass(frozen=True)
class DynamicMatters(PlacesStudy):
    """The same planner with predictors from "it stays there" to the other's own plan.

    Parameters
    ----------
    planner : settings of the MPC; its predictor is exchanged.
    predictors : by name.
    """

    claim: ClassVar[str] = (
        "Trajectory planning is significantly enhanced when obstacles are considered dynamic "
        "(section I): static against moving predictions on the same seeds."
    )
    reference: ClassVar[str] = "schoeneberg2025trajectory"
    printed: ClassVar[tuple[str, ...]] = (
        *("collisions", "deadlocks", "goals_in_time", "clearance_min_m"),
        *("clearance_median_m", "time_ratio", "length_ratio", "coverage"),
    )

    planner: Controller
    predictors: dict[str, Predictor]

    def validate(self) -> None:
        """Refuse settings that make no study."""
        self.controllers()

    def axes(self) -> Axes:
        """Each scenario with each predictor."""
        return {"scenario": self.scenarios, "planner": self.predictors, "seed": self.seed_range}

    def controllers(self) -> Mapping[str, Controller]:
        """Return the planner with each predictor."""
        return {
            name: exchanged(self.planner, predictor=one) for name, one in self.predictors.items()
        }

    def measure(self, task: Task) -> TaskOutcome:
        """Play one episode."""
        episode = self.played(task, self.controllers()[task.settings["planner"]])
        return outcome(episode, task, self.tail)

    def summary(self, rows: list[Row]) -> list[Row]:
        """One line per scenario and predictor."""
        return [
            {"scenario": scenario, "predictor": predictor, **pick(condense(some), COLUMNS)}
            for (scenario, predictor), some in group(rows, "scenario", "planner").items()
        ]

    def pictures(self, result: Result) -> Pictures:
        """Draw clearance and time of every episode by predictor, one column per scenario."""
        groups = group(result.rows, "scenario").items()
        columns = {scenario.replace("_", " "): rows for (scenario,), rows in groups}
        yield "dynamic_matters", strips(columns, PANELS, (3.4 * len(columns), 4.4))

    def quick(self) -> Self:
        """One seed."""
        return reduced(self, seeds=1)

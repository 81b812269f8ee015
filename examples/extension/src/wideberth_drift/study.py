"""The distance that people drift."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Self, final

from wideberth.experiments import GridStudy, Result, Row, Task, TaskOutcome, reduced, subplots


@final
@dataclass(frozen=True)
class DriftDistance(GridStudy):
    """Distance that people drift within a time, by their speed."""

    claim: ClassVar[str] = "How far do people drift?"
    speeds: tuple[float, ...] = (0.2,)
    time: float = 3.0

    def axes(self) -> Mapping[str, Sequence[float]]:
        """Return the grid."""
        return {"speed": self.speeds}

    def measure(self, task: Task) -> TaskOutcome:
        """Measure one speed."""
        return TaskOutcome(rows=[{**task.settings, "drift_m": task.settings["speed"] * self.time}])

    def summary(self, rows: list[Row]) -> list[Row]:
        """Print the whole table."""
        return rows

    def pictures(self, result: Result) -> Iterator[tuple[str, Any]]:
        """Draw the distance over the speed."""
        figure, panel = subplots()
        panel.plot([row["speed"] for row in result.rows], [row["drift_m"] for row in result.rows])
        yield "drift", figure

    def quick(self) -> Self:
        """Measure one speed."""
        return reduced(self, speeds=1)

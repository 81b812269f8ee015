"""The paper's two scenarios: who yields, who passes first, and at what distance."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar, Self, final

from ...framework import Controller
from ...framework.values.arrays import positive
from ...simulation.log.episode_log import Episode
from ..engine.closed_loop import condense, group, outcome
from .episodes import OnePlaceStudy
from .grid import Axes, Pictures, Result, Row, Task, TaskOutcome, reduced


@final
@dataclass(frozen=True)
class Encounter(OnePlaceStudy):
    """Two robots meet, over seeds, under several settings of the planner.

    Parameters
    ----------
    planners : settings to compare by name, on the same seeds.
    show : seeds whose views and run are drawn for every planner; the first of them is animated
        for the first planner.
    view_distance : m between the robots at the moment whose plans are drawn.
    """

    claim: ClassVar[str] = (
        "Robots that plan for each other's predicted motion avoid collisions without "
        "communication (section V)."
    )
    reference: ClassVar[str] = "schoeneberg2025trajectory"
    printed: ClassVar[tuple[str, ...]] = (
        *("episodes", "collisions", "deadlocks", "goals_in_time", "clearance_min_m"),
        *("time_ratio", "below_reference", "coverage", "errors"),
    )

    planners: dict[str, Controller]
    show: tuple[int, ...] = (0,)
    view_distance: float = 5.0

    def validate(self) -> None:
        """Refuse settings that make no study."""
        positive("view_distance", self.view_distance)
        self.check_shown(self.show)

    def axes(self) -> Axes:
        """Each planner."""
        return {"scenario": ["run"], "planner": self.planners, "seed": self.seed_range}

    def controllers(self) -> Mapping[str, Controller]:
        """Return the planners."""
        return self.planners

    def measure(self, task: Task) -> TaskOutcome:
        """Play one episode."""
        episode = self.played(task, self.planners[task.settings["planner"]])
        return outcome(episode, task, self.tail, keep=task.seed in self.show)

    def summary(self, rows: list[Row]) -> list[Row]:
        """One line per planner, with who went first and who gave way."""
        lines = []
        for (planner,), some in group(rows, "planner").items():
            line = {"planner": planner, **condense(some)}
            for word in ("first", "yields"):
                names = [row[word] for row in some if row[word]]
                counts = {name: names.count(name) for name in sorted(set(names))}
                line[word] = ", ".join(f"{name} {count}" for name, count in counts.items())
            lines.append(line)
        return lines

    def pictures(self, result: Result) -> Pictures:
        """Draw the run of each planner, the views of two robots, and an animation of the first."""
        for i, (name, controller) in enumerate(self.planners.items()):
            for seed in self.show:
                episode = Episode.from_bytes(result.read(f"run-{name}-{seed}.npz"))
                called = self.figure_name(name, seed, self.show)
                film = i == 0 and seed == self.show[0]
                yield from self.episode_pictures(
                    called, episode, controller, self.view_distance, film
                )

    def quick(self) -> Self:
        """Two seeds; of more than two planners the first two, and one seed."""
        return reduced(self, planners=2, seeds=2 if len(self.planners) <= 2 else 1)

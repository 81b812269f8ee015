"""The paper's two scenarios: who yields, who passes first, and at what distance."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import ClassVar, Self, final

from ...framework.controller import Controller
from ...framework.plugins.io import write_bytes
from ...framework.robot import Robot
from ...framework.values.arrays import positive
from ...simulation.engine.settings import Settings
from ...simulation.log.episode_log import Episode
from ...simulation.scenarios.base import Scenario
from ..engine.base import Experiment, Result, Row, Task, TaskOutcome
from ..engine.closed_loop import (
    EPISODE_CAPTIONS,
    check_settings,
    check_shown,
    check_starts,
    condense,
    figure_name,
    first_of,
    grid,
    group,
    inputs_of,
    outcome,
    play,
    seeds_of,
    shown_of_fewer,
)


@final
@dataclass(frozen=True)
class Encounter(Experiment):
    """Two robots meet, over seeds, under several settings of the planner.

    Parameters
    ----------
    scenario : where they start and go; drawn from each seed.
    robot : model of both plants.
    planners : settings to compare by name, on the same seeds.
    settings : clock, noise and end of the episodes.
    seeds : number of episodes per planner.
    first_seed : the seeds are first_seed to first_seed + seeds - 1.
    tail : 1 - content that the plans' levels are compared with, and of the drawn regions.
    show : seeds whose views and run are drawn for every planner; the first of them is animated
        for the first planner.
    view_distance : m between the robots at the moment whose plans are drawn.
    """

    claim: ClassVar[str] = (
        "Robots that plan for each other's predicted motion avoid collisions without "
        "communication (section V)."
    )
    reference: ClassVar[str] = "schoeneberg2025trajectory"
    growing: ClassVar[tuple[str, ...]] = ("seeds",)
    captions: ClassVar[Mapping[str, str]] = {
        "views_*": (
            "What each robot planned and kept out of, when the robots came near: a planned "
            "position and the region of its step have the same shade."
        ),
        **EPISODE_CAPTIONS,
    }
    headline: ClassVar[tuple[str, ...]] = ("collisions", "clearance_min_m", "time_ratio")

    scenario: Scenario
    robot: Robot
    planners: dict[str, Controller]
    settings: Settings = field(default_factory=Settings)
    seeds: int = 20
    first_seed: int = 0
    tail: float = 0.05
    show: tuple[int, ...] = (0,)
    view_distance: float = 5.0

    def __post_init__(self) -> None:
        check_settings(self, planners=self.planners)
        positive("view_distance", self.view_distance)
        check_shown(self.show, self.first_seed, self.seeds)

    def tasks(self) -> list[Task]:
        """One per planner and seed."""
        return grid({"scenario": ["run"], "planner": self.planners}, seeds_of(self))

    def inputs(self) -> list[Path]:
        """Return the files that the scenario reads."""
        return inputs_of([self.scenario])

    def check(self) -> None:
        """Begin an episode with every planner."""
        check_starts({"": self.scenario}, self.robot, self.planners, self.first_seed)

    def measure(self, task: Task) -> TaskOutcome:
        """Play one episode."""
        controller = self.planners[task.settings["planner"]]
        episode = play(self.scenario, self.robot, controller, self.settings, task.seed)
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

    def figures(self, result: Result, folder: Path) -> list[Path]:
        """Draw the run of each planner, the views of two robots, and an animation of the first."""
        from ...framework.mpc.planner.planner import planner_behind
        from ..drawing.animation import animate
        from ..drawing.episodes import draw_run, draw_views
        from ..drawing.plotting import paper_style, save

        files: list[Path] = []
        for i, (name, controller) in enumerate(self.planners.items()):
            planner = planner_behind(controller)
            for seed in self.show:
                episode = Episode.from_bytes(result.read(f"run-{name}-{seed}.npz"))
                called = figure_name(name, seed, self.show)
                with paper_style():
                    if len(episode.robots) == 2:  # a scenario of one's own may have another number
                        views = draw_views(
                            episode, distance=self.view_distance, tail=self.tail, planner=planner
                        )
                        files += save(views, folder, f"views_{called}")
                    files += save(draw_run(episode), folder, f"run_{called}")
                if i == 0 and seed == self.show[0]:
                    files.append(folder / f"animation_{called}.gif")
                    write_bytes(files[-1], animate(episode, tail=self.tail, planner=planner))
        return files

    def quick(self) -> Self:
        """Two seeds; of more than two planners the first two, and one seed."""
        seeds = min(self.seeds, 2 if len(self.planners) <= 2 else 1)
        planners = first_of(self.planners, 2)
        show = shown_of_fewer(self.show, self.first_seed, seeds)
        return replace(self, planners=planners, seeds=seeds, show=show)

"""Controllers in the same situations: who arrives, who touches, how fast; and chance."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, ClassVar, Self, final

from ...framework import Controller, Robot, WideberthError
from ...framework.controller import driving
from ...metrics.statistics import known_mean
from ...simulation.engine.settings import Settings
from ...simulation.log.episode_log import Episode
from ...simulation.scenarios.base import Scenario
from ..engine.closed_loop import check_starts, column, inputs_of, log_name
from .agility import agile
from .comparison_figures import summary_pictures
from .episode_statistics import ANSWERS, SOURCES, against, by_controller, condensed
from .episodes import (
    SeededStudy,
    check_robots,
    episode_metric,
    measured,
)
from .grid import Axes, Pictures, Result, Row, Task, TaskOutcome, labelled, reduced


@final
@dataclass(frozen=True)
class Comparison(SeededStudy):
    """Every controller in every scenario with every robot under all settings, on the same seeds.

    A controller with a field ``robot`` is given the robot that it drives; its own must be one
    of ``robots`` (a planner made for another one is a mistake). At one seed all controllers
    meet the same situation and the same noise, so that they are compared in pairs. Columns are
    defined in docs/metrics.md; a scenario with rules of its own (`Scenario.judge`) adds
    ``judged_...``.

    Parameters
    ----------
    scenarios : by name; each seed draws the same situation for every controller.
    robots : models of the plants, by name.
    agility : names of `wideberth.experiments.studies.agility.AGILITY`: every robot drives with
        each of these limits, and the column ``robot`` has both names. Empty for its own limits.
    controllers : by name.
    settings : clock, noise and end of the episodes, by name; a sweep over faults has several.
    baseline : controller that the others are compared with in pairs; empty for the first.
    oracle : controller that knows the future; the extra time against it is the
        ``price_of_uncertainty_s``. Empty for none.
    show : seeds whose episodes are kept and drawn; one of each scenario is animated.
    metrics : columns of your own, by name: "module:function", which takes an `Episode` and returns
        a number. The summary has its mean over the episodes.
    """

    claim: ClassVar[str] = (
        "In the same situations: which controller arrives without touching anybody, how fast, "
        "how near to others, and is the difference more than chance?"
    )
    reference: ClassVar[str] = SOURCES
    printed: ClassVar[tuple[str, ...]] = ANSWERS

    scenarios: dict[str, Scenario]
    robots: dict[str, Robot]
    controllers: dict[str, Controller]
    settings: dict[str, Settings] = field(default_factory=lambda: {"nominal": Settings()})
    baseline: str = ""
    oracle: str = ""
    show: tuple[int, ...] = ()
    agility: tuple[str, ...] = ()
    metrics: dict[str, str] = field(default_factory=dict)

    def validate(self) -> None:
        """Refuse settings that make no study."""
        for name in ("baseline", "oracle"):
            named = getattr(self, name)
            if named and named not in self.controllers:
                raise WideberthError(
                    f"{name} is {named!r}; the controllers are {sorted(self.controllers)}"
                )
        self.check_shown(self.show)
        check_robots(
            {f"scenarios.{name}": one for name, one in self.scenarios.items()},
            {f"robots.{name}": one for name, one in self.robots.items()},
            {f"controllers.{name}": one for name, one in self.controllers.items()},
        )
        for robot in self._plants.values():
            for controller in self.controllers.values():
                driving(controller, robot)

    def axes(self) -> Axes:
        """All scenarios, robots, settings and controllers."""
        return {**self._axes, "seed": self.seed_range}

    def inputs(self) -> list[Path]:
        """Return the files that the scenarios read."""
        return inputs_of(self.scenarios.values())

    def check(self) -> None:
        """Begin an episode of the first seed in every scenario with every robot and controller."""
        for target in self.metrics.values():
            episode_metric(target)
        for robot in self._plants.values():
            driven = {name: driving(one, robot) for name, one in self.controllers.items()}
            check_starts(self.scenarios, robot, driven, self.first_seed)

    def measure(self, task: Task) -> TaskOutcome:
        """Play one episode."""
        scenario, robot, settings, controller = (
            entries[task.settings[column]] for column, entries in self._axes.items()
        )
        driven = driving(controller, robot)
        shared = task, self.tail, self.show, self.metrics
        return measured(scenario, robot, driven, settings, *shared)

    def summary(self, rows: list[Row]) -> list[Row]:
        """One line per scenario, robot, settings and controller, paired with the baseline.

        Of scenario, robot and settings those are named of which there are several.
        """
        places = [name for name in self._axes if name != "controller"]
        lines = []
        for known, some in labelled(rows, *places):
            head = {name: known[name] for name in places if len(self._axes[name]) > 1}
            played = by_controller(some)
            for name, own in played.items():
                line = {**head, "controller": name, **condensed(own)}
                line |= {metric: known_mean(column(own, metric)) for metric in self.metrics}
                line |= against(own, played[self._baseline])
                if self.oracle:
                    price = against(own, played[self.oracle])["time_difference_s"]
                    line["price_of_uncertainty_s"] = price
                lines.append(line)
        return lines

    def pictures(self, result: Result) -> Pictures:
        """Draw outcomes, times against clearances, pairs and trends, and the shown episodes."""
        lines = self.summary(result.rows)
        yield from summary_pictures(lines, result.rows, self._baseline)
        filmed = set[str]()
        for task in self.tasks():
            if task.seed in self.show:
                episode = Episode.from_bytes(result.read(log_name(task)))
                name = log_name(task).removesuffix(".npz").replace(" ", "_")
                film = task.settings["scenario"] not in filmed
                filmed.add(task.settings["scenario"])
                controller = self.controllers[task.settings["controller"]]
                yield from self.episode_pictures(name, episode, controller, film=film)

    def quick(self) -> Self:
        """Play one seed to its end, in the first scenario with the first robot and settings.

        Cut short, no episode would have an arrival, and there would be nothing to compare.
        """
        show = tuple(seed for seed in self.show if seed == self.first_seed)
        few = reduced(self, scenarios=1, robots=1, agility=1, settings=1, seeds=1)
        return replace(few, show=show)

    @property
    def _axes(self) -> dict[Any, Mapping[str, Any]]:
        """Column of the table -> its entries by name."""
        return {
            "scenario": self.scenarios,
            "robot": self._plants,
            "settings": self.settings,
            "controller": self.controllers,
        }

    @property
    def _plants(self) -> Mapping[str, Robot]:
        """Robots with all limits that are asked for, by the names of both."""
        if not self.agility:
            return self.robots
        return {
            f"{name} {limits}": agile(robot, limits, f"robots.{name}")
            for name, robot in self.robots.items()
            for limits in self.agility
        }

    @property
    def _baseline(self) -> str:
        return self.baseline or next(iter(self.controllers))

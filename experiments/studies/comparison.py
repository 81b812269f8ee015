"""Controllers in the same situations: who arrives, who touches, how fast; and chance."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, is_dataclass, replace
from pathlib import Path
from typing import Any, ClassVar, Self, final

from ...framework.controller import Controller
from ...framework.robot import Robot
from ...framework.values.arrays import probability, whole
from ...framework.values.errors import WideberthError
from ...simulation.engine.settings import Settings
from ...simulation.measures.episode_measures import measures
from ...simulation.scenarios.base import Scenario
from ..engine.base import Experiment, Outcome, Result, Row, Task
from ..engine.closed_loop import check_starts, first_of, grid, group, inputs_of, outcome, play
from .comparison_summary import against, condensed

AXES = {
    "scenario": "scenarios",
    "robot": "robots",
    "settings": "settings",
    "controller": "controllers",
}
"""Column of the table -> field of the experiment."""
SOURCES = (
    "clopper1934use,mcnemar1947note,efron1993introduction,perezhigueras2023hunavsim,"
    "biswas2022socnavbench,balasubramanian2015analysis"
)
"""Keys of what the columns of `measured`, `condensed` and `against` are taken from."""


@final
@dataclass(frozen=True)
class Comparison(Experiment):
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
    controllers : by name.
    settings : clock, noise and end of the episodes, by name; a sweep over faults has several.
    seeds : number of episodes of each combination.
    first_seed : the seeds are first_seed to first_seed + seeds - 1.
    baseline : controller that the others are compared with in pairs; empty for the first.
    oracle : controller that knows the future; the extra time against it is the
        ``price_of_uncertainty_s``. Empty for none.
    show : seeds whose episodes are kept and drawn; one of each scenario is animated.
    tail : 1 - content that forecasts and regions are measured against.
    """

    claim: ClassVar[str] = (
        "In the same situations: which controller arrives without touching anybody, how fast, "
        "how near to others, and is the difference more than chance?"
    )
    reference: ClassVar[str] = SOURCES

    scenarios: dict[str, Scenario]
    robots: dict[str, Robot]
    controllers: dict[str, Controller]
    settings: dict[str, Settings] = field(default_factory=lambda: {"nominal": Settings()})
    seeds: int = 20
    first_seed: int = 0
    baseline: str = ""
    oracle: str = ""
    show: tuple[int, ...] = ()
    tail: float = 0.05

    def __post_init__(self) -> None:
        whole("seeds", self.seeds)
        whole("first_seed", self.first_seed, least=0)
        probability("tail", self.tail)
        for name in AXES.values():
            if not getattr(self, name):
                raise WideberthError(f"{name} is empty; name at least one")
        for name in ("baseline", "oracle"):
            named = getattr(self, name)
            if named and named not in self.controllers:
                raise WideberthError(
                    f"{name} is {named!r}; the controllers are {sorted(self.controllers)}"
                )
        end = self.first_seed + self.seeds
        if any(not self.first_seed <= seed < end for seed in self.show):
            raise WideberthError(
                f"show is {list(self.show)}; wanted seeds in [{self.first_seed}, {end})"
            )
        check_robots(
            {f"scenarios.{name}": one for name, one in self.scenarios.items()},
            {f"robots.{name}": one for name, one in self.robots.items()},
            {f"controllers.{name}": one for name, one in self.controllers.items()},
        )

    def tasks(self) -> list[Task]:
        """One per scenario, robot, settings, controller and seed."""
        axes = {column: getattr(self, name) for column, name in AXES.items()}
        return grid(axes, range(self.first_seed, self.first_seed + self.seeds))

    def inputs(self) -> list[Path]:
        """Return the files that the scenarios read."""
        return inputs_of(self.scenarios.values())

    def check(self) -> None:
        """Begin an episode of the first seed in every scenario with every robot and controller."""
        for robot in self.robots.values():
            driven = {name: driving(one, robot) for name, one in self.controllers.items()}
            check_starts(self.scenarios, robot, driven, self.first_seed)

    def measure(self, task: Task) -> Outcome:
        """Play one episode."""
        scenario, robot, settings, controller = (
            getattr(self, name)[task.settings[column]] for column, name in AXES.items()
        )
        driven = driving(controller, robot)
        return measured(scenario, robot, driven, settings, task, self.tail, self.show)

    def summary(self, rows: list[Row]) -> list[Row]:
        """One line per scenario, robot, settings and controller, paired with the baseline.

        Of scenario, robot and settings those are named of which there are several.
        """
        places = [name for name in AXES if name != "controller"]
        lines = []
        for labels, some in group(rows, *places).items():
            known = dict(zip(places, labels, strict=True))
            head = {name: known[name] for name in places if len(getattr(self, AXES[name])) > 1}
            played = {name: own for (name,), own in group(some, "controller").items()}
            for name, own in played.items():
                line = {**head, "controller": name, **condensed(own)}
                line |= against(own, played[self._baseline()])
                if self.oracle:
                    price = against(own, played[self.oracle])["time_difference_s"]
                    line["price_of_uncertainty_s"] = price
                lines.append(line)
        return lines

    def figures(self, result: Result, folder: Path) -> list[Path]:
        """Draw outcomes, times against clearances, pairs and trends, and the shown episodes."""
        from .comparison_figures import draw_episodes, draw_summary

        kept = [task for task in self.tasks() if task.seed in self.show]
        return [
            *draw_summary(self.summary(result.rows), result.rows, self._baseline(), folder),
            *draw_episodes(result, kept, self.controllers, self.tail, folder),
        ]

    def quick(self) -> Self:
        """Play one seed to its end, in the first scenario with the first robot and settings.

        Cut short, nobody would have arrived, and there would be nothing to compare.
        """
        return replace(
            self,
            scenarios=first_of(self.scenarios),
            robots=first_of(self.robots),
            settings=first_of(self.settings),
            seeds=1,
            show=tuple(seed for seed in self.show if seed == self.first_seed),
        )

    def _baseline(self) -> str:
        return self.baseline or next(iter(self.controllers))


def measured(
    scenario: Scenario,
    robot: Robot,
    controller: Controller,
    settings: Settings,
    task: Task,
    tail: float,
    show: Sequence[int] = (),
) -> Outcome:
    """Play the episode of a task and measure all there is; keep it where its seed is shown."""
    episode = play(scenario, robot, controller, settings, task.seed)
    made = outcome(episode, task, tail, keep=task.seed in show)
    made.rows[0].update(measures(episode, tail, settings.time_limit))
    judged = scenario.judge(episode)
    made.rows[0].update({f"judged_{name}": value for name, value in judged.items()})
    return made


def check_robots(
    scenarios: Mapping[str, Scenario],
    robots: Mapping[str, Robot],
    controllers: Mapping[str, Controller],
) -> None:
    """Refuse robots for which scenarios have no room, and controllers made for other robots.

    Parameters
    ----------
    scenarios, robots, controllers : by where they stand in the config ("robots.unicycle").

    Raises
    ------
    WideberthError : a robot larger than a scenario's ``robot_radius``; a controller whose own
        robot is none of these, or that refuses one of them.
    """
    for place, scenario in scenarios.items():
        room = scenario.robot_radius or float("inf")
        for name, robot in robots.items():
            if robot.radius > room + 1e-9:
                raise WideberthError(
                    f"{place} has room for a robot of radius {room:g} m, and {name} has "
                    f"{robot.radius:g} m: set the scenario's robot_radius"
                )
    for name, controller in controllers.items():
        own = getattr(controller, "robot", None)
        if own is not None and own not in robots.values():
            raise WideberthError(
                f"{name} drives {own}, unlike {' and '.join(robots)}: write the robot once with a "
                "YAML anchor"
            )
        for robot in robots.values():
            driving(controller, robot)


def driving(controller: Controller, robot: Robot) -> Controller:
    """Return the controller with the robot that it is to drive, where it asks for one."""
    made: Any = controller
    entries: Any = fields(made) if is_dataclass(controller) else ()
    if not any(entry.name == "robot" and entry.init for entry in entries) or made.robot == robot:
        return controller
    changed: Controller = replace(made, robot=robot)
    return changed

"""Studies of closed loops: what is common to those that play episodes over seeds."""

from abc import abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields
from pathlib import Path
from types import MappingProxyType
from typing import final

from ...framework import Controller, Robot, WideberthError
from ...framework.controller import DrivesRobot, driving
from ...framework.mpc.planner.planner import planner_behind
from ...framework.plugins.registry import named
from ...framework.values.arrays import probability, whole
from ...simulation.engine.settings import Settings
from ...simulation.log.episode_log import Episode
from ...simulation.measures.episode_measures import measures
from ...simulation.scenarios.base import Scenario
from ..engine.closed_loop import about_first_contact, check_starts, inputs_of, outcome, play
from .grid import GridStudy, Pictures, Row, Task, TaskOutcome

LEAD = 1.5
"""s from the drawn plan of a flight to the closest approach."""


@dataclass(frozen=True, kw_only=True)
class SeededStudy(GridStudy):
    """Every point of the grid is played at the same seeds.

    Parameters
    ----------
    seeds : number of episodes at each point.
    first_seed : the seeds are first_seed to first_seed + seeds - 1.
    tail : 1 - content that forecasts and levels are measured against, and of the drawn regions.
    """

    seeds: int = 20
    first_seed: int = 0
    tail: float = 0.05

    @final
    def __post_init__(self) -> None:
        whole("seeds", self.seeds)
        whole("first_seed", self.first_seed, least=0)
        probability("tail", self.tail)
        for entry in (one for one in fields(self) if one.init):
            if getattr(self, entry.name) == {} and entry.default_factory is not dict:
                raise WideberthError(f"{entry.name} is empty; name at least one")
        self.validate()

    def validate(self) -> None:
        """Refuse settings that make no study; those of all studies with seeds are checked."""
        return

    @final
    @property
    def seed_range(self) -> range:
        """The seeds."""
        return range(self.first_seed, self.first_seed + self.seeds)

    @final
    def check_shown(self, show: Sequence[int]) -> None:
        """Refuse to show an episode that is not played, or one twice.

        Parameters
        ----------
        show : seeds of the episodes that are drawn.

        Raises
        ------
        WideberthError : a seed outside these, or one that stands twice.
        """
        first, seeds = self.first_seed, self.seeds
        if any(not first <= seed < first + seeds for seed in show):
            raise WideberthError(
                f"show is {[*show]}; wanted seeds in [{first}, {first + seeds}), as in "
                f"show=[{first}]"
            )
        if len(set(show)) < len(show):
            raise WideberthError(f"show is {[*show]}; wanted each seed once")

    @staticmethod
    def figure_name(name: str, seed: int, show: Sequence[int]) -> str:
        """Name the figure of one episode: by its seed too where several are shown."""
        return name if len(show) == 1 else f"{name}_{seed}"

    @final
    def episode_pictures(
        self,
        name: str,
        episode: Episode,
        controller: Controller,
        views: float | None = None,
        film: bool = False,
    ) -> Pictures:
        """Yield the pictures of one episode: the views of two robots, the run, and the film.

        In space the one picture is the flight, from above and from the side.

        Parameters
        ----------
        name : ends the names of the pictures.
        controller : of the robots; the regions of a planner are drawn.
        views : m between the robots at the moment whose plans are drawn; None draws none.
        film : whether the episode is animated.
        """
        from ..drawing.animation import animate
        from ..drawing.episodes import draw_run, draw_views
        from ..drawing.episodes_3d import draw_flight

        if episode.robots[0].positions.shape[1] == 3:
            yield f"flight_{name}", draw_flight(episode, tail=self.tail, lead=LEAD)
            return
        planner = planner_behind(controller)
        if views is not None and len(episode.robots) == 2:
            yield (
                f"views_{name}",
                draw_views(episode, distance=views, tail=self.tail, planner=planner),
            )
        yield f"run_{name}", draw_run(episode)
        if film:
            yield f"animation_{name}.gif", animate(episode, tail=self.tail, planner=planner)


@dataclass(frozen=True, kw_only=True)
class ClosedLoopStudy(SeededStudy):
    """All robots have one model, and episodes have one clock.

    Parameters
    ----------
    robot : model of all plants.
    settings : clock, noise and end of the episodes.
    """

    robot: Robot
    settings: Settings = field(default_factory=Settings)

    @abstractmethod
    def places(self) -> Mapping[str, Scenario]:
        """Return the scenarios by name; by "" where there is one only."""

    @abstractmethod
    def controllers(self) -> Mapping[str, Controller]:
        """Return controllers, by name, that must be able to begin an episode everywhere."""

    @final
    def inputs(self) -> list[Path]:
        """Return the files that the scenarios read."""
        return inputs_of(self.places().values())

    @final
    def check(self) -> None:
        """Begin an episode of the first seed with each controller at each place."""
        check_starts(self.places(), self.robot, self.controllers(), self.first_seed)

    @final
    def played(self, task: Task, controller: Controller) -> Episode:
        """Play the episode of a point with a controller."""
        place = task.settings.get("scenario", "")
        scenario = self.places().get(place) or self.places()[""]
        return play(scenario, self.robot, controller, self.settings, task.seed)


@dataclass(frozen=True, kw_only=True)
class OnePlaceStudy(ClosedLoopStudy):
    """A closed loop in one scenario.

    Parameters
    ----------
    scenario : each seed draws the same situation for every controller.
    """

    scenario: Scenario

    @final
    def places(self) -> Mapping[str, Scenario]:
        """Return the scenario."""
        return {"": self.scenario}


@dataclass(frozen=True, kw_only=True)
class PlacesStudy(ClosedLoopStudy):
    """A closed loop in several scenarios.

    Parameters
    ----------
    scenarios : by name; each seed draws the same situation for every controller.
    """

    scenarios: dict[str, Scenario]

    @final
    def places(self) -> Mapping[str, Scenario]:
        """Return the scenarios."""
        return self.scenarios


def measured(
    scenario: Scenario,
    robot: Robot,
    controller: Controller,
    settings: Settings,
    task: Task,
    tail: float,
    show: Sequence[int] = (),
    metrics: Mapping[str, str] = MappingProxyType({}),
    more: Callable[[Episode], Row] = lambda _: {},
) -> TaskOutcome:
    """Play the episode of a task and measure all there is; keep it where its seed is shown.

    ``metrics`` are columns by name, see `episode_metric`; ``more`` returns a study's own columns.
    """
    episode = play(scenario, robot, controller, settings, task.seed)
    judged = scenario.judge(episode)
    columns = {
        **measures(episode, tail, settings.time_limit),
        **about_first_contact(episode, scenario, robot, controller, settings),
        **{f"judged_{name}": value for name, value in judged.items()},
        **more(episode),
    }
    for name, target in metrics.items():
        if name in columns:
            raise WideberthError(f"metrics: the column {name!r} exists; give yours another name")
        columns[name] = float(episode_metric(target)(episode))
    return outcome(episode, task, tail, columns, keep=task.seed in show)


def episode_metric(target: str) -> Callable[[Episode], float]:
    """Return the function that "module:function" names; it takes an episode.

    Raises
    ------
    WideberthError : the module cannot be imported, or has no such function.
    """
    metric: Callable[[Episode], float] | None = named(target) if ":" in target else None
    if not callable(metric):
        raise WideberthError(
            f"{target!r} names no function; wanted module:function, which takes an episode"
        )
    return metric


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
        if isinstance(controller, DrivesRobot) and controller.robot not in robots.values():
            raise WideberthError(
                f"{name} drives {controller.robot}, unlike {' and '.join(robots)}: write the "
                "robot once with a YAML anchor"
            )
        for robot in robots.values():
            driving(controller, robot)

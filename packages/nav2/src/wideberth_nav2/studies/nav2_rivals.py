"""Nav2's controllers in the same situations as our planner, with the same path and view."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields, is_dataclass, replace
from pathlib import Path
from typing import Any, ClassVar, Self, final

import numpy as np

from wideberth.controllers.withdrawing import Withdrawing
from wideberth.experiments import Result, Row, Task, TaskOutcome, reduced
from wideberth.experiments.engine.closed_loop import about_first_contact, column, outcome
from wideberth.experiments.engine.errors import as_user_error
from wideberth.experiments.studies.comparison_figures import summary_pictures
from wideberth.experiments.studies.episode_statistics import (
    against,
    condensed,
    paired,
    with_interval,
)
from wideberth.experiments.studies.episodes import SeededStudy
from wideberth.experiments.studies.grid import labelled
from wideberth.framework import Controller, Predictor, Robot, WideberthError
from wideberth.framework.control.command_limits import top_speed
from wideberth.framework.controller import driving, fresh
from wideberth.framework.mpc.planner.planner import Planner
from wideberth.framework.values.arrays import positive
from wideberth.metrics.statistics import known_mean, mcnemar
from wideberth.simulation.engine.episode import Run
from wideberth.simulation.engine.settings import Settings
from wideberth.simulation.log.episode_log import Episode
from wideberth.simulation.measures.episode_measures import measures
from wideberth.simulation.scenarios.base import Scenario

from ..controllers.local_controllers import shipped_parameters
from ..costmap.local_costmap import CostmapView
from ..server.navigator import Nav2
from .looks import draw_looks, looks_from_bytes, looks_to_bytes
from .same_view import SameView, Watched

AXES = {"scenario": "places", "limits": "limits", "view": "views", "controller": "controllers"}
"""Column of the table -> field of the study."""
CHANCE = 0.01
"""p below which a difference is called one."""
OWN_RADIUS, OWN_INFLATION = 0.22, 0.70
"""m: of the robot for which Nav2 ships its settings, and the inflation there."""
LOOK_PERIOD = 0.5
"""s between two looks that are kept of a shown episode."""
MEANS = {
    "clearance_mean_m": "clearance", "jerk_rms": "jerk_rms", "recoveries": "recoveries",
    "gave_up": "gave_up",
}  # fmt: skip
"""Column of the summary -> column of the table whose mean it is."""


@final
@dataclass(frozen=True)
class Place:
    """A situation, the radius of the robots in it, and how long it lasts.

    Parameters
    ----------
    scenario : draws the situation.
    radius : m, of the robots that are examined.
    settings : clock, noise and end of its episodes.
    """

    scenario: Scenario
    radius: float
    settings: Settings = field(default_factory=Settings)

    def __post_init__(self) -> None:
        room = self.scenario.robot_radius or np.inf
        if positive("place.radius", self.radius) > room + 1e-9:
            raise WideberthError(
                f"place.radius is {self.radius:g} m; the scenario has room for {room:g} m: set "
                "its robot_radius"
            )


@final
@dataclass(frozen=True)
class LimitSet:
    """What the robot can do, and whether the same limits bind the rivals.

    Parameters
    ----------
    robot : model of the plant; a place sets its radius.
    bounded : the rivals' velocities and accelerations are those of the robot. If not, each keeps
        those that Nav2 ships, and the robot does what it can of them.
    """

    robot: Robot
    bounded: bool = True


@final
@dataclass(frozen=True)
class Nav2Rivals(SeededStudy):
    """Every controller at every place, under all limits and views, on the same seeds.

    All robots of an episode have the same controller. Each is given the same path and learns of
    the same bodies, see `SameView`; what stands still is a known map. Those of Nav2 stand in
    Nav2's loop, with what Nav2 ships for its own robot where a config says nothing else. The
    lengths of a view are for that robot, of 0.22 m, and grow with the radius: window, ranges and
    the inflation beyond the robot's outline stay, and the window and the ranges are
    ``radius / 0.22 m`` times as large (an exact view stays as it is).

    A planner drives at the robot's top speed, as rivals do. The paired tests are McNemar's of
    success and of touches, and Wilcoxon's signed-rank test of the times of those seeds at which
    both arrived; ``finding`` names what holds at p < 0.01.

    Parameters
    ----------
    places, limits, views, controllers : by name.
    tracker : forecasts whose velocities TEB receives; the other rivals receive positions.
    baseline : controller that the others are compared with.
    partners : controllers that are compared with another one instead, by name.
    show : seeds whose episodes are kept and drawn.
    """

    claim: ClassVar[str] = (
        "With the same path, the same view and the same robot: does a planner that forecasts "
        "arrive where Nav2's controllers do not, or sooner, and where not?"
    )
    reference: ClassVar[str] = "macenski2020marathon,mcnemar1947note,wilcoxon1945individual"
    printed: ClassVar[tuple[str, ...]] = (
        *("episodes", "success", "collision", "time_mean_s", "clearance_mean_m", "gave_up"),
        *("time_difference_s", "finding", "judged_outcome", "errors"),
    )

    places: dict[str, Place]
    limits: dict[str, LimitSet]
    views: dict[str, CostmapView]
    controllers: dict[str, Controller]
    tracker: Predictor
    baseline: str
    partners: dict[str, str] = field(default_factory=dict)
    show: tuple[int, ...] = ()

    def validate(self) -> None:
        """Refuse settings that make no study."""
        pairs = [
            (f"partners.{one}", name)
            for one, both in self.partners.items()
            for name in (one, both)
        ]
        for label, name in [("baseline", self.baseline), *pairs]:
            if name not in self.controllers:
                raise WideberthError(
                    f"{label} is {name!r}; the controllers are {sorted(self.controllers)}"
                )
        self.check_shown(self.show)

    def axes(self) -> Mapping[Any, Any]:
        """All places, limits, views and controllers."""
        axes: dict[Any, Any] = {column: getattr(self, name) for column, name in AXES.items()}
        return {**axes, "seed": self.seed_range}

    def inputs(self) -> list[Path]:
        """Return the files that the scenarios read."""
        return [file for place in self.places.values() for file in place.scenario.inputs()]

    def check(self) -> None:
        """Begin an episode of every controller at every place, under the first limits and view."""
        firsts = {column: next(iter(getattr(self, name))) for column, name in AXES.items()}
        seed = self.first_seed
        for place in self.places:
            for controller in self.controllers:
                settings = {**firsts, "scenario": place, "controller": controller}
                with as_user_error(
                    f"{controller} at {place}, seed {seed}: no episode can begin: "
                ):
                    self._begun(Task("", seed, settings), looks=False)

    def measure(self, task: Task) -> TaskOutcome:
        """Play one episode."""
        place = self.places[task.settings["scenario"]]
        keep = task.seed in self.show
        run, watched = self._begun(task, keep)
        run.advance()
        episode, robot = run.episode(), run.drivers[0].agent.robot
        more = {
            **measures(episode, self.tail, place.settings.time_limit),
            **_tried(watched),
            **about_first_contact(episode, place.scenario, robot, watched[0], place.settings),
        }
        made = outcome(episode, task, self.tail, more)
        labels = {name: made.rows[0][name] for name in (*AXES, "seed")}
        made.times[:] = [
            {**labels, **_processor_time(one, log.name, episode.duration)}
            for one, log in zip(watched, episode.robots, strict=True)
        ]
        if keep:
            made.files[f"{_file(task)}.npz"] = episode.to_bytes()
            if watched[0].looks:
                made.files[f"looks-{_file(task)}.npz"] = looks_to_bytes(watched[0].looks)
        return made

    def summary(self, rows: list[Row]) -> list[Row]:
        """One line per place, limits, view and controller, paired with the baseline."""
        places = [name for name in AXES if name != "controller"]
        lines = []
        for head, some in labelled(rows, *places):
            played = {str(label["controller"]): own for label, own in labelled(some, "controller")}
            for name, own in played.items():
                line = {**head, "controller": name, **condensed(own)}
                line |= {to: known_mean(column(own, source)) for to, source in MEANS.items()}
                partner = self.partners.get(name, self.baseline)
                if partner in played:
                    line |= {"partner": partner, **compared(own, played[partner])}
                lines.append(line)
        return lines

    def pictures(self, result: Result) -> Iterator[tuple[str, Any]]:
        """Draw outcomes and times per place, and what Nav2's controllers saw."""
        rows = [_as_compared(row) for row in result.rows]
        lines = [_as_compared(line) for line in self.summary(result.rows)]
        yield from summary_pictures(lines, rows, self.baseline)
        for task in self.tasks():
            name = f"looks-{_file(task)}.npz"
            if task.seed in self.show and name in result.names():
                episode = Episode.from_bytes(result.read(f"{_file(task)}.npz"))
                looks = looks_from_bytes(result.read(name))
                yield f"looks_{_file(task).replace(' ', '_')}", draw_looks(episode, looks)

    def quick(self) -> Self:
        """One seed at the first place, under the first limits and view, of three controllers."""
        kept = [*self.controllers][:3]
        partners = {one: two for one, two in self.partners.items() if {one, two} <= {*kept}}
        whole = replace(self, partners=partners)
        return reduced(whole, places=1, limits=1, views=1, controllers=3, seeds=1)

    def _begun(self, task: Task, looks: bool) -> tuple[Run, list[Watched]]:
        """Return an episode at its start, and the controllers of its robots."""
        place, limits, view, controller = (
            getattr(self, name)[task.settings[column]] for column, name in AXES.items()
        )
        robot = with_radius(limits.robot, place.radius)
        seen = sized(view, place.radius)
        driven = adapted(controller, robot, limits.bounded, seen)
        cast = place.scenario.cast(task.seed)
        every = LOOK_PERIOD if looks else 0.0
        watched = [Watched(fresh(driven), every) for _ in cast.placements]
        robots = [
            one.agent(robot, own, truth=False)
            for one, own in zip(cast.placements, watched, strict=True)
        ]
        tracker = self.tracker if _uses_dynamic_obstacles(driven) else None
        world = SameView(place.settings, seen, tracker)
        agents = [*robots, *cast.people]
        run = Run(agents, place.settings, task.seed, cast.bystanders, (), cast.polygons, world)
        return run, watched


def with_radius(robot: Robot, radius: float) -> Robot:
    """Return the same robot with another radius, m.

    Raises
    ------
    WideberthError : a robot whose size is no field of its own.
    """
    made: Any = robot
    entries: Any = fields(made) if is_dataclass(robot) else ()
    if not any(entry.name == "radius" and entry.init for entry in entries):
        raise WideberthError(f"{type(robot).__name__} has no radius to set; take unicycle")
    changed: Robot = replace(made, radius=radius)
    return changed


def sized(view: CostmapView, radius: float) -> CostmapView:
    """Return a view for a robot of this radius, m, from that of Nav2's own robot."""
    inflation = view.inflation_radius + radius - OWN_RADIUS
    scale = 1.0 if view.exact else radius / OWN_RADIUS
    names = ("width", "height", "obstacle_max_range", "raytrace_max_range", "laser_range")
    lengths = {name: scale * getattr(view, name) for name in names}
    return replace(view, **lengths, inflation_radius=inflation)


def adapted(controller: Controller, robot: Robot, bounded: bool, view: CostmapView) -> Controller:
    """Return a controller for a robot; Nav2 with a view and what it ships, ours at top speed."""
    driven = driving(controller, robot)
    if isinstance(driven, Nav2):
        settings = driven.settings
        parameters = {**shipped_parameters(settings.local), **settings.parameters}
        settings = replace(settings, parameters=parameters, view=view)
        return replace(driven, settings=settings, robot_limits=bounded)
    if isinstance(driven, Withdrawing):
        return replace(driven, controller=adapted(driven.controller, robot, bounded, view))
    if isinstance(driven, Planner):
        fastest = top_speed(robot, np.zeros(len(robot.states)))
        return replace(driven, reference_speed=fastest)
    return driven


def _uses_dynamic_obstacles(controller: Controller) -> bool:
    """Whether a controller takes the velocities of others from a tracker."""
    return isinstance(controller, Nav2) and controller.settings.local == "teb"


def _tried(watched: Sequence[Watched]) -> Row:
    """Count recoveries, and who gave up, over the robots of an episode."""
    ones = [one.controller for one in watched if isinstance(one.controller, Nav2)]
    if not ones:
        return {"recoveries": None, "gave_up": None}
    failed = [one.navigation == "failed" for one in ones]
    return {"recoveries": sum(one.recoveries for one in ones), "gave_up": any(failed)}


def _processor_time(one: Watched, agent: str, duration: float) -> Row:
    """Median and 99th percentile of a tick, and the share of the episode's time, s."""
    seconds = np.array(one.seconds or [np.nan])
    return {
        "agent": agent,
        "ticks": len(one.seconds),
        "tick_median": float(np.median(seconds)),
        "tick_p99": float(np.percentile(seconds, 99.0)),
        "per_second": float(seconds.sum() / duration),
    }


def compared(rows: Sequence[Row], others: Sequence[Row]) -> Row:
    """Compare a controller with the baseline, seed by seed, and say what is beyond chance."""
    touched = paired(rows, others, "collision"), paired(others, rows, "collision")
    nearer = paired(rows, others, "clearance") - paired(others, rows, "clearance")
    line = against(rows, others) | {"p_touch": mcnemar(*touched)}
    interval = with_interval("clearance_difference", nearer)
    line |= {f"{name}_m": value for name, value in interval.items()}
    return line | {"finding": finding(line)}


def finding(line: Row) -> str:
    """Say how a controller stands to the baseline: success first, then time, at `CHANCE`."""
    if line["p_success"] < CHANCE:
        fewer = line["only_baseline"] > line["only_this"]
        return "arrives less often" if fewer else "arrives more often"
    if line["p_time"] < CHANCE:
        return "slower" if line["time_difference_s"] > 0.0 else "faster"
    return "no difference shown"


def _as_compared(row: Row) -> Row:
    """Name limits and view as the figures of a comparison do."""
    return {**row, "robot": row["limits"], "settings": row["view"]}


def _file(task: Task) -> str:
    """Name of what is kept of an episode."""
    return "-".join([*(str(task.settings[name]) for name in AXES), str(task.seed)])

"""What plans promise of the people around them, against what happened, and what it cost."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any, ClassVar, Self, final

import numpy as np

from ...controllers.constant_velocity import ConstantVelocityController
from ...framework import Controller, Fittable, Predictor, Robot, Tracks, WideberthError
from ...framework.controller import driving
from ...framework.mpc.levels.base import LevelPolicy
from ...framework.mpc.planner.planner import Planner
from ...framework.plugins.config import describe
from ...framework.plugins.registry import unknown
from ...framework.values.arrays import Array, whole
from ...framework.values.coverage import Coverage, Event
from ...metrics.statistics import known_mean, ratio, ratio_interval
from ...predictors.data.recordings import Recording
from ...simulation.engine.settings import Settings
from ...simulation.log.episode_log import Episode
from ...simulation.measures.kept_clear import KeptClear, people_of
from ...simulation.measures.summary import summarise, time_rows
from ...simulation.scenarios.base import Scenario
from ...simulation.scenarios.recorded_scene import SCENES, RecordedScene
from ..drawing.plotting import PAGE, few, legend_below, subplots, title
from ..engine.closed_loop import check_starts, column, group, inputs_of, play
from .fitting import AS_GIVEN, NOTHING, fitted
from .grid import Axes, GridStudy, Pictures, Result, Row, Task, TaskOutcome, labelled, reduced
from .prediction_data import PredictionData, SceneFiles
from .variants import planner_of

BLOCK = 100
"""Episodes per task: they share a planner that is fitted once."""
APART = 1_000_000
"""Seeds that calibration adds to its own, so that it never sees an episode that is counted."""
CREEPING = 1e-3
"""m/s, of the robot beside which calibration watches people."""
LASTING = 100
"""Rows of a recording that an episode may last; starts nearer than that are of one block."""
MISSES = {
    Event.STEP: "steps",
    Event.LONG_RUN: "steps",
    Event.PERSON: "persons",
    Event.PLAN: "plans",
    Event.FIELD: "fields",
    Event.TASK: "episodes",
}
"""Event -> what is counted, and missed, of it."""
STEPS_SHOWN = ("first", "middle", "last")
SUMS = ("steps", "persons", "plans", "fields", "meetings", "driven")


@final
@dataclass(frozen=True)
class SimulatedPlace:
    """A scenario with simulated people, from other episodes of which calibration learns.

    Parameters
    ----------
    scenario : who walks there.
    settings : clock, noise and end of the episodes.
    learning : episodes that calibration learns from, each as long as the time limit. The robot in
        them hardly moves from its start.
    """

    scenario: Scenario
    settings: Settings = field(default_factory=Settings)
    learning: int = 40

    def __post_init__(self) -> None:
        whole("learning", self.learning)

    def watched(self, robot: Robot, dt: float) -> list[Tracks]:
        """Return the people of the episodes that calibration learns from, seen as the robot does.

        Parameters
        ----------
        robot : that drives among them.
        dt : s between samples.
        """
        driver = ConstantVelocityController(robot=robot, reference_speed=CREEPING)
        whole_time = replace(self.settings, deadlock_after=2.0 * self.settings.time_limit)
        seeds = range(APART, APART + self.learning)
        played = (play(self.scenario, robot, driver, whole_time, seed) for seed in seeds)
        return [seen_tracks(episode, dt, self.settings.channel.noise) for episode in played]


@final
@dataclass(frozen=True)
class Guarantees(GridStudy):
    """Each planner among the same people; every plan is judged by where people then were.

    A planner promises an event (see `wideberth.framework.values.coverage.Event`) through its
    predictor or its level. For every plan, the regions that its forecast has at the level aimed at
    are held against the true positions at the plan's steps. A person is missed where they are
    outside of their regions; a plan where any person is at any step; a field where any
    person is outside of the regions of all; an episode where any of its plans is; and a
    meeting where the plan, driven to its end, would touch a person. People whom the plan could
    not know of do not count. Regions count without the radii of robot and people,
    and as aimed at: where a level gave way the plan kept less.

    ``missed`` is the share missed of what the planner's own event counts, to be held against
    ``promise``. Intervals of 95 % are from a bootstrap over blocks: of simulated people an
    episode, of recorded ones all starts within 100 rows, whose people are partly the same.

    What can be fitted is fitted: among simulated people on other episodes of the place, among
    recorded ones on the recordings of all other sites (leave one out).

    Parameters
    ----------
    planners : by name, best known first.
    robot : that all of them drive.
    places : of simulated people, by name.
    data : recordings; every scene that is scored is a place. Known scenes have the starts and
        goals of `RecordedScene`; in others the robot crosses the area from left to right.
    settings : of the episodes among recorded people.
    as_given : planners whose predictors stay as they stand, as shipped or saved; all others that
        can be fitted are.
    starts : instants of a recording, evenly spaced, at which episodes begin. Seed k is the k-th,
        modulo their number, with noise of its own.
    only : places to take, simulated and recorded; all if empty.
    seeds : episodes of each planner in each place.
    first_seed : the seeds are first_seed to first_seed + seeds - 1.
    """

    claim: ClassVar[str] = (
        "How often do people leave what plans kept clear, anywhere on it, how often was it "
        "promised that they would not, and what did the promise cost?"
    )
    reference: ClassVar[str] = "lindemann2023safe,gibbs2021adaptive,efron1993introduction"
    printed: ClassVar[tuple[str, ...]] = (
        *("event", "promise", "missed", "missed_low", "missed_high", "plans_missed"),
        *("radius_last_m", "arrived", "collisions", "time_s"),
    )

    planners: dict[str, Controller]
    robot: Robot
    places: dict[str, SimulatedPlace] = field(default_factory=dict)
    data: PredictionData = field(default_factory=PredictionData)
    settings: Settings = field(default_factory=Settings)
    as_given: tuple[str, ...] = ()
    starts: int = 30
    only: tuple[str, ...] = ()
    seeds: int = 30
    first_seed: int = 0

    def __post_init__(self) -> None:
        whole("seeds", self.seeds)
        whole("first_seed", self.first_seed, least=0)
        whole("starts", self.starts)
        if not self.planners:
            raise WideberthError("planners is empty; name at least one")
        for controller in self.planners.values():
            planner_of(controller)
        for name in self.as_given:
            if name not in self.planners:
                raise WideberthError(f"as_given: {unknown('planner', name, self.planners)}")

    def axes(self) -> Axes:
        """Each planner in each place, and the seeds in blocks."""
        seeds = range(self.first_seed, self.first_seed + self.seeds)
        return {
            "place": [*self._simulated, *self._scenes()],
            "planner": self.planners,
            ("seed", "seeds"): [(one, min(BLOCK, seeds.stop - one)) for one in seeds[::BLOCK]],
        }

    def inputs(self) -> list[Path]:
        """Return the recordings and the files that scenarios read."""
        files = [
            path
            for scene in self.data.found(self._named).values()
            for path in self.data.paths(scene)
        ]
        return [*files, *inputs_of(place.scenario for place in self.places.values())]

    def check(self) -> None:
        """Begin an episode of the first seed in every place with every planner.

        Raises
        ------
        WideberthError : a place that is named like a recorded scene.
        """
        for name in self._scenes():
            if name in self.places:
                raise WideberthError(
                    f"places.{name} is named like a scene of data: give it another name"
                )
        every = {name: self._place(name)[0] for name in (*self._simulated, *self._scenes())}
        driven = {name: driving(one, self.robot) for name, one in self.planners.items()}
        check_starts(every, self.robot, driven, self.first_seed)

    def measure(self, task: Task) -> TaskOutcome:
        """Fit the planner, play a block of episodes, and judge their plans."""
        place, name = task.settings["place"], task.settings["planner"]
        scenario, settings = self._place(place)
        planner, learnt_from = self._fitted(place, name)
        rows: list[Row] = []
        times: list[Row] = []
        labels = {"place": place, "planner": name}
        for seed in range(task.seed, task.seed + task.settings["seeds"]):
            episode = play(scenario, self.robot, planner, settings, seed)
            block = self._block(scenario, seed)
            head: Row = {**labels, "seed": seed, "block": block, "fitted": learnt_from}
            rows.append(head | judged(episode, planner, scenario.cast(seed).bystanders))
            times += [{**labels, "seed": seed, **row} for row in time_rows(episode)]
        return TaskOutcome(rows, times)

    @property
    def _named(self) -> tuple[str, ...]:
        """Recorded scenes that ``only`` names."""
        return tuple(name for name in self.only if name not in self.places)

    @property
    def _simulated(self) -> list[str]:
        """Names of the places of simulated people."""
        return [name for name in self.places if not self.only or name in self.only]

    def _scenes(self) -> dict[str, SceneFiles]:
        """Return the recorded scenes that are places.

        Raises
        ------
        WideberthError : ``only`` names what is neither a place nor a scene.
        """
        found = self.data.found(self._named)
        chosen = {name: one for name, one in found.items() if one.role == "primary"}
        for name in self._named:
            if name not in chosen:
                raise WideberthError(f"only: {unknown('place', name, [*self.places, *chosen])}")
        return {name: one for name, one in chosen.items() if not self.only or name in self._named}

    def _place(self, name: str) -> tuple[Scenario, Settings]:
        if name in self.places:
            return self.places[name].scenario, self.places[name].settings
        files = self._scenes()[name]
        recording, dt = self.data.read(files)[0], self.data.step(files)
        rows = _starts(recording, self.starts)
        path = str(self.data.paths(files)[0])
        if name in SCENES:
            return RecordedScene(path, name, rows=rows, dt=dt), self.settings  # type: ignore[arg-type]
        start, goal = _across(recording.positions)
        return RecordedScene(path, None, start, goal, rows, dt), self.settings

    def _block(self, scenario: Scenario, seed: int) -> int:
        """Return the block of an episode: those of one block depend on each other."""
        if isinstance(scenario, RecordedScene):
            return scenario.rows[seed % len(scenario.rows)] // LASTING
        return seed

    def _fitted(self, place: str, name: str) -> tuple[Planner, str]:
        """Return a planner that has learnt from all but this place, and what it was fitted to."""
        planner = planner_of(self.planners[name])
        if name in self.as_given:
            return planner, AS_GIVEN
        if not isinstance(planner.predictor, Fittable):
            return planner, NOTHING
        if place in self.places:
            training = self.places[place].watched(self.robot, planner.track_dt)
        else:
            training = self.data.training(place, self._named)
        predictor, learnt_from = fitted(planner.predictor, training)
        return replace(planner, predictor=predictor), learnt_from

    def summary(self, rows: list[Row]) -> list[Row]:
        """One line per place and planner."""
        return [
            {**labels, **self._line(planner_of(self.planners[labels["planner"]]), some)}
            for labels, some in labelled(rows, "place", "planner")
        ]

    def _line(self, planner: Planner, rows: list[Row]) -> Row:
        coverage, tail, counted = promised(planner)
        line: Row = {
            "event": coverage.event.name.lower(),
            "promise": tail,
            **missed_share("missed", rows, counted),
            "episodes": len(rows),
            "fitted": rows[0]["fitted"],
        }
        for name in SUMS[:-1]:
            line |= missed_share(f"{name}_missed", rows, name)
        line |= {
            "episodes_missed_driving": float(np.mean(column(rows, "driven_missed") > 0)),
            **{f"radius_{at}_m": known_mean(column(rows, f"radius_{at}")) for at in STEPS_SHOWN},
            "area_m2": known_mean(column(rows, "area")),
            "arrived": float(np.mean(column(rows, "arrived"))),
            "collisions": int(column(rows, "collision").sum()),
            "time_s": known_mean(column(rows, "time")),
            "clearance_m": float(np.median(column(rows, "clearance"))),
        }
        return line

    def pictures(self, result: Result) -> Pictures:
        """Draw promise against what was kept, and the price."""
        lines = self.summary(result.rows)
        yield "guarantees", draw(lines)

    def quick(self) -> Self:
        """Keep the first planners in the first place of either kind for two episodes."""
        places = {name: replace(one, learning=10) for name, one in self.places.items()}
        only = (*self._simulated[:1], *list(self._scenes())[:1])
        names = list(self.planners)[:3]
        known = tuple(name for name in self.as_given if name in names)
        small = replace(self, places=places, only=only, as_given=known)
        return reduced(small, planners=3, seeds=2, starts=2)


def promised(planner: Planner) -> tuple[Coverage, float, str]:
    """Return the contract behind a planner, the probability that it leaves open, and what counts.

    It is that of a kind of slots where one has a contract, of which meetings count, since it
    speaks of the plan itself; else that of the predictor, which says what the level's tail is
    worth; else that of the level.

    Raises
    ------
    WideberthError : none of them promises anything.
    """
    for kind in planner.further_kinds:
        if kind.coverage is not None:
            return kind.coverage, float(describe(kind)["risk"]), "meetings"
    stated: tuple[Predictor | LevelPolicy, ...] = (planner.predictor, planner.level)
    for part in stated:
        if part.coverage is not None:
            return part.coverage, float(describe(part)["tail"]), MISSES[part.coverage.event]
    raise WideberthError("neither predictor nor level of the planner states a coverage")


def judged(episode: Episode, planner: Planner, others: Sequence[Any]) -> Row:
    """Return what an episode says of the promises of its robot's plans."""
    (log,) = episode.robots
    of_plan = partial(
        KeptClear.of,
        region=planner.region,
        level=planner.level,
        people=people_of(episode, others),
        radius=log.radius,
    )
    found = [one for one in map(of_plan, log.plans) if one is not None]
    counts = [one.counts() for one in found]
    row: Row = {name: sum(one[name] for one in counts) for name in _COLUMNS}
    row |= {"episodes": 1.0, "episodes_missed": float(row["plans_missed"] > 0)}
    for at, place in zip(STEPS_SHOWN, (0, (planner.horizon - 1) // 2, -1), strict=True):
        row[f"radius_{at}"] = known_mean(_joined([one.radius[:, place] for one in found]))
    row["area"] = known_mean(_joined([np.pi * (one.radius**2).ravel() for one in found]))
    summed = summarise(episode)
    arrived = summed["ended"] == "goals"
    return row | {
        "arrived": arrived,
        "collision": summed["collision"],
        "clearance": summed["clearance"],
        "time": log.reached if arrived else None,
    }


_COLUMNS = (
    *(name for each in SUMS for name in (each, f"{each}_missed")),
    "plans_with_newcomers",
)


def _joined(parts: Sequence[Array]) -> Array:
    return np.concatenate([np.zeros(0), *parts])


def missed_share(name: str, rows: list[Row], counted: str, block: str = "block") -> Row:
    """Share of what is counted that was missed, with its interval over blocks.

    ``block`` is the column that says which rows depend on each other.
    """
    blocks = group(rows, block).values()
    parts = np.array([column(some, f"{counted}_missed").sum() for some in blocks])
    wholes = np.array([column(some, counted).sum() for some in blocks])
    low, high = ratio_interval(parts, wholes)
    share = float(ratio(parts.sum(), wholes.sum()))
    return {name: share, f"{name}_low": low, f"{name}_high": high}


def seen_tracks(episode: Episode, dt: float, noise: float) -> Tracks:
    """Return the people of an episode at a step of its own, with the noise of detections."""
    others = [agent for agent in episode.agents if agent.kind != "robot"]
    times = np.arange(episode.times[0], episode.duration + 1e-9, dt)
    places = np.array([episode.at(agent, times) for agent in others])
    rng = np.random.default_rng([episode.seed, 1])
    places = places + noise * rng.standard_normal(places.shape)
    covariance = np.broadcast_to(max(noise, 1e-3) ** 2 * np.eye(2), (len(others), 2, 2))
    radius = np.array([agent.radius for agent in others])
    names = tuple(agent.name for agent in others)
    return Tracks(places, dt, names, radius, covariance, float(times[-1]))


def _starts(recording: Recording, count: int) -> tuple[int, ...]:
    """Rows, evenly spaced, at which people are there and an episode still has room."""
    last = max(len(recording.times) - LASTING, 1)
    there = np.flatnonzero(np.isfinite(recording.positions[:, :last]).all(axis=2).any(axis=0))
    if not there.size:
        raise WideberthError(
            "a recording shows no one before its last 100 rows: take a longer one"
        )
    chosen = there[np.linspace(0, len(there) - 1, count).round().astype(int)]
    return tuple(dict.fromkeys(chosen.tolist()))


def _across(positions: Array) -> tuple[tuple[float, float, float], tuple[float, float]]:
    """Start and goal of a way from left to right through the area where people walk."""
    low, high = np.nanquantile(positions[..., 0], (0.05, 0.95))
    middle = float(np.nanmedian(positions[..., 1]))
    return (float(low), middle, 0.0), (float(high), middle)


LEAST = 3e-3
"""Lower end of the axis of what was missed; shares of zero stand there."""
MARKS = "osD^vP*X<>dph8"


def draw(lines: list[Row]) -> Any:
    """Draw what was missed over what was promised, a panel per place, shaded by the price.

    Planners of one promise stand side by side, over a dotted line at what they promised.
    """
    places = group(lines, "place")
    promises = {str(line["planner"]): float(line["promise"]) for line in lines}
    names = sorted(promises, key=promises.__getitem__)
    values = sorted(set(promises.values()))
    at = {name: k + values.index(promises[name]) for k, name in enumerate(names)}
    across = min(len(places), 3)
    down = -(-len(places) // across)
    figure, panels = subplots(
        down, across, figsize=(PAGE, 0.9 + 2.2 * down), squeeze=False, sharex=True, sharey=True
    )
    widest = max(float(line["radius_last_m"]) for line in lines)
    shades: Any = None
    for panel, ((place,), some) in zip(panels.flat, places.items(), strict=False):
        for line in some:
            name = str(line["planner"])
            shades = _mark(panel, line, at[name], MARKS[names.index(name) % len(MARKS)], widest)
        _dotted(panel, {value: [at[n] for n in names if promises[n] == value] for value in values})
        panel.set(yscale="log", ylim=(0.8 * LEAST, 1.2), title=title(place))
    for panel in panels.flat[len(places) :]:
        panel.set_visible(False)
    for panel in panels[-1]:
        panel.set_xlabel("promised: missed at most")
    for panel in panels[:, 0]:
        panel.set_ylabel("missed")
    figure.colorbar(shades, ax=[*panels.flat], label="radius at the last step (m)", shrink=0.8)
    for k, name in enumerate(names):
        look = MARKS[k % len(MARKS)]
        panels[0, 0].plot([], [], look, color="0.4", markersize=5, label=title(name))
    words = few(int(line["episodes"]) for line in lines) or "bars: intervals of 95 %"
    legend_below(figure, panels[:1, 0], ncols=4, title=f"{words}; dotted: as promised",
                 title_fontsize=7)  # fmt: skip
    return figure


def _dotted(panel: Any, places: Mapping[float, Sequence[int]]) -> None:
    """Draw each promise over the planners that make it, and name it on the axis."""
    for value, own in places.items():
        panel.plot([own[0] - 0.5, own[-1] + 0.5], [value, value], "k:", linewidth=1.0)
    middles = [0.5 * (own[0] + own[-1]) for own in places.values()]
    panel.set_xticks(middles, [f"{100 * value:g} %" for value in places])
    panel.grid(axis="x", visible=False)


def _mark(panel: Any, line: Row, at: int, look: str, widest: float) -> Any:
    """Draw one planner's marker with its interval; return what the colours stand for."""
    missed = max(float(line["missed"]), LEAST)
    ends = [max(float(line[f"missed_{end}"]), LEAST) for end in ("low", "high")]
    panel.plot([at, at], ends, "-", color="0.6", linewidth=0.9, zorder=1)
    return panel.scatter(
        at, missed, c=[float(line["radius_last_m"])], marker=look, s=26, cmap="Greys",
        vmin=0.0, vmax=widest, edgecolors="black", linewidths=0.6, zorder=2,
    )  # fmt: skip

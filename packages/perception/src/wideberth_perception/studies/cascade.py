"""Robots that see for themselves: what sensing, tracking, drift and slip cost, stage by stage."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import product
from pathlib import Path
from textwrap import fill
from typing import Any, ClassVar, NamedTuple, Self, final

import numpy as np

from wideberth.controllers.reactive import Reactive
from wideberth.experiments import Result, Row, Task, TaskOutcome, reduced, subplots
from wideberth.experiments.drawing.plotting import PAGE, few, legend_below, style
from wideberth.experiments.engine.closed_loop import column, condense, outcome
from wideberth.experiments.engine.errors import as_user_error
from wideberth.experiments.studies.episode_statistics import with_interval
from wideberth.experiments.studies.episodes import SeededStudy
from wideberth.experiments.studies.grid import labelled
from wideberth.framework import Controller, Robot, WideberthError
from wideberth.framework.controller import fresh
from wideberth.framework.plugins.registry import unknown
from wideberth.framework.values.arrays import positive
from wideberth.metrics.episode import free_time
from wideberth.metrics.statistics import known_mean
from wideberth.simulation.engine.agents import RobotAgent
from wideberth.simulation.engine.episode import Run
from wideberth.simulation.engine.settings import Settings
from wideberth.simulation.log.episode_log import AgentLog, Episode
from wideberth.simulation.scenarios.base import Placement, Scenario

from ..cascade.cascade import SensingPipeline
from ..cascade.measures import perception_row
from ..cascade.world import WheeledWorld

AXES = {
    "scenario": "scenarios",
    "planner": "planners",
    "cascade": "cascades",
    "settings": "settings",
}
"""Column of the table -> field of the study."""
FROM_REST = partial(Settings, history=0.0)
"""Settings of robots that have not been seen before time 0."""
COLUMNS = (
    "episodes", "collisions", "deadlocks", "goals_in_time", "goals_in_time_true",
    "clearance_min_m", "clearance_median_m", "time_ratio", "coverage", "coverage_first",
    "coverage_last", "below_reference", "least_content", "fallback_plans", "errors",
)  # fmt: skip
PERCEIVED = (
    "goal_error", "drift", "own_nees", "detection_error", "detection_nees", "track_error",
    "speed_error", "track_nees", "track_coverage", "identities", "false_tracks", "stopped",
)  # fmt: skip
"""Columns of the table whose mean over the episodes stands in the summary."""


class Measure(NamedTuple):
    """What is compared between two cases.

    Attributes
    ----------
    name : of the columns that hold it.
    source : column of the table.
    words : with the unit, for axes.
    """

    name: str
    source: str
    words: str


MEASURES = (
    Measure("clearance", "clearance", "clearance (m)"),
    Measure("time", "time_s", "time (s)"),
    Measure("coverage", "coverage", "coverage"),
    Measure("given_up", "below_reference", "level given up"),
)
"""Level given up is the share of plans below the reference level."""


class Case(NamedTuple):
    """One combination that is played, by the names of the config.

    Attributes
    ----------
    label : its own name.
    scenario, planner, cascade, settings : what is played.
    """

    label: str
    scenario: str
    planner: str
    cascade: str
    settings: str


class PlayedEpisode(NamedTuple):
    """A case and the rows of its episodes."""

    case: Case
    rows: list[Row]


@final
@dataclass(frozen=True)
class CascadeStudy(SeededStudy):
    """Robots that sense, estimate, track and drive on wheels, on the same seeds for every case.

    No robot receives another's position: what lies between the world and a planner is a cascade
    of sensors, state estimation, detection and tracking, any stage of which may be the truth.
    Robots begin at rest and unseen. Without ``cases`` everything is combined with everything,
    and cascades are compared within the same scenario, planner and settings. With ``cases``
    those are played, and compared with each other.

    ``goals_in_time`` counts episodes in which every robot was at its goal within twice the
    free time as it believed, ``goals_in_time_true`` those in which it then was within
    ``true_tolerance`` of it. ``time_s`` is the time of
    the slowest robot; who never arrives counts with the time limit. ``..._change`` are means over
    seeds of the difference to the case before (``stepwise``) or to the first one, with bootstrap
    intervals of 95 %. Steps of one chain add up to the difference of its ends. What each robot
    perceived is measured by `wideberth_perception.cascade.measures.perception_row`.

    Parameters
    ----------
    scenarios, planners, cascades : by name.
    robot : model of all robots, as large as the cascade's body at least.
    settings : clock and end of the episodes, by name; without history.
    cases : name -> which scenario, planner, cascade and settings; what a case does not name is
        the first of its kind.
    stepwise : compare each case with the one before it, not with the first.
    true_tolerance : m, from its goal, within which a robot has truly arrived. By its own belief
        it arrives within the ``goal_tolerance`` of the settings; what it drifts comes on top.
    show : seeds whose episodes are kept and drawn; the first case's is animated.
    view_distance : m between two robots at the moment whose beliefs are drawn.
    """

    claim: ClassVar[str] = (
        "Robots that perceive each other with their own sensors avoid collisions too: what does "
        "each stage from ranges to wheels cost in clearance, time and coverage?"
    )
    reference: ClassVar[str] = "schoeneberg2025trajectory"
    printed: ClassVar[tuple[str, ...]] = (
        *("episodes", "collisions", "goals_in_time", "goals_in_time_true", "clearance_min_m"),
        *("clearance_change", "time_change", "coverage", "coverage_change", "errors"),
    )

    scenarios: dict[str, Scenario]
    robot: Robot
    planners: dict[str, Controller]
    cascades: dict[str, SensingPipeline]
    settings: dict[str, Settings] = field(default_factory=lambda: {"nominal": FROM_REST()})
    cases: dict[str, dict[str, str]] = field(default_factory=dict)
    stepwise: bool = False
    true_tolerance: float = 0.5
    show: tuple[int, ...] = (0,)
    view_distance: float = 5.0

    def validate(self) -> None:
        """Refuse settings that make no study."""
        positive("view_distance", self.view_distance)
        positive("true_tolerance", self.true_tolerance)
        self.check_shown(self.show)
        for label, chosen in self.cases.items():
            for axis, name in chosen.items():
                if axis not in AXES:
                    raise WideberthError(f"cases.{label}: {unknown('key', axis, AXES)}")
                known = getattr(self, AXES[axis])
                if name not in known:
                    raise WideberthError(f"cases.{label}.{axis}: {unknown('name', name, known)}")
        for cascade, settings in product(self.cascades.values(), self.settings.values()):
            WheeledWorld(cascade, settings)

    def played(self) -> list[Case]:
        """List all cases: those of the config, or all combinations."""
        if self.cases:
            first = {axis: next(iter(getattr(self, name))) for axis, name in AXES.items()}
            return [Case(label, **{**first, **own}) for label, own in self.cases.items()]
        several = [axis for axis, name in AXES.items() if len(getattr(self, name)) > 1]
        found = []
        for names in product(*(getattr(self, name) for name in AXES.values())):
            chosen = dict(zip(AXES, names, strict=True))
            label = "-".join(chosen[axis] for axis in several or ["cascade"])
            found.append(Case(label, **chosen))
        return found

    def axes(self) -> Mapping[Any, Any]:
        """Each case."""
        cases = {case.label: case for case in self.played()}
        return {("case", *AXES): cases, "seed": self.seed_range}

    def inputs(self) -> list[Path]:
        """Return the files that the scenarios read."""
        return [file for scenario in self.scenarios.values() for file in scenario.inputs()]

    def check(self) -> None:
        """Begin an episode of every case."""
        seed = self.first_seed
        for case in self.played():
            with as_user_error(f"case {case.label!r}, seed {seed}: no episode can begin: "):
                self._begun(case, seed)

    def measure(self, task: Task) -> TaskOutcome:
        """Play one episode."""
        case = Case(*(task.settings[column] for column in ("case", *AXES)))
        run = self._begun(case, task.seed)
        run.advance()
        episode, limit = run.episode(), self.settings[case.settings].time_limit
        more = arrivals(episode, limit, self.true_tolerance) | perception_row(episode)
        made = outcome(episode, task, self.tail, more)
        if task.seed in self.show:
            made.files[_file(case, task.seed)] = episode.to_bytes()
        return made

    def summary(self, rows: list[Row]) -> list[Row]:
        """One line per case, compared with the case before it or the first."""
        return [line for chain in self._chains(rows) for line in self._lines(chain)]

    def pictures(self, result: Result) -> Iterator[tuple[str, Any]]:
        """Draw what each case changes, and the views and runs of the shown seeds."""
        chains = [chain for chain in self._chains(result.rows) if len(chain) > 1]
        if chains:
            cases = [[self._step(one.case) for one in chain] for chain in chains]
            drawn = {
                self._place(chain[0].case): dict(
                    list(zip(own, self._lines(chain), strict=True))[1:]
                )
                for own, chain in zip(cases, chains, strict=True)
            }
            row_above = f"the row above, the first row against {cases[0][0]}"
            yield "changes", draw_changes(drawn, row_above if self.stepwise else cases[0][0])
            most = [row for place, lines in drawn.items() for row in largest(place, lines)]
            yield "largest_changes.csv", most
        for i, (case, seed) in enumerate(product(self.played(), self.show)):
            episode = Episode.from_bytes(result.read(_file(case, seed)))
            called = self.figure_name(case.label.replace(" ", "_"), seed, self.show)
            planner = self.planners[case.planner]
            yield from self.episode_pictures(called, episode, planner, self.view_distance, i == 0)

    def quick(self) -> Self:
        """One seed; of what is combined one scenario and two of each; of cases two."""
        if self.cases:
            return reduced(self, cases=2, seeds=1)
        names = list(self.cascades)
        ends = {name: self.cascades[name] for name in (names[0], names[-1])}
        return reduced(replace(self, cascades=ends), scenarios=1, planners=2, seeds=1)

    def _begun(self, case: Case, seed: int) -> Run:
        """Return an episode of a case at its start."""
        settings = self.settings[case.settings]
        cast = self.scenarios[case.scenario].cast(seed)
        controller = self.planners[case.planner]
        robots = [at_rest(one, self.robot, controller) for one in cast.placements]
        world = WheeledWorld(self.cascades[case.cascade], settings)
        return cast.begin(robots, settings, seed, world)

    def _chains(self, rows: list[Row]) -> list[list[PlayedEpisode]]:
        """Return the cases that are compared with one another, with their rows."""
        known = {head["case"]: some for head, some in labelled(rows, "case")}
        chains: dict[tuple[str, ...], list[PlayedEpisode]] = {}
        for case in self.played():
            key = () if self.cases else (case.scenario, case.planner, case.settings)
            if case.label in known:
                chains.setdefault(key, []).append(PlayedEpisode(case, known[case.label]))
        return list(chains.values())

    def _lines(self, chain: Sequence[PlayedEpisode]) -> list[Row]:
        """Return the lines of one chain of cases."""
        lines: list[Row] = []
        for i, (case, rows) in enumerate(chain):
            other = chain[max(i - 1, 0) if self.stepwise else 0].rows
            lines.append(self._head(case) | condensed(rows) | changes(rows, other))
        return lines

    def _head(self, case: Case) -> Row:
        """Return the columns that say which case it is."""
        if self.cases:
            return {"case": case.label}
        several = [axis for axis, name in AXES.items() if len(getattr(self, name)) > 1]
        return {axis: getattr(case, axis) for axis in several or ["cascade"]}

    def _place(self, case: Case) -> str:
        """Say what the cases of a chain have in common."""
        head = self._head(case)
        return ", ".join(head[axis] for axis in head if axis not in ("cascade", "case"))

    def _step(self, case: Case) -> str:
        """Say what sets a case apart within its chain."""
        return case.label if self.cases else case.cascade


def _file(case: Case, seed: int) -> str:
    """Name of the file in which an episode is kept."""
    return f"run-{case.label.replace(' ', '_')}-{seed}.npz"


def at_rest(placement: Placement, robot: Robot, controller: Controller) -> RobotAgent:
    """Return the robot of a place, which begins at rest and means to drive as fast."""
    truth = not isinstance(controller, Reactive)  # which could not use it
    agent = placement.agent(robot, fresh(controller), truth)
    return replace(agent, speed=0.0, reference_speed=agent.reference)


def arrivals(episode: Episode, limit: float, tolerance: float) -> Row:
    """Say when the slowest robot arrived, as it believed and in truth.

    ``goal_error`` is the largest distance of a robot from its goal at the end, m.

    Parameters
    ----------
    episode : of robots in the plane.
    limit : s, that counts for who never arrives.
    tolerance : m, within which a robot is truly at its goal.
    """
    true = [_first_within(episode, log, tolerance) for log in episode.robots]
    free = [free_time(log.paths[0][1], log.speed) for log in episode.robots]
    ratios = [time / own for time, own in zip(true, free, strict=True)]
    believed = [log.reached for log in episode.robots]
    slowest = limit if any(np.isnan(believed)) else max(believed)
    away = [np.linalg.norm(log.positions[-1] - log.paths[-1][1].goal) for log in episode.robots]
    return {
        "time_s": float(slowest),
        "time_ratio_true_worst": float(max(ratios)),
        "goal_error": float(max(away)),
    }


def _first_within(episode: Episode, log: AgentLog, tolerance: float) -> float:
    """Return when a robot was at its goal first, s; inf where it never was."""
    away = np.linalg.norm(log.positions - log.paths[-1][1].goal, axis=1)
    near = np.flatnonzero(away <= tolerance)
    return float(episode.times[near[0]]) if near.size else float("inf")


def condensed(rows: Sequence[Row]) -> Row:
    """Condense the episodes of a case into a line."""
    line = condense(rows)
    line["goals_in_time_true"] = float((column(rows, "time_ratio_true_worst") <= 2.0).mean())
    for name in ("coverage_first", "coverage_last"):
        line[name] = known_mean(column(rows, name))
    means = {name: known_mean(column(rows, name)) for name in PERCEIVED}
    return {name: line[name] for name in COLUMNS} | means


def changes(rows: Sequence[Row], others: Sequence[Row]) -> Row:
    """Return what differs from another case: mean over the seeds of both, interval of 95 %."""
    line: Row = {}
    before = {row["seed"]: row for row in others}
    pairs = [(row, before[row["seed"]]) for row in rows if row["seed"] in before]
    for measure in MEASURES:
        source = measure.source
        gap = column([a for a, _ in pairs], source) - column([b for _, b in pairs], source)
        line |= with_interval(f"{measure.name}_change", gap)
    return line


def largest(place: str, lines: Mapping[str, Row]) -> list[Row]:
    """Return of each measure the case that changes it most, as far as chance allows to say.

    Parameters
    ----------
    place : what the cases have in common.
    lines : case -> its line of the summary.
    """
    found: list[Row] = []
    for measure in MEASURES:
        name = f"{measure.name}_change"
        sure = {
            case: line for case, line in lines.items()
            if line[f"{name}_low"] > 0.0 or line[f"{name}_high"] < 0.0
        }  # fmt: skip
        case = max(sure, key=lambda one: abs(sure[one][name]), default="")
        ends = ("", "_low", "_high")
        numbers = {f"change{end}": sure[case][name + end] if case else None for end in ends}
        found.append({"place": place, "measure": measure.words, "case": case, **numbers})
    return found


def sentence(rows: Sequence[Row]) -> str:
    """Say what matters most, from the rows of `largest` of one place."""
    findings = [
        f"{row['case']} changes {_short(row)} most, by {_signed(row['change'])} "
        f"({_signed(row['change_low'])} to {_signed(row['change_high'])})"
        for row in rows
        if row["case"]
    ]
    silent = [_short(row) for row in rows if not row["case"]]
    if silent:
        findings.append(f"nothing changes {' or '.join(silent)} beyond chance")
    place = f"{rows[0]['place']}: " if rows[0]["place"] else ""
    return f"{place}{'; '.join(findings)}."


def _short(row: Row) -> str:
    return str(row["measure"]).split(" (")[0]


def _signed(value: float) -> str:
    return f"{value:+.2g}".replace("-", "\N{MINUS SIGN}")


MARKERS = "osD^v"
"""One per place; every other one is hollow."""


def draw_changes(drawn: Mapping[str, Mapping[str, Row]], against: str) -> Any:
    """Draw the mean change of every measure by every case, with intervals.

    Parameters
    ----------
    drawn : place -> case -> its line of the summary.
    against : what each case is compared with.
    """
    names = list(dict.fromkeys(case for lines in drawn.values() for case in lines))
    height = 0.9 + 0.27 * len(names) * max(1.0, 0.6 * len(drawn)) + 0.32 * len(drawn)
    figure, panels = subplots(1, len(MEASURES), figsize=(PAGE, height + 0.5), sharey=True)
    for i, (place, lines) in enumerate(drawn.items()):
        shift = 0.5 * (i + 0.5 - 0.5 * len(drawn)) / len(drawn)
        look: dict[str, Any] = {
            **style(i, MARKERS), "linestyle": "", "markersize": 3.5,
            "markerfacecolor": "white" if i % 2 else None, "elinewidth": 0.9, "capsize": 1.5,
            "label": place or "mean change",
        }  # fmt: skip
        for panel, measure in zip(panels, MEASURES, strict=True):
            name = f"{measure.name}_change"
            values, low, high = (
                column(list(lines.values()), name + e) for e in ("", "_low", "_high")
            )
            rows = np.array([names.index(case) for case in lines]) + shift
            reach = np.abs(np.stack([values - low, high - values]))
            panel.errorbar(values, rows, xerr=reach, **look)
    for panel, measure in zip(panels, MEASURES, strict=True):
        panel.axvline(0.0, color="0.3", linewidth=0.8, zorder=1.0)
        panel.set_xlabel(f"change of {measure.words}")
    panels[0].set_yticks(range(len(names)), [name.replace("_", " ") for name in names])
    panels[0].set_ylim(len(names) - 0.5, -0.5)
    counts = [line["episodes"] for lines in drawn.values() for line in lines.values()]
    hit = sum(line["collisions"] for lines in drawn.values() for line in lines.values())
    title = [
        f"Change against {against}: mean over {counts[0]} seeds, intervals of 95 %; "
        f"{hit} collisions in {sum(counts)} episodes."
    ]
    if not few(counts):
        title += [fill(sentence(largest(place, lines)), 118) for place, lines in drawn.items()]
    else:
        title = [f"Change against {against}; {few(counts)}"]
    figure.suptitle("\n".join(title), fontsize=7, x=0.01, ha="left")
    if len(drawn) > 1:
        legend_below(figure, panels[:1], ncols=4)
    return figure

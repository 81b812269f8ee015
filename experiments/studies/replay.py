"""The robot crosses among recorded people, who do not know of it."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar, Self, final

import numpy as np

from ...framework.controller import Controller, fresh
from ...framework.plugins.io import write_bytes
from ...framework.robot import Robot
from ...framework.tracking.recordings import Recording
from ...framework.values.arrays import positive
from ...framework.values.errors import WideberthError
from ...metrics.episode import approach
from ...simulation.engine.agents import RobotAgent
from ...simulation.engine.episode import run_episode
from ...simulation.engine.settings import Settings
from ...simulation.log.episode_log import Episode
from ..engine.base import Experiment, Result, Row, Task, TaskOutcome
from ..engine.closed_loop import (
    EPISODE_CAPTIONS,
    check_settings,
    check_shown,
    column,
    condense,
    figure_name,
    group,
    outcome,
    seeds_of,
    shown_of_fewer,
)
from ..engine.progress import say
from .crowd import CrowdInstant, TrackFile, counted_reasons, draw_situation

if TYPE_CHECKING:
    from matplotlib.figure import Figure

STILL = 0.05
"""m/s; a robot slower than this at a contact was run into."""
SUDDEN = 2.0
"""s; a person whom the robot touches sooner than this after the track begins came suddenly:
one at 1.5 m/s is first seen 3 m away, and a robot at 1 m/s needs 1.4 s to stop."""
CONTACTS = ("drove_into", "run_into", "sudden")
SHOWN = (
    *(
        "deadlocks",
        "goals_in_time",
        "clearance_min_m",
        "clearance_median_m",
        "time_ratio",
        "extra_time_s",
    ),
    *("below_reference", "least_content", "gave_way", "named_forecasts", "coverage"),
)
"""Columns of `condense` in the summary."""


@final
@dataclass(frozen=True)
class Replay(Experiment):
    """Plan through a recording of people or robots, under several settings of the planner.

    Each episode draws a person and a moment: the robot's straight way leads to where that
    person is then, and on (see `wideberth.experiments.studies.crowd.draw_situation`). It sees the
    others come before it starts. They move as recorded, straight between two samples, and
    do not make way: where a person would have stepped aside, the recorded one does not.
    Contacts are therefore counted in three kinds:

    - ``drove_into``: the robot moved, and had seen the person for at least 2 s;
    - ``run_into``: it was slower than 0.05 m/s;
    - ``sudden``: it moved, but the person's track had begun less than 2 s before.

    Faster people who come from behind are among the first kind.

    A recording holds neither walls nor people outside the camera's view, so that the robot may
    drive where a person could not. When the recording ends everybody is gone; ``outlasted``
    says that the episode went on beyond it. Tracks too short to be usable are obstacles
    all the same, but the robot is never aimed at them.

    Parameters
    ----------
    tracks : the recording.
    robot : model of the plant, in the plane.
    planners : settings to compare by name, in the same episodes.
    settings : clock, noise and end of the episodes.
    reach : m before and behind the person aimed at.
    speed : m/s at the start, and the reference of the free time; state the planners'
        ``reference_speed`` alike, or the ratio of times says little.
    seeds : number of episodes per planner.
    first_seed : the seeds are first_seed to first_seed + seeds - 1.
    tail : 1 - content that the plans' levels are compared with, and of the drawn regions.
    show : seeds whose run is drawn for every planner; the first of them is animated for the
        first planner.
    """

    claim: ClassVar[str] = (
        "Forecasts with their uncertainty let a robot cross among recorded people (who do not "
        "make way for it); what does the predictor change?"
    )
    reference: ClassVar[str] = "schoeneberg2025trajectory"
    growing: ClassVar[tuple[str, ...]] = ("seeds",)
    captions: ClassVar[Mapping[str, str]] = {
        "comparison": (
            "Clearance and time of every episode by planner: below the line at 0 the robot "
            "touched a person."
        ),
        **EPISODE_CAPTIONS,
    }
    headline: ClassVar[tuple[str, ...]] = ("drove_into", "clearance_min_m", "time_ratio")

    robot: Robot
    planners: dict[str, Controller]
    tracks: TrackFile = field(default_factory=TrackFile)
    settings: Settings = field(default_factory=Settings)
    reach: float = 6.0
    speed: float = 0.7
    seeds: int = 6
    first_seed: int = 0
    tail: float = 0.05
    show: tuple[int, ...] = (0,)

    def __post_init__(self) -> None:
        check_settings(self, planners=self.planners)
        positive("reach", self.reach)
        positive("speed", self.speed)
        check_shown(self.show, self.first_seed, self.seeds)
        if self.robot.dimension != 2:
            raise WideberthError(
                f"robot moves in {self.robot.dimension} dimensions; recordings are plane"
            )

    def tasks(self) -> list[Task]:
        """One per planner and episode; the recording is read and every episode drawn first.

        Raises
        ------
        WideberthError : a file that cannot be used, or too short for an episode.
        """
        recording = self.tracks.read()
        if self.tracks.is_bag:
            say(recording.report())
        seeds = seeds_of(self)
        for seed in seeds:
            self.situation(recording, seed)
        return [
            Task(f"{planner} {seed}", seed, {"scenario": "replay", "planner": planner})
            for planner in self.planners
            for seed in seeds
        ]

    def inputs(self) -> list[Path]:
        """Return the files of the recording."""
        return self.tracks.files()

    def situation(self, recording: Recording, seed: int) -> CrowdInstant:
        """Draw one episode; the same for all planners."""
        return draw_situation(
            recording,
            np.random.default_rng([seed, 7]),
            reach=self.reach,
            speed=self.speed,
            radii=(self.robot.radius, self.tracks.radius),
            span=(
                self.settings.history + self.settings.channel.delay,
                self.settings.time_limit + self.settings.truth_span,
            ),
        )

    def measure(self, task: Task) -> TaskOutcome:
        """Play one episode."""
        recording = self.tracks.read()
        found = self.situation(recording, task.seed)
        controller = fresh(self.planners[task.settings["planner"]])
        robot = RobotAgent("robot", self.robot, controller, found.path, self.speed, truth=True)
        episode = run_episode([robot], self.settings, seed=task.seed, others=found.people)
        made = outcome(episode, task, self.tail, keep=task.seed in self.show)
        made.rows[0].update(self._labels(recording, found, episode), **contacts(episode, found))
        if task.seed == self.first_seed and task.settings["planner"] == next(iter(self.planners)):
            made.files["tracks.txt"] = f"{recording.report()}\n{recording.noise.text}\n".encode()
        return made

    def _labels(self, recording: Recording, found: CrowdInstant, episode: Episode) -> Row:
        """Columns about the recording and the stretch of it that was played."""
        there = [np.isfinite(log.positions).any() for log in episode.agents[1:]]
        usable = len(recording.usable)
        return {
            "recording": self.tracks.name,
            "dt": recording.dt,
            "start": found.start,
            "aimed": found.aimed,
            "people": int(np.sum(there)),
            "outlasted": episode.duration > found.end + 1e-9,
            "tracks_usable": usable,
            "tracks_unusable": len(recording.ids) - usable,
            "why_unusable": counted_reasons(recording),
            "noise": recording.noise.text,
        }

    def summary(self, rows: list[Row]) -> list[Row]:
        """One line per planner, with the kinds of contact and what the recording held."""
        lines = []
        for (planner,), some in group(rows, "planner").items():
            line = condense(some)
            lines.append({
                "planner": planner,
                **{key: line[key] for key in ("episodes", "collisions")},
                **{kind: int(column(some, kind).sum()) for kind in CONTACTS},
                **{key: value for key, value in line.items() if key in SHOWN},
                "people": float(np.median(column(some, "people"))),
                **{key: some[0][key] for key in ("tracks_usable", "tracks_unusable")},
                **{key: some[0][key] for key in ("why_unusable", "noise")},
            })  # fmt: skip
        return lines

    def figures(self, result: Result, folder: Path) -> list[Path]:
        """Compare the planners, draw one episode of each, and animate the first's."""
        from ...framework.mpc.planner.planner import planner_behind
        from ..drawing.animation import animate
        from ..drawing.episodes import draw_run
        from ..drawing.plotting import paper_style, save

        with paper_style():
            files = save(compare(result.rows), folder, "comparison")
        for i, (name, controller) in enumerate(self.planners.items()):
            for seed in self.show:
                episode = Episode.from_bytes(result.read(f"replay-{name}-{seed}.npz"))
                called = figure_name(name, seed, self.show)
                with paper_style():
                    files += save(draw_run(episode), folder, f"run_{called}")
                if i == 0 and seed == self.show[0]:
                    files.append(folder / f"animation_{called}.gif")
                    film = animate(episode, tail=self.tail, planner=planner_behind(controller))
                    write_bytes(files[-1], film)
        return files

    def quick(self) -> Self:
        """One episode of each planner."""
        return replace(self, seeds=1, show=shown_of_fewer(self.show, self.first_seed, 1))


def contacts(episode: Episode, found: CrowdInstant) -> Row:
    """How many people the robot touched, in the three kinds of `Replay`."""
    robot = episode.agents[0]
    number: Row = dict.fromkeys(CONTACTS, 0)
    for person, log in zip(found.people, episode.agents[1:], strict=True):
        gaps = approach(robot.positions, log.positions) - robot.radius - log.radius
        touched = np.flatnonzero(gaps < 0.0)
        if not touched.size:
            continue
        first = int(touched[0])
        seen = person.times[np.isfinite(person.positions).all(axis=1)]
        if robot.speeds[first] < STILL:
            number["run_into"] += 1
        elif episode.times[first] - seen[0] < SUDDEN:
            number["sudden"] += 1
        else:
            number["drove_into"] += 1
    return number


def compare(rows: list[Row]) -> "Figure":
    """Draw clearance and time of every episode, a column per planner, with the medians.

    Episodes that never reached the goal stand as triangles at the upper edge.
    """
    from matplotlib.figure import Figure

    from ..drawing.plotting import PAGE
    from ..drawing.strips import strip, strip_legend

    groups = group(rows, "planner")
    figure = Figure(figsize=(PAGE, 2.7 if len(groups) <= 6 else 3.5))
    titles = {
        "clearance": "least clearance (m)",
        "time_ratio_worst": "time over free time",
    }
    for panel, (name, title) in zip(figure.subplots(1, 2), titles.items(), strict=True):
        strip(panel, rows, name)
        panel.axhline(0.0 if name == "clearance" else 1.0, color="0.5", linewidth=0.6)
        panel.set_ylabel(title)
    strip_legend(figure, "bodies touch, free time")
    return figure

"""The robot crosses among recorded people, who do not know of it."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar, Self, final

import numpy as np

from ...framework import Controller, Robot, WideberthError
from ...framework.controller import fresh
from ...framework.values.arrays import positive
from ...metrics.episode import approach
from ...predictors.data.recordings import Recording, doubts
from ...simulation.engine.agents import RobotAgent
from ...simulation.engine.episode import run_episode
from ...simulation.engine.settings import Settings
from ...simulation.log.episode_log import Episode
from ..engine.closed_loop import column, condense, outcome, pick
from ..engine.progress import say
from .comparison_figures import draw_front
from .crowd import SHIPPED, CrowdInstant, TrackFile, counted_reasons, draw_situation
from .episodes import SeededStudy
from .grid import Axes, Pictures, Result, Row, Task, TaskOutcome, labelled, reduced
from .prediction_data import pace

STILL = 0.05
"""m/s; a robot slower than this at a contact was run into."""
SUDDEN = 2.0
"""s; a person whom the robot touches sooner than this after the track begins came suddenly:
one at 1.5 m/s is first seen 3 m away, and a robot at 1 m/s needs 1.4 s to stop."""
CONTACTS = ("drove_into", "run_into", "sudden")
SHOWN = (
    *("deadlocks", "goals_in_time", "clearance_min_m", "clearance_median_m", "time_ratio"),
    "extra_time_s",
    *("below_reference", "least_content", "gave_way", "named_forecasts", "coverage"),
)
"""Columns of `condense` in the summary."""


@final
@dataclass(frozen=True)
class Replay(SeededStudy):
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
    drive where a person could not. When the recording ends all people are gone; ``outlasted``
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
    show : seeds whose run is drawn for every planner; the first of them is animated for the
        first planner.
    """

    claim: ClassVar[str] = (
        "Forecasts with their uncertainty let a robot cross among recorded people (who do not "
        "make way for it); what does the predictor change?"
    )
    reference: ClassVar[str] = "schoeneberg2025trajectory"
    printed: ClassVar[tuple[str, ...]] = (
        *("drove_into", "run_into", "sudden", "goals_in_time"),
        *("clearance_min_m", "time_ratio", "below_reference", "coverage"),
    )

    robot: Robot
    planners: dict[str, Controller]
    tracks: TrackFile = field(default_factory=TrackFile)
    settings: Settings = field(default_factory=Settings)
    reach: float = 6.0
    speed: float = 0.7
    show: tuple[int, ...] = (0,)

    def validate(self) -> None:
        """Refuse settings that make no study."""
        positive("reach", self.reach)
        positive("speed", self.speed)
        self.check_shown(self.show)
        if self.robot.dimension != 2:
            raise WideberthError(
                f"robot moves in {self.robot.dimension} dimensions; recordings are plane"
            )

    def axes(self) -> Axes:
        """Each planner; the recording is read and every episode drawn first.

        Raises
        ------
        WideberthError : a file that cannot be used, or too short for an episode.
        """
        recording = self.tracks.read()
        if self.tracks.is_bag:
            say(recording.report())
        seeds = self.seed_range
        for seed in seeds:
            self.situation(recording, seed)
        return {"scenario": ["replay"], "planner": self.planners, "seed": seeds}

    def check(self) -> None:
        """Say how a file of the user's own is taken; it does not hold the time between rows."""
        if not self.tracks.path.startswith(SHIPPED):
            known = f"{self.tracks.path}: taken as {self.tracks.dt:g} s between rows (tracks.dt)"
            recording = self.tracks.read()
            say("; ".join([known, *(doubts(recording.speed) or [pace(recording)])]))

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
                self.settings.history + self.settings.channel.largest_age,
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
        more = self._labels(recording, found, episode) | contacts(episode, found)
        made = outcome(episode, task, self.tail, more, keep=task.seed in self.show)
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
        for labels, some in labelled(rows, "planner"):
            line = condense(some)
            lines.append({
                **labels,
                **pick(line, ("episodes", "collisions")),
                **{kind: int(column(some, kind).sum()) for kind in CONTACTS},
                **pick(line, SHOWN),
                "people": float(np.median(column(some, "people"))),
                **pick(some[0], ("tracks_usable", "tracks_unusable", "why_unusable", "noise")),
            })  # fmt: skip
        return lines

    def pictures(self, result: Result) -> Pictures:
        """Compare the planners, draw one episode of each, and animate the first's."""
        yield "comparison", compare(result.rows)
        for i, (name, controller) in enumerate(self.planners.items()):
            for seed in self.show:
                episode = Episode.from_bytes(result.read(f"replay-{name}-{seed}.npz"))
                called = self.figure_name(name, seed, self.show)
                film = i == 0 and seed == self.show[0]
                yield from self.episode_pictures(called, episode, controller, film=film)

    def quick(self) -> Self:
        """One episode of each planner."""
        return reduced(self, seeds=1)


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


def compare(rows: list[Row]) -> Any:
    """Draw clearance against time of each planner; who never arrived is named below."""
    place = {"scenario": "replay", "robot": "", "settings": ""}
    shown = [{**row, **place, "controller": row["planner"]} for row in rows]
    names = list(dict.fromkeys(str(row["planner"]) for row in rows))
    return draw_front(shown, names, "extra_time_worst", "time beyond the free time (s)")

"""Forecasts from the first sight of a person on, of a predictor that begins without memory."""

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar, Self, final

import numpy as np

from ...framework import Detection, Observation, Predictor, Scene
from ...framework.tracking.perception import FORGET, Perception
from ...framework.values.arrays import Array, BoolArray, positive, whole
from ...metrics.scoring import reached_tail, region_area
from ...metrics.statistics import known_mean
from ...predictors.data.recordings import Recording
from ...simulation.engine.agents import ReplayAgent
from ..drawing.plotting import PAGE, legend_below, style, subplots, title
from ..engine.closed_loop import column, group
from .fitting import AS_GIVEN, fitted
from .grid import Axes, GridStudy, Pictures, Result, Row, Task, TaskOutcome, labelled, reduced
from .prediction_data import PredictionData, SceneFiles

SEEN: dict[str, tuple[float, float]] = {
    "once": (1, 1), "twice": (2, 2), "three to seven": (3, 7), "eight or more": (8, np.inf),
}  # fmt: skip
"""Class of people -> how often they have been seen, at least and at most."""
MOTIONS = "standing", "starting", "stopping", "turning", "walking on", "other"
"""Classes of motion from a forecast on, to the last step of a person; see `motions`."""
STANDS, WALKS = 0.2, 0.5
"""m/s; who is slower than the first stands, who is faster than the second walks."""
SHARP = 45.0
"""degrees; a change of direction by more is a turn."""
PACE = 0.8
"""s over which a velocity is measured."""
EVERY = "all"
"""Name of all classes together."""
TAIL = 0.05
"""1 - content of the regions."""
SHOWN = ("first", "middle", "last")
SAMPLES = 80
"""Samples of a track that are kept, as a planner keeps them."""


@final
@dataclass(frozen=True, eq=False)
class Sights:
    """How the forecasts of one moment came true.

    Attributes
    ----------
    seen : (O,), how often each person has been seen, this moment included.
    motion : (O,), index in `MOTIONS`.
    known, missed : (O, N), whether the person was still there at a step, and outside the region.
    radius : (O, N), m, of the disc as large as the region.
    """

    seen: Array
    motion: Array
    known: BoolArray
    missed: BoolArray
    radius: Array


@final
@dataclass(frozen=True)
class FirstSight(GridStudy):
    """Forecasts as a robot makes them among recorded people, judged by how often it saw them.

    A recording is cut into episodes, in each of which everything is new: no person has been seen,
    the measurement noise is not stated, and what adapts begins as it was fitted. All people who
    are there are seen every ``dt`` seconds, as by a planner of that period, and each sight is
    followed by a forecast of all steps up to ``ahead``. A person counts at the steps up to which
    the recording has them without a gap. So those who have been seen once count as those who have
    been seen for long, as they do for a planner.

    ``missed`` is the share of steps at which the true position lay outside of the region (of
    several modes that of highest density), ``plans_missed`` the share of moments at which any
    person was outside at any step. The means over scenes weigh every scene alike. The interval of
    ``missed`` is from a bootstrap that draws whole episodes of each scene.

    Predictors that can be fitted learn from the recordings of all other scenes, unless
    ``as_given`` names them.

    Parameters
    ----------
    predictors : by name.
    data : the recordings.
    dt : s, of each of the robots.
    noise : m, standard deviations of what is added to every sight, each for itself.
    ahead : s, time of the last step.
    rows : of a recording in an episode.
    starts : episodes of each recording, evenly spaced over it; fewer where it is too short.
    as_given : predictors that are not fitted.
    only : scenes to score; all if empty.
    seeds : of the noise, how many.
    first_seed : the seeds are first_seed to first_seed + seeds - 1.
    """

    claim: ClassVar[str] = (
        "A forecast covers what it says from the first second on: of people who have just "
        "appeared as of those who have been seen for long?"
    )
    reference: ClassVar[str] = "gibbs2021adaptive"

    predictors: dict[str, Predictor]
    data: PredictionData = field(default_factory=PredictionData)
    dt: tuple[float, ...] = (0.25, 0.5)
    noise: tuple[float, ...] = (0.0, 0.02, 0.05)
    ahead: float = 5.0
    rows: int = 100
    starts: int = 4
    as_given: tuple[str, ...] = ()
    only: tuple[str, ...] = ()
    seeds: int = 3
    first_seed: int = 0

    def __post_init__(self) -> None:
        positive("ahead", self.ahead)
        for name in ("rows", "starts", "seeds"):
            whole(name, getattr(self, name))
        whole("first_seed", self.first_seed, least=0)
        for name, least in (("dt", False), ("noise", True)):
            for value in getattr(self, name):
                positive(name, value, zero=least)

    def scored(self) -> dict[str, SceneFiles]:
        """Return the scenes to score."""
        found = self.data.found(self.only)
        chosen = {name: one for name, one in found.items() if one.role == "primary"}
        return {name: one for name, one in chosen.items() if not self.only or name in self.only}

    def axes(self) -> Axes:
        """Each predictor in each scene, seen at each step and with each noise."""
        return {
            "predictor": self.predictors,
            "scene": self.scored(),
            "dt": self.dt,
            "noise": self.noise,
            "seed": range(self.first_seed, self.first_seed + self.seeds),
        }

    def inputs(self) -> list[Path]:
        """Return the recordings."""
        scenes = self.data.found(self.only).values()
        return [path for scene in scenes for path in self.data.paths(scene)]

    def measure(self, task: Task) -> TaskOutcome:
        """Fit the predictor to the other scenes, and look at the people of this one."""
        name, scene = str(task.settings["predictor"]), str(task.settings["scene"])
        predictor, text = self.predictors[name], AS_GIVEN
        if name not in self.as_given:
            predictor, text = fitted(predictor, self.data.training(scene, self.only))
        dt, noise = float(task.settings["dt"]), float(task.settings["noise"])
        rng = np.random.default_rng(task.seed)
        head: Row = {
            "predictor": name, "scene": scene, "dt": dt, "noise": noise, "seed": task.seed,
            "fitted": text,
        }  # fmt: skip
        rows: list[Row] = []
        recordings = self.data.read(self.scored()[scene])
        begins = [(one, begin) for one in recordings for begin in self._begins(one)]
        for number, (recording, begin) in enumerate(begins):
            sights = list(self._episode(predictor, recording, begin, dt, noise, rng))
            rows += [head | {"episode": number} | row for row in counted(sights)]
        return TaskOutcome(rows)

    def _begins(self, recording: Recording) -> list[int]:
        """Rows at which episodes begin: as many as there is room for, with people in each."""
        length = len(recording.times)
        there: BoolArray = np.asarray(np.isfinite(recording.positions).all(axis=2))
        whole_ones = range(0, max(length - self.rows, 0) + 1, self.rows)
        seen = [row for row in whole_ones if there[:, row : row + self.rows].any()]
        chosen = np.linspace(0, len(seen) - 1, min(self.starts, len(seen))).round()
        return [seen[int(place)] for place in chosen]

    def _episode(
        self, predictor: Predictor, recording: Recording, begin: int, dt: float, noise: float,
        rng: np.random.Generator,
    ) -> Iterator[Sights]:  # fmt: skip
        """Yield how the forecasts of every moment of an episode came true."""
        people = [
            ReplayAgent(ident, recording.times, track, self.data.radius)
            for ident, track in zip(recording.ids, recording.positions, strict=True)
        ]
        start, end = recording.times[[begin, min(begin + self.rows, len(recording.times)) - 1]]
        ticks = np.arange(0.0, end - start + 1e-9, dt)
        grid = dt * np.arange(1, round(self.ahead / dt) + 1, dtype=np.float64)
        state = Perception.initial(predictor, 2, dt, SAMPLES, dt, FORGET)
        places = np.array([one.at(start + ticks) for one in people])
        measured = places + noise * rng.standard_normal(places.shape)
        for tick, stamp in enumerate(ticks.tolist()):
            here = np.flatnonzero(np.isfinite(places[:, tick]).all(axis=1))
            detections = tuple(
                Detection(people[i].name, measured[i, tick], None, self.data.radius) for i in here
            )
            state = state.take(Observation(stamp, np.zeros(3), detections))
            tracks = state.history.tracks()
            state = state.learnt(tracks, Scene())
            forecast = state.forecast(tracks, stamp, grid, Scene())
            if tracks is None or forecast is None or not len(here):
                continue
            names = [people[i].name for i in here]
            rows = [tracks.ids.index(name) for name in names]
            now = start + stamp
            truth = np.array([people[i].at(now + grid) for i in here])
            seen = np.isfinite(tracks.positions[rows]).all(axis=2).sum(axis=1)
            parts = forecast.mean[rows], forecast.covariance[rows], forecast.weight[rows]
            motion = np.array([_motion(people[i], now, grid) for i in here])
            yield _sights(seen, motion, *parts, truth)

    def summary(self, rows: list[Row]) -> list[Row]:
        """Means over the scenes by predictor and class of people, then every scene."""
        lines: list[Row] = []
        scenes = len(group(rows, "scene"))
        if scenes > 1:
            for (name, seen, motion), some in group(rows, "predictor", "seen", "motion").items():
                head: Row = {"predictor": name, "scene": f"mean of {scenes}"}
                lines.append(head | {"seen": seen, "motion": motion} | _line(some, "scene"))
        for labels, some in labelled(rows, "predictor", "scene", "seen", "motion"):
            lines.append({**labels, **_line(some, "scene")})
        for labels, some in labelled(rows, "predictor", "dt", "noise"):
            every = [row for row in some if (row["seen"], row["motion"]) == (EVERY, EVERY)]
            labels |= {"seen": EVERY, "motion": EVERY}
            lines.append({**labels, **_line(every, "scene")})
        return lines

    def pictures(self, result: Result) -> Pictures:
        """Draw what was missed by how often people have been seen."""
        yield "first_sight", draw(result.rows)

    def quick(self) -> Self:
        """Look at an episode of one scene with one predictor."""
        return reduced(self, predictors=1, dt=-1, noise=1, rows=25, starts=1, seeds=1)


def _motion(person: ReplayAgent, now: float, grid: Array) -> int:
    """Return the class of `motions` of a person at a time, s, who is known at times ahead."""
    path = person.at(now + np.concatenate([[-PACE, 0.0, PACE], grid]))
    present = np.logical_and.accumulate(np.isfinite(path[3:]).all(axis=1))
    if not present.any():
        return MOTIONS.index("other")
    last = now + grid[present][-1]
    before, after = path[1] - path[0], path[2] - path[1]
    first = before if np.isfinite(before).all() else after
    final = np.subtract(*person.at(np.array([last, max(last - PACE, now)])))
    return int(motions(first / PACE, final / min(PACE, last - now)))


def motions(first: Array, final: Array) -> Array:
    """Classify motions by the velocities at their beginning and end, (..., 2), m/s.

    Standing and walking on are what they are at both ends; who walks and changes direction by
    more than `SHARP` degrees turns. "other" are those who stroll, or leave at once.

    Returns
    -------
    kind : (...), index in `MOTIONS`.
    """
    slow, fast = np.linalg.norm(first, axis=-1), np.linalg.norm(final, axis=-1)
    walks, stands = (slow > WALKS, fast > WALKS), (slow < STANDS, fast < STANDS)
    along = (first * final).sum(axis=-1)
    both = walks[0] & walks[1]
    turns = both & (along < np.cos(np.radians(SHARP)) * slow * fast)
    each = [stands[0] & stands[1], stands[0] & walks[1], walks[0] & stands[1], turns, both]
    return np.asarray(np.select(each, range(len(each)), len(each)))


def _sights(
    seen: Array, motion: Array, mean: Array, covariance: Array, weight: Array, truth: Array
) -> Sights:
    """Judge forecasts by what was true, (O, N, D), m; NaN where a person was not there."""
    known = np.logical_and.accumulate(np.isfinite(truth).all(axis=2), axis=1)
    truth = np.where(known[..., None], truth, np.nan)
    tails = reached_tail(mean, covariance, weight, truth)
    area = region_area(mean, covariance, weight, TAIL)
    missed = np.asarray(known & (tails < TAIL), dtype=np.bool_)
    return Sights(seen, motion, known, missed, np.sqrt(area / np.pi))


def counted(found: list[Sights]) -> list[Row]:
    """Count what was missed: a line for all people, per class of `SEEN` and of `MOTIONS`.

    ``steps`` and ``steps_missed`` count persons and steps; ``first``, ``middle`` and ``last`` name
    the steps of one region; ``plans`` are moments at which any step of any person is known.
    """
    if not found:
        return []
    plans = sum(bool(one.known.any()) for one in found)
    broken = sum(bool(one.missed.any()) for one in found)
    seen, motion, known, missed, radius = (
        np.concatenate([getattr(one, name) for one in found])
        for name in ("seen", "motion", "known", "missed", "radius")
    )
    classes = {(EVERY, EVERY): np.ones(len(seen), dtype=np.bool_)}
    for name, (least, most) in SEEN.items():
        classes[name, EVERY] = (seen >= least) & (seen <= most)
    classes |= {(EVERY, name): motion == number for number, name in enumerate(MOTIONS)}
    rows: list[Row] = []
    for (often, kind), own in classes.items():
        row: Row = {
            "seen": often, "motion": kind, "people": int(own.sum()),
            "steps": int(known[own].sum()), "steps_missed": int(missed[own].sum()),
            "plans": plans, "plans_missed": broken,
        }  # fmt: skip
        for at, step in zip(SHOWN, (0, (known.shape[1] - 1) // 2, -1), strict=True):
            row[f"known_{at}"] = int(known[own, step].sum())
            row[f"missed_{at}"] = int(missed[own, step].sum())
            row[f"radius_{at}_m"] = known_mean(radius[own, step])
        rows.append(row)
    return rows


def _line(rows: list[Row], alike: str) -> Row:
    """Condense lines of the table; each value of the column ``alike`` counts the same."""
    parts = [_shares(some) for some in group(rows, alike).values()]
    line: Row = {name: known_mean([part[name] for part in parts]) for name in parts[0]}
    low, high = _interval(list(group(rows, alike).values()))
    return line | {"missed_low": low, "missed_high": high}


def _interval(scenes: list[list[Row]]) -> tuple[float, float]:
    """Interval of 95 % of the mean over scenes of ``missed``, drawing whole episodes of each."""
    rng, shares = np.random.default_rng(0), []
    for rows in scenes:
        episodes = np.unique(column(rows, "episode"), return_inverse=True)[1]
        parts = np.bincount(episodes, column(rows, "steps_missed"))
        wholes = np.bincount(episodes, column(rows, "steps"))
        drawn = rng.integers(len(parts), size=(1000, len(parts)))
        with np.errstate(invalid="ignore"):
            shares.append(parts[drawn].sum(axis=1) / wholes[drawn].sum(axis=1))
    means = np.array([known_mean(draw) for draw in np.transpose(shares)])
    means = means[np.isfinite(means)]
    return tuple(np.quantile(means, (0.025, 0.975)).tolist()) if len(means) else (np.nan, np.nan)


def _shares(rows: list[Row]) -> dict[str, float]:
    """Shares that were missed of one scene, and its mean radii."""
    people = column(rows, "people")
    found = {
        "missed": _share(rows, "steps_missed", "steps"),
        "plans_missed": _share(rows, "plans_missed", "plans"),
        **{f"missed_{at}": _share(rows, f"missed_{at}", f"known_{at}") for at in SHOWN},
    }
    for at in SHOWN:
        radius = column(rows, f"radius_{at}_m")
        known = np.isfinite(radius) & (people > 0)
        found[f"radius_{at}_m"] = (
            float(np.average(radius[known], weights=people[known])) if known.any() else np.nan
        )
    return found


def _share(rows: list[Row], part: str, of: str) -> float:
    number = column(rows, of).sum()
    return float(column(rows, part).sum() / number) if number else np.nan


MARKS = "osD^vP*X"


def draw(rows: list[Row]) -> Any:
    """Draw shares that were missed by class of people: a line per predictor, a panel per noise."""
    noises = list(group(rows, "noise"))
    rows = [row for row in rows if row["motion"] == EVERY]
    figure, panels = subplots(1, len(noises), figsize=(PAGE, 2.6), squeeze=False, sharey=True)
    for panel, (noise,) in zip(panels[0], noises, strict=True):
        some = [row for row in rows if row["noise"] == noise]
        for index, ((name,), own) in enumerate(group(some, "predictor").items()):
            shares = [
                _line([row for row in own if row["seen"] == seen], "scene")["missed"]
                for seen in SEEN
            ]
            panel.plot(range(len(SEEN)), shares, label=title(str(name)), **style(index, MARKS))
        panel.axhline(TAIL, color="black", linestyle=":", linewidth=0.9)
        panel.set_xticks(range(len(SEEN)), [seen.replace(" ", "\n", 1) for seen in SEEN])
        panel.set_title(f"{100 * float(noise):g} cm of noise added")
        panel.set_xlabel("seen so far")
    panels[0, 0].set_ylabel("missed")
    panels[0, 0].set_ylim(bottom=0.0)
    legend_below(figure, panels[0, :1], ncols=4)
    return figure

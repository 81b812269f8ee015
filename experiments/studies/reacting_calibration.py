"""What is left of a promise that was calibrated beside another planner, where people react."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar, Self, final

import numpy as np

from ...framework import Controller, Robot, Tracks, WideberthError
from ...framework.controller import driving
from ...framework.numerics.chi_square import content_bound
from ...framework.values.arrays import Array, positive, whole
from ...metrics.statistics import known_mean
from ...predictors.conformal import Conformal
from ...predictors.core.calibration import replayed, squared_distances
from ...predictors.data.windows import windows_of
from ...simulation.engine.settings import Settings
from ...simulation.measures.summary import summarise
from ...simulation.scenarios.base import Scenario
from ..drawing.plotting import PAGE, few, legend_below, subplots, title
from ..drawing.shaded_tables import shaded
from ..engine.closed_loop import check_starts, column, group, inputs_of, play
from .grid import Axes, GridStudy, Pictures, Result, Row, Task, TaskOutcome, labelled, reduced
from .guarantees import MISSES, missed_share, seen_tracks
from .variants import planner_of

STAGE = 1000
"""Seeds between two collections of one task: no episode is both learnt from and counted."""
SEED = 100_000
"""Seeds between two tasks."""
PLANNER = "planner"
"""Name of the planner among the drivers."""
COUNTED = ("steps", "persons", "plans")


@final
@dataclass(frozen=True)
class ReactingCalibration(GridStudy):
    """Conformal calibration among people who answer what the robot does.

    A calibration is exact for futures that are exchangeable with those it was fitted to. People
    who make way for a robot walk otherwise beside another one, and beside the same one when its
    regions change. Two parts:

    - table: people are watched beside each driver A, the predictor is fitted to what was seen, and
      counted beside each driver B. Where B is the planner it drives with the predictor that was
      fitted beside A.
    - iteration: fitted beside the first driver, then again and again: the planner drives with the
      predictor of iteration j among people whom it was not fitted to, its promise is counted, and
      the same episodes give the quantile from which the next radius follows (`next_radius`).

    Counted are windows of people who were seen for as long as calibration asks: the truth outside
    of the region at a step (steps), at any step (persons), and of anyone at any step from one
    moment on (plans). The radius is that of a disc as large as the region at the last step.

    Parameters
    ----------
    scenarios : people by name.
    planner : whose predictor is exchanged.
    drivers : others, beside whom people are watched; the first one begins the iteration.
    robot : that all of them drive.
    predictors : to be calibrated, by name.
    gains : kappa of `next_radius`, one iteration each.
    iterations : of each.
    collected : episodes of each collection.
    settings : of the episodes.
    seeds : repetitions of all.
    first_seed : the seeds are first_seed to first_seed + seeds - 1.
    """

    claim: ClassVar[str] = (
        "How much of a calibrated promise is left when people react to another planner than that "
        "of the calibration, and does calibrating again bring it back?"
    )
    reference: ClassVar[str] = "mirzaeedodangeh2026safe,lindemann2023safe"
    printed: ClassVar[tuple[str, ...]] = (
        *("promise", "missed", "missed_low", "missed_high"),
        *("radius_m", "arrived", "collisions", "episodes"),
    )

    scenarios: dict[str, Scenario]
    planner: Controller
    drivers: dict[str, Controller]
    robot: Robot
    predictors: dict[str, Conformal]
    gains: tuple[float, ...] = (0.0, 0.5)
    iterations: int = 6
    collected: int = 20
    settings: Settings = field(default_factory=Settings)
    seeds: int = 1
    first_seed: int = 0

    def __post_init__(self) -> None:
        planner_of(self.planner)
        for name in ("iterations", "collected", "seeds"):
            whole(name, getattr(self, name))
        whole("first_seed", self.first_seed, least=0)
        for gain in self.gains:
            positive("gains", gain, zero=True, most=0.999)
        if not self.drivers or PLANNER in self.drivers:
            raise WideberthError(
                f"drivers is {list(self.drivers)}; wanted at least one, and none named {PLANNER!r}"
            )

    def axes(self) -> Axes:
        """All people and predictors, each with the table and the iterations."""
        parts: dict[str, tuple[str, float | None]] = {"table": ("table", None)}
        parts |= {f"gain {gain:g}": ("iteration", gain) for gain in self.gains}
        return {
            "people": self.scenarios,
            "calibration": self.predictors,
            ("part", "gain"): parts,
            "seed": range(self.first_seed, self.first_seed + self.seeds),
        }

    def inputs(self) -> Sequence[Any]:
        """Return the files that scenarios read."""
        return inputs_of(self.scenarios.values())

    def check(self) -> None:
        """Begin an episode of each driver in each scenario."""
        every = {**self.drivers, PLANNER: self.planner}
        made = {name: driving(one, self.robot) for name, one in every.items()}
        check_starts(self.scenarios, self.robot, made, 0)

    def measure(self, task: Task) -> TaskOutcome:
        """Collect, calibrate and count."""
        given = task.settings
        crowd = _Crowd(self, self.scenarios[given["people"]], SEED * task.seed)
        predictor = self.predictors[given["calibration"]]
        head = {"people": given["people"], "calibration": given["calibration"], "seed": task.seed}
        if given["part"] == "table":
            found = self._table(crowd, predictor)
        else:
            found = self._iterated(crowd, predictor, given["gain"])
        return TaskOutcome([head | {"part": given["part"]} | row for row in found])

    def _table(self, crowd: "_Crowd", predictor: Conformal) -> Iterable[Row]:
        """Count beside each driver what was calibrated beside each."""
        names = [*self.drivers, PLANNER]
        counted = {name: crowd.watched(name, predictor, 1) for name in self.drivers}
        for beside in names:
            learnt = predictor.fit(crowd.watched(beside, predictor, 0).tracks)
            for driver in names:
                seen = counted.get(driver) or crowd.watched(driver, learnt, 1)
                for row in seen.judged(learnt):
                    yield {
                        "calibrated": beside,
                        "driven": driver,
                        "gain": 0.0,
                        "iteration": 0,
                    } | row

    def _iterated(self, crowd: "_Crowd", predictor: Conformal, gain: float) -> Iterable[Row]:
        """Drive, count, and calibrate again."""
        first = next(iter(self.drivers))
        learnt = predictor.fit(crowd.watched(first, predictor, 0).tracks)
        for iteration in range(self.iterations):
            seen = crowd.watched(PLANNER, learnt, 1 + iteration)
            for row in seen.judged(learnt):
                beside = PLANNER if iteration else first
                yield {
                    "calibrated": beside, "driven": PLANNER, "gain": gain, "iteration": iteration
                } | row  # fmt: skip
            learnt = corrected(learnt, predictor.fit(seen.tracks), gain)

    def summary(self, rows: list[Row]) -> list[Row]:
        """One line per collection that was counted."""
        keys = "part", "people", "calibration", "calibrated", "driven", "gain", "iteration"
        return [{**labels, **self._line(labels, some)} for labels, some in labelled(rows, *keys)]

    def _line(self, labels: Row, rows: list[Row]) -> Row:
        predictor = self.predictors[labels["calibration"]]
        line: Row = {"promise": predictor.tail}
        event = MISSES[predictor.coverage.event]
        for name, counted in (("missed", event), *((f"{name}_missed", name) for name in COUNTED)):
            line |= missed_share(name, rows, counted, "episode")
        return line | {
            "radius_m": known_mean(column(rows, "radius")),
            "arrived": float(np.mean(column(rows, "arrived"))),
            "collisions": int(column(rows, "collision").sum()),
            "episodes": len(rows),
        }

    def pictures(self, result: Result) -> Pictures:
        """Draw the iterations, and the table."""
        lines = group(self.summary(result.rows), "part")
        yield "iteration", draw_iterations(lines[("iteration",)])
        yield "table", draw_table(lines[("table",)])

    def quick(self) -> Self:
        """Keep the first people, one predictor and one gain, and few episodes."""
        return reduced(
            self, scenarios=1, predictors=1, gains=1, drivers=1, iterations=2, collected=2, seeds=1
        )


@final
@dataclass(frozen=True)
class _Seen:
    """Episodes of one collection: who was seen, and how they ended."""

    tracks: list[Tracks]
    ends: list[Row]

    def judged(self, predictor: Conformal) -> Iterable[Row]:
        """Yield a row for each episode: what was counted, and what of it was missed."""
        for tracks, end in zip(self.tracks, self.ends, strict=True):
            yield {**counts(predictor, tracks), **end}


@final
@dataclass(frozen=True)
class _Crowd:
    """People of one scenario, watched beside the drivers of a study from a first seed on."""

    study: ReactingCalibration
    scenario: Scenario
    first: int

    def watched(self, driver: str, predictor: Conformal, stage: int) -> _Seen:
        """Play the episodes of a stage; the planner drives with the predictor."""
        study = self.study
        planner = planner_of(study.planner)
        controller = study.drivers.get(driver) or replace(planner, predictor=predictor)
        controller = driving(controller, study.robot)
        seeds = range(self.first + STAGE * stage, self.first + STAGE * stage + study.collected)
        found = _Seen([], [])
        for seed in seeds:
            episode = play(self.scenario, study.robot, controller, study.settings, seed)
            summed = summarise(episode)
            end = {"arrived": summed["ended"] == "goals", "collision": summed["collision"]}
            noise = study.settings.channel.noise
            found.tracks.append(seen_tracks(episode, planner.track_dt, noise))
            found.ends.append({**end, "episode": seed})
        return found


def counts(predictor: Conformal, tracks: Tracks) -> Row:
    """Count steps, persons and plans of one scene, and those that a predictor's regions missed.

    The radius is that of a disc as large as the region of the last step, over all windows, m.
    """
    (windows,) = windows_of([tracks], predictor.observed, predictor.steps, wanted=0, who="counts")
    if not len(windows):
        empty: Row = {f"{name}{end}": 0.0 for name in COUNTED for end in ("", "_missed")}
        return empty | {"radius": None}
    mean, covariance, weight = replayed(predictor, tracks, windows)
    bound = content_bound(tracks.dimension, predictor.tail)
    outside = squared_distances(mean, covariance, weight, windows.future) > bound
    missed = np.asarray(outside.any(axis=1))
    moments, owner = np.unique(windows.row, return_inverse=True)
    size = bound * np.sqrt(np.linalg.det(covariance[:, 0, -1]))
    return {
        "steps": float(outside.size),
        "steps_missed": float(outside.sum()),
        "persons": float(len(missed)),
        "persons_missed": float(missed.sum()),
        "plans": float(len(moments)),
        "plans_missed": float((np.bincount(owner, weights=missed) > 0).sum()),
        "radius": float(np.sqrt(size).mean()),
    }


def next_radius(radius: Array, quantile: Array, gain: float) -> Array:
    """Return the smallest radius that is large enough however people answer the change to it.

    A region of radius r was driven with, and q is the quantile of the errors seen beside it. If
    the quantile moves by at most kappa < 1 times the change of the radius, every r' with

        r' >= q + kappa |r' - r|

    keeps the promise beside itself. The smallest one is

        r' = r + (q - r) / (1 - kappa)   for q >= r,    r' = r - (r - q) / (1 + kappa)   else.

    With kappa = 0 it is q itself: calibrate again, and hope.

    The idea and its implicit rule are those of the source; its kappa is bounded by Lipschitz
    constants of planner and people. Our planner has none (it changes sides, and stands), so that
    here kappa is assumed.

    Parameters
    ----------
    radius, quantile : (N,), in any unit.
    gain : kappa, in [0, 1).

    References
    ----------
    Mirzaeedodangeh, Shekhtman, Matni, Lindemann, "Safe Planning in Interactive Environments via
    Iterative Policy Updates and Adversarially Robust Conformal Prediction", L4DC 2026.
    """
    more = quantile - radius
    return np.asarray(radius + np.where(more >= 0.0, more / (1.0 - gain), more / (1.0 + gain)))


def corrected(driven: Conformal, again: Conformal, gain: float) -> Conformal:
    """Return the predictor of the next iteration, its radii by `next_radius`.

    Parameters
    ----------
    driven : that the robot drove with. again : the same, fitted to what was then seen.
    """
    if driven.fitted is None or again.fitted is None:
        return again
    radius, quantile = (np.sqrt(one.fitted.scale) for one in (driven, again) if one.fitted)
    scale = next_radius(radius, quantile, gain) ** 2
    return replace(again, fitted=replace(again.fitted, scale=tuple(scale.tolist())))


def draw_iterations(lines: list[Row]) -> Any:
    """Draw what was missed against the iteration, a panel per kind of people."""
    panels_of = group(lines, "people")
    figure, panels = subplots(
        1, len(panels_of), figsize=(PAGE, 2.6), squeeze=False, sharey=True, sharex=True
    )
    for panel, ((people,), some) in zip(panels.flat, panels_of.items(), strict=True):
        for k, ((name, gain), own) in enumerate(group(some, "calibration", "gain").items()):
            look = {"color": str(0.15 + 0.45 * (k % 2)), "marker": "osD^"[k % 4], "markersize": 3}
            middle = np.array([row["missed"] for row in own])
            ends = np.array([[row["missed_low"], row["missed_high"]] for row in own]).T
            iteration = np.array([row["iteration"] for row in own]) + 0.06 * k
            label = f"{title(name)}, gain {gain:g}"
            panel.errorbar(iteration, middle, np.abs(ends - middle), label=label, elinewidth=0.7,
                           linewidth=0.9, **look)  # fmt: skip
        for promise in {row["promise"] for row in some}:
            panel.axhline(promise, color="black", linestyle=":", linewidth=0.9)
        panel.set(xlabel="iteration", ylim=(0.0, None))
        panel.set_title(title(people))
    panels[0, 0].set_ylabel("missed")
    words = few(int(line["episodes"]) for line in lines) or "bars: intervals of 95 %"
    legend_below(figure, panels[:1, 0], ncols=2, title=words, title_fontsize=7)
    return figure


def draw_table(lines: list[Row]) -> Any:
    """Draw missed over promised of every pair of drivers, a panel per people and calibration."""
    panels_of = group(lines, "people", "calibration")
    across = len(group(lines, "people"))
    down = len(panels_of) // across
    figure, panels = subplots(down, across, figsize=(PAGE, 0.6 + 2.0 * down), squeeze=False)
    for k, ((people, name), some) in enumerate(panels_of.items()):
        panel = panels[k % down, k // down]
        rows, columns = (list(dict.fromkeys(row[axis] for row in some))
                         for axis in ("calibrated", "driven"))  # fmt: skip
        ratio = np.array([row["missed"] / row["promise"] for row in some])
        ratio = ratio.reshape(len(rows), len(columns))
        shaded(panel, ratio, ".1f", better_high=False)
        panel.set_xticks(range(len(columns)), [title(one) for one in columns], rotation=90)
        panel.set_yticks(range(len(rows)), [title(one) for one in rows])
        panel.set_title(f"{title(people)}, {title(name)}")
    return figure

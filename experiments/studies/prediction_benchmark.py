"""Every predictor on every scene: errors, likelihoods, coverage, areas, fallbacks and times."""

import json
from dataclasses import dataclass, field, replace
from pathlib import Path
from time import perf_counter
from typing import ClassVar, Self, final

from ...framework import Fittable, Predictor, WideberthError, build, names
from ...framework.plugins.registry import unknown
from ...predictors.data.recordings import usual_speed
from ..engine.closed_loop import group
from .fitting import AS_GIVEN, NOTHING, check_fit, fitted
from .grid import Axes, GridStudy, Pictures, Result, Row, Task, TaskOutcome
from .prediction_data import PredictionData, SceneFiles, longest_stretch
from .prediction_figures import prediction_pictures
from .prediction_scores import LEVELS, calibration, run_along, table_rows
from .prediction_tables import primary_rows, summarised
from .prediction_windows import Protocol, shown_windows, window_places
from .region_family import rounded

SHOWN = (0.5, 0.95)
"""Quantiles of the surprise of the two forecasts that are drawn."""


@final
@dataclass(frozen=True)
class PredictionBenchmark(GridStudy):
    """Forecasts held against recordings of people or robots; one task per predictor and scene.

    At each row of a recording a predictor is given all who are seen, as far back as
    ``protocol.observed`` rows, and the windows that are complete there are scored (see
    `Protocol`, and `wideberth.metrics.scoring` for the definitions). What can be fitted
    is
    fitted to the recordings of all other scenes (leave one scene out); if these are too few,
    or there are none, the predictor is scored with its defaults and ``fitted`` says why. A
    predictor that was fitted before, as one given by ``{saved: FILE}``, is fitted anew unless
    ``as_given`` names it; whether it had seen the scene that it is scored on is not checked.
    What adapts starts anew with every recording.

    The table has a line per predictor, scene and step; lines of step "all" average over the
    steps (``error_m`` is then the ADE, ``final_m`` the FDE) and tell how often the predictor
    fell back, and why, without numbers in the reasons. ``median_m`` is the median of the
    windows' errors, where ``error_m`` is their mean. ``all_95`` is the share of windows that
    stay in the regions of content 0.95 at all steps, ``joint_95`` that of trajectories in the
    region of content 0.95 of the joint covariance, where the forecast has one. Areas are those
    of the regions of content 0.95: their median, their 90th percentile and their mean. Lines
    of slice "stops" are of those who walk at the forecast and stand at its end; the other
    slices are classes of speed (see `Protocol`), with a line per step.

    Parameters
    ----------
    predictors : by name, beside the registered ones; one named like a registered one stands
        for it.
    registered : score every registered predictor with its defaults too.
    left_out : registered ones that are not scored. An oracle without the future is its
        fallback; a predictor that solves a game at every row would need days.
    data : the recordings.
    protocol : which windows are scored.
    chosen : names of the predictors to score, given or registered; if empty, all the given
        ones, and the registered ones but for those left out.
    fit : whether what can be fitted is.
    as_given : names of predictors that are scored as they are all the same.
    only : scenes to score; all if empty. Files of the others may then be missing.
    """

    claim: ClassVar[str] = (
        "Forecasts cover what then happens: how far off is each predictor, and how honest?"
    )
    reference: ClassVar[str] = "gneiting2007strictly, schoeller2020constant"
    printed: ClassVar[tuple[str, ...]] = (
        *("windows", "ade_m", "fde_m", "nll"),
        *("cover_95", "area_m2", "fell_back", "notes"),
    )

    predictors: dict[str, Predictor] = field(default_factory=dict)
    registered: bool = True
    left_out: tuple[str, ...] = ("oracle",)
    data: PredictionData = field(default_factory=PredictionData)
    protocol: Protocol = field(default_factory=Protocol)
    chosen: tuple[str, ...] = ()
    fit: bool = True
    as_given: tuple[str, ...] = ()
    only: tuple[str, ...] = ()

    def family(self) -> list[str]:
        """Names of the predictors: the chosen ones, or the given and then the registered ones.

        Raises
        ------
        WideberthError : unknown names in ``chosen`` or ``as_given``.
        """
        known = {*self.predictors, *names("predictors")}
        for field_name in ("chosen", "as_given"):
            for name in getattr(self, field_name):
                if name not in known:
                    message = f"{field_name}: {unknown('predictor', name, known)}"
                    key = name.rpartition(":")[2].lower()
                    path = f"; name it first, as in --set 'predictors.{key}={{type: \"{name}\"}}'"
                    raise WideberthError(message + path * (":" in name))
        others = names("predictors") if self.registered else []
        taken = {*self.predictors, *self.left_out}
        usual = [*self.predictors, *(name for name in others if name not in taken)]
        return list(self.chosen) or usual

    def member(self, name: str) -> Predictor:
        """Return the given predictor of this name, or the registered one with its defaults."""
        given = self.predictors.get(name)
        found: Predictor = build("predictors", name) if given is None else given
        return found

    def scored(self) -> dict[str, SceneFiles]:
        """Return the scenes to score.

        Raises
        ------
        WideberthError : as `PredictionData.found`, and unknown names in ``only``.
        """
        found = self.data.found(self.only)
        scenes = {name: scene for name, scene in found.items() if scene.role != "training"}
        for name in self.only:
            if name not in scenes:
                hint = f" ({name!r} is a predictor: 'chosen' names predictors, 'only' scenes)"
                known = name in {*self.predictors, *names("predictors")}
                raise WideberthError(
                    f"only: {unknown('scene', name, scenes)}{hint if known else ''}"
                )
        return {name: scenes[name] for name in (self.only or scenes)}

    def axes(self) -> Axes:
        """Each scene with each predictor; recordings are read and predictors built first.

        Raises
        ------
        WideberthError : a file that cannot be used, a scene without a single window, or a
            predictor whose fit needs a library that is not installed.
        """
        for name in self.family():
            self._check_fit(name)
        scored, short = self.scored(), {}
        for name, scene in self.data.found(self.only).items():
            recordings = self.data.read(scene)
            if name in scored and not any(
                len(window_places(self.data, one, self.protocol)) for one in recordings
            ):
                short[name] = max(map(longest_stretch, recordings))
        if short:
            raise WideberthError(self._no_window(scored, short))
        pairs = [(predictor, scene) for scene in scored for predictor in self.family()]
        return {("predictor", "scene"): pairs}

    def _check_fit(self, name: str) -> None:
        """Refuse a predictor that cannot be built, or lacks a library for its fit."""
        predictor = self.member(name)
        if self._learns(name, predictor):
            check_fit(predictor, f"or score it unfitted: --set 'as_given=[{name}]'")

    def _no_window(self, scored: dict[str, SceneFiles], short: dict[str, int]) -> str:
        """Say which scenes are too short, by how much, and how to go on."""
        how, others = self.protocol, [name for name in scored if name not in short]
        (name, rows), *more = short.items()
        return (
            f"scene {name} ({', '.join(scored[name].files)}) has no window of {how.observed} + "
            f"{how.least} consecutive rows of {self.data.step(scored[name]):g} s: its longest "
            f"track has {rows}"
            + (f"; nor have {', '.join(one for one, _ in more)}" if more else "")
            + "; state fewer under protocol, or (for logs of a robot) a smaller dt"
            + (f", or score the others: --set 'only=[{', '.join(others)}]'" if others else "")
        )

    def inputs(self) -> list[Path]:
        """Return the recordings."""
        scenes = self.data.found(self.only).values()
        return [path for scene in scenes for path in self.data.paths(scene)]

    def measure(self, task: Task) -> TaskOutcome:
        """Fit the predictor to the other scenes, run it along this one, and score it."""
        name, place = str(task.settings["predictor"]), str(task.settings["scene"])
        scene = self.data.found(self.only)[place]
        recordings = self.data.read(scene)
        begin = perf_counter()
        predictor, learnt_from = self._fitted(name, place)
        seconds = perf_counter() - begin
        shown = shown_windows(self.data, recordings[0], self.protocol, SHOWN)
        scores, effort, samples = run_along(predictor, recordings, self.data, self.protocol, shown)
        dt = self.data.step(scene)
        head: Row = {"predictor": name, "scene": place, "role": scene.role}
        how: Row = {
            "protocol": self.protocol.text(dt),
            "speed_mps": rounded(usual_speed(recordings)),
            "fitted": learnt_from,
            "noise": self.data.noise_text(recordings),
        }
        rows = [head | how | row for row in table_rows(scores, dt, self.protocol.speeds)]
        kept = {"levels": LEVELS, "coverage": calibration(scores), "samples": samples}
        files = {f"{place}/{name}.json": json.dumps(kept).encode()}
        return TaskOutcome(rows, [{**head, "fit_s": seconds, **effort.row()}], files)

    def _learns(self, name: str, predictor: Predictor) -> bool:
        return isinstance(predictor, Fittable) and self.fit and name not in self.as_given

    def _fitted(self, name: str, scene: str) -> tuple[Predictor, str]:
        """Return the predictor as it is scored, and what it was fitted to."""
        predictor = self.member(name)
        if not isinstance(predictor, Fittable):
            return predictor, NOTHING
        if not self._learns(name, predictor):
            return predictor, AS_GIVEN
        missing = ", ".join(self.data.missing() or ())
        lacking = f" ({missing} not there)" if missing else ""
        return fitted(predictor, self.data.training(scene, self.only), lacking)

    def summary(self, rows: list[Row]) -> list[Row]:
        """Means over the scenes, then every scene; see `summarised`."""
        return summarised(rows)

    def pictures(self, result: Result) -> Pictures:
        """Draw calibration, coverage and error per step, and two forecasts of each predictor."""
        rows = primary_rows(result.rows)
        files = {
            (str(predictor), str(scene)): json.loads(result.read(f"{scene}/{predictor}.json"))
            for predictor, scene in group(rows, "predictor", "scene")
        }
        yield from prediction_pictures(rows, files)

    def quick(self) -> Self:
        """Few rows of the smallest scene, and the chosen or the first three predictors."""
        scenes = self.scored()
        small = min(scenes, key=lambda name: self.data.size(scenes[name]))
        chosen = self.chosen or tuple(self.family()[:3])
        protocol = replace(self.protocol, stride=max(self.protocol.stride, 5))
        return replace(self, chosen=chosen, only=(small,), protocol=protocol)

"""Every predictor on every scene: errors, likelihoods, coverage, areas, fallbacks and times."""

import json
import sys
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from time import perf_counter
from typing import ClassVar, Self, final

import numpy as np

from wideberth.experiments.base import Experiment, Outcome, Result, Row, Task
from wideberth.experiments.closed_loop import column, group, known_mean
from wideberth.experiments.prediction_data import (
    PredictionData,
    Protocol,
    SceneFiles,
    window_places,
)
from wideberth.experiments.prediction_scores import (
    LEVELS,
    Effort,
    calibration,
    run_along,
    shown_windows,
    table_rows,
)
from wideberth.experiments.region_family import rounded
from wideberth.framework.config import build
from wideberth.framework.errors import WideberthError
from wideberth.framework.predictor import Fittable, Predictor
from wideberth.framework.registry import names, unknown

SHOWN = (0.5, 0.95)
"""Quantiles of the surprise of the two forecasts that are drawn."""
MEANS = {
    "ade_m": "error_m",
    "fde_m": "final_m",
    "nll": "nll",
    "energy_m": "energy_m",
    "cover_50": "cover_50",
    "cover_90": "cover_90",
    "cover_95": "cover_95",
    "all_95": "all_95",
    "joint_95": "joint_95",
    "fell_back": "fell_back",
}
"""Columns of the summary that are means over the scenes -> columns of the table."""


@final
@dataclass(frozen=True)
class PredictionBenchmark(Experiment):
    """Forecasts held against recordings of people or robots; one task per predictor and scene.

    At each row of a recording a predictor is given everybody who is seen, as far back as
    ``protocol.observed`` rows, and the windows that are complete there are scored (see
    `Protocol`, and `wideberth.framework.scoring` for the definitions). What can be fitted is
    fitted to the recordings of all other scenes (leave one scene out); if these are too few,
    or there are none, the predictor is scored with its defaults and ``fitted`` says why.
    What adapts starts anew with every recording.

    The table has a line per predictor, scene and step; lines of step "all" average over the
    steps (``error_m`` is then the ADE, ``final_m`` the FDE) and tell how often the predictor
    fell back, and why, without numbers in the reasons. ``median_m`` is the median of the
    windows' errors, where ``error_m`` is their mean. ``all_95`` is the share of windows that
    stay in the regions of content 0.95 at all steps, ``joint_95`` that of trajectories in the
    region of content 0.95 of the joint covariance, where the forecast has one. Areas are
    medians of the regions of content 0.95. Lines of slice "stops" are of those who walk at
    the forecast and stand at its end.

    Parameters
    ----------
    predictors : by name, beside the registered ones; one named like a registered one stands
        for it.
    registered : score every registered predictor with its defaults too.
    left_out : registered ones that are not scored. An oracle without the future is its
        fallback; a predictor that solves a game at every row would need days.
    data : the recordings.
    protocol : which windows are scored.
    fit : whether what can be fitted is.
    only : scenes to score; all if empty.
    """

    claim: ClassVar[str] = (
        "Forecasts cover what then happens: how far off is each predictor, and how honest?"
    )
    reference: ClassVar[str] = "gneiting2007strictly, schoeller2020constant"

    predictors: dict[str, Predictor] = field(default_factory=dict)
    registered: bool = True
    left_out: tuple[str, ...] = ("oracle",)
    data: PredictionData = field(default_factory=PredictionData)
    protocol: Protocol = field(default_factory=Protocol)
    fit: bool = True
    only: tuple[str, ...] = ()

    def family(self) -> list[str]:
        """Names of the predictors: the given ones, then the registered ones."""
        taken = {*self.predictors, *self.left_out}
        others = names("predictors") if self.registered else []
        return [*self.predictors, *(name for name in others if name not in taken)]

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
        scenes = {
            name: scene for name, scene in self.data.found().items() if scene.role != "training"
        }
        for name in self.only:
            if name not in scenes:
                raise WideberthError(f"only: {unknown('scene', name, scenes)}")
        return {name: scenes[name] for name in (self.only or scenes)}

    def tasks(self) -> Sequence[Task]:
        """One per predictor and scene; every recording is read and every predictor built first.

        Raises
        ------
        WideberthError : a file that cannot be used, or a scene without a single window.
        """
        for name in self.family():
            self.member(name)
        scenes, how = self.data.found(), self.protocol
        scored = self.scored()
        for name, scene in scenes.items():
            recordings = self.data.read(scene)
            if name in scored and not any(
                len(window_places(self.data, one, how)) for one in recordings
            ):
                raise WideberthError(
                    f"scene {name} ({', '.join(scene.files)}) has no window of {how.observed} + "
                    f"{how.least} consecutive rows of {self.data.step(scene):g} s; state fewer "
                    "under protocol, another dt, or leave the scene out"
                )
        return [
            Task(f"{predictor} {scene}", settings={"predictor": predictor, "scene": scene})
            for scene in scored
            for predictor in self.family()
        ]

    def inputs(self) -> Sequence[Path]:
        """Return the recordings."""
        return [path for scene in self.data.found().values() for path in self.data.paths(scene)]

    def measure(self, task: Task) -> Outcome:
        """Fit the predictor to the other scenes, run it along this one, and score it."""
        name, place = str(task.settings["predictor"]), str(task.settings["scene"])
        scene = self.data.found()[place]
        recordings = self.data.read(scene)
        begin = perf_counter()
        predictor, fitted = self._fitted(self.member(name), place)
        seconds = perf_counter() - begin
        shown = shown_windows(self.data, recordings[0], self.protocol, SHOWN)
        scores, effort, samples = run_along(predictor, recordings, self.data, self.protocol, shown)
        dt = self.data.step(scene)
        head: Row = {"predictor": name, "scene": place, "role": scene.role}
        how: Row = {"protocol": self.protocol.text(dt, self.fit), "fitted": fitted}
        rows = [head | how | row for row in table_rows(scores, dt)]
        kept = {"levels": LEVELS, "coverage": calibration(scores), "samples": samples}
        files = {f"{place}/{name}.json": json.dumps(kept).encode()}
        return Outcome(rows, [{**head, "fit_s": seconds, **_times(effort)}], files)

    def _fitted(self, predictor: Predictor, scene: str) -> tuple[Predictor, str]:
        """Return the predictor as it is scored, and what it was fitted to."""
        if not self.fit or not isinstance(predictor, Fittable):
            return predictor, "nothing to fit" if self.fit else "as given"
        training = self.data.training(scene)
        if not training:
            return predictor, "not fitted: no other scene"
        try:
            return predictor.fit(training), f"{len(training)} recordings"
        except WideberthError as error:
            return predictor, f"not fitted: {error}"

    def summary(self, rows: list[Row]) -> list[Row]:
        """Means over the primary scenes by predictor, then every predictor scene by scene.

        ``cover_95_steps`` are the extremes over the steps: of the mean over the scenes in the
        first lines, of the scene in the others. ``area_m2`` is that of the last step. The
        protocol stands in the notes of the first line and wherever it changes; in the table it
        stands in every line.
        """
        together = group(_primary(rows), "predictor").values()
        lines = [_line(some, f"mean of {len(group(some, 'scene'))}") for some in together]
        apart = group(rows, "predictor", "scene").items()
        lines += [_line(some, str(scene)) for (_, scene), some in apart]
        said = ""
        for line in lines:
            protocol = line.pop("protocol")
            notes = [protocol] if protocol != said else []
            line["notes"] = "; ".join([*notes, *line.pop("remarks")]) or None
            said = protocol
        return lines

    def figures(self, result: Result, folder: Path) -> list[Path]:
        """Draw calibration, coverage and error per step, and two forecasts of everybody."""
        from wideberth.experiments.plotting import paper_style
        from wideberth.experiments.prediction_figures import draw_all

        rows = _primary(result.rows)
        files = {
            (str(predictor), str(scene)): json.loads(result.read(f"{scene}/{predictor}.json"))
            for predictor, scene in group(rows, "predictor", "scene")
        }
        with paper_style():
            return draw_all(rows, files, folder)

    def quick(self) -> Self:
        """Few rows of the smallest scene, and the first three predictors."""
        sizes = {
            name: sum(path.stat().st_size for path in self.data.paths(scene))
            for name, scene in self.scored().items()
        }
        small = min(sizes, key=lambda name: sizes[name])
        first = {name: self.member(name) for name in self.family()[:3]}
        protocol = replace(self.protocol, stride=max(self.protocol.stride, 5))
        return replace(self, predictors=first, registered=False, only=(small,), protocol=protocol)


def _times(effort: Effort) -> Row:
    """Measured times of one task."""
    return {
        "calls": effort.calls,
        "obstacles_per_call": effort.obstacles / effort.calls,
        "predict_us_per_obstacle": 1e6 * effort.predict / effort.obstacles,
        "predict_s": effort.predict,
        "update_s": effort.update,
    }


def _primary(rows: list[Row]) -> list[Row]:
    """Lines of the primary scenes; of all where there is none."""
    return [row for row in rows if row["role"] == "primary"] or rows


def _line(rows: list[Row], scene: str) -> Row:
    """Condense the lines of one predictor, in one or several scenes."""
    whole = [row for row in rows if row["step"] == "all" and row["slice"] == "all"]
    steps = list(group([row for row in rows if row["step"] != "all"], "step").values())
    cover = [known_mean(column(some, "cover_95")) for some in steps]
    return {
        "predictor": whole[0]["predictor"],
        "scene": scene,
        "windows": int(column(whole, "windows").sum()),
        **{name: rounded(known_mean(column(whole, of))) for name, of in MEANS.items()},
        "cover_95_steps": f"{np.min(cover):.3f} to {np.max(cover):.3f}",
        "area_m2": rounded(known_mean(column(steps[-1], "area_m2"))),
        "protocol": "; ".join(dict.fromkeys(str(row["protocol"]) for row in whole)),
        "remarks": _remarks(whole),
    }


def _remarks(rows: list[Row]) -> list[str]:
    """Say what was not fitted, and why one scene's forecasts fell back."""
    remarks = {str(row["fitted"]) for row in rows if str(row["fitted"]).startswith("not fitted")}
    reasons = [str(rows[0]["reasons"])] if len(rows) == 1 and rows[0]["reasons"] else []
    return [*sorted(remarks), *reasons]


if __name__ == "__main__":
    from wideberth.experiments.cli import main

    sys.argv[1:1] = ["run", "prediction_benchmark"]
    main()

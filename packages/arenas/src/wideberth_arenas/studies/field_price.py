"""What a functional envelope of distance fields gives up, and what a calibrated constant does."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any, ClassVar, Self, final

import numpy as np
from numpy.typing import NDArray

from wideberth.draw import COLOURS
from wideberth.experiments import GridStudy, Result, Row, Task, TaskOutcome, reduced, subplots
from wideberth.experiments.drawing.plotting import PAGE, legend_below
from wideberth.experiments.engine.closed_loop import column
from wideberth.experiments.studies.grid import labelled
from wideberth.experiments.studies.prediction_data import PredictionData, SceneFiles
from wideberth.framework import Predictor, WideberthError
from wideberth.framework.calibration import rank_quantile
from wideberth.framework.plugins.config import build
from wideberth.framework.plugins.registry import unknown
from wideberth.framework.values.arrays import Array, BoolArray, whole
from wideberth.metrics.statistics import bootstrap_interval, known_mean

from ..controllers.functional_envelope import (
    EnvelopeFit,
    FieldGrid,
    residual_fields,
)
from .conformal_protocol import RecordedCourse
from .field_rows import MARGIN, FieldRows

SHOWN = (1, 6, 12)
"""Steps of which the distance given up is stated."""
METHODS = ("envelope", "constant", "joint envelope", "joint constant", "envelope as published")
"""Two pairs of the same promise: each step's field, and all steps' fields at once."""
BLOCK = 25
"""Rows that are drawn together, 10 s: what is seen at one row is seen at the next ones."""
GIVEN_UP = tuple(f"u_{step}_m" for step in SHOWN)
KEPT = ("field_step", "field", "plan", "person_step")


@final
@dataclass(frozen=True, eq=False)
class Calibrating:
    """Rows that calibrate: the fields, the largest errors, and in which parts.

    Attributes
    ----------
    fields : (R, N, P), m, D_pred - D; NaN where no one is left.
    errors : (R, N), m, the supremum of the field over all places.
    learning, held : which rows components and growth are learnt from, and which calibrate.
    """

    fields: Array
    errors: Array
    learning: NDArray[np.int64]
    held: NDArray[np.int64]

    def drawn(self, rng: np.random.Generator) -> "Calibrating":
        """Return the same parts with blocks of rows drawn anew."""
        blocks = np.arange(len(self.fields)) // BLOCK
        chosen = rng.integers(blocks.max() + 1, size=blocks.max() + 1)
        times = np.bincount(chosen, minlength=blocks.max() + 1)[blocks]
        parts = (np.repeat(part, times[part]) for part in (self.learning, self.held))
        return Calibrating(self.fields, self.errors, *parts)

    def upper(self, method: str, steps: Sequence[int], tail: float) -> Array:
        """U, (S, P), m, of some steps, counted from 1.

        Raises
        ------
        WideberthError : too few rows for the tail.
        """
        fit = EnvelopeFit(tail, as_published="published" in method)
        at = np.array(steps) - 1
        if method == "joint envelope":
            return np.asarray(self._joint_envelope(fit)[at])
        if method == "joint constant":
            return self._constants(self._joint_constant(tail)[at])
        if method == "constant":
            both = np.concatenate([self.learning, self.held])
            values = [_quantile(self.errors[both, h], tail) for h in at]
            return self._constants(np.array(values))
        parts = [[_known(self.fields[part, h]) for part in (self.learning, self.held)] for h in at]
        return np.stack([fit.bound(*own) for own in parts])

    def _constants(self, values: Array) -> Array:
        return np.repeat(values[:, None], self.fields.shape[2], axis=1)

    def _joint_envelope(self, fit: EnvelopeFit) -> Array:
        """U, (N, P), of all steps' fields as one, each over its largest deviation."""
        learning, held = (
            self.fields[part][np.isfinite(self.fields[part]).all(axis=(1, 2))]
            for part in (self.learning, self.held)
        )
        scale = np.maximum(learning.std(axis=0).max(axis=1), 1e-6)[:, None]
        flat = [(some / scale).reshape(len(some), -1) for some in (learning, held)]
        return np.asarray(fit.bound(*flat).reshape(scale.shape[0], -1) * scale)

    def _joint_constant(self, tail: float) -> Array:
        """U, (N,): c v_h with v_h the error's quantile of one part, and c of the other."""
        growth = np.maximum(np.nanquantile(self.errors[self.learning], 1.0 - tail, axis=0), 1e-6)
        largest = np.fmax.reduce(self.errors[self.held] / growth, axis=1)
        return np.asarray(growth * _quantile(largest, tail))


@final
@dataclass(frozen=True, eq=False)
class Fields:
    """Fields of all rows of a recording, and where people then were among the predictions.

    Attributes
    ----------
    rows : (R,). grid : of the fields.
    fields, errors : as in `Calibrating`.
    near : (R, N, O), m, from each person to the nearest prediction; NaN for who is not there.
    cell : (R, N, O), of the grid, of each person.
    """

    rows: NDArray[np.int64]
    grid: FieldGrid
    fields: Array
    errors: Array
    near: Array
    cell: NDArray[np.int64]

    @classmethod
    def of(cls, rows: FieldRows, grid: FieldGrid) -> "Fields":
        """Compute them."""
        count, steps, people = rows.predicted.shape[:3]
        fields = np.full((count, steps, grid.cells**2), np.nan)
        near = np.full((count, steps, people), np.nan)
        for h in range(steps):
            ahead, truth = rows.predicted[:, h], rows.actual[:, h]
            known, some = residual_fields(grid, ahead, truth)
            fields[known, h] = some
            for row in known:
                near[row, h] = _nearest(truth[row], ahead[row])
        errors = np.fmax.reduce(near, axis=2)
        cell, _ = grid.nearest(np.nan_to_num(rows.actual))
        return cls(rows.rows, grid, fields, errors, near, cell)

    def calibrating(self, which: BoolArray) -> Calibrating:
        """Return some rows, dealt to the parts of `EnvelopeFit`."""
        held, learning = EnvelopeFit().parts(int(which.sum()))
        return Calibrating(self.fields[which], self.errors[which], learning, held)

    def missed(self, which: BoolArray, upper: Array, *, exact: bool) -> dict[str, float]:
        """Share of steps, rows and persons at which the bound did not hold, among some rows.

        Parameters
        ----------
        upper : (N, P), m. exact : whether it is a constant, so that no grid is asked.
        """
        known = np.isfinite(self.errors[which])
        bound = upper[np.arange(upper.shape[0])[:, None], self.cell[which]]
        outside = self.near[which] > bound  # false for NaN
        high = self.errors[which] > upper[:, 0]
        if not exact:
            high = np.asarray((self.fields[which] > upper).any(axis=2))
        there = np.isfinite(self.near[which])
        return {
            "field_step": float(high[known].mean()),
            "field": float(high.any(axis=1).mean()),
            "plan": float(outside.any(axis=(1, 2)).mean()),
            "person_step": float(outside[there].mean()),
        }


def _nearest(people: Array, predictions: Array) -> Array:
    """Distance from people (O, 2) to the nearest prediction (K, 2), (O,), m; NaN where unknown."""
    known = predictions[np.isfinite(predictions).all(axis=1)]
    return np.asarray(np.sqrt(((people[:, None] - known) ** 2).sum(axis=2)).min(axis=1))


def _quantile(errors: Array, tail: float) -> float:
    """Return the error that a further exchangeable one exceeds with probability ``tail``."""
    known = _known(errors)
    return rank_quantile(known, np.arange(len(known)), tail)


def _known(values: Array) -> Array:
    """Return the rows without NaN."""
    return values[np.isfinite(values).all(axis=tuple(range(1, values.ndim)))]


@final
@dataclass(frozen=True)
class FieldPrice(GridStudy):
    """Distance given up for one promise of the distance field, and how often it was broken.

    `FunctionalEnvelope` bounds how far the field of distances to predictions lies above the true
    one by a function of the place. The same promise can be kept by a constant,

        U_h = quantile of sup_x (D_pred,h(x) - D_h(x)) = max_j min_k |t_j - p_k|,

    the largest distance from a true position t_j to its nearest prediction p_k, since both fields
    change by no more than the distance between two places: no grid, components or mixture.

    Windows of ``window`` rows are left out in turn, with those whose futures reach into them; all
    else of the recording calibrates. The promise is for each step's field, or for all steps at
    once (joint): then the envelope is that of all steps' fields as one, and the constants are
    c v_h. "field_step" is the share of steps at which the bound did not hold somewhere, "field" of
    rows with such a step, "person_step" of people who were where the bound says that no one is,
    and "plan" of rows with such a person.

    The distance given up is the mean of U over the grid. Its interval is from a block bootstrap of
    the calibration rows; those of the shares are from a bootstrap over the windows.

    Attributes
    ----------
    data : recordings, one file each.
    only : scenes; all by default.
    predictor : of people, not fitted.
    tail : of the promise.
    people : "paired": those who are both predicted and there, as published, or "everyone":
        newcomers count, too.
    window : rows that are left out at a time.
    cells : of the grid, along each side.
    resamples : of the bootstrap of calibration rows.
    """

    data: PredictionData = field(default_factory=PredictionData)
    only: tuple[str, ...] = ()
    predictor: Predictor = field(
        default_factory=partial(
            build, "predictors", {"type": "kalman", "acceleration_density": 0.02}
        )
    )
    tail: float = 0.1
    people: tuple[str, ...] = ("paired", "everyone")
    window: int = 30
    cells: int = 32
    resamples: int = 40

    claim: ClassVar[str] = (
        "A constant keeps the functional envelope's promise and gives up less distance."
    )
    reference: ClassVar[str] = "shin2026prediction, lei2015conformal"
    printed: ClassVar[tuple[str, ...]] = (
        *("u_1_m", "u_6_m", "u_12_m", "more_u_12_m", "more_u_12_m_low", "more_u_12_m_high"),
        *("field_step", "field", "plan", "person_step"),
    )

    def __post_init__(self) -> None:
        for name in ("window", "cells", "resamples"):
            whole(name, getattr(self, name))
        if wrong := [name for name in self.people if name not in ("paired", "everyone")]:
            raise WideberthError(f"people holds {wrong[0]!r}; wanted 'paired' or 'everyone'")

    def axes(self) -> Mapping[Any, Any]:
        """Each recording, with both meanings of people."""
        return {"scene": list(self._scenes()), "people": self.people}

    def inputs(self) -> Sequence[Path]:
        """Return the recordings."""
        return [path for one in self._scenes().values() for path in self.data.paths(one)]

    def _scenes(self) -> dict[str, SceneFiles]:
        """Return the recordings by name.

        Raises
        ------
        WideberthError : a name in ``only`` that is none of a scene.
        """
        found = self.data.found(self.only)
        for name in self.only:
            if name not in found:
                raise WideberthError(f"only: {unknown('scene', name, found)}")
        return {name: found[name] for name in self.only or found}

    def measure(self, task: Task) -> TaskOutcome:
        """Leave out each window, and draw the calibration anew."""
        recording = self.data.read(self._scenes()[str(task.settings["scene"])])[0]
        everywhere = recording.positions.reshape(-1, recording.positions.shape[2])
        everywhere = everywhere[np.isfinite(everywhere).all(axis=1)]
        course = RecordedCourse(recording, (*everywhere[0], 0.0), tuple(everywhere[0]))
        rows = FieldRows.of(course, self.predictor)
        if task.settings["people"] == "paired":
            rows = rows.paired()
        fields = Fields.of(rows, FieldGrid.around(everywhere, MARGIN, self.cells))
        table = [row for first in range(int(rows.rows[0]), int(rows.rows[-1]), self.window)
                 for row in self._left_out(fields, first)]  # fmt: skip
        table += self._resampled(fields)
        return TaskOutcome([{**task.settings, **row} for row in table])

    def _left_out(self, fields: Fields, first: int) -> list[Row]:
        """Measure in one window, with the envelopes of all else."""
        end, steps = first + self.window, fields.errors.shape[1]
        inside = (fields.rows >= first) & (fields.rows < end) & np.isfinite(fields.errors).any(1)
        if not inside.any():
            return []
        outside = (fields.rows < first - steps) | (fields.rows >= end + steps)
        calibrating, table = fields.calibrating(outside), []
        for method in METHODS:
            upper = calibrating.upper(method, range(1, steps + 1), self.tail)
            missed = fields.missed(inside, upper, exact=method.endswith("constant"))
            chosen = upper[np.array(SHOWN) - 1]
            given: Row = {"method": method, "window": first, "resample": -1}
            table.append({**given, **_given_up(chosen), **missed, "rows": int(inside.sum())})
        return table

    def _resampled(self, fields: Fields) -> list[Row]:
        """Calibrate on the whole recording, and on its rows drawn anew, in blocks."""
        whole_recording = fields.calibrating(np.ones(len(fields.rows), dtype=np.bool_))
        table: list[Row] = []
        for number in range(-1, self.resamples):
            drawn = whole_recording
            if number >= 0:
                drawn = drawn.drawn(np.random.default_rng(number))
            for method in METHODS:
                upper = drawn.upper(method, SHOWN, self.tail)
                given: Row = {"method": method, "window": -1, "resample": number}
                table.append({**given, **_given_up(upper)})
        return table

    def summary(self, rows: list[Row]) -> list[Row]:
        """One line per recording, meaning of people and method, with intervals."""
        table = []
        for named, own in labelled(rows, "scene", "people"):
            by_method = {head["method"]: some for head, some in labelled(own, "method")}
            for method, some in by_method.items():
                rival = method.replace("envelope as published", "constant")
                rival = rival.replace("envelope", "constant")
                line = {**named, "method": method, **_line(some)}
                if rival != method:
                    line |= _difference(some, by_method[rival])
                table.append(line)
        return table

    def pictures(self, result: Result) -> Iterator[tuple[str, Any]]:
        """Distance given up, per recording, of both pairs."""
        table = self.summary(result.rows)
        kinds = labelled(table, "people")
        figure, panels = subplots(1, len(kinds), figsize=(PAGE, 3.4), squeeze=False, sharey=False)
        for panel, (named, own) in zip(panels[0], kinds, strict=True):
            _panel(panel, own)
            panel.set_title(str(named["people"]))
        panels[0][0].set_ylabel(f"mean of U {SHOWN[-1]} steps ahead (m)")
        legend_below(figure, panels[0], ncols=3)
        yield "field_price", figure

    def quick(self) -> Self:
        """One recording, few cells and resamples."""
        return reduced(self, people=1, cells=12, resamples=3)


def _given_up(upper: Array) -> Row:
    return {name: float(one.mean()) for name, one in zip(GIVEN_UP, upper, strict=True)}


def _line(rows: list[Row]) -> Row:
    """State what is given up, and means over the windows, with intervals."""
    windows = [row for row in rows if row["window"] >= 0]
    line: Row = {"windows": len(windows), "rows": int(column(windows, "rows").sum())}
    for name in GIVEN_UP:
        line |= _with_interval(name, _calibrated(rows, name))
    for name in KEPT:
        values = column(windows, name)
        line[name] = known_mean(values)
        low, high = bootstrap_interval(values, np.random.default_rng(0))
        line[f"{name}_low"], line[f"{name}_high"] = low, high
    return line


def _difference(rows: list[Row], others: list[Row]) -> Row:
    """Compare what is given up with the constant, with the interval over the resamples."""
    line: Row = {}
    for name in GIVEN_UP:
        more = _calibrated(rows, name) - _calibrated(others, name)
        line |= _with_interval(f"more_{name}", more)
    return line


def _calibrated(rows: list[Row], name: str) -> Array:
    """Return a column of the calibrations with the whole recording, and with resamples of it."""
    return column([row for row in rows if row["window"] < 0], name)


def _with_interval(name: str, values: Array) -> Row:
    """State the first value, and the interval of the others, which are resamples."""
    low, high = np.quantile(values[1:], (0.025, 0.975))
    return {name: float(values[0]), f"{name}_low": float(low), f"{name}_high": float(high)}


def _panel(panel: Any, rows: list[Row]) -> None:
    """Bars of the methods, one group per recording."""
    last = f"u_{SHOWN[-1]}_m"
    scenes = list(dict.fromkeys(row["scene"] for row in rows))
    for k, method in enumerate(METHODS):
        own = [row for row in rows if row["method"] == method]
        place = np.arange(len(scenes)) + 0.16 * (k - 2)
        value = column(own, last)
        ends = value - column(own, f"{last}_low"), column(own, f"{last}_high") - value
        error = np.maximum(ends, 0.0)  # the value may lie outside
        panel.bar(place, value, 0.15, yerr=error, color=COLOURS[k], label=method,
                  hatch="//" * ("constant" in method), edgecolor="white")  # fmt: skip
    panel.set_xticks(np.arange(len(scenes)), scenes)

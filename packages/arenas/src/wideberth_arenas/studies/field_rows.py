"""What was predicted at every row of a recording, and where people then were, for envelopes.

With them FCP is calibrated for an episode, as in the published loop or without its faults.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import takewhile

import numpy as np
from numpy.typing import NDArray

from wideberth.framework.predictor import Predictor
from wideberth.framework.values.arrays import Array, BoolArray

from ..controllers.fcp import FunctionalConformalPlanner
from ..controllers.functional_envelope import EnvelopeFit, FieldGrid, FunctionalEnvelope
from ..controllers.sampled_paths import SAMPLES
from .conformal_protocol import MOST, PERSON, RecordedCourse

STEPS = 12
"""Of the forecasts."""
MARGIN = 2.0
"""m, around everything that a grid holds."""
CELLS = 128
"""Along each side of the published grid."""
SCENE_CELLS = 64
"""Along each side of the grid of a whole scene."""


@dataclass(frozen=True, eq=False)
class FieldRows:
    """Predicted and true places at the steps after some rows.

    Attributes
    ----------
    rows : (R,), of the recording.
    predicted : (R, N, O, 2), m, of those seen at the row; NaN for others.
    actual : (R, N, O, 2), m, of everyone who is there at the step; NaN for others.
    dt : s between the steps.
    """

    rows: NDArray[np.int64]
    predicted: Array
    actual: Array
    dt: float

    @classmethod
    def of(cls, course: RecordedCourse, predictor: Predictor, steps: int = STEPS) -> "FieldRows":
        """Forecast at every row at which someone is seen."""
        recorded, rows = course.recording.positions, np.array(course.rows)
        count = len(recorded)
        predicted = np.full((len(rows), steps, count, 2), np.nan)
        actual = predicted.copy()
        for place, row in enumerate(rows.tolist()):
            who, _ = course.people(row)
            tracks = course.recording.tracks(row, SAMPLES, radius=PERSON, noise=0.0)
            names = [tracks.ids.index(course.recording.ids[one]) for one in who]
            forecast = predictor.predict(tracks.select(names), steps)
            likeliest = forecast.weight.argmax(axis=1)
            mean = forecast.mean[np.arange(len(who)), likeliest]
            predicted[place][:, who] = np.swapaxes(mean, 0, 1)
            ahead = recorded[:, row + 1 : row + 1 + steps]
            actual[place][: ahead.shape[1]] = np.swapaxes(ahead, 0, 1)
        return cls(rows, predicted, actual, course.recording.dt)

    @property
    def known(self) -> int:
        """Fewest rows at a step at which someone is both predicted and there."""
        both = [np.isfinite(one[..., 0]).any(axis=2) for one in (self.predicted, self.actual)]
        return int((both[0] & both[1]).sum(axis=0).min(initial=len(self.rows)))

    def chosen(self, which: BoolArray) -> "FieldRows":
        """Return some of the rows."""
        return FieldRows(self.rows[which], self.predicted[which], self.actual[which], self.dt)

    def outside(self, first: int, last: int) -> "FieldRows":
        """Return the rows whose steps do not reach into an episode, nor its into theirs."""
        steps = self.predicted.shape[1]
        return self.chosen((self.rows < first - steps) | (self.rows > last + steps))

    def paired(self) -> "FieldRows":
        """Count only people who are both predicted and there, as published."""
        both = np.isfinite(self.predicted) & np.isfinite(self.actual)
        predicted, actual = (np.where(both, one, np.nan) for one in (self.predicted, self.actual))
        return replace(self, predicted=predicted, actual=actual)

    def calibrated(self, fit: EnvelopeFit, grid: FieldGrid) -> FunctionalEnvelope:
        """Calibrate an envelope on these rows."""
        return fit.envelope(grid, self.predicted, self.actual, self.dt)


def episode_grid(course: RecordedCourse, rows: FieldRows, first: int) -> FieldGrid:
    """Return the published grid of an episode: its people, predictions, start and goal."""
    within = rows.chosen((rows.rows >= first) & (rows.rows < first + MOST))
    places = [course.people(row)[1] for row in within.rows.tolist()]
    return _grid(course, [within.predicted.reshape(-1, 2), *places], CELLS)


def scene_grid(course: RecordedCourse) -> FieldGrid:
    """Return the grid of everyone in a recording, start and goal."""
    return _grid(course, [course.recording.positions.reshape(-1, 2)], SCENE_CELLS)


def _grid(course: RecordedCourse, places: Sequence[Array], cells: int) -> FieldGrid:
    points = np.concatenate([np.array([course.start[:2], course.goal]), *places])
    return FieldGrid.around(points[np.isfinite(points).all(axis=1)], MARGIN, cells)


def unbroken(course: RecordedCourse, first: int, most: int = MOST) -> tuple[int, ...]:
    """Return the rows of FCP's published loop, which ends where no one is seen."""
    seen = set(course.rows)
    return tuple(takewhile(seen.__contains__, range(first, first + most)))


def calibrated(
    planner: FunctionalConformalPlanner,
    course: RecordedCourse,
    episode: Sequence[int],
    begun: int,
) -> FunctionalConformalPlanner:
    """Return FCP with the envelope of an episode.

    It is calibrated outside of the episode, on a grid of the scene; in a recording that is too
    short for that it stays without an envelope. As published it is calibrated
    on all rows, those of the episode among them, on the grid of the episode that the comparison
    begins with; its cells are then laid over the grid of this one.

    Parameters
    ----------
    episode : its rows. begun : first row of the episode that the comparison begins with.
    """
    rows = _field_rows(course, planner.predictor)
    if planner.as_published:
        fitted = _published(course, planner.predictor, begun)
        envelope = replace(fitted, grid=episode_grid(course, rows, episode[0]))
    else:
        fit, away = EnvelopeFit(), rows.outside(episode[0], episode[-1]).paired()
        if away.known < fit.fewest:
            return planner
        envelope = away.calibrated(fit, scene_grid(course))
    return replace(planner, envelope=envelope)


@lru_cache(maxsize=4)
def _field_rows(course: RecordedCourse, predictor: Predictor) -> FieldRows:
    return FieldRows.of(course, predictor)


@lru_cache(maxsize=4)
def _published(course: RecordedCourse, predictor: Predictor, begun: int) -> FunctionalEnvelope:
    rows = _field_rows(course, predictor)
    grid = episode_grid(course, rows, begun)
    return rows.paired().calibrated(EnvelopeFit(as_published=True), grid)

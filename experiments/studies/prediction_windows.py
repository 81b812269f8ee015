"""Which windows of a recording are forecast and scored."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Literal, final

import numpy as np

from ...framework import Tracks, WideberthError, cut_windows
from ...framework.values.arrays import Array, positive, whole
from ...predictors.data.recordings import Recording
from ...predictors.data.windows import IntArray
from .prediction_data import PredictionData

SHORTEST = 2
"""Predicted steps of the shortest window in Schoeller's protocol."""
SLICES = ("all", "stops")
"""Names of the table's slices that no class of speed may have."""
WAY = 1.0
"""m from the forecast to the end of what was predicted; who goes less far is hardly drawn."""


@final
@dataclass(frozen=True)
class Protocol:
    """Which windows are scored, and how.

    A window is an obstacle with ``observed`` consecutive rows, the newest of which is the
    moment of the forecast. "full": and ``predicted`` consecutive rows after it. "schoeller",
    as in the published baseline of constant velocity: 2 rows after it suffice and at most
    ``predicted`` are scored, so that every start within a track gives one window of 10 to 20
    rows (with 8 + 12); the last row that there is counts as the final one.

    Windows overlap and follow one another by ``stride`` rows.

    A window's speed is the distance from the position 3 s before the forecast (from the first
    observed one where fewer were observed) to the newest, over the time between.

    Parameters
    ----------
    observed : rows that a predictor is given, with all people who are seen at the newest one.
    predicted : rows ahead.
    windows : "full" or "schoeller".
    stride : every so many rows a forecast is scored. Predictors that adapt see every row.
    floor : m, standard deviation added in quadrature in the likelihoods (and in the joint
        coverage), but not in coverage and area: those are of the forecast as it stands.
    draws : of each forecast, for the energy scores and the joint regions of mixtures; the same
        for every predictor.
    speeds : m/s, least speed of each class of windows that is also scored by itself; the first
        is 0.

    Raises
    ------
    WideberthError : a number out of range.
    """

    observed: int = 8
    predicted: int = 12
    windows: Literal["full", "schoeller"] = "full"
    stride: int = 1
    floor: float = 0.01
    draws: int = 99
    speeds: dict[str, float] = field(
        default_factory=lambda: {"standing": 0.0, "slow": 0.1, "walking": 0.5, "fast": 1.5}
    )

    def __post_init__(self) -> None:
        fewest = {"observed": 2, "predicted": SHORTEST, "stride": 1, "draws": 2}
        for name, few in fewest.items():
            whole(f"protocol.{name}", getattr(self, name), least=few)
        positive("protocol.floor", self.floor)
        for name in SLICES:
            if name in self.speeds:
                raise WideberthError(
                    f"protocol.speeds has a class {name!r}, which is another part of the table; "
                    "name it otherwise"
                )
        least = list(self.speeds.values())
        increase = all(first < second for first, second in pairwise(least))
        if least and not (least[0] == 0.0 and increase and np.isfinite(least[-1])):
            raise WideberthError(
                f"protocol.speeds is {self.speeds}; wanted the least speed of each class, m/s: "
                "0 for the first, and more from each to the next"
            )

    @property
    def least(self) -> int:
        """Rows that must follow the newest observed one."""
        return self.predicted if self.windows == "full" else SHORTEST

    def text(self, dt: float) -> str:
        """Say in one line which windows are scored and how; ``fitted`` says who learnt."""
        kind = "full windows" if self.windows == "full" else f"windows from {SHORTEST} on"
        apart = "" if self.stride == 1 else f", every {self.stride} rows"
        return (
            f"{self.observed} + {self.predicted} rows of {dt:g} s, {kind}{apart}, "
            f"floor {self.floor:g} m"
        )


@final
@dataclass(frozen=True, eq=False)
class ForecastInstant:
    """One row of a recording at which forecasts are scored.

    Attributes
    ----------
    row : in the recording.
    tracks : of all people seen at this row, and the ``observed`` rows up to it.
    scored : indices into the tracks of those who are scored.
    truth : (K, predicted, D), m, what the scored ones then did; NaN after the first sample
        missing.
    """

    row: int
    tracks: Tracks
    scored: IntArray
    truth: Array


def window_places(data: PredictionData, recording: Recording, how: Protocol) -> IntArray:
    """Track and newest observed row of every window, (W, 2), by row and then by track."""
    found = cut_windows(data.whole(recording), how.observed, how.least)
    places = np.stack([found.obstacle, found.row], axis=1)
    kept = places[places[:, 1] % how.stride == 0]
    return np.asarray(kept[np.lexsort(kept.T)])


def moments(
    data: PredictionData, recording: Recording, how: Protocol
) -> Iterator[ForecastInstant]:
    """Yield every row of a recording, from the first; ``scored`` is empty without windows."""
    places = window_places(data, recording, how)
    length = len(recording.times)
    for row in range(length):
        tracks = recording.tracks(row, how.observed, radius=data.radius, noise=data.noise)
        who = places[places[:, 1] == row, 0]
        where = {ident: index for index, ident in enumerate(tracks.ids)}
        scored = np.array([where[recording.ids[i]] for i in who], dtype=np.int64)
        truth = np.full((len(who), how.predicted, tracks.dimension), np.nan)
        ahead = recording.positions[who, row + 1 : row + 1 + how.predicted]
        seen = np.isfinite(ahead).all(axis=2)
        unbroken = np.logical_and.accumulate(seen, axis=1)
        truth[:, : ahead.shape[1]] = np.where(unbroken[..., None], ahead, np.nan)
        yield ForecastInstant(row, tracks, scored, truth)


def shown_windows(
    data: PredictionData, recording: Recording, how: Protocol, quantiles: Sequence[float]
) -> list[tuple[int, str]]:
    """Choose windows to draw: row and identity of some that are more or less of a surprise.

    Of all windows known in full of those who get somewhere (of all if none does) they are
    those whose distance of the last position from that of a person who walks straight on has
    these quantiles.
    """
    found: list[tuple[float, int, str, float]] = []
    for moment in moments(data, recording, how):
        past = moment.tracks.positions[moment.scored]
        straight = past[:, -1] + how.predicted * (past[:, -1] - past[:, -2])
        gaps = np.linalg.norm(moment.truth[:, -1] - straight, axis=1).tolist()
        ways = np.linalg.norm(moment.truth[:, -1] - past[:, -1], axis=1).tolist()
        idents = [moment.tracks.ids[index] for index in moment.scored]
        found += [
            (gap, moment.row, ident, way)
            for gap, ident, way in zip(gaps, idents, ways, strict=True)
            if np.isfinite(gap)
        ]
    chosen = sorted([one for one in found if one[-1] >= WAY] or found)
    at = [round(share * (len(chosen) - 1)) for share in quantiles]
    return [chosen[i][1:3] for i in at] if chosen else []

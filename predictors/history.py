"""What every predictor does first: turn tracks with holes into clean histories."""

from dataclasses import dataclass

import numpy as np

from ..framework.arrays import Array, BoolArray
from ..framework.tracks import Tracks

LONGEST_GAP = 5
"""Missing samples in a row that are bridged by a straight line; what lies before a longer
gap is dropped (at the paper's 2 Hz this is a gap of 3 s)."""


@dataclass(frozen=True, eq=False)
class History:
    """The past of one obstacle, without holes.

    Attributes
    ----------
    origin : (D,), m, the newest observed position; zeros if there is none.
    positions : (H, D), m, relative to `origin`, oldest first, last row 0. Working relative
        to the obstacle keeps all digits however far the world's origin is away.
    observed : (H,), False where a sample was missing and has been interpolated.
    late : steps between the newest observed sample and the newest sample of the tracks. A
        forecast made from this history must drop its first ``late`` steps.
    """

    origin: Array
    positions: Array
    observed: BoolArray
    late: int

    @property
    def samples(self) -> int:
        """Number of samples that were truly observed."""
        return int(self.observed.sum())


def histories(
    tracks: Tracks, *, length: int | None = None, longest_gap: int = LONGEST_GAP
) -> list[History]:
    """Prepare the history of each obstacle.

    A sample with NaN in any coordinate counts as missing. Gaps between two observed
    samples are filled by linear interpolation, p(t) on the straight line between them.

    Parameters
    ----------
    tracks : as observed.
    length : most grid samples to keep, counted back from the newest observed one.
    longest_gap : gaps of more missing samples than this cut the older part off.

    Returns
    -------
    One `History` per obstacle, in the order of the tracks; an obstacle that was never
    observed has H = 0.
    """
    return [_history(track, length, longest_gap) for track in tracks.positions]


def _history(track: Array, length: int | None, longest_gap: int) -> History:
    """Prepare one track, (T, D)."""
    seen = np.flatnonzero(np.isfinite(track).all(axis=1))
    size = track.shape[1]
    if not seen.size:
        empty = np.zeros((0, size))
        return History(np.zeros(size), empty, np.zeros(0, dtype=np.bool_), len(track))
    long = np.flatnonzero(np.diff(seen) > longest_gap + 1)
    seen = seen[long[-1] + 1 :] if long.size else seen
    if length is not None:
        seen = seen[seen > seen[-1] - length]
    rows = np.arange(seen[0], seen[-1] + 1)
    origin = np.array(track[seen[-1]])
    known = track[seen] - origin
    columns = [np.interp(rows, seen, column) for column in known.T]
    return History(
        origin, np.stack(columns, axis=1), np.isin(rows, seen), len(track) - 1 - int(seen[-1])
    )


def measurement_noise(tracks: Tracks, floor: float) -> Array:
    """Covariance of one position measurement, never below ``floor``: (O, D, D), m^2.

    R = tracks.noise + floor^2 I. Adding (rather than clipping eigenvalues) keeps it
    smooth and turns with the world.
    """
    return np.asarray(tracks.noise + floor**2 * np.eye(tracks.dimension))

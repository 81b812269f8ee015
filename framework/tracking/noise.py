"""Measurement noise, estimated from tracks: how far measured positions lie beside a smooth way."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, TypeAlias

import numpy as np

from ..values.arrays import Array, BoolArray

IntArray: TypeAlias = np.ndarray[Any, np.dtype[np.int64]]

LENGTH, STRIDE, FEWEST = 8, 4, 6
"""Samples of a window, samples from one window to the next, and fewest that a window must hold."""
DEVIATIONS = np.geomspace(1e-3, 1.0, 41)
"""m, deviations that are compared; the first and the last stand for all beyond."""
STRENGTHS = np.geomspace(1e-9, 1e1, 19)
"""m^2, strengths of white acceleration, q dT^3, and of white jerk, q dT^5, in a window."""
USUAL, SPREAD = 0.03, np.log(3.0)
"""m, and deviation of its logarithm: what is taken before anything was measured. Two windows of a
straight walk outweigh it."""
BOUND = 10.0
"""nat; no window counts against a deviation by more, so that one jump does not decide."""
SAME = 1e-6
"""m; a second difference below it vanishes."""
TINY, UNEVEN = 0.01, 8.0
"""Median spacings between two samples of a window, at least and at most."""
HUGE = 1e9
"""m; positions so far away have lost the digits that tell noise."""
MOST = 2000
"""Windows of one recording that are looked at, evenly spaced."""
MEMORY = 500
"""Windows over which a running estimate forgets."""


@dataclass(frozen=True)
class NoiseEstimate:
    """The noise of a sensor as its tracks show it.

    Attributes
    ----------
    deviation : m, standard deviation of a measured position along each axis.
    samples : that it was estimated from; 0 if there were none, and ``deviation`` is `USUAL`.
    tracks : that they belong to.
    """

    deviation: float
    samples: int
    tracks: int

    def covariance(self, size: int) -> Array:
        """Covariance of one measured position, (D, D), m^2."""
        return self.deviation**2 * np.eye(size)

    @property
    def text(self) -> str:
        """The estimate in a sentence.

        Examples
        --------
        >>> NoiseEstimate(0.0981, 3120, 41).text
        'measurement noise estimated as 0.098 m from 3120 samples of 41 tracks'
        """
        if not self.samples:
            return (
                f"measurement noise not estimated: no track has {FEWEST} measured samples among "
                f"{LENGTH} in a row; taken as {self.deviation:.2g} m"
            )
        beyond = {DEVIATIONS[0]: "at most ", DEVIATIONS[-1]: "at least "}.get(self.deviation, "")
        return (
            f"measurement noise estimated as {beyond}{self.deviation:.2g} m from "
            f"{self.samples} samples of {self.tracks} track{'s' if self.tracks > 1 else ''}"
        )


@dataclass(frozen=True, eq=False)
class NoiseEvidence:
    """Log likelihood of each of `DEVIATIONS`, added up over windows of tracks.

    In a window of 8 samples an obstacle moves under white acceleration or white jerk of unknown
    strength q, and each position is measured with white noise of variance r^2 per axis:

    z = (1, t, t^2) c + p + e,   Cov(p) = q K,   Cov(e) = r^2 I,
    K_ij = int_0^min(t_i, t_j) (t_i - u)^k (t_j - u)^k / k!^2 du,   k = 1 or 2

    Place, velocity and acceleration c are unknown. Let the columns of N span what is orthogonal
    to (1, t, t^2), and N' K N = V diag(l) V'. Then the entries of V' N' z are independent, with
    variances r^2 + q l_j, and their density is a number per r, q and k. Both k and strengths q
    of all magnitudes are equally likely in each window, so that a person who walks straight,
    turns or stops is described by a strength of his own; windows in which the motion is smooth
    determine the noise. Likelihoods of windows multiply. The estimate is the r of the
    largest product with a weak prior about `USUAL`, found by a parabola through the best three
    of the grid.

    Windows of which half of the second differences vanish are left out: annotators and trackers
    repeat or interpolate positions that they did not measure. Noise must be white; what a filter
    has smoothed looks less noisy than it is.

    Attributes
    ----------
    likelihood : (41,), nat, of each deviation, relative to the likeliest in each window.
    windows, samples, tracks : that were looked at.
    """

    likelihood: Array
    windows: int = 0
    samples: int = 0
    tracks: int = 0

    @classmethod
    def none(cls) -> "NoiseEvidence":
        """Return the evidence of nothing."""
        return cls(np.zeros(len(DEVIATIONS)))

    def joined(
        self, found: Array, samples: int, tracks: int, memory: int | None = None
    ) -> "NoiseEvidence":
        """Return the evidence with that of more windows.

        Parameters
        ----------
        found : (W, 41), of `window_likelihoods`; windows that it left out are not counted.
        samples, tracks : that had not been looked at before.
        memory : windows after which older ones count 1/e; by default all count alike.
        """
        used = np.isfinite(found).all(axis=1)
        number = int(used.sum())
        if not number:
            return self
        kept = 1.0 if memory is None else (1.0 - 1.0 / memory) ** number
        return NoiseEvidence(
            kept * self.likelihood + found[used].sum(axis=0),
            self.windows + number,
            self.samples + samples,
            self.tracks + tracks,
        )

    @cached_property
    def estimate(self) -> NoiseEstimate:
        """The likeliest deviation; `USUAL` where there is no evidence."""
        return NoiseEstimate(self._likeliest(), self.samples, self.tracks)

    def _likeliest(self) -> float:
        logarithm = np.log(DEVIATIONS)
        total = self.likelihood - 0.5 * ((logarithm - np.log(USUAL)) / SPREAD) ** 2
        best = int(np.argmax(total))
        if not self.windows or not 0 < best < len(total) - 1:
            return float(DEVIATIONS[best]) if self.windows else USUAL
        before, top, after = total[best - 1 : best + 2]
        shift = 0.5 * (before - after) / (before - 2.0 * top + after)
        return float(np.exp(logarithm[best] + shift * (logarithm[1] - logarithm[0])))


def estimated_noise(positions: Array) -> NoiseEstimate:
    """Estimate the noise that all tracks of a recording share; see `NoiseEvidence`.

    On synthetic walks and drives with pauses, turns and gaps, 200 samples with 0.5 to 20 cm of
    noise, every 0.1 to 0.5 s, it is within 20 %. Where the noise is small beside what jerks do
    between two samples (half a centimetre every 0.5 s on a tight circle of 0.5 m at 1 m/s), it
    can be several times too small or large, and then matters little to a forecast.

    Parameters
    ----------
    positions : (O, T, D), m, on a uniform grid, NaN where not measured.
    """
    windows = _grid_windows(positions)
    count = len(windows)
    windows = windows[:: max(-(-count // MOST), 1)]
    if not len(windows):
        return NoiseEstimate(USUAL, 0, 0)
    track, start = windows.T
    rows = start[:, None] + np.arange(LENGTH)
    cut = positions[track[:, None], rows]
    known = np.asarray(np.isfinite(cut).all(axis=2))
    found = window_likelihoods([
        (np.flatnonzero(seen).astype(np.float64), one[seen])
        for seen, one in zip(known, cut, strict=True)
    ])  # fmt: skip
    used = np.isfinite(found).all(axis=1)
    looked = np.zeros(positions.shape[:2], dtype=np.bool_)
    looked[track[used, None], rows[used]] = known[used]
    number = int(looked.sum()), int(looked.max(axis=1).sum())
    return NoiseEvidence.none().joined(found, *number).estimate


def _grid_windows(positions: Array) -> IntArray:
    """Track and first row of each window that holds enough samples, (W, 2)."""
    count, rows, _ = positions.shape
    if rows < LENGTH or not count:
        return np.empty((0, 2), dtype=np.int64)
    windows = []
    for track in range(count):  # a recording of hours has too many cells for copies of all
        sampled = np.isfinite(positions[track]).all(axis=1)
        total = np.concatenate([[0], np.cumsum(sampled)])
        enough = total[LENGTH:] - total[:-LENGTH] >= FEWEST
        place = np.arange(rows - LENGTH + 1) - np.argmax(sampled)
        starts = np.flatnonzero(enough & (place % STRIDE == 0))
        windows.append(np.stack([np.full(len(starts), track), starts], axis=1))
    return np.concatenate(windows).astype(np.int64)


def window_likelihoods(windows: Sequence[tuple[Array, Array]]) -> Array:
    """Log likelihood of each deviation in each window, (W, 41), nat; NaN where it is left out.

    Parameters
    ----------
    windows : times, (n,), s or rows, increasing, and positions, (n, D), m, of at least 6
        samples each.
    """
    with np.errstate(all="ignore"):  # of numbers too large to square; such windows are left out
        return _likelihoods(windows)


def _likelihoods(windows: Sequence[tuple[Array, Array]]) -> Array:
    """Return `window_likelihoods`, with NumPy's warnings."""
    found = np.full((len(windows), len(DEVIATIONS)), np.nan)
    for times, alike in _by_times(windows):
        positions = np.stack([windows[place][1] for place in alike])
        positions = positions - positions[:, :1]
        measured = np.asarray(~_copied(times, positions), dtype=np.bool_)
        each = np.concatenate(
            [_densities(positions[measured], *basis) for basis in _bases(times)], axis=2
        )
        top = each.max(axis=2, keepdims=True)
        total = top[..., 0] + np.log(np.exp(each - top).sum(axis=2))
        total -= total.max(axis=1, keepdims=True)
        found[np.array(alike)[measured]] = np.logaddexp(total, -BOUND)
    return found


def _by_times(windows: Sequence[tuple[Array, Array]]) -> Iterator[tuple[Array, list[int]]]:
    """Yield times in median spacings, from 0, and the windows that share them."""
    groups: dict[tuple[float, ...], list[int]] = {}
    for place, (times, positions) in enumerate(windows):
        step = np.diff(times) / np.median(np.diff(times))
        if step.min() > TINY and step.max() <= UNEVEN and np.abs(positions).max() < HUGE:
            key = (0.0, *np.cumsum(step).round(3).tolist())
            groups.setdefault(key, []).append(place)
    for key, alike in groups.items():
        yield np.array(key), alike


def _copied(times: Array, positions: Array) -> BoolArray:
    """Whether half of the second differences vanish, (W,), time in spacings."""
    step = np.diff(times)[:, None]
    velocity = np.diff(positions, axis=1) / step
    bend = np.abs(np.diff(velocity, axis=1)).max(axis=2)
    return np.asarray((bend < SAME).mean(axis=1) >= 0.5, dtype=np.bool_)


def _densities(positions: Array, basis: Array, share: Array) -> Array:
    """Log density of windows (W, n, D) for each deviation and strength, (W, 41, 19), nat."""
    square = np.sum(np.einsum("wnd,nm->wmd", positions, basis) ** 2, axis=2)
    variance = DEVIATIONS[:, None, None] ** 2 + STRENGTHS[:, None] * share
    normal = 0.5 * positions.shape[2] * np.log(variance).sum(axis=2)
    return np.asarray(-normal - 0.5 * np.einsum("wm,rqm->wrq", square, 1.0 / variance))


def _bases(times: Array) -> Iterator[tuple[Array, Array]]:
    """Yield the directions N V, (n, n - 3), and l, (n - 3,), of each kind of motion."""
    least = np.minimum.outer(times, times)
    apart = np.abs(np.subtract.outer(times, times))
    acceleration = least**3 / 3 + apart * least**2 / 2
    jerk = (least**5 / 5 + apart * least**4 / 2 + apart**2 * least**3 / 3) / 4
    middle = times - times.mean()
    rest = np.linalg.qr(np.vander(middle, 3), mode="complete")[0][:, 3:]
    for kernel in (acceleration, jerk):
        share, turned = np.linalg.eigh(rest.T @ kernel @ rest)
        yield rest @ turned, np.maximum(share, 0.0)

"""Windows: pieces of recorded tracks, each a history with its true future."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np

from ...framework.values.arrays import Array, whole
from ...framework.values.errors import WideberthError
from ...framework.values.tracks import Tracks

IntArray: TypeAlias = np.ndarray[Any, np.dtype[np.int64]]


@dataclass(frozen=True, eq=False)
class Windows:
    """Fully observed stretches of tracks, each taken for an obstacle of its own.

    One call of `Predictor.predict` on ``tracks`` forecasts all of them. They stem from
    different times, so that a predictor which looks at neighbours must not be fed with them.

    Attributes
    ----------
    tracks : W obstacles of ``observed`` samples each.
    future : (W, predicted, D), m, the samples that followed.
    obstacle : (W,), index of the track that a window was cut from.
    row : (W,), row of its newest observed sample.
    """

    tracks: Tracks
    future: Array
    obstacle: IntArray
    row: IntArray

    def __len__(self) -> int:
        """Count the windows."""
        return len(self.future)


def cut_windows(scene: Tracks, observed: int, predicted: int, stride: int = 1) -> Windows:
    """Cut every stretch of ``observed + predicted`` consecutive samples out of tracks.

    Parameters
    ----------
    scene : tracks of a whole recording, NaN where unobserved.
    observed : samples that the predictor sees.
    predicted : samples that follow, the newest observed one not included.
    stride : rows between the starts of two windows of one track.

    Returns
    -------
    Windows, by track and then by row; none where no stretch is long enough.
    """
    whole("observed", observed)
    whole("predicted", predicted, least=0)
    whole("stride", stride)
    total = observed + predicted
    seen = np.isfinite(scene.positions).all(axis=2)
    starts = max(scene.positions.shape[1] - total + 1, 0)
    runs = np.zeros((len(scene), starts), dtype=np.bool_)
    if runs.size:
        counts = np.concatenate([np.zeros((len(scene), 1)), np.cumsum(seen, axis=1)], axis=1)
        runs = counts[:, total:] - counts[:, :-total] == total
    obstacle, start = np.nonzero(runs)
    first = np.argmax(runs, axis=1)[obstacle] if runs.size else start
    kept = (start - first) % stride == 0
    obstacle, start = obstacle[kept], start[kept]
    whole_window = scene.positions[obstacle[:, None], start[:, None] + np.arange(total)]
    joint = scene.state_covariance
    tracks = Tracks(
        whole_window[:, :observed],
        scene.dt,
        tuple(f"{scene.ids[o]}@{s}" for o, s in zip(obstacle, start, strict=True)),
        scene.radius[obstacle],
        scene.noise[obstacle],
        scene.stamp,
        None if joint is None else joint[obstacle],
    )
    row = np.asarray(start + observed - 1, dtype=np.int64)
    return Windows(tracks, whole_window[:, observed:], obstacle.astype(np.int64), row)


def windows_of(
    dataset: Sequence[Tracks], observed: int, predicted: int, *, wanted: int, who: str
) -> list[Windows]:
    """Cut the windows of every scene that a predictor is fitted to.

    Parameters
    ----------
    dataset : scenes; all must have the same number of coordinates.
    observed, predicted : as in `cut_windows`.
    wanted : fewest windows in all scenes together.
    who : name of the predictor, for the message.

    Raises
    ------
    WideberthError : fewer windows than wanted, or scenes of different dimensions.
    """
    same_dimension(dataset, who)
    found = [cut_windows(scene, observed, predicted) for scene in dataset]
    number = sum(map(len, found))
    if number < wanted:
        raise WideberthError(
            f"{who}.fit: {len(found)} scenes hold {number} windows of {observed} + {predicted} "
            f"consecutive samples; wanted at least {wanted}: give more or longer recordings"
        )
    return found


def same_dimension(dataset: Sequence[Tracks], who: str) -> None:
    """Refuse scenes with different numbers of coordinates.

    Raises
    ------
    WideberthError : names the numbers found.
    """
    sizes = {scene.dimension for scene in dataset}
    if len(sizes) > 1:
        raise WideberthError(
            f"{who}.fit: scenes have {' and '.join(map(str, sorted(sizes)))} coordinates; fit "
            "one predictor to scenes of one dimension"
        )

"""When truth falls due for the online calibration, and where it was then."""

import numpy as np

from wideberth.framework.tracks import Tracks
from wideberth.predictors.adaptive_conformal import _position


def tracks_of(positions: np.ndarray, stamp: float) -> Tracks:
    count, _, size = positions.shape
    names = tuple(f"o{i}" for i in range(count))
    return Tracks(positions, 0.5, names, np.full(count, 0.3), np.zeros((count, size, size)), stamp)


def test_truth_is_looked_up_between_two_samples() -> None:
    """And is not known before the first sample, after the newest, or where either is missing."""
    seen = tracks_of(np.array([[[0.0, 0.0], [2.0, 4.0], [6.0, 4.0]]]), stamp=10.0)
    for time, wanted in (
        (9.0, (0, 0)),
        (9.125, (0.5, 1)),
        (9.5, (2, 4)),
        (9.75, (4, 4)),
        (10, (6, 4)),
    ):
        np.testing.assert_allclose(_position(seen, time), [wanted], err_msg=str(time))
    assert np.isnan(_position(seen, 8.9)).all()
    alone = tracks_of(seen.positions[:, -1:], stamp=10.0)
    np.testing.assert_array_equal(_position(alone, 10.0), [[6.0, 4.0]])
    assert np.isnan(_position(alone, 9.9)).all()
    assert np.isnan(_position(tracks_of(seen.positions[:, :0], stamp=10.0), 10.0)).all()

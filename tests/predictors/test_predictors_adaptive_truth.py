"""When truth falls due for the online calibration, and where it was then."""

import numpy as np

from wideberth.framework.values.tracks import Tracks
from wideberth.predictors.adaptive_conformal import AdaptiveConformal, _position
from wideberth.predictors.static import Static


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


def test_a_fit_takes_the_class_of_speed_from_the_newest_sample_on() -> None:
    """Who stands in a forecast of one step is of the slowest class, however fast he came."""
    rng = np.random.default_rng(12)
    walks = 0.01 * rng.standard_normal((20, 20, 2)).cumsum(axis=1)
    walks[10:, :, 0] += 0.5 * np.arange(20.0)
    scene = tracks_of(walks, stamp=9.5)
    both = AdaptiveConformal(Static(), observed=4, steps=1, speeds=(0.5,)).fit([scene])
    whole = AdaptiveConformal(Static(), observed=4, steps=1, speeds=()).fit([scene])
    assert whole.start is not None and both.start == whole.start * 2

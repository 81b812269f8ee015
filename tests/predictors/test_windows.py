"""Windows cut from recordings, against brute force."""

import numpy as np
import pytest

from wideberth.framework.values.errors import WideberthError
from wideberth.framework.values.tracks import Tracks
from wideberth.predictors.data.windows import cut_windows, windows_of


def scene(rng, count=6, rows=30, holes=0.1, size=2):
    positions = rng.normal(size=(count, rows, size))
    positions[rng.random((count, rows)) < holes] = np.nan
    noise = np.tile(1e-4 * np.eye(size), (count, 1, 1))
    return Tracks(positions, 0.4, tuple(f"p{i}" for i in range(count)), np.ones(count), noise)


@pytest.mark.parametrize("stride", [1, 3])
def test_windows_are_those_that_brute_force_finds(stride):
    tracks = scene(np.random.default_rng(0))
    cut = cut_windows(tracks, 3, 4, stride)
    found = []
    for track in range(len(tracks)):
        starts = [
            start
            for start in range(30 - 7 + 1)
            if np.isfinite(tracks.positions[track, start : start + 7]).all()
        ]
        found += [(track, s) for s in starts if (s - starts[0]) % stride == 0]
    assert list(zip(cut.obstacle, cut.row - 2, strict=True)) == found
    assert len(cut) > 5
    for index, (track, start) in enumerate(found):
        piece = tracks.positions[track, start : start + 7]
        np.testing.assert_array_equal(cut.tracks.positions[index], piece[:3])
        np.testing.assert_array_equal(cut.future[index], piece[3:])


def test_short_or_empty_scenes_give_no_windows():
    tracks = scene(np.random.default_rng(1), rows=5)
    assert len(cut_windows(tracks, 4, 4)) == 0
    assert len(cut_windows(tracks.select([]), 2, 2)) == 0
    assert cut_windows(tracks, 4, 4).future.shape == (0, 4, 2)


def test_a_small_dataset_is_refused_with_what_it_holds():
    tracks = scene(np.random.default_rng(2), holes=0.0)
    assert len(windows_of([tracks], 8, 12, wanted=60, who="mine")[0]) == 66
    with pytest.raises(WideberthError, match=r"mine.fit: 1 scenes hold 66 windows of 8 \+ 12"):
        windows_of([tracks], 8, 12, wanted=67, who="mine")
    other = scene(np.random.default_rng(2), size=3)
    with pytest.raises(WideberthError, match="2 and 3 coordinates"):
        windows_of([tracks, other], 8, 12, wanted=1, who="mine")


@pytest.mark.parametrize(
    ("numbers", "words"),
    [((0, 1, 1), "observed is 0"), ((1, -1, 1), "predicted is -1"), ((1, 1, 0), "stride is 0")],
)
def test_numbers_that_cut_nothing_are_refused(numbers, words):
    positions = np.zeros((1, 5, 2))
    tracks = Tracks(positions, 0.5, ("a",), np.full(1, 0.3), np.zeros((1, 2, 2)))
    with pytest.raises(WideberthError, match=words):
        cut_windows(tracks, *numbers)

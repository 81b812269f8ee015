"""How far along a path a robot has come."""

import numpy as np
import pytest

from wideberth.framework.values.path import Path
from wideberth.framework.values.path_progress import PathProgress, ReferenceProgress


def follow(path: Path, places: np.ndarray) -> list[float]:
    """Return the arc length at each place of a drive."""
    progress, found = ReferenceProgress(path), []
    for place in places:
        progress, arc = progress.advanced(place)
        found.append(arc)
    return found


def test_a_robot_that_cuts_a_corner_and_waits_comes_past_it():
    spike = Path([(0.0, 0.0), (4.0, 0.0), (4.0, -1.0), (4.4, 10.0)])
    cut = np.array([[x, 1.2] for x in np.arange(0.0, 4.01, 0.1)])
    rest = np.array([[4.04, y] for y in np.arange(1.2, 4.0, 0.1)])
    arcs = follow(spike, np.concatenate([cut, rest, np.tile(rest[-1:], (30, 1))]))
    assert arcs[-1] > 5.0 + 4.5, "it still looks at the leg before the corner"
    assert np.diff(arcs).min() >= 0.0


def test_a_robot_that_waits_beside_a_spike_comes_past_it():
    """Its reference goes to the tip and back, and it waits for that near the way back."""
    spike = Path([(0.0, 0.0), (4.0, 0.0), (4.0, -2.0), (5.0, 10.0)])
    there = np.array([[x, 0.3] for x in np.arange(0.0, 4.3, 0.1)])
    arcs = follow(spike, np.concatenate([there, np.tile([4.4, 0.3], (30, 1))]))
    assert arcs[len(there)] < 5.0 and arcs[-1] > 7.0


def test_a_robot_that_waits_on_its_path_stays_where_it_is():
    loop = Path([(0.0, 0.0), (4.0, 0.0), (4.0, 2.0), (2.0, 2.0), (2.0, -2.0)])
    arcs = follow(loop, np.array([[0.0, 0.0], [1.0, 0.0], *[[1.97, 0.0]] * 50]))
    assert arcs[-1] == pytest.approx(1.97)


def test_a_robot_on_a_path_that_crosses_itself_goes_all_around():
    angle = np.linspace(0.0, 2.0 * np.pi, 60)
    loop = np.stack([6.0 + 3.0 * np.sin(angle), 3.0 - 3.0 * np.cos(angle)], axis=1)
    path = Path(np.concatenate([[[0.0, 0.0]], loop, [[12.0, 0.0]]]))
    wanted = np.arange(0.0, path.length, 0.2)
    assert np.allclose(follow(path, path.at(wanted)), wanted, atol=1e-9)
    aside = path.at(wanted) + np.array([0.0, 0.3])  # driven beside it
    assert np.abs(np.array(follow(path, aside)) - wanted).max() < 0.4


@pytest.mark.parametrize("beside", [0.0, 0.02, -0.09])
@pytest.mark.parametrize("kind", [PathProgress, ReferenceProgress])
def test_a_robot_that_stands_before_the_tip_of_a_way_back_comes_past_it(kind, beside):
    path = Path([(0.0, 0.0), (4.0, 0.0), (-4.0, beside)])
    progress = kind(path)
    for x in [*np.arange(0.0, 3.0, 0.1), *[3.0] * 12, *np.arange(3.0, 3.5, 0.1), *[3.5] * 30]:
        progress, arc = progress.advanced(np.array([x, 0.0]), 3.0)
    assert 5.0 - 1e-3 <= arc < 5.01, "it is on the way back, and does not fall back from there"
    for x in np.arange(3.5, -4.01, -0.1):
        progress, arc = progress.advanced(np.array([x, beside]), 3.0)
    assert arc == pytest.approx(path.length, abs=1e-2)


def test_a_way_back_beyond_what_is_looked_ahead_is_not_taken():
    progress = PathProgress(Path([(0.0, 0.0), (4.0, 0.0), (0.0, 0.0)]))
    for x in [*np.arange(0.0, 1.0, 0.1), *[1.0] * 30]:
        progress, arc = progress.advanced(np.array([x, 0.0]), 3.0)
    assert arc == pytest.approx(1.0)


def test_a_robot_that_has_not_set_out_takes_no_way_back():
    """It turns on the spot at first, at the end of its path too."""
    progress = PathProgress(Path([(0.0, 0.0), (1.0, 0.0), (0.0, 0.0)]))
    for _ in range(40):
        progress, arc = progress.advanced(np.zeros(2), 3.0)
    assert arc == 0.0


def test_who_only_watches_takes_the_way_back_once_the_robot_drives_back():
    progress = PathProgress(Path([(0.0, 0.0), (4.0, 0.0), (0.0, 0.0)]))
    for x in [*np.arange(0.0, 3.0, 0.1), *[2.9] * 20]:
        progress, arc = progress.advanced(np.array([x, 0.0]))
    assert arc == pytest.approx(2.9)
    for x in np.arange(2.9, 1.0, -0.1):
        progress, arc = progress.advanced(np.array([x, 0.0]))
    assert arc == pytest.approx(8.0 - x)


def test_a_path_that_has_moved_a_little_is_gone_on_along():
    loop = np.array([(0.0, 0.0), (4.0, 0.0), (4.0, 4.0), (0.0, 4.0), (0.0, 0.0)])
    progress = ReferenceProgress(Path(loop))
    for place in progress.path.at(np.arange(0.0, 15.9, 0.2)):
        moved = progress.path.points + 0.001
        progress, arc = progress.on(Path(moved)).advanced(place)
    assert arc > 15.5
    assert progress.on(Path(loop + 1.0)).last is None
    assert progress.on(Path(loop[:-1])).last is None
    end = progress.advanced(loop[-1] + 0.08)[0].rest
    assert end.length < 0.2, "at its end nothing is left of the loop"


def test_who_follows_no_timed_reference_does_not_skip_a_spike():
    """People who wait near a turn of their way still walk to its tip."""
    progress = PathProgress(Path([(0.0, 0.0), (4.0, 0.0), (4.0, -2.0), (5.0, 10.0)]))
    for place in np.concatenate([[[x, 0.3] for x in np.arange(0.0, 4.3, 0.1)], [[4.4, 0.3]] * 30]):
        progress, arc = progress.advanced(place)
    assert arc < 5.0

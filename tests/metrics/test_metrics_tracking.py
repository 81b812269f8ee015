"""GOSPA against brute force and another library; what is counted along a run."""

from datetime import datetime
from itertools import permutations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from wideberth import WideberthError
from wideberth.framework.values.arrays import Array
from wideberth.framework.values.sensing import TrackedObstacle
from wideberth.metrics.tracking import gospa, nees, track_scores

places = st.lists(
    st.tuples(st.floats(-3, 3, allow_nan=False), st.floats(-3, 3, allow_nan=False)), max_size=4
)


def brute(truth: Array, found: Array, cut: float, order: float) -> float:
    """The least cost over all partial assignments, from the definition."""
    few, many = sorted((np.reshape(truth, (-1, 2)), np.reshape(found, (-1, 2))), key=len)
    best = np.inf
    for chosen in permutations(range(len(many)), len(few)):
        distance = np.linalg.norm(few - many[list(chosen)], axis=1)
        paired = np.minimum(distance**order, cut**order).sum()  # unpaired: twice c^p / 2
        best = min(best, paired + cut**order / 2 * (len(many) - len(few)))
    return float(best ** (1 / order))


@settings(max_examples=60, deadline=None)
@given(places, places, st.floats(0.2, 3.0), st.sampled_from([1.0, 2.0, 3.0]))
def test_the_least_over_all_assignments(
    truth: list, found: list, cut: float, order: float
) -> None:
    got = gospa(np.array(truth), np.array(found), cut=cut, order=order)
    assert got.value == pytest.approx(brute(truth, found, cut, order), abs=1e-9)
    assert got.pairs + got.missed == len(truth) and got.pairs + got.false == len(found)


def test_nothing_and_nobody() -> None:
    assert gospa([], []).value == 0.0
    assert gospa([[1.0, 2.0]], [], cut=2.0).value == pytest.approx(2.0 / np.sqrt(2.0))
    assert gospa([], [[1.0, 2.0]], cut=2.0, order=1.0).value == pytest.approx(1.0)
    with pytest.raises(WideberthError, match=r"order is 0\.5; wanted at least 1"):
        gospa([], [], order=0.5)
    with pytest.raises(WideberthError, match="cut"):
        gospa([], [], cut=0.0)


def test_stone_soup_says_the_same() -> None:
    reason = "compares with Stone Soup, of the extra bench"
    library = pytest.importorskip("stonesoup.metricgenerator.ospametric", reason=reason)
    state = pytest.importorskip("stonesoup.types.state", reason=reason)
    rng = np.random.default_rng(0)
    other = library.GOSPAMetric(p=2, c=1.0, measure=_measure())
    for count, wrong in ((3, 0), (5, 2), (1, 4), (4, 1)):
        truth = rng.uniform(-2, 2, (count, 2))
        found = np.concatenate([truth[1:], rng.uniform(-2, 2, (wrong, 2))])
        found = found + 0.2 * rng.standard_normal(found.shape)
        ours = gospa(truth, found)
        now = datetime(2020, 1, 1)
        theirs, _ = other.compute_gospa_metric(
            [state.State(place.reshape(-1, 1), now) for place in found],
            [state.State(place.reshape(-1, 1), now) for place in truth],
        )
        values = theirs.value if hasattr(theirs, "value") else theirs
        assert ours.value == pytest.approx(values["distance"])
        assert ours.located**2 == pytest.approx(values["localisation"])
        assert ours.missed * 0.5 == pytest.approx(values["missed"])
        assert ours.false * 0.5 == pytest.approx(values["false"])


def _measure() -> object:
    """Return the distance of positions, as Stone Soup wants it."""
    from stonesoup.measures import Euclidean

    return Euclidean()


def track(ident: str, x: float, speed: float = 0.0, spread: float = 0.01) -> TrackedObstacle:
    state = np.array([x, 0.0, speed, 0.0])
    return TrackedObstacle(ident, 0.0, state, spread * np.eye(4), 0.3, 0.0)


def test_what_a_run_counts() -> None:
    """One obstacle found late, followed, lost, then under another identity; one never found."""
    still, far = np.array([0.0, 0.0, 0.0, 0.0]), np.array([9.0, 0.0, 0.0, 0.0])
    run = [
        (0.0, {"a": still}, []),
        (0.1, {"a": still, "b": far}, [track("1", 0.3)]),
        (0.2, {"a": still, "b": far}, [track("1", 0.3), track("2", 0.1)]),  # it keeps its track
        (0.3, {"a": still, "b": far}, [track("2", 0.1), track("3", 5.0)]),
    ]
    scores = track_scores(run)
    assert scores.switches == 1 and scores.pairs == 3 and scores.instants == 4
    assert scores.latency == pytest.approx(0.1) and scores.followed == 0.5
    assert scores.missed == pytest.approx(4 / 7) and scores.false == pytest.approx(2 / 4)
    # Of the two tracks beside it at 0.2 s the nearer one counts for the errors.
    assert scores.located == pytest.approx(np.sqrt((0.09 + 0.01 + 0.01) / 3))
    assert scores.nees == pytest.approx((9.0 + 1.0 + 1.0) / 3) and scores.inside == 1.0
    wanted = [gospa([[0, 0]], []).value, gospa([[0, 0], [9, 0]], [[0.3, 0]]).value]
    wanted += [gospa([[0, 0], [9, 0]], [[0.3, 0], [0.1, 0]]).value]
    wanted += [gospa([[0, 0], [9, 0]], [[0.1, 0], [5, 0]]).value]
    assert scores.gospa == pytest.approx(np.mean(wanted))
    assert nees(np.array([1.0, 2.0]), np.diag([1.0, 4.0])) == pytest.approx(2.0)


def test_tracks_that_change_places() -> None:
    """Each track is exact for the other one: switches where they stand apart; no error at all."""
    for apart, switches in ((0.75, 2), (0.4, 0)):
        truth = {"a": np.zeros(4), "b": np.array([apart, 0.0, 0.0, 0.0])}
        run = [
            (0.0, truth, [track("1", 0.0), track("2", apart)]),
            (0.1, truth, [track("1", apart), track("2", 0.0)]),
        ]
        scores = track_scores(run)
        assert scores.switches == switches
        assert scores.nees == 0.0 and scores.inside == 1.0 and scores.missed == 0.0
    off = track_scores([(0.0, truth, [track("1", 0.1), track("2", 0.75)])])
    assert off.inside == 0.5 and off.nees == pytest.approx((1.0 + 12.25) / 2)
    with pytest.raises(WideberthError, match=r"near is 0"):
        track_scores(run, near=0.0)


def test_a_run_without_anything() -> None:
    scores = track_scores([(0.0, {}, [])])
    assert scores.gospa == 0.0 and np.isnan(scores.latency) and np.isnan(scores.nees)


def test_two_tracks_of_one_name_are_two() -> None:
    """The second one stands beside nothing: it is false, whichever of the two comes first."""
    truth = {"a": np.zeros(4)}
    for tracks in ([track("1", 0.0), track("1", 7.0)], [track("1", 7.0), track("1", 0.0)]):
        scores = track_scores([(0.0, truth, tracks)])
        assert scores.false == 1.0 and scores.missed == 0.0 and scores.pairs == 1
        assert scores.gospa == pytest.approx(gospa([[0, 0]], [[0, 0], [7, 0]]).value)

"""GOSPA against brute force and another library; what is counted along a run."""

from dataclasses import asdict
from datetime import datetime
from itertools import permutations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from wideberth import WideberthError
from wideberth.framework.values.arrays import Array
from wideberth.simulation.sensing.perceived import TrackedObstacle
from wideberth_perception.tracking_scores import gospa, nees, track_scores

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
    reason = "compares with Stone Soup, of the dependency group bench"
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


@pytest.mark.parametrize("seed", range(40))
def test_counts_do_not_depend_on_the_order_of_names_and_tracks(seed: int) -> None:
    """Obstacles on a grid, so that distances are equal as well, and tracks that change places."""
    rng = np.random.default_rng(seed)
    run = []
    for k in range(12):
        truth = {name: np.append(rng.integers(0, 4, 2) * 0.2, [0.0, 0.0]) for name in "abc"}
        places = [truth[name][0] for name in rng.permutation(list(truth))]
        run.append((0.1 * k, truth, [track(str(i), x) for i, x in enumerate(places)]))
    turned = [(t, dict(reversed(truth.items())), found[::-1]) for t, truth, found in run]
    assert asdict(track_scores(run)) == asdict(track_scores(turned))


def test_a_track_that_went_over_to_another_obstacle_is_its_track() -> None:
    """The obstacle that was its former one has no claim on it, however near it stands."""

    def state(x: float) -> Array:
        return np.array([x, 0.0, 0.0, 0.0])

    run = [
        (0.0, {"a": state(0.0), "b": state(9.0)}, [track("1", 0.0), track("2", 9.0)]),
        (0.4, {"a": state(3.0), "b": state(9.0)}, [track("1", 9.0)]),  # b goes on as 1
        (0.8, {"a": state(8.8), "b": state(9.0)}, [track("1", 8.8), track("3", 9.0)]),
        (1.2, {"a": state(6.0), "b": state(9.0)}, [track("1", 9.0), track("3", 6.0)]),
    ]
    assert track_scores(run).switches == 2  # b from 2 to 1, a from 1 to 3


@pytest.mark.parametrize("order", [1.0, 7.0, 60.0, 1e3, 1e6])
@pytest.mark.parametrize("unit", [1e-3, 1.0, 1e3])
def test_extreme_orders(order: float, unit: float) -> None:
    """Against the least of all assignments, in logarithms: sums of powers have no floats here."""
    rng = np.random.default_rng(0)
    for count, more in ((1, 2), (3, 3), (4, 3), (2, 4)):
        truth, found = (unit * rng.uniform(-1.0, 1.0, (size, 2)) for size in (count, more))
        for cut in (0.5 * unit, 4.0 * unit):
            scores = gospa(truth, found, cut=cut, order=order)
            value, located = in_logarithms(truth, found, cut, order)
            assert scores.value == pytest.approx(value, rel=1e-9)
            assert scores.located == pytest.approx(located, rel=1e-9)


def in_logarithms(truth: Array, found: Array, cut: float, order: float) -> tuple[float, float]:
    """Return the value and the located part of the best of all assignments.

    Of assignments whose sums are equal in floats the one with the smaller lengths is taken.
    """
    few, many = sorted((truth, found), key=len)
    best = (np.inf, (np.inf,), 0.0)
    for chosen in permutations(range(len(many)), len(few)):
        distance = np.linalg.norm(few - many[list(chosen)], axis=1)
        near = distance[distance < cut]
        single = len(truth) + len(found) - 2 * len(near)
        unpaired = [order * np.log(cut) + np.log(single / 2.0)] if single else []
        whole = np.logaddexp.reduce([*(order * np.log(near)), *unpaired]) / order
        part = np.exp(np.logaddexp.reduce(order * np.log(near)) / order) if len(near) else 0.0
        key = (round(float(whole), 13), tuple(sorted(np.minimum(distance, cut))[::-1]), part)
        best = min(best, key)
    return float(np.exp(best[0])), float(best[2])


def test_equal_places_at_extreme_orders_are_found() -> None:
    """A distance of 0.3 m and one of 0 have the same power of 2000, which is 0 in floats."""
    scores = gospa([[0.0, 0.0], [0.3, 0.0]], [[0.3, 0.0], [0.0, 0.0]], order=2000.0)
    assert scores.value == 0.0 and scores.located == 0.0 and scores.pairs == 2
    far = gospa([[0, 0], [0.3, 0], [9, 0]], [[0.3, 0], [0, 0], [5, 0]], order=2000.0)
    assert far.located == 0.0 and (far.pairs, far.missed, far.false) == (2, 1, 1)


def test_a_singular_covariance_says_nothing_about_honesty() -> None:
    exact = track("1", 0.1, spread=0.0)
    flat = TrackedObstacle("2", 0.0, [9.1, 0, 0, 0], np.diag([1.0, 1.0, 1.0, 0.0]), 0.3, 0.0)
    truth = {"a": np.zeros(4), "b": np.array([9.0, 0, 0, 0]), "c": np.array([20.0, 0, 0, 0])}
    scores = track_scores([(0.0, truth, [exact, flat, track("3", 20.3)])])
    assert scores.nees == pytest.approx(9.0) and scores.inside == 1.0
    assert scores.pairs == 3 and scores.located == pytest.approx(np.sqrt((0.01 + 0.01 + 0.09) / 3))
    alone = track_scores([(0.0, {"a": np.zeros(4)}, [exact])])
    assert np.isnan(alone.nees) and np.isnan(alone.inside)

"""Measurements at times of their own: what is refused, what is read from them, and the lag."""

import pickle
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from wideberth import WideberthError
from wideberth.framework.values.measurements import (
    NO_LOG,
    AdmittedMeasurements,
    Measurements,
    measurements_on_grid,
)
from wideberth.framework.values.number_limits import bounded
from wideberth.framework.values.tracks import Tracks

NOISE = np.diag([1e-4, 4e-4])
TIMES = ([1.0, 1.5, 2.25], [], [0.5, 2.0])


def places(number: int, size: int = 2) -> np.ndarray:
    return np.arange(number * size, dtype=float).reshape(number, size)


def sighted(**changes: Any) -> Measurements:
    parts: dict[str, Any] = {
        "times": TIMES,
        "positions": [places(len(times)) for times in TIMES],
        "noise": [np.tile(NOISE, (len(times), 1, 1)) for times in TIMES],
        "log": (4, 7, 5),
    }
    return Measurements(**(parts | changes))


def tracks_of(sightings: Measurements | None, stamp: float = 2.5, **changes: Any) -> Tracks:
    count = 3 if sightings is None else len(sightings)
    parts: dict[str, Any] = {
        "positions": np.zeros((count, 4, 2)),
        "dt": 0.5,
        "ids": [f"o{k}" for k in range(count)],
        "radius": np.full(count, 0.3),
        "noise": np.tile(NOISE, (count, 1, 1)),
    }
    return Tracks(**(parts | {"stamp": stamp, "sightings": sightings} | changes))


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"positions": [places(3)]}, r"measurements\.positions has 1 entries; wanted 3"),
        ({"noise": []}, r"measurements\.noise has 0 entries; wanted 3"),
        ({"log": (1,)}, r"measurements\.log has 1 entries; wanted 3"),
        ({"times": ([1.0, 1.0, 2.0], [], [0.5, 2.0])}, r"measurements\.times\[0\] must increase"),
        ({"times": ([1.0, 1.5, 2.25], [], [2.0, 0.5])}, r"measurements\.times\[2\] must increase"),
        ({"times": ([1.0, 1.5, np.nan], [], [0.5, 2.0])}, r"measurements\.times\[0\]"),
        ({"times": ([[1.0]], [], [0.5, 2.0])}, r"measurements\.times\[0\]"),
        ({"positions": [places(2), places(0), places(2)]}, r"measurements\.positions\[0\]"),
        ({"positions": [places(3), places(0), places(2, 3)]}, r"measurements\.positions\[2\]"),
        (
            {"positions": [places(3), places(0), places(2) + np.inf]},
            r"measurements\.positions\[2\]",
        ),
        ({"noise": [np.tile(-NOISE, (3, 1, 1)), np.zeros((0, 2, 2)), np.tile(NOISE, (2, 1, 1))]},
         r"measurements\.noise\[0\]"),
        ({"noise": [NOISE, np.zeros((0, 2, 2)), np.tile(NOISE, (2, 1, 1))]},
         r"measurements\.noise\[0\]"),
    ],
)  # fmt: skip
def test_what_is_no_measurement_is_refused_by_name(changes: dict[str, Any], words: str) -> None:
    with pytest.raises(WideberthError, match=words):
        sighted(**changes)


def test_newest_and_count_are_those_of_each_obstacle() -> None:
    sightings = sighted()
    assert len(sightings) == 3 and sightings.size == 2
    np.testing.assert_array_equal(sightings.newest, [2.25, -np.inf, 2.0])
    assert sightings.count.tolist() == [3, 0, 2]
    np.testing.assert_array_equal(sightings.positions[2], places(2))
    np.testing.assert_array_equal(sightings.noise[0], np.tile(NOISE, (3, 1, 1)))
    empty = Measurements([], [], [])
    assert len(empty) == 0 and empty.newest.shape == empty.count.shape == (0,)


def test_some_obstacles_and_some_measurements_of_each() -> None:
    sightings = sighted()
    assert sightings.count.tolist() == [3, 0, 2]  # what was read before is read anew
    other = sightings.select([2, 0])
    assert other.log == (5, 4) and other.count.tolist() == [2, 3]
    np.testing.assert_array_equal(other.newest, [2.0, 2.25])
    assert len(sightings.select([])) == 0
    some = sightings.part([slice(2), slice(None), np.array([False, True])])
    assert some.log == sightings.log and some.count.tolist() == [2, 0, 1]
    np.testing.assert_array_equal(some.positions[2], places(2)[1:])
    np.testing.assert_array_equal(some.newest, [1.5, -np.inf, 2.0])


def test_without_numbers_of_logs_nothing_compares() -> None:
    assert sighted(log=None).log == (NO_LOG,) * 3


def test_they_travel_between_processes() -> None:
    again = pickle.loads(pickle.dumps(sighted()))
    assert again.log == (4, 7, 5)
    np.testing.assert_array_equal(again.values[0], sighted().values[0])


def test_the_samples_of_a_grid_are_measurements_relative_to_the_newest_row() -> None:
    positions = np.arange(16.0).reshape(2, 4, 2)
    positions[1, 2, 1] = np.nan
    noise = np.stack([NOISE, 2 * NOISE])
    sightings = measurements_on_grid(positions, 0.5, noise)
    np.testing.assert_array_equal(sightings.times[0], [-1.5, -1.0, -0.5, 0.0])
    np.testing.assert_array_equal(sightings.times[1], [-1.5, -1.0, 0.0])
    np.testing.assert_array_equal(sightings.positions[1], positions[1, [0, 1, 3]])
    np.testing.assert_array_equal(sightings.noise[1], np.tile(2 * NOISE, (3, 1, 1)))
    assert sightings.log == (NO_LOG, NO_LOG)
    for empty in (np.empty((2, 0, 2)), np.full((2, 3, 2), np.nan)):
        assert measurements_on_grid(empty, 0.5, noise).count.tolist() == [0, 0]


def test_tracks_measure_what_was_sighted_else_the_grid() -> None:
    sightings = sighted()
    tracks = tracks_of(sightings)
    assert tracks.measured is sightings and tracks.clock == 2.5
    np.testing.assert_allclose(tracks.lag, [0.25, 0.0, 0.5])
    grid = tracks_of(None)
    assert grid.clock == 0.0 and grid.measured.count.tolist() == [4, 4, 4]
    positions = np.zeros((3, 4, 2))
    positions[0, -1], positions[1, -2:, 0], positions[2] = np.nan, np.nan, np.nan
    late = tracks_of(None, positions=positions)
    np.testing.assert_array_equal(late.lag, [0.5, 1.0, 0.0])
    assert tracks.select([2]).measured.log == (5,)
    assert tracks.select([2]).lag.tolist() == [0.5]


@pytest.mark.parametrize(
    ("stamp", "late", "lag"),
    [
        (10.0, 0.0, 0.0),
        (10.0, 0.4e-6, 0.0),
        (10.0, 0.6e-6, 0.6e-6),
        (1.7e9, 7e-7, 0.0),  # three steps of the clock
        (1.7e9, 2e-6, 2e-6),
        (1e9, 1e8, 1e6),
    ],
)
def test_a_lag_is_what_the_clock_resolves(stamp: float, late: float, lag: float) -> None:
    """A millionth of a step, or four steps of the clock, are nothing; 1e6 s are the most."""
    one = Measurements([[stamp - late]], [places(1)], [NOISE[None]])
    found = tracks_of(one, stamp=stamp).lag
    np.testing.assert_allclose(found, [lag], atol=0.6 * np.spacing(stamp))
    assert (found > 0).all() == (lag > 0)


@pytest.mark.parametrize(
    ("maker", "words"),
    [
        (lambda: tracks_of(sighted(), ids=["a", "b"], positions=np.zeros((2, 4, 2)),
                           radius=[1, 1], noise=np.tile(NOISE, (2, 1, 1))),
         r"tracks\.sightings are of 3 obstacles; wanted 2"),
        (lambda: tracks_of(sighted(), positions=np.zeros((3, 4, 3)),
                           noise=np.tile(np.eye(3), (3, 1, 1))),
         r"tracks\.sightings need 3 coordinates"),
        (lambda: tracks_of(sighted(), stamp=2.2), r"tracks\.sightings end at 2\.25 s; .* 2\.2 s"),
    ],
)  # fmt: skip
def test_sightings_of_other_tracks_are_refused(maker: Callable[[], Tracks], words: str) -> None:
    with pytest.raises(WideberthError, match=words):
        maker()


def limited(sightings: Measurements) -> tuple[Measurements, tuple[str | None, ...]]:
    known = bounded(tracks_of(sightings), None)
    if known is None:
        return sightings, (None,) * len(sightings)
    assert known.tracks.sightings is not None
    return known.tracks.sightings, known.reasons


def test_measurements_within_the_limits_stay_as_they_are() -> None:
    assert limited(sighted())[0].log == (4, 7, 5)
    assert bounded(tracks_of(sighted()), None) is None


@pytest.mark.parametrize(
    ("measurement", "place", "left", "words"),
    [
        (1, 1e300, [1.0, 2.25], "taken as not observed"),
        (1, 1e5, [2.25], "a leap"),
        (2, 1e5, [2.25], "a leap"),
        (0, 1e5, [1.5, 2.25], "a leap"),
    ],
)
def test_a_measurement_beyond_the_limits_is_left_out(
    measurement: int, place: float, left: list[float], words: str
) -> None:
    """With those before a leap; the others are as they were, also who was never measured."""
    positions = [places(len(times)) for times in TIMES]
    positions[0][measurement, 0] = place
    found, reasons = limited(sighted(positions=positions))
    assert found.times[0].tolist() == left and found.log == (4, 7, 5)
    assert words in str(reasons[0]) and reasons[1:] == (None, None)
    np.testing.assert_array_equal(found.values[2], sighted().values[2])


def test_too_vague_too_soon_and_too_small_measurements() -> None:
    noise = [np.tile(NOISE, (len(times), 1, 1)) for times in TIMES]
    noise[0][1] = np.diag([1e300, 1e-4])
    found, reasons = limited(sighted(noise=noise))
    np.testing.assert_allclose(found.noise[0][1], np.diag([1e12, 0.0]), atol=1e-3)
    assert reasons[0] == "known to more than 1e+06 m, taken as that"
    assert limited(found)[1] == (None,) * 3, "a second time nothing is beyond them"
    soon = ([1.0, 1.0 + 1e-9, 2.25], [], [0.5, 2.0])
    found, reasons = limited(sighted(times=soon))
    assert found.times[0].tolist() == [1.0 + 1e-9, 2.25]
    assert "apart" in str(reasons[0]) and reasons[1:] == (None, None)
    tiny = [places(3), places(0), places(2) * 1e-300]
    found, reasons = limited(sighted(positions=tiny))
    assert not found.positions[2].any() and reasons == (None,) * 3


def test_what_was_admitted_one_by_one_is_not_looked_at_again() -> None:
    admitted = AdmittedMeasurements(TIMES, sighted().positions, sighted().noise, (4, 7, 5))
    assert isinstance(admitted.select([0]), AdmittedMeasurements)
    assert limited(admitted)[0] is admitted
    assert bounded(replace(tracks_of(sighted()), sightings=admitted), None) is None

"""What a history says of each measurement, and when the log of an obstacle is another one."""

from itertools import pairwise

import numpy as np
import pytest

from wideberth import Detection
from wideberth.framework.tracking.history import History
from wideberth.framework.tracking.noise import LENGTH, STRIDE
from wideberth.framework.values.arrays import Array
from wideberth.framework.values.measurements import AdmittedMeasurements, Measurements
from wideberth.framework.values.tracks import Tracks

DT = 0.5
EMPTY = History(DT, 12, 3.0, 1.25)


def seen(name: str, place: float, age: float = 0.0, spread: float | None = 0.01) -> Detection:
    noise = None if spread is None else spread**2 * np.array([[1.0, 0.3], [0.3, 2.0]])
    return Detection(name, (place, 1.0), noise, 0.3, age, "lidar")


def tracks_of(history: History) -> Tracks:
    tracks = history.tracks()
    assert tracks is not None and isinstance(tracks.sightings, AdmittedMeasurements)
    Tracks(**vars(tracks))  # what was assembled passes the checks
    return tracks


def log_of(history: History, name: str = "a") -> tuple[int, Array, Array, Array]:
    """Return number, times, positions and covariances of an obstacle's log."""
    tracks = tracks_of(history)
    row, sightings = tracks.ids.index(name), tracks.measured
    # A constructor's checks accept what the history hands out.
    Measurements(sightings.times, sightings.positions, sightings.noise, sightings.log)
    return (
        sightings.log[row], sightings.times[row], sightings.positions[row], sightings.noise[row]
    )  # fmt: skip


def test_every_measurement_is_there_once_with_the_covariance_stated_then() -> None:
    history, wanted = EMPTY, []
    for tick, (age, spread) in enumerate([(0.0, 0.01), (0.13, 0.02), (0.02, 0.005), (0.3, 0.01)]):
        stamp = 5.0 + 0.7 * tick
        history = history.add(stamp, (seen("b", 9.0, 0.05), seen("a", 0.1 * tick, age, spread)))
        wanted.append((stamp - age, 0.1 * tick, spread))
    _, times, positions, noise = log_of(history)
    assert times.tolist() == [time for time, _, _ in wanted]
    assert positions[:, 0].tolist() == [place for _, place, _ in wanted]
    for spread, (_, _, deviation) in zip(noise, wanted, strict=True):
        np.testing.assert_allclose(spread, deviation**2 * np.array([[1.0, 0.3], [0.3, 2.0]]))
    assert log_of(history, "b")[1].tolist() == [5.0 + 0.7 * tick - 0.05 for tick in range(4)]
    np.testing.assert_allclose(tracks_of(history).lag, [0.25, 0.0])


def test_noise_that_a_sensor_does_not_state_is_that_estimated_when_it_comes() -> None:
    rng = np.random.default_rng(3)
    history, estimates = EMPTY, []
    for tick in range(LENGTH + 3 * STRIDE):
        sensor = history.noise.get("lidar")
        estimates.append(np.nan if sensor is None else sensor.deviation)
        place = 0.3 * tick + 0.2 * rng.standard_normal()
        history = history.add(0.25 * tick, (seen("a", place, 0.0, None),))
    _, times, _, noise = log_of(history)
    found = np.sqrt(noise[:, 0, 0])
    wanted = np.array(estimates)[-len(times) :]
    known = np.isfinite(wanted)
    np.testing.assert_allclose(found[known], wanted[known], rtol=1e-12)
    assert len(np.unique(found)) > 1, "the estimate has changed meanwhile"


def test_a_log_keeps_its_number_while_measurements_are_appended() -> None:
    """Also as old ones are left out, and while others come, are reordered and go."""
    history = EMPTY
    numbers = set()
    for tick in range(60):
        others = [seen(f"o{k}", 5.0 * k) for k in range(tick % 4)]
        history = history.add(0.3 * tick, (*others, seen("a", 0.05 * tick)))
        numbers.add(log_of(history)[0])
    assert len(numbers) == 1
    assert log_of(history)[1][0] > 8.0  # what was measured before is forgotten
    assert len(set(tracks_of(history).measured.log)) == len(tracks_of(history))


def test_a_log_has_another_number_once_a_measurement_is_inserted_or_replaced() -> None:
    history = EMPTY
    for tick in range(4):
        history = history.add(0.5 * tick, (seen("a", 0.1 * tick), seen("b", 8.0)))
    first, other = log_of(history)[0], log_of(history, "b")[0]
    late = history.add(1.6, (seen("a", 0.12, 0.4),))
    assert log_of(late)[0] not in (first, other) and log_of(late, "b")[0] == other
    assert log_of(late)[1].tolist() == pytest.approx([0.0, 0.5, 1.0, 1.2, 1.5])
    again = history.add(1.5, (seen("a", 0.9),))
    assert log_of(again)[0] not in (first, other)
    assert log_of(again)[1].tolist() == [0.0, 0.5, 1.0, 1.5]
    assert log_of(again)[2][-1, 0] == 0.9
    middle = history.add(1.6, (seen("a", 0.7, 0.6),))
    assert log_of(middle)[0] not in (first, other) and log_of(middle)[2][2, 0] == 0.7
    # What is left out changes nothing: a late one beside another measurement.
    beside = history.add(1.6, (seen("a", 0.7, 0.6 - 1e-3),))
    assert log_of(beside)[0] == first and log_of(beside)[1].tolist() == [0.0, 0.5, 1.0, 1.5]


def test_a_name_used_again_has_another_log() -> None:
    """After it was forgotten, after a leap, and after a clock that went back."""
    history = EMPTY.add(0.0, (seen("a", 0.0),)).add(0.5, (seen("a", 0.1),))
    first = log_of(history)[0]
    forgotten = history.add(4.0, (seen("b", 5.0),)).add(4.1, (seen("a", 0.1),))
    assert log_of(forgotten)[0] != first and log_of(forgotten)[1].tolist() == [4.1]
    leapt = history.add(1.0, (seen("a", 80.0),))
    assert log_of(leapt, "a#2")[0] != first and log_of(leapt)[0] == first
    emptied = history.emptied()
    assert emptied.tracks() is None
    assert log_of(emptied.add(0.0, (seen("a", 0.0),)))[0] != first


def test_numbers_are_never_used_twice() -> None:
    history, owners = EMPTY, {}
    rng = np.random.default_rng(4)
    for tick in range(80):
        if tick % 23 == 22:
            history = history.emptied()
        names = [f"o{k}" for k in rng.permutation(6)[: 1 + tick % 5]]
        ages = rng.choice([0.0, 0.0, 0.2, 0.7], len(names))
        history = history.add(
            0.4 * tick,
            tuple(seen(n, 3.0 * int(n[1]), a) for n, a in zip(names, ages, strict=True)),
        )
        tracks = tracks_of(history)
        assert len(set(tracks.measured.log)) == len(tracks)
        for name, number in zip(tracks.ids, tracks.measured.log, strict=True):
            assert owners.setdefault(number, name) == name


def test_the_same_number_means_the_same_measurements() -> None:
    """Up to the newest one that two sightings share, whatever came late or twice."""
    rng = np.random.default_rng(5)
    history, before = EMPTY, None
    same = 0
    for tick in range(300):
        age = float(rng.choice([0.0, 0.0, 0.3, 0.9]))
        stamp = 0.2 * tick + float(rng.choice([0.0, 0.05]))
        history = history.add(stamp, (seen("a", 0.01 * tick, age),))
        after = log_of(history)
        if before is not None and before[0] == after[0]:
            same += 1
            oldest, newest = after[1][0], before[1][-1]
            if newest in after[1]:
                old, new = (
                    log[2][(log[1] >= oldest) & (log[1] <= newest)] for log in (before, after)
                )
                np.testing.assert_array_equal(old, new)
        before = after
    assert 50 < same < 299


def test_people_seen_together_share_no_number() -> None:
    numbers = []
    history = EMPTY
    for tick in range(3):
        history = history.add(0.5 * tick, tuple(seen(f"o{k}", 4.0 * k) for k in range(5)))
        numbers.append(tracks_of(history).measured.log)
    assert all(one == other for one, other in pairwise(numbers)) and len(set(numbers[0])) == 5

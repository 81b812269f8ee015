"""The online calibration counts and judges each person at the times of its own measurements."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest
from scipy.stats import chi2

from wideberth.framework.values.measurements import Measurements
from wideberth.framework.values.tracks import Tracks
from wideberth.predictors import adaptive_conformal
from wideberth.predictors.adaptive_conformal import AdaptiveConformal
from wideberth.predictors.kalman import Kalman

DT, STEPS, TAIL, RATE = 0.4, 3, 0.1, 0.2
ROWS = 8


def adaptive(**settings: Any) -> AdaptiveConformal:
    parts = {"tail": TAIL, "rate": RATE, "steps": STEPS, "speeds": ()}
    return AdaptiveConformal(Kalman(), **(parts | settings))


def tracks_at(
    stamp: float, times: Sequence[np.ndarray], places: Sequence[np.ndarray], logs: Sequence[int]
) -> Tracks:
    """Return tracks of all who were measured up to a time, on the grid as a history puts them.

    The last digit of the number of a log is the name of its person.
    """
    grid = stamp - DT * np.arange(ROWS - 1.0, -1.0, -1.0)
    sightings = Measurements(
        times, places, [np.tile(1e-4 * np.eye(2), (len(one), 1, 1)) for one in times], logs
    )
    positions = np.stack([
        np.stack([np.interp(grid, time, axis) for axis in place.T], axis=1)
        for time, place in zip(times, places, strict=True)
    ])  # fmt: skip
    count = len(times)
    noise = np.tile(1e-4 * np.eye(2), (count, 1, 1))
    ids = [f"o{number % 10}" for number in logs]
    return Tracks(positions, DT, ids, np.full(count, 0.3), noise, stamp, sightings=sightings)


def walks(count: int, rows: int, seed: int = 0) -> np.ndarray:
    """People whose velocity drifts, (O, T, 2)."""
    rng = np.random.default_rng(seed)
    velocity = 1.0 + np.cumsum(0.1 * rng.standard_normal((count, rows, 2)), axis=1)
    return np.cumsum(DT * velocity, axis=1)


def run_of(places: np.ndarray, ages: Sequence[float]) -> list[Tracks]:
    """Return the tracks of each row, with every person measured at an age of its own."""
    count, rows = places.shape[:2]
    clock = DT * np.arange(rows)
    return [
        tracks_at(
            float(clock[row]),
            [clock[: row + 1] - age for age in ages],
            list(places[:, : row + 1]),
            range(count),
        )
        for row in range(1, rows)
    ]


@pytest.fixture
def judged(monkeypatch: pytest.MonkeyPatch) -> list[tuple[str, float, int, bool]]:
    """Name, due time, step, and whether the truth is known, of all that is judged."""
    found: list[tuple[str, float, int, bool]] = []
    truth_of = adaptive_conformal._truth

    def recorded(tracks: Tracks, looks: Any) -> np.ndarray:
        truth = truth_of(tracks, looks)
        known = np.isfinite(truth).all(axis=1).tolist()
        names = [tracks.ids[row] for row in looks.row]
        found.extend(zip(names, looks.time.tolist(), looks.step.tolist(), known, strict=True))
        return truth

    monkeypatch.setattr(adaptive_conformal, "_truth", recorded)
    return found


@pytest.mark.parametrize("ages", [(0.0, 0.0, 0.0), (0.0, 0.05, 0.39), (0.0, 0.2, 0.2)])
def test_every_forecast_of_everybody_is_judged_once_per_step(
    judged: list[tuple[str, float, int, bool]], ages: tuple[float, ...]
) -> None:
    """Also of those who are never measured at the newest instant of all."""
    predictor, rows = adaptive(), 20
    for tracks in run_of(walks(3, rows), ages):
        predictor = predictor.update(tracks)
    assert all(known for *_, known in judged)
    keys = [(name, round(time / DT) - step - 1, step) for name, time, step, _ in judged]
    assert len(set(keys)) == len(keys)
    # A forecast of row r is judged for a step once a measurement of row r + step + 1 is there,
    # of who is older one row later.
    wanted = {
        (f"o{k}", row, step)
        for k, age in enumerate(ages)
        for row in range(1, rows)
        for step in range(STEPS)
        if row + step + 1 + (age > 0) < rows
    }
    assert set(keys) == wanted


def test_who_was_not_measured_within_the_newest_step_is_not_counted(
    judged: list[tuple[str, float, int, bool]],
) -> None:
    places, clock = walks(2, 9), DT * np.arange(9.0)
    predictor = adaptive()
    for row in range(2, 9):
        seen = max(row - 3, 1)  # three steps late, or two at first
        times, gone = clock[: row + 1], clock[: seen + 1]
        tracks = tracks_at(times[-1], [times, gone], [places[0, : row + 1], places[1, : seen + 1]],
                           (0, 1))  # fmt: skip
        predictor = predictor.update(tracks)
    assert {name for name, *_ in judged} == {"o0"}


def test_measurements_on_the_grid_learn_what_the_grid_learns() -> None:
    places = walks(4, 40, seed=2)
    places[1, 15:18], places[2, :9], places[3, 30:] = np.nan, np.nan, np.nan
    clock = DT * np.arange(40.0)
    grid = sighted = adaptive(speeds=(0.5, 1.5))
    for row in range(2, 40):
        seen = np.isfinite(places[:, : row + 1]).all(axis=2)
        index = np.flatnonzero(seen.any(axis=1))
        ids, count = [f"o{k}" for k in index], len(index)
        parts = {
            "positions": places[index, : row + 1], "dt": DT, "ids": ids,
            "radius": np.full(count, 0.3), "noise": np.tile(1e-4 * np.eye(2), (count, 1, 1)),
            "stamp": clock[row],
        }  # fmt: skip
        measured = Measurements(
            [clock[: row + 1][seen[k]] for k in index],
            [places[k, : row + 1][seen[k]] for k in index],
            [np.tile(1e-4 * np.eye(2), (int(seen[k].sum()), 1, 1)) for k in index],
            index.tolist(),
        )
        grid, sighted = (
            grid.update(Tracks(**parts)),
            sighted.update(Tracks(**parts, sightings=measured)),
        )
        assert grid.state is not None and sighted.state is not None
        np.testing.assert_allclose(
            sighted.state.log_scale, grid.state.log_scale, rtol=0, atol=1e-12
        )
    assert np.abs(sighted.state.log_scale).max() > 0.1


def test_the_long_run_rate_holds_at_ages_of_their_own() -> None:
    """The bound of the class docstring, for two people in every sum, judged from outside."""
    rows, ages = 700, (0.0, 0.17)
    places = walks(2, rows, seed=3)
    clock, size = DT * np.arange(rows), chi2.ppf(1 - TAIL, 2)
    predictor = adaptive()
    misses: list[list[bool]] = [[] for _ in range(STEPS)]
    log = []
    for row in range(1, rows):
        start = max(row - 30, 0)
        tracks = tracks_at(
            float(clock[row]),
            [clock[start : row + 1] - age for age in ages],
            list(places[:, start : row + 1]),
            (0, 1),
        )
        predictor = predictor.update(tracks)
        assert predictor.state is not None
        log.append(predictor.state.log_scale[:STEPS])
        forecast = predictor.predict(tracks, STEPS)
        for step in range(min(STEPS, rows - 2 - row)):
            for k, age in enumerate(ages):
                share = age / DT
                now = places[k, row + step + 1]
                truth = now + share * (places[k, row + step + 2] - now)
                gap = truth - forecast.mean[k, 0, step]
                spread = forecast.covariance[k, 0, step]
                misses[step].append(gap @ np.linalg.solve(spread, gap) > size)
    reach = np.ptp(np.array(log), axis=0)
    for step in range(STEPS):
        bound = np.sqrt(2.0) * (reach[step] + 3.0 * RATE) / (RATE * len(misses[step]))
        assert abs(np.mean(misses[step]) - TAIL) <= bound < 0.05


@pytest.mark.parametrize(("pause", "known"), [(1.5, True), (2.45, True), (2.55, False)])
def test_nothing_is_judged_across_a_long_pause(
    judged: list[tuple[str, float, int, bool]], pause: float, known: bool
) -> None:
    """And what is judged across a short one is so on the line between both measurements."""
    clock = np.append(DT * np.arange(6.0), DT * (5.0 + pause))
    places = np.stack([clock, 0.0 * clock], axis=1)
    predictor = adaptive()
    for row in (3, 4, 5, 6):
        tracks = tracks_at(clock[row], [clock[: row + 1]], [places[: row + 1]], (0,))
        predictor = predictor.update(tracks)
    inside = [entry for entry in judged if DT * 5.01 < entry[1] < clock[-1] - 0.01]
    assert len(inside) >= 2 and all(found == known for *_, found in inside)


def test_who_was_forgotten_is_not_judged_by_where_he_appears_again() -> None:
    """His new log says nothing of where he was before it began."""
    predictor = adaptive(steps=12)
    first = tracks_at(1.0, [np.array([0.6, 1.0])], [np.zeros((2, 2))], (0,))
    again = tracks_at(4.9, [np.array([4.9])], [np.full((1, 2), 30.0)], (10,))
    learnt = predictor.update(first).update(again)
    assert learnt.state is not None and not np.any(learnt.state.log_scale)

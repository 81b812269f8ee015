"""Forecasts from any instant on: what is seen late is drawn where it is by now."""

import numpy as np
import pytest

from wideberth.framework.values.motion import Detection, Observation
from wideberth.predictors import Kalman
from wideberth.predictors.core.forecaster import KEPT, Forecaster

VELOCITY = np.array([1.2, -0.4])
TIMES = np.array([0.0, 0.5, 1.0])


def seen(stamp: float, age: float = 0.0) -> Observation:
    place = (stamp - age) * VELOCITY
    return Observation(stamp, np.zeros(3), (Detection("a", place, 1e-6 * np.eye(2), 0.3, age),))


@pytest.mark.parametrize("late", [0.0, 0.3, 0.75])
@pytest.mark.parametrize("age", [0.0, 0.2])
def test_a_person_is_forecast_from_the_instant_that_is_asked_for(late: float, age: float) -> None:
    """Seen ``late + age`` s ago at v, it is ahead of there by as much times v."""
    forecaster = Forecaster(Kalman(acceleration_density=1e-4), 0.1)
    for stamp in np.arange(0.0, 2.05, 0.1):
        forecaster.take(seen(float(stamp), age), np.zeros(2), 0.3)
    found = forecaster.at(2.0 + late, TIMES)
    assert found is not None
    tracks, forecast = found
    wanted = (2.0 + late + TIMES)[:, None] * VELOCITY
    assert forecast.mean[0, 0] == pytest.approx(wanted, abs=0.01)
    assert tracks.ids == ("a",) and tracks.stamp == pytest.approx(2.0 - age)


def test_what_is_older_is_known_less() -> None:
    forecaster = Forecaster(Kalman(acceleration_density=0.1), 0.1)
    for stamp in np.arange(0.0, 2.05, 0.1):
        forecaster.take(seen(float(stamp)), np.zeros(2), 0.3)
    spreads = []
    for late in (0.0, 0.5, 1.0):
        found = forecaster.at(2.0 + late, TIMES)
        assert found is not None
        spreads.append(np.linalg.det(found[1].covariance[0, 0, 1]))
    assert spreads[0] < spreads[1] < spreads[2]


def test_who_is_no_longer_reported_is_dropped() -> None:
    forecaster = Forecaster(Kalman(), 0.1)
    assert forecaster.at(0.0, TIMES) is None
    for stamp in (0.0, 0.1, 0.2):
        forecaster.take(seen(stamp), np.zeros(2), 0.3)
    for stamp in (0.2 + KEPT - 0.05, 0.2 + KEPT + 0.05):
        assert forecaster.at(stamp, TIMES) is not None
        forecaster.take(Observation(stamp, np.zeros(3)), np.zeros(2), 0.3)
    assert forecaster.at(0.3 + KEPT, TIMES) is None


def test_numbers_of_no_use_are_noted() -> None:
    nowhere = Detection("b", np.array([np.nan, 0.0]), None, 0.3)
    notes = Forecaster(Kalman(), 0.1).take(
        Observation(0.0, np.zeros(3), (nowhere,)), np.zeros(2), 0.3
    )
    assert len(notes) == 1 and "'b'" in notes[0]

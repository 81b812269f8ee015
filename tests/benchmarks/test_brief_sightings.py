"""The count of ignored people: its dry run, and decisions in which the number is known."""

from importlib import import_module
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from wideberth.framework.values.forecast import Forecast
from wideberth.framework.values.motion import Detection, Observation


@pytest.fixture
def script(monkeypatch: pytest.MonkeyPatch) -> Any:
    """Stand where the script stands: it imports others by their plain names."""
    monkeypatch.syspath_prepend(str(Path(__file__).resolve().parents[2] / "benchmarks"))
    return import_module("brief_sightings")


def plan_of(**deviations: float) -> Any:
    """Return the part of a plan that is judged: each person's deviation at both steps, m."""
    covariance = np.array([np.diag([0.01, value**2]) for value in deviations.values()])
    covariance = np.stack([covariance, 100.0 * covariance], axis=1)  # wider at the second step
    forecast = Forecast.single(np.zeros((len(deviations), 2, 2)), covariance, 0.3)
    return SimpleNamespace(forecast=forecast, tracked=tuple(deviations))


def test_absent_and_wide_people_are_counted_until_they_are_forgotten(script: Any) -> None:
    seen = [Detection(name, (1.0, 2.0), None, 0.3, age) for name, age in (("a", 0.0), ("b", 0.5))]
    episode = [
        (Observation(0.0, (0.0,), seen), plan_of(a=4.9, b=4.9)),
        (Observation(1.0, (0.0,)), plan_of(a=0.1, b=5.1)),
        (Observation(2.4, (0.0,)), plan_of(b=6.0)),
        (Observation(2.6, (0.0,)), plan_of(a=0.1, b=6.0)),
        (Observation(2.9, (0.0,)), None),
        (Observation(3.1, (0.0,)), plan_of(a=6.0)),
    ]
    counts = [(2, 0, 0), (2, 0, 1), (2, 1, 1), (1, 0, 0), (1, 1, 0), (0, 0, 0)]
    assert script.ignored(iter(episode)) == counts


def test_dry_run_prints_a_row_for_each_channel(
    script: Any, capsys: pytest.CaptureFixture[str]
) -> None:
    rows = script.main(["--quick"])
    assert [(row["predictor"], row["dropout"], row["jitter_ms"]) for row in rows] == [
        (predictor, dropout, 1e3 * jitter)
        for predictor in script.PREDICTORS
        for dropout in script.DROPOUTS
        for jitter in script.JITTERS
    ]
    assert all(row["decisions"] >= 5 and row["people"] > 5 for row in rows)
    assert capsys.readouterr().out.count("| kalman |") == 6

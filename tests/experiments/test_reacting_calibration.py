"""Calibration among people who react: what is counted, the margin rule, and people who do not."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from wideberth.experiments.engine.base import Result
from wideberth.experiments.engine.csv_tables import write_table
from wideberth.experiments.engine.shipped_configs import read_experiment
from wideberth.experiments.studies.reacting_calibration import (
    ReactingCalibration,
    corrected,
    counts,
    next_radius,
)
from wideberth.framework.numerics.chi_square import content_bound
from wideberth.framework.values.errors import WideberthError
from wideberth.framework.values.tracks import Tracks
from wideberth.metrics.episode import squared_mahalanobis
from wideberth.predictors.conformal import Conformal
from wideberth.predictors.constant_velocity import ConstantVelocity


def study() -> ReactingCalibration:
    found = read_experiment("reacting_calibration", [])[0]
    assert isinstance(found, ReactingCalibration)
    return found


def walkers(rows: int = 40, people: int = 3) -> Tracks:
    """People whose velocity drifts; the last one comes late."""
    rng = np.random.default_rng(2)
    velocity = 0.5 + 0.1 * np.cumsum(rng.standard_normal((people, rows, 2)), axis=1)
    places = np.cumsum(0.4 * velocity, axis=1)
    places[-1, :15] = np.nan
    names = tuple(f"person {k}" for k in range(people))
    noise = np.tile(1e-4 * np.eye(2), (people, 1, 1))
    return Tracks(places, 0.4, names, np.full(people, 0.3), noise)


def test_steps_persons_and_plans_are_counted_one_by_one() -> None:
    tracks = walkers()
    base = ConstantVelocity(acceleration_density=0.02)
    predictor = Conformal(base, tail=0.3, observed=4, steps=5)
    bound, wanted = content_bound(2, 0.3), dict.fromkeys(("steps", "persons", "plans"), 0)
    missed, areas = dict.fromkeys(wanted, 0), []
    for row in range(3, 35):
        anyone = False
        seen = np.isfinite(tracks.positions[:, row - 3 : row + 6]).all(axis=(1, 2))
        for person in np.flatnonzero(seen):
            past = tracks.positions[person : person + 1, row - 3 : row + 1]
            alone = Tracks(past, 0.4, ("one",), tracks.radius[:1], tracks.noise[:1])
            forecast = base.predict(alone, 5)
            truth = tracks.positions[person, row + 1 : row + 6]
            own = squared_mahalanobis(forecast.mean[0, 0], forecast.covariance[0, 0], truth)
            areas.append(bound * np.pi * np.sqrt(np.linalg.det(forecast.covariance[0, 0, -1])))
            wanted["steps"] += 5
            missed["steps"] += int((own > bound).sum())
            wanted["persons"] += 1
            missed["persons"] += int((own > bound).any())
            anyone = anyone or bool((own > bound).any())
        wanted["plans"] += int(seen.any())
        missed["plans"] += int(anyone)
    found = counts(predictor, tracks)
    assert {name: found[name] for name in wanted} == wanted
    assert {name: found[f"{name}_missed"] for name in wanted} == missed
    assert 0 < missed["persons"] < wanted["persons"] > missed["plans"] > 0
    assert found["radius"] == pytest.approx(np.sqrt(np.array(areas) / np.pi).mean())


def test_who_was_not_seen_for_long_enough_counts_nowhere() -> None:
    found = counts(Conformal(ConstantVelocity()), walkers(rows=10))
    assert found["steps"] == found["plans_missed"] == 0.0 and found["radius"] is None


@pytest.mark.parametrize("gain", [0.0, 0.3, 0.9])
def test_the_next_radius_is_the_smallest_that_holds_however_people_answer(gain: float) -> None:
    rng = np.random.default_rng(1)
    radius, quantile = rng.uniform(0.1, 3.0, (2, 500))
    found = next_radius(radius, quantile, gain)
    worst = quantile + gain * np.abs(found - radius)
    np.testing.assert_allclose(found, worst, atol=1e-9)
    less = found - 1e-3
    assert (less < quantile + gain * np.abs(less - radius)).all()


def iterated(response: float, gain: float, rounds: int = 20) -> tuple[float, list[bool]]:
    """Radii of people whose quantile is 1 + response (r - 1), begun at 3; whether each held."""
    radius, held = 3.0, []
    for _ in range(rounds):
        quantile = 1.0 + response * (radius - 1.0)
        radius = float(next_radius(np.array(radius), np.array(quantile), gain))
        held.append(radius >= 1.0 + response * (radius - 1.0) - 1e-9)
    return radius, held


def test_it_comes_to_rest_where_the_gain_covers_the_answer_and_else_need_not() -> None:
    for response in (-0.4, 0.0, 0.4):
        radius, held = iterated(response, 0.5)
        assert radius == pytest.approx(1.0, abs=1e-3) and all(held)
    # calibrating again without a margin breaks every other promise of people who answer the other
    # way, and where the answer is larger than the change nothing comes to rest
    assert not all(iterated(-0.4, 0.0)[1])
    radius, held = iterated(-1.5, 0.2)
    assert abs(radius - 1.0) > 2.0 and not all(held)


def test_the_radius_is_the_root_of_the_scale() -> None:
    dataset = [walkers()]
    again = Conformal(ConstantVelocity(acceleration_density=0.02), 0.3, observed=4, steps=5)
    again = again.fit(dataset)
    assert again.fitted is not None
    driven = replace(again, fitted=replace(again.fitted, scale=(4.0,) * 5))
    found = corrected(driven, again, 0.5).fitted
    assert found is not None
    wanted = next_radius(np.full(5, 2.0), np.sqrt(again.fitted.scale), 0.5)
    np.testing.assert_allclose(np.sqrt(found.scale), wanted, rtol=1e-12)
    alone = corrected(driven, again, 0.0).fitted
    assert alone is not None
    np.testing.assert_allclose(alone.scale, again.fitted.scale, rtol=1e-12)
    assert corrected(replace(again, fitted=None), again, 0.5) == again


def test_people_who_never_make_way_walk_the_same_beside_every_driver(tmp_path: Path) -> None:
    quick = study().quick()
    assert list(quick.scenarios) == ["straight"]
    quick = replace(quick, settings=replace(quick.settings, time_limit=12.0))  # none arrives
    rows = [row for task in quick.tasks() for row in quick.measure(task).rows]
    seen: dict[int, set[tuple[float, ...]]] = {}
    for row in rows:
        if row["part"] == "table":
            numbers = tuple(row[f"{name}_missed"] for name in ("steps", "persons", "plans"))
            seen.setdefault(row["episode"], set()).add(numbers)
    assert seen and all(len(numbers) == 1 for numbers in seen.values())
    lines = quick.summary(rows)
    iterations = [line["iteration"] for line in lines if line["part"] == "iteration"]
    assert iterations == [0, 1]
    first, second = (line for line in lines if line["part"] == "iteration")
    assert (first["calibrated"], second["calibrated"]) == ("stands", "planner")
    write_table(tmp_path / "table.csv", rows)
    paths = quick.figures(Result(tmp_path), tmp_path)
    assert sorted(path.name for path in paths) == [
        "iteration.pdf", "iteration.png", "table.pdf", "table.png"
    ]  # fmt: skip


def test_wrong_settings_are_refused() -> None:
    made = study()
    with pytest.raises(WideberthError, match=r"drivers is \['planner'\]"):
        replace(made, drivers={"planner": made.planner})
    with pytest.raises(WideberthError, match="gains"):
        replace(made, gains=(1.0,))

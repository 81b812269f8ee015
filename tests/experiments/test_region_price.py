"""The price of regions in closed loop: what is paired, what is timed, what is said."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from wideberth.experiments.engine.base import Row
from wideberth.experiments.engine.closed_loop import play
from wideberth.experiments.engine.csv_tables import read_table
from wideberth.experiments.engine.runner import draw, run
from wideberth.experiments.engine.shipped_configs import read_experiment
from wideberth.experiments.studies.region_price import (
    AT_RISK,
    ELLIPSE,
    RegionPrice,
    area_ratio,
    excess,
    solve_times,
    time_rows,
)
from wideberth.experiments.studies.stopwatch import Stopwatch
from wideberth.experiments.studies.variants import planner_of
from wideberth.framework import names
from wideberth.framework.testing import check_controller
from wideberth.framework.values.errors import WideberthError

EXACT = "minkowski_sum"


@pytest.fixture(scope="module")
def shipped() -> RegionPrice:
    experiment, _ = read_experiment("region_price", [])
    assert isinstance(experiment, RegionPrice)
    return experiment


def test_every_registered_region_is_played(shipped: RegionPrice) -> None:
    assert shipped.registered and shipped.seeds >= 10 and EXACT in shipped.at_risk
    assert {task.settings["forecast"] for task in shipped.tasks()} == {"kalman", "var"}
    for name in names("regions"):
        planner = shipped.variant(name, shipped.predictors["kalman"])
        assert type(planner.region).__name__.lower() == name.replace("_", "")


def test_the_level_for_a_risk(shipped: RegionPrice) -> None:
    predictor = shipped.predictors["kalman"]
    levels = [
        planner.level.levels(planner.region, 1, 1, 2).item()
        for planner in (shipped.variant(EXACT + end, predictor) for end in ("", AT_RISK))
    ]
    assert levels == pytest.approx([2.4477468306808166, 1.6448536269514722], abs=1e-9)


def test_planner_is_that_of_the_crossing(shipped: RegionPrice) -> None:
    crossing, _ = read_experiment("crossing", [])
    planner = planner_of(shipped.planner)
    for name in ("predictor", "level", "solver", "penalty", "margin", "horizon", "cost"):
        assert getattr(planner, name) == getattr(crossing.planners["default"], name)  # type: ignore[attr-defined]


def test_stopwatch_changes_nothing(shipped: RegionPrice) -> None:
    planner = planner_of(shipped.planner)
    watch = Stopwatch(planner, [])
    settings = replace(shipped.settings, time_limit=6.0)
    plain, timed = (
        play(shipped.scenario, shipped.robot, controller, settings, 0)
        for controller in (planner, watch)
    )
    assert plain.to_bytes() == timed.to_bytes()
    assert len(watch.seconds) == sum(len(log.plans) for log in timed.robots)
    assert min(watch.seconds) >= 0.0
    check_controller(Stopwatch(planner, []), shipped.robot)


def test_quick_run(shipped: RegionPrice, tmp_path: Path) -> None:
    """Kalman forecasts are round: there the paper's ellipse is the exact sum."""
    small = shipped.quick()
    result = run(small, tmp_path / "out")
    rows = {row["region"]: row for row in result.rows}
    assert len(rows) == 3
    for name in ("clearance", "time_ratio_worst", "length_ratio_worst"):
        assert rows[EXACT][name] == pytest.approx(rows[ELLIPSE][name], abs=1e-3)
    lines = {line["region"]: line for line in read_table(tmp_path / "out" / "summary.csv")}
    assert lines[ELLIPSE]["extra_time"] == lines[ELLIPSE]["extra_path"] == 0.0
    assert lines[EXACT]["area_ratio"] == pytest.approx(1.0, abs=1e-9)
    assert all(line["episodes"] == line["paired"] == 1 for line in lines.values())
    drawn = draw(tmp_path / "out")
    assert {path.suffix for path in drawn} == {".png", ".pdf", ".csv"}
    ratios = {row["region"]: row["ratio"] for row in solve_times(result.times)}
    assert ratios[ELLIPSE] == 1.0 and ratios.keys() == rows.keys()


def test_a_region_that_is_refused_leaves_a_remark(shipped: RegionPrice, tmp_path: Path) -> None:
    """The paper's ellipse guarantees no risk: it has no level for one. Nobody arrives in 2 s."""
    only = replace(
        shipped.quick(),
        regions={ELLIPSE: shipped.regions[ELLIPSE]},
        at_risk=(ELLIPSE,),
        settings=replace(shipped.settings, time_limit=2.0),
    )
    result = run(only, tmp_path / "out")
    played, refused = result.rows
    assert not played["remark"] and refused["region"] == ELLIPSE + AT_RISK
    assert "guarantees no collision risk" in refused["remark"]
    assert [row["region"] for row in result.times] == [ELLIPSE]
    first, second = read_table(tmp_path / "out" / "summary.csv")
    assert first["paired"] == 0 and np.isnan(first["extra_time"])
    assert second["remark"] == refused["remark"] and second["episodes"] is None
    assert draw(tmp_path / "out")


def test_areas_of_round_covariances(shipped: RegionPrice) -> None:
    reference = shipped.variant(ELLIPSE, shipped.predictors["kalman"])
    at_risk = shipped.variant(EXACT + AT_RISK, shipped.predictors["kalman"])
    deviations = np.array([0.1, 0.5, 2.0])
    covariances = deviations[:, None, None] ** 2 * np.eye(2)
    margin = 2 * shipped.robot.radius + 0.1
    expected = ((1.6448536 * deviations + margin) / (2.4477468 * deviations + margin)) ** 2
    assert area_ratio(at_risk, reference, covariances) == pytest.approx(expected.mean(), rel=1e-6)
    assert area_ratio(reference, reference, covariances) == pytest.approx(1.0, abs=1e-9)
    assert area_ratio(reference, reference, covariances[:0]) is None


def test_excess_is_over_seeds_at_which_both_arrived() -> None:
    def rows(*ratios: float) -> list[Row]:
        return [{"time_ratio_worst": ratio, "length_ratio_worst": 1.0} for ratio in ratios]

    found = excess(rows(1.2, np.inf, 1.0), rows(1.0, 1.0, np.inf), "time_ratio_worst")
    assert found == pytest.approx([0.2])


def test_ratios_are_within_one_task_and_their_median_over_seeds() -> None:
    times: list[Row] = []
    for seed, pace in enumerate((1.0, 3.0, 10.0)):  # a machine that gets slower
        solves = {ELLIPSE: [pace] * 9, "other": [(2.0 + seed) * pace] * 9, "none": []}
        times += time_rows([({"forecast": "f", "region": n}, own) for n, own in solves.items()])
    lines = {line["region"]: line for line in solve_times(times)}
    assert lines.keys() == {ELLIPSE, "other"}
    assert [lines["other"][key] for key in ("ratio_q25", "ratio", "ratio_q75")] == [2.5, 3.0, 3.5]
    assert lines["other"]["solves"] == 27 and lines[ELLIPSE]["ratio_p95"] == 1.0
    alone = solve_times(time_rows([({"forecast": "f", "region": "other"}, [1.0])]))
    assert np.isnan(alone[0]["ratio"])


def test_bad_settings_are_named(shipped: RegionPrice) -> None:
    with pytest.raises(WideberthError, match="must be named 'mahalanobis_ellipse'"):
        replace(shipped, regions={EXACT: shipped.regions[EXACT]})
    with pytest.raises(WideberthError, match="at_risk names"):
        replace(shipped, at_risk=("ellipse",))
    with pytest.raises(WideberthError, match="predictors"):
        replace(shipped, predictors={})
    with pytest.raises(WideberthError, match="seeds"):
        replace(shipped, seeds=0)

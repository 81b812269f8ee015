"""The comparison of costs in closed loop."""

from dataclasses import replace
from pathlib import Path

import pytest

from wideberth.experiments.engine.base import Row
from wideberth.experiments.engine.runner import draw, run
from wideberth.experiments.engine.shipped_configs import read_experiment
from wideberth.experiments.studies.cost_comparison import CostComparison, solve_times
from wideberth.experiments.studies.variants import planner_of
from wideberth.framework.values.errors import WideberthError


@pytest.fixture(scope="module")
def shipped() -> CostComparison:
    experiment, _ = read_experiment("cost_comparison", [])
    assert isinstance(experiment, CostComparison)
    return experiment


def test_the_planner_is_that_of_the_crossing(shipped: CostComparison) -> None:
    crossing, _ = read_experiment("crossing", [])
    planner, usual = planner_of(shipped.planner), crossing.planners["default"]  # type: ignore[attr-defined]
    assert shipped.seeds >= 20 and list(shipped.costs) == ["tracking", "contouring"]
    for name in ("region", "predictor", "solver", "penalty", "margin", "horizon"):
        assert getattr(planner, name) == getattr(usual, name)


def test_a_crossing_with_each_cost(shipped: CostComparison, tmp_path: Path) -> None:
    result = run(shipped, tmp_path / "out", quick=True)
    lines = shipped.summary(result.rows)
    assert [line["cost"] for line in lines] == ["tracking", "contouring"]
    for line in lines:
        assert line["episodes"] == line["goals_in_time"] == 1
        assert line["collisions"] == 0 and line["clearance_min_m"] > 0.2
        assert 0.49 < line["peak_speed"] <= 0.7 + 1e-6
        assert 0.0 < line["deviation"] < 2.0
    assert solve_times(result.times)[0]["ratio"] == 1.0
    assert {path.suffix for path in draw(tmp_path / "out")} == {".png", ".pdf", ".csv"}


def test_ratios_are_within_one_seed() -> None:
    times: list[Row] = [
        {"scenario": "s", "planner": name, "seed": seed, "median_s": factor * pace, "p95_s": pace}
        for seed, pace in enumerate((1.0, 10.0, 100.0))
        for name, factor in (("a", 1.0), ("b", 2.0 + seed))
    ]
    first, second = solve_times(times)
    assert (first["ratio"], second["ratio"]) == (1.0, 3.0)
    assert second["median_ms"] == pytest.approx(30e3)


def test_settings_that_make_no_experiment_are_refused(shipped: CostComparison) -> None:
    with pytest.raises(WideberthError, match="costs is empty"):
        replace(shipped, costs={})
    with pytest.raises(WideberthError, match="seeds"):
        replace(shipped, seeds=0)

"""The open-loop experiments reproduce the published tables; their figures only draw."""

import math
from dataclasses import fields
from pathlib import Path
from statistics import NormalDist
from typing import Any

import pytest

from wideberth.experiments.engine.base import Experiment, Result, Row
from wideberth.experiments.engine.csv_tables import write_table
from wideberth.experiments.engine.shipped_configs import config_path
from wideberth.experiments.studies.approximation_error import ApproximationError, map_rows
from wideberth.experiments.studies.ellipse_construction import EllipseConstruction
from wideberth.experiments.studies.forecast_regions import ForecastRegions
from wideberth.framework.plugins.io import write_bytes
from wideberth.framework.plugins.yamlfile import read_config
from wideberth.framework.values.errors import WideberthError

EXPERIMENTS = [ApproximationError(), ForecastRegions(), EllipseConstruction()]


def measured(experiment: Experiment) -> list[Row]:
    return [row for task in experiment.tasks() for row in experiment.measure(task).rows]


def test_approximation_error_peaks() -> None:
    experiment = ApproximationError(angles=3601, resolution=2)
    table = {row["condition"]: row for row in experiment.summary(measured(experiment))}
    published = {2: (0.00823, 38.17), 10: (0.12065, 21.78), 100: (0.84255, 7.63)}
    for condition, (error, angle) in published.items():
        row = table[condition]
        assert row["largest_radial_error"] == pytest.approx(error, abs=6e-6)
        assert row["at_deg_radial"] == pytest.approx(angle, abs=0.03)
        assert row["largest_clearance_error"] == pytest.approx(row["closed_form"], abs=2e-6)
    assert table[1]["largest_radial_error"] == 0.0


def test_approximation_error_vanishes_on_the_axes() -> None:
    for row in measured(ApproximationError(angles=7, resolution=2)):
        if row["part"] == "curve" and row["polar_angle_deg"] in (0.0, 90.0):
            assert row["radial_error_over_margin"] == pytest.approx(0.0, abs=1e-11)
            assert row["clearance_error_over_margin"] == pytest.approx(0.0, abs=1e-11)


PUBLISHED = {
    0.1: {10: 0.02352, 100: 0.12681, 1e3: 0.32639, 1e4: 0.55501},
    0.5: {10: 0.07136, 100: 0.28649, 1e3: 0.53622, 1e4: 0.72466},
    1.0: {10: 0.09572, 100: 0.34154, 1e3: 0.58799, 1e4: 0.75944},
    5.0: {10: 0.13179, 100: 0.40496, 1e3: 0.64010, 1e4: 0.79263},
}
"""Largest clearance error over the margin: short semi-axis in margins -> condition -> error."""


@pytest.mark.parametrize("size", PUBLISHED)
@pytest.mark.parametrize("margin", [0.3, 1.5])
def test_map_has_the_published_errors(size: float, margin: float) -> None:
    rows = {row["condition"]: row for row in map_rows(size, margin, 5)}
    assert rows[1]["largest_clearance_error_closed_form"] == 0.0
    for condition, error in PUBLISHED[size].items():
        row = rows[condition]
        assert row["largest_clearance_error_closed_form"] == pytest.approx(error, abs=6e-6)
        # The search ends within 6e-5 rad of the peak, and the curve is flat there.
        assert row["largest_clearance_error_found"] == pytest.approx(
            row["largest_clearance_error_closed_form"], abs=1e-7
        )


def test_map_covers_the_grid_and_is_summed_up() -> None:
    experiment = ApproximationError(conditions=(4.0,), angles=3, resolution=5)
    rows = measured(experiment)
    chart = [row for row in rows if row["part"] == "map"]
    assert {row["short_axis_over_margin"] for row in chart} == {0.01, 0.1, 1.0, 10.0, 100.0}
    assert {row["condition"] for row in chart} == {1.0, 10.0, 100.0, 1e3, 1e4}
    lines = [line for line in experiment.summary(rows) if "largest_disagreement" in line]
    assert [line["condition"] for line in lines] == [1e4] * 5
    assert max(line["largest_disagreement"] for line in lines) < 1e-7
    errors = [line["closed_form"] for line in lines]
    assert errors == sorted(errors)  # a smaller margin loses a larger share of itself


def test_forecast_regions_over_the_contents() -> None:
    experiment = ForecastRegions(draws=20_000)
    rows = measured(experiment)
    assert len(rows) == len(experiment.contents) * len(experiment.correlations)
    normal = NormalDist()
    for row in rows:
        p, rho = row["content"], row["correlation"]
        z, square = normal.inv_cdf(1 - (1 - p) / 4), -2 * math.log(1 - p)
        expected = 4 * z**2 / (math.pi * square * math.sqrt(1 - rho**2))
        assert row["area_ratio"] == pytest.approx(expected, rel=1e-9)
        assert row["rectangle_content"] >= p
        four = 4 * (p * (1 - p) / 20_000) ** 0.5
        assert row["ellipse_frequency"] == pytest.approx(p, abs=four)
        if rho == 0:
            assert row["rectangle_content"] == pytest.approx((1 - (1 - p) / 2) ** 2, abs=1e-9)


def test_forecast_regions_against_the_table() -> None:
    experiment = ForecastRegions(draws=20_000, contents=(0.9,))
    rows = {row["correlation"]: row for row in experiment.summary(measured(experiment))}
    assert rows[0.8]["area_ratio"] == pytest.approx(1.7701, abs=6e-5)
    assert rows[0.8]["rectangle_content"] == pytest.approx(0.921942, abs=1e-6)
    for row in rows.values():
        content, three = row["rectangle_content"], 3 * (0.1 * 0.9 / 20_000) ** 0.5
        assert row["rectangle_frequency"] == pytest.approx(content, abs=three)
        assert row["ellipse_frequency"] == pytest.approx(0.9, abs=three)


def test_forecast_regions_compares_the_enlarged_areas_with_both_ellipses() -> None:
    """The paper's ellipse is the one with longer axes; the exact sum stands beside it."""
    experiment = ForecastRegions(
        draws=1, contents=(0.9,), correlations=(0.0, 0.8), deviations=(1.0, 0.1)
    )
    rows = {row["correlation"]: row for row in measured(experiment)}
    lines = {line["correlation"]: line for line in experiment.summary(list(rows.values()))}
    s = math.sqrt(-2 * math.log(0.1))
    ellipse = math.pi * (s + 1.5) * (0.1 * s + 1.5)
    assert rows[0.0]["ellipse_enlarged_m2"] == pytest.approx(ellipse, rel=1e-12)
    assert lines[0.0]["sum_ratio"] == pytest.approx(0.9974, abs=6e-5)
    for rho, row in rows.items():
        assert row["enlarged_ratio"] == row["rectangle_enlarged_m2"] / row["ellipse_enlarged_m2"]
        assert row["sum_ratio"] == row["rectangle_enlarged_m2"] / row["sum_enlarged_m2"]
        assert lines[rho]["enlarged_ratio"] > max(1.0, lines[rho]["sum_ratio"])


def test_ellipse_construction_risks() -> None:
    experiment = EllipseConstruction()
    rows = {row["curve"]: row for row in experiment.summary(measured(experiment))}
    # Published for deviations (1, 0.1) m, margin 1.5 m, p = 0.95: 3.2e-2 against 7.1e-3.
    assert rows["outer ellipse"]["largest_collision_risk"] == pytest.approx(3.2e-2, abs=5e-4)
    assert rows["exact sum"]["largest_collision_risk"] == pytest.approx(7.1e-3, abs=5e-5)
    areas = {name: row["area_m2"] for name, row in rows.items()}
    assert areas["outer ellipse"] / areas["exact sum"] == pytest.approx(0.907, abs=6e-4)
    assert rows["exact sum"]["smallest_clearance_m"] == pytest.approx(1.5, abs=1e-8)


@pytest.mark.parametrize("experiment", EXPERIMENTS, ids=lambda one: type(one).__name__)
def test_figures_are_drawn_from_the_result_alone(experiment: Any, tmp_path: Path) -> None:
    small = experiment.quick()
    rows: list[Row] = []
    for task in small.tasks():
        outcome = small.measure(task)
        rows += outcome.rows
        for name, content in outcome.files.items():
            (tmp_path / "files").mkdir(exist_ok=True)
            write_bytes(tmp_path / "files" / name, content)
    write_table(tmp_path / "table.csv", rows)
    first, second = tmp_path / "first", tmp_path / "second"
    drawn = small.figures(Result(tmp_path), first)
    assert {path.suffix for path in drawn} == {".png", ".pdf"}
    again = small.figures(Result(tmp_path), second)
    assert [path.read_bytes() for path in drawn] == [path.read_bytes() for path in again]


@pytest.mark.parametrize("experiment", EXPERIMENTS, ids=lambda one: type(one).__name__)
def test_shipped_config_states_the_defaults(experiment: Any) -> None:
    name = Path(__import__(type(experiment).__module__, fromlist=["x"]).__file__).stem
    config = read_config(config_path(name), [])
    assert config.pop("type") == name
    assert set(config) == {field.name for field in fields(experiment)}
    for key, value in config.items():
        default = getattr(experiment, key)
        assert (tuple(value) if isinstance(value, list) else value) == default


def test_bad_settings_are_named() -> None:
    with pytest.raises(WideberthError, match="conditions"):
        ApproximationError(conditions=(0.5,))
    with pytest.raises(WideberthError, match="correlations"):
        ForecastRegions(correlations=(1.0,))
    with pytest.raises(WideberthError, match="wanted one of contents"):
        ForecastRegions(content=0.7)
    with pytest.raises(WideberthError, match="resolution"):
        ApproximationError(resolution=1)
    with pytest.raises(WideberthError, match="content"):
        EllipseConstruction(content=1.5)

"""The experiment on the risk along the boundary: its table, what it leaves out, its figure."""

import json
from pathlib import Path

import pytest

from wideberth.experiments.engine.base import Result, Row
from wideberth.experiments.engine.csv_tables import write_table
from wideberth.experiments.engine.shipped_configs import read_experiment
from wideberth.experiments.studies.boundary_risk import BoundaryRisk
from wideberth.framework import names
from wideberth.framework.plugins.io import write_bytes
from wideberth.framework.values.errors import WideberthError
from wideberth.regions.luetkepohl_rectangle import LuetkepohlRectangle
from wideberth.regions.mahalanobis_ellipse import MahalanobisEllipse
from wideberth.regions.minkowski_sum import MinkowskiSum

REGIONS = {
    "ellipse": MahalanobisEllipse(),
    "sum": MinkowskiSum(),
    "box": LuetkepohlRectangle("box"),
}


def run(experiment: BoundaryRisk, folder: Path) -> list[Row]:
    rows: list[Row] = []
    for task in experiment.tasks():
        outcome = experiment.measure(task)
        rows += outcome.rows
        for name, content in outcome.files.items():
            (folder / "files").mkdir(exist_ok=True)
            write_bytes(folder / "files" / name, content)
    write_table(folder / "table.csv", rows)
    return rows


def test_published_row(tmp_path: Path) -> None:
    experiment = BoundaryRisk(REGIONS, registered=False, cases=((1.0, 0.1, 1.5),))
    rows = run(experiment, tmp_path)
    table = {row["region"]: row for row in experiment.summary(rows)}
    published = {"ellipse": (0.907, 3.2e-2), "sum": (1.0, 7.1e-3), "box": (1.081, 1.24e-2)}
    for name, (area, risk) in published.items():
        assert table[name]["area_ratio"] == pytest.approx(area, abs=1e-3)
        assert table[name]["risk_max"] == pytest.approx(risk, rel=0.01)
        assert table[name]["above_tail"] is False
    by_name = {row["region"]: row for row in rows}
    for name in published:
        curve = json.loads((tmp_path / "files" / f"0_{name}.json").read_text())
        low, high = by_name[name]["risk_min"], by_name[name]["risk_max"]
        assert low * (1 - 1e-8) <= min(curve["risk"]) and max(curve["risk"]) <= high * (1 + 1e-8)
        assert max(curve["risk"]) == pytest.approx(high, rel=1e-3)


def test_the_lengthened_ellipse_can_exceed_the_tail(tmp_path: Path) -> None:
    """Condition 100 and margins far above the deviations: 1.38 times the tail (published)."""
    experiment = BoundaryRisk(
        {"ellipse": MahalanobisEllipse()}, registered=False, cases=((0.15, 0.015, 1.5),)
    )
    (row,) = experiment.summary(run(experiment, tmp_path))
    assert row["above_tail"] is True
    assert row["risk_max"] == pytest.approx(1.38 * 0.05, rel=5e-3)


def test_what_is_registered_is_measured() -> None:
    experiment, _ = read_experiment("boundary_risk", [])
    assert isinstance(experiment, BoundaryRisk)
    found = {task.settings["region"] for task in experiment.tasks()}
    assert {"mahalanobis_ellipse", "minkowski_sum", "luetkepohl_rectangle_box"} <= found
    assert found - {"luetkepohl_rectangle_box"} <= set(names("regions"))
    assert len(experiment.tasks()) == 4 * len(found)
    assert experiment.cases == BoundaryRisk().cases and experiment.tail == BoundaryRisk().tail


def test_a_region_that_is_empty_leaves_a_remark(tmp_path: Path) -> None:
    experiment = BoundaryRisk(REGIONS, registered=False, cases=((0.0, 0.0, 0.0),))
    rows = run(experiment, tmp_path)
    lines = {row["region"]: row for row in experiment.summary(rows)}
    assert lines["sum"]["above_tail"] is None and lines["sum"]["risk_max"] is None
    assert "empty" in {row["region"]: row for row in rows}["sum"]["remark"]
    assert experiment.figures(Result(tmp_path), tmp_path / "figures")


def test_figure_is_drawn_from_the_result_alone(tmp_path: Path) -> None:
    shipped, _ = read_experiment("boundary_risk", [])
    small = shipped.quick()
    run(small, tmp_path)
    drawn = small.figures(Result(tmp_path), tmp_path / "first")
    assert {path.suffix for path in drawn} == {".png", ".pdf"}
    again = small.figures(Result(tmp_path), tmp_path / "second")
    assert [path.read_bytes() for path in drawn] == [path.read_bytes() for path in again]


def test_bad_settings_are_named() -> None:
    with pytest.raises(WideberthError, match="cases"):
        BoundaryRisk(cases=())
    with pytest.raises(WideberthError, match="regions"):
        BoundaryRisk(registered=False)
    with pytest.raises(WideberthError, match="tail"):
        BoundaryRisk(tail=1.0)
    with pytest.raises(WideberthError, match="margin"):
        BoundaryRisk(cases=((1.0, 1.0, -1.0),))

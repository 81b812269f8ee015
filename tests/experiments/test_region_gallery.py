"""The gallery shows every registered region, and says why one is missing."""

import json
import math
from pathlib import Path

import numpy as np
import pytest
from shapely import LinearRing, Point

from wideberth.experiments.engine.base import Result, Row
from wideberth.experiments.engine.csv_tables import read_table, write_table
from wideberth.experiments.engine.shipped_configs import read_experiment
from wideberth.experiments.studies.region_gallery import RegionGallery
from wideberth.framework import names
from wideberth.framework.plugins.io import write_bytes
from wideberth.framework.values.errors import WideberthError
from wideberth.regions.luetkepohl_rectangle import LuetkepohlRectangle
from wideberth.regions.mahalanobis_ellipse import MahalanobisEllipse
from wideberth.regions.park import Park


def run(experiment: RegionGallery, folder: Path) -> dict[str, Row]:
    rows: list[Row] = []
    for task in experiment.tasks():
        outcome = experiment.measure(task)
        rows += outcome.rows
        for name, content in outcome.files.items():
            (folder / "files").mkdir(exist_ok=True)
            write_bytes(folder / "files" / name, content)
    write_table(folder / "table.csv", rows)
    return {row["region"]: row for row in read_table(folder / "table.csv")}


def test_every_registered_region_is_shown() -> None:
    experiment, _ = read_experiment("region_gallery", [])
    assert isinstance(experiment, RegionGallery)
    shown = {task.settings["region"] for task in experiment.tasks()}
    assert shown >= set(names("regions"))  # all of them know two coordinates
    assert {"luetkepohl_rectangle_box", "eigen_rectangle_box"} <= shown
    default = RegionGallery()
    for key in ("deviations", "correlation", "margin", "tail", "registered"):
        assert getattr(experiment, key) == getattr(default, key)


def test_areas_and_outlines(tmp_path: Path) -> None:
    experiment = RegionGallery(
        {"ellipse": MahalanobisEllipse(), "disc": LuetkepohlRectangle()},
        registered=False,
        deviations=(1.0, 0.5),
        correlation=0.0,
        margin=0.75,
    )
    rows = run(experiment, tmp_path)
    s, z = math.sqrt(-2 * math.log(0.05)), LuetkepohlRectangle().level(0.05)
    h, k, r = z, 0.5 * z, 0.75
    area = 4 * h * k + 4 * r * (h + k) + math.pi * r**2
    assert rows["disc"]["area"] == pytest.approx(area, rel=1e-8)
    assert rows["ellipse"]["area"] == pytest.approx(math.pi * (s + r) * (0.5 * s + r), rel=1e-8)
    curves = json.loads((tmp_path / "files" / "ellipse.json").read_text())
    around = np.linspace(0.0, 2 * np.pi, 2000, endpoint=False)
    content = LinearRing(np.stack([s * np.cos(around), 0.5 * s * np.sin(around)], axis=1))
    for point in curves["exact"][::20]:
        assert content.distance(Point(point)) == pytest.approx(r, abs=1e-4)  # a polygon's error
    x, y = np.array(curves["region"]).T
    np.testing.assert_allclose((x / (s + r)) ** 2 + (y / (0.5 * s + r)) ** 2, 1.0, atol=1e-6)


def test_what_is_not_defined_is_listed_with_the_reason(tmp_path: Path) -> None:
    experiment = RegionGallery(
        {"ellipse": MahalanobisEllipse(), "park": Park()},
        registered=False,
        deviations=(1.0, 0.0),
        correlation=0.0,
    )
    rows = run(experiment, tmp_path)
    lines = experiment.summary(list(rows.values()))
    assert [line["region"] for line in lines] == ["ellipse", "park"]
    assert lines[1]["remark"] and lines[1]["area_ratio"] is None
    assert experiment.figures(Result(tmp_path), tmp_path / "figures")


def test_figure_is_drawn_from_the_result_alone(tmp_path: Path) -> None:
    small = read_experiment("region_gallery", [])[0].quick()
    assert isinstance(small, RegionGallery)
    rows = run(small, tmp_path)
    sizes = [line["area_ratio"] for line in small.summary(list(rows.values()))]
    assert len(sizes) == 3 and sizes == sorted(sizes)
    drawn = small.figures(Result(tmp_path), tmp_path / "first")
    assert {path.suffix for path in drawn} == {".png", ".pdf"}
    again = small.figures(Result(tmp_path), tmp_path / "second")
    assert [path.read_bytes() for path in drawn] == [path.read_bytes() for path in again]


def test_bad_settings_are_named() -> None:
    with pytest.raises(WideberthError, match="correlation is 1"):
        RegionGallery(correlation=1.0)
    with pytest.raises(WideberthError, match="tail"):
        RegionGallery(tail=0.0)
    with pytest.raises(WideberthError, match="margin"):
        RegionGallery(margin=-1.0)
    with pytest.raises(WideberthError, match="deviations"):
        RegionGallery(deviations=(1.0, -1.0))
    with pytest.raises(WideberthError, match="regions"):
        RegionGallery(registered=False)

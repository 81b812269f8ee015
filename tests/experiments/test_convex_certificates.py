"""Convex programs certify the closed forms of regions; here closed forms certify the programs."""

from pathlib import Path

import numpy as np
import pytest

from wideberth.experiments.engine.runner import draw, run
from wideberth.experiments.studies.convex_certificates import (
    ConvexCertificates,
    distances,
    smallest_ellipse,
    sum_support,
)
from wideberth.framework.values.errors import WideberthError
from wideberth.regions import inflation
from wideberth.regions.du_toit import DuToit
from wideberth.regions.mahalanobis_ellipse import MahalanobisEllipse
from wideberth.regions.minimum_area import MinimumArea
from wideberth.regions.minkowski_sum import MinkowskiSum

ANGLES = np.linspace(0.0, 2.0 * np.pi, 40, endpoint=False)
NORMALS = np.stack([np.cos(ANGLES), np.sin(ANGLES)], axis=1)


def test_support_of_a_sum_is_the_sum_of_supports() -> None:
    axes = np.array([6.0, 0.5])
    want = np.hypot(*(axes * NORMALS).T) + 1.5
    np.testing.assert_allclose(sum_support(axes, 1.5, NORMALS), want, atol=1e-6)


def test_distances_of_a_disc_and_of_a_square() -> None:
    points = np.array([[3.0, 0.4], [-1.0, 2.5], [2.0, 2.0]])

    def disc(normals: np.ndarray) -> np.ndarray:
        return np.ones(len(normals))

    def square(normals: np.ndarray) -> np.ndarray:
        return np.abs(normals).sum(axis=1)

    found = distances(points, disc, NORMALS)
    np.testing.assert_allclose(found, np.linalg.norm(points, axis=1) - 1.0, atol=1e-5)
    np.testing.assert_allclose(distances(points, square, NORMALS), [2.0, 1.5, 2**0.5], atol=1e-5)


def test_smallest_ellipse_of_two_discs_is_their_sum() -> None:
    np.testing.assert_allclose(smallest_ellipse(np.array([2.0, 2.0]), 1.5), 3.5, rtol=1e-4)


def test_certificates_agree_with_closed_forms(tmp_path: Path) -> None:
    """The clearance that the paper's ellipse loses, and the least area."""
    regions = {
        "mahalanobis_ellipse": MahalanobisEllipse(),
        "minkowski_sum": MinkowskiSum(),
        "minimum_area": MinimumArea(),
    }
    settings = {"directions": 120, "points": 3, "conditions": (1.0, 25.0)}
    experiment = ConvexCertificates(regions, False, **settings)
    result = run(experiment, tmp_path / "r")
    rows = {(row["region"], row["condition"]): row for row in result.rows}
    assert {key: row["certified"] for key, row in rows.items()} == {
        **dict.fromkeys(((name, 1.0) for name in regions), "exact"),
        ("mahalanobis_ellipse", 25.0): "inner",
        ("minkowski_sum", 25.0): "exact",
        ("minimum_area", 25.0): "outer",
    }
    lost = inflation.largest_clearance_error(np.array(7.5), np.array(1.5), np.array(1.5)) / 1.5
    assert rows["mahalanobis_ellipse", 25.0]["gap_min"] == pytest.approx(-float(lost), abs=2e-3)
    assert all(row["distance_error"] < 2e-4 for row in rows.values())
    assert rows["minimum_area", 25.0]["area_ratio"] == pytest.approx(1.0, abs=5e-5)
    assert rows["minkowski_sum", 25.0]["area_ratio"] < 1.0 - 1e-3
    (png, pdf) = draw(tmp_path / "r")
    assert png.suffix == ".png" and pdf.suffix == ".pdf" and png.stat().st_size > 10_000
    (line, *_) = experiment.summary(result.rows)
    assert line["certified"] == "exact, inner" and line["declared"] == "inner"


def test_only_convex_regions_within_the_solvers_digits() -> None:
    with pytest.raises(WideberthError, match=r"regions \['du_toit'\] have no support function"):
        ConvexCertificates({"du_toit": DuToit()})
    with pytest.raises(WideberthError, match=r"conditions is \(1000000\.0,\); wanted"):
        ConvexCertificates(conditions=(1e6,))
    with pytest.raises(WideberthError, match=r"short_axis is 3\.0; wanted"):
        ConvexCertificates(short_axis=3.0)
    with pytest.raises(WideberthError, match="regions is empty"):
        ConvexCertificates(registered=False)

"""Regions and collision risk against golden values computed independently with 50 digits.

One adapter per function of the file gives each quantity that exists here as a callable; the file
may be any of the same schema (``--golden FILE``). A function or field without one is reported, not
failed: it belongs to something that is not built yet. The public file has none.
"""

import json
import math
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from wideberth.framework.numerics.eigenframe import eigen_axes
from wideberth.framework.risk.collision_probability import collision_probability
from wideberth.framework.values.forecast import GaussianObstacle
from wideberth.metrics import ellipses
from wideberth.regions import gaussian
from wideberth.regions.box import box_content, distance_to_box
from wideberth.regions.eigen_rectangle import EigenRectangle
from wideberth.regions.gaussian import CENTRE
from wideberth.regions.luetkepohl_rectangle import LuetkepohlRectangle
from wideberth.regions.mahalanobis_ellipse import MahalanobisEllipse
from wideberth.regions.minkowski_sum import MinkowskiSum
from wideberth.tests.oracles import inflation
from wideberth.tests.oracles.polygons import max_face, polygon_signed_distance
from wideberth.tests.oracles.region_levels import bhattacharyya_distance, ellipse_level_of_content
from wideberth.tests.oracles.risk_bounds import (
    box_bound,
    centre_line_bound,
    centre_point_value,
    half_plane_bound,
    half_plane_level,
    highest_density_bound,
)

PUBLIC = Path(__file__).parents[1] / "golden_regions.json"

Fields = dict[str, Callable[[], Any]]


def region_case(given: dict[str, Any]) -> Fields:
    sigma, point = np.array(given["Sigma"], dtype=float), np.array(given["point"], dtype=float)
    mean, margin = np.array(given["mu"], dtype=float), np.float64(given["r"] + given["r_d"])
    s = ellipse_level_of_content(given["p"])
    deviations, vectors = eigen_axes(sigma)
    a, b = s * deviations
    obstacle = GaussianObstacle(mean, sigma)
    ellipse, exact, rectangle = MahalanobisEllipse(), MinkowskiSum(), LuetkepohlRectangle()
    inflated, packed = ellipse.parameters(obstacle, margin), exact.parameters(obstacle, margin)
    bare = exact.parameters(obstacle, np.float64(0.0))
    z = rectangle.level(1.0 - given["p"])
    box = rectangle.parameters(obstacle, margin)
    level = np.float64(s)
    axes = np.array([a, b])
    means = inflation.means(a, b)
    trace, area = inflation.least_trace, inflation.least_area
    return {
        "s": lambda: s,
        "eigenvalues_desc": lambda: deviations**2,
        "major_axis_angle": lambda: math.atan2(vectors[1, 0], vectors[0, 0]) % math.pi,
        "a": lambda: a,
        "b": lambda: b,
        "R": lambda: margin,
        "inflated_axes": lambda: axes + margin,
        "inflated_level": lambda: symbolic_q(ellipse, point, inflated, s),
        "A_mean": lambda: means[0],
        "H_mean": lambda: means[1],
        "max_clearance_error": lambda: inflation.largest_clearance_error(a, b, margin),
        "R_eff": lambda: inflation.effective_margin(a, b, margin),
        "cos2_worst_normal": lambda: inflation.worst_normal_cosine(a, b, margin),
        "g_eff": lambda: inflation.effective_level_ratio(a, b, margin),
        "s_req": lambda: inflation.smallest_level(*deviations, s, margin),
        "delta_min": lambda: inflation.smallest_margin(a, b, margin),
        "brito_axes": lambda: axes + inflation.smallest_margin(a, b, margin),
        "beta_trace": lambda: trace(a, b, margin),
        "axes_min_trace": lambda: inflation.outer_axes(a, b, margin, trace(a, b, margin)),
        "beta_volume": lambda: area(a, b, margin),
        "axes_min_area": lambda: inflation.outer_axes(a, b, margin, area(a, b, margin)),
        "perimeter": lambda: ellipses.perimeter(axes),
        "area_ellipse": lambda: exact.area(bare, level),
        "area_inflated": lambda: ellipse.area(inflated, level),
        "area_exact": lambda: exact.area(packed, level),
        "signed_distance_ellipse": lambda: exact.signed_distance(point, bare, level),
        "signed_distance_exact": lambda: exact.signed_distance(point, packed, level),
        "gauge_exact": lambda: exact.gauge(point, packed, level),
        "z_bonferroni": lambda: z,
        "bonferroni_halfwidths_axis_aligned": lambda: z * box[2:4],
        "collision_probability": lambda: collision_probability(mean - point, sigma, margin),
        "optimal_halfplane_m": lambda: half_plane_level(mean - point, sigma, margin),
        "optimal_halfplane_bound": lambda: half_plane_bound(mean - point, sigma, margin),
        "boundary_halfplane_guarantee": lambda: exact.risk(s),
        "dutoit": lambda: centre_point_value(mean - point, sigma, margin),
        "park": lambda: highest_density_bound(mean - point, sigma, margin),
        "zhu_halfplane": lambda: centre_line_bound(mean - point, sigma, margin),
        "whitened_box_bound": lambda: box_bound(mean - point, sigma, margin),
    }


def symbolic_q(region: MahalanobisEllipse, point: Any, parameters: Any, level: float) -> float:
    """The paper's left-hand side, from the constraint that the solver sees."""
    from wideberth.framework.numerics.symbolic import ca
    from wideberth.framework.values.motion import Pose

    x, p = ca.SX.sym("x", 2), ca.SX.sym("p", len(parameters))
    (value,) = region.constraint(Pose((x[0], x[1])), p, level, ca.SX(0, 1)).inequalities
    logarithm = float(ca.Function("c", [x, p], [value])(point, parameters))
    return (1.0 + CENTRE) * math.exp(2.0 * logarithm) - CENTRE


def inflation_error(given: dict[str, Any]) -> Fields:
    a, b, margin = (np.float64(given[name]) for name in ("a", "b", "R"))
    angle = np.float64(math.radians(given["angle_deg"]))
    return {
        "radial_error": lambda: inflation.radial_error(a, b, margin, angle),
        "clearance_error": lambda: inflation.clearance_error(a, b, margin, angle),
        "support_error_at_normal_angle": lambda: inflation.support_error(a, b, margin, angle),
        "rho_exact": lambda: inflation.exact_radius(a, b, margin, angle),
        "rho_inflated": lambda: inflation.ellipse_radius(a + margin, b + margin, angle),
    }


def point_ellipse(given: dict[str, Any]) -> Fields:
    order = [0, 1] if given["a"] >= given["b"] else [1, 0]
    point = np.array([given["x"], given["y"]], dtype=float)[order]
    axes = np.array([given["a"], given["b"]], dtype=float)[order]
    return {
        "signed_distance": lambda: ellipses.distance_to_ellipse(point, axes),
        "closest": lambda: ellipses.closest_point(point, axes)[order],
    }


def forecast_rectangle(given: dict[str, Any]) -> Fields:
    variants: dict[str, LuetkepohlRectangle | EigenRectangle] = {
        "bonferroni": LuetkepohlRectangle(),
        "sidak": LuetkepohlRectangle(correction="sidak"),
        "eigen_bonferroni": EigenRectangle(correction="bonferroni"),
        "eigen_sidak": EigenRectangle(correction="sidak"),
    }
    if given["variant"] not in variants:
        return {}
    region, rho = variants[given["variant"]], given["rho"]
    sigma = np.array([[1.0, rho], [rho, 1.0]])
    none = np.float64(0.0)
    z, s = region.level(1.0 - given["p"]), gaussian.ellipse_level(1.0 - given["p"])
    obstacle = GaussianObstacle(np.zeros(2), sigma)
    box = region.area(region.parameters(obstacle, none), np.float64(z))
    ellipse = MinkowskiSum().area(MinkowskiSum().parameters(obstacle, none), np.float64(s))
    eigen = isinstance(region, EigenRectangle)
    shape = np.diag(np.linalg.eigvalsh(sigma)) if eigen else sigma
    half = z * np.sqrt(np.diagonal(shape))
    return {
        "z": lambda: z,
        "coverage": lambda: box_content(half, shape),
        "area_over_ellipse_area": lambda: box / ellipse,
    }


def bhattacharyya(given: dict[str, Any]) -> Fields:
    first, second = np.array(given["Sigma1"]), np.array(given["Sigma2"])
    distance = bhattacharyya_distance(given["delta"], first, second)
    return {"distance": lambda: distance, "coefficient": lambda: np.exp(-distance)}


def polygon_sd(given: dict[str, Any]) -> Fields:
    point, vertices = np.array(given["point"]), np.array(given["vertices_ccw"])
    return {
        "signed_distance": lambda: polygon_signed_distance(point, vertices),
        "max_face": lambda: max_face(point, vertices),
    }


def ellipsoid_sum_3d(given: dict[str, Any]) -> Fields:
    axes, margin = np.sort(np.array(given["axes"]))[::-1], np.float64(given["R"])
    obstacle = GaussianObstacle(np.zeros(3), np.diag(axes**2))
    ellipse, exact, one = MahalanobisEllipse(), MinkowskiSum(), np.float64(1.0)
    a, c = axes[0], axes[-1]
    return {
        "surface": lambda: ellipses.surface(axes),
        "mean_width": lambda: 2.0 * ellipses.mean_support(axes),
        "volume_exact": lambda: exact.area(exact.parameters(obstacle, margin), one),
        "volume_inflated": lambda: ellipse.area(ellipse.parameters(obstacle, margin), one),
        "max_clearance_error": lambda: inflation.largest_clearance_error(a, c, margin),
        "delta_min": lambda: inflation.smallest_margin(a, c, margin),
    }


def collision(given: dict[str, Any]) -> Fields:
    sigma = np.diag([given["sigma1"] ** 2, given["sigma2"] ** 2])
    d = [given["dx"], given["dy"]]
    return {"": lambda: collision_probability(d, sigma, given["R"])}


def collision_3d(given: dict[str, Any]) -> Fields:
    sigma = np.diag(np.array(given["sigma"]) ** 2)
    return {"": lambda: collision_probability(given["d"], sigma, given["R"])}


def s_of_p(given: dict[str, Any]) -> Fields:
    return {"": lambda: ellipse_level_of_content(given["p"], given["n"])}


def rectangle_sd(given: dict[str, Any]) -> Fields:
    return {"": lambda: distance_to_box(np.array(given["point"]), np.array(given["half"]))}


ADAPTERS: dict[str, Callable[[dict[str, Any]], Fields]] = {
    "region_case": region_case,
    "s_of_p": s_of_p,
    "inflation_error": inflation_error,
    "point_ellipse": point_ellipse,
    "collision_probability": collision,
    "collision_probability_3d": collision_3d,
    "forecast_rectangle": forecast_rectangle,
    "ellipsoid_sum_3d": ellipsoid_sum_3d,
    "rectangle_sd": rectangle_sd,
    "bhattacharyya": bhattacharyya,
    "polygon_sd": polygon_sd,
}


def tolerance(case: dict[str, Any], field: str) -> float:
    """What the file's meta says: 1e-10, 1e-9 for collision integrals, 1e-8 at condition 1e8."""
    if "cond" in case.get("note", "") and "1e8" in case["note"]:
        return 1e-8
    condition = case["inputs"].get("Sigma")
    if condition is not None:
        values = np.abs(np.linalg.eigvalsh(condition))
        if 0.0 < values.min() < 1.01e-8 * values.max():
            return 1e-8
    if "collision_probability" in (case["func"], case["func"].removesuffix("_3d"), field):
        return 1e-9
    return 1e-10


def agree(got: Any, want: Any, relative: float, modulus: float | None) -> bool:
    got, want = np.asarray(got, dtype=float), np.asarray(want, dtype=float)
    if got.shape != want.shape:
        return False
    gap = np.abs(got - want)
    if modulus is not None:  # an axis has no direction
        gap = np.minimum(gap, np.abs(modulus - gap))
    return bool((gap <= np.maximum(relative * np.abs(want), 1e-12)).all())


def compare(document: dict[str, Any]) -> tuple[int, int, Counter[str], list[str]]:
    """Check every pair; returns how many, how many are undefined, the unknown, the wrong."""
    checked, undefined, unknown, wrong = 0, 0, Counter[str](), []
    for case in document["cases"]:
        name, expected = case["func"], case["expected"]
        wanted = expected if isinstance(expected, dict) else {"": expected}
        fields = ADAPTERS[name](case["inputs"]) if name in ADAPTERS else {}
        for field, want in wanted.items():
            if field not in fields:
                unknown[f"{name}.{field}".rstrip(".")] += 1
            elif want is None:
                undefined += 1
            else:
                checked += 1
                modulus = math.pi if field == "major_axis_angle" else None
                got = fields[field]()
                if not agree(got, want, tolerance(case, field), modulus):
                    wrong.append(f"{case['id']} {name}.{field}: got {got!r}, wanted {want!r}")
    return checked, undefined, unknown, wrong


def test_every_known_pair(golden_path: Path, capsys: Any) -> None:
    document = json.loads(golden_path.read_text(encoding="utf-8"))
    checked, undefined, unknown, wrong = compare(document)
    with capsys.disabled():
        print(f"\n{golden_path.name}: {checked} pairs checked, {undefined} undefined")
        if unknown:
            listed = ", ".join(f"{name} ({count})" for name, count in sorted(unknown.items()))
            print(f"not built yet, {sum(unknown.values())} pairs: {listed}")
    assert checked, "no pair of the file is known here"
    assert not wrong, "\n".join(wrong)
    if golden_path == PUBLIC:
        assert not unknown


def test_unknown_functions_and_fields_are_reported_not_failed() -> None:
    document = {
        "cases": [
            {"id": "X1", "func": "not_built", "inputs": {}, "expected": {"x": 1.0, "y": None}},
            {"id": "X2", "func": "s_of_p", "inputs": {"p": 0.95, "n": 2}, "expected": 2.0},
        ]
    }
    checked, undefined, unknown, wrong = compare(document)
    assert (checked, undefined) == (1, 0)
    assert dict(unknown) == {"not_built.x": 1, "not_built.y": 1}
    assert len(wrong) == 1 and wrong[0].startswith("X2")

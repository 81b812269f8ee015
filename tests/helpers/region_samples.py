"""Regions and obstacles that several tests of the regions share."""

from typing import Any

import numpy as np

from wideberth.framework.region import Region
from wideberth.framework.values.forecast import GaussianObstacle
from wideberth.regions.best_half_plane import BestHalfPlane
from wideberth.regions.bhattacharyya import Bhattacharyya
from wideberth.regions.du_toit import DuToit
from wideberth.regions.eigen_rectangle import EigenRectangle
from wideberth.regions.half_plane import HalfPlane
from wideberth.regions.luetkepohl_rectangle import LuetkepohlRectangle
from wideberth.regions.mahalanobis_ellipse import MahalanobisEllipse
from wideberth.regions.minimum_area import MinimumArea
from wideberth.regions.minimum_trace import MinimumTrace
from wideberth.regions.minkowski_sum import MinkowskiSum
from wideberth.regions.outer_ellipse import OuterEllipse
from wideberth.regions.park import Park
from wideberth.regions.repaired_level import RepairedLevel
from wideberth.regions.repaired_margin import RepairedMargin
from wideberth.regions.risk_contour import RiskContour
from wideberth.regions.whitened_box import WhitenedBox

PAPER = [
    MahalanobisEllipse(),
    MinkowskiSum(),
    LuetkepohlRectangle(),
    LuetkepohlRectangle(enlargement="box"),
]
"""Those that the paper compares."""

OUTER: list[OuterEllipse] = [RepairedMargin(), RepairedLevel(), MinimumTrace(), MinimumArea()]
"""Ellipses that enclose the exact sum."""

RECTANGLES: list[EigenRectangle | LuetkepohlRectangle] = [
    EigenRectangle("sidak", "disc"),
    EigenRectangle("bonferroni", "disc"),
    EigenRectangle("sidak", "box"),
    EigenRectangle("bonferroni", "box"),
    LuetkepohlRectangle("disc", "sidak"),
    LuetkepohlRectangle("box", "sidak"),
]
"""Those that `PAPER` lacks."""

BY_RISK: list[Region] = [
    HalfPlane(),
    BestHalfPlane(),
    DuToit(),
    Park(),
    Bhattacharyya(),
    WhitenedBox(),
    RiskContour(),
]
"""Those whose tail is not a content: a collision risk, or what stands for it."""

COVARIANCE = np.array([[1.2, 0.5], [0.5, 0.4]])


def packed(region: Region, covariance: Any = COVARIANCE, margin: Any = 0.7) -> Any:
    covariance = np.asarray(covariance, dtype=float)
    mean = np.broadcast_to(np.arange(1.0, covariance.shape[-1] + 1.0), covariance.shape[:-1])
    return region.parameters(GaussianObstacle(mean, covariance), np.asarray(margin))


def random_covariances(rng: np.random.Generator, count: int, size: int) -> tuple[Any, Any]:
    """Covariances with deviations between 1e-4 m and 10 m, and margins of 1e-2 m to 10 m."""
    turn = np.linalg.qr(rng.standard_normal((count, size, size)))[0]
    variance = 10.0 ** (2 * rng.uniform(-4, 1, (count, size)))
    covariance = np.einsum("kij,kj,klj->kil", turn, variance, turn)
    return 0.5 * (covariance + np.swapaxes(covariance, 1, 2)), 10.0 ** rng.uniform(-2, 1, count)


def random_obstacles(
    rng: np.random.Generator, count: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Means, covariances up to condition 1e4, margins."""
    angle = rng.uniform(0.0, np.pi, count)
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    turn = np.moveaxis(turn, -1, 0)
    deviations = 10.0 ** rng.uniform(-1.5, 0.5, (count, 1)) * np.stack(
        [np.ones(count), 10.0 ** rng.uniform(-2.0, 0.0, count)], axis=-1
    )
    sigma = turn @ (deviations[..., None] ** 2 * np.swapaxes(turn, -1, -2))
    sigma = 0.5 * (sigma + np.swapaxes(sigma, -1, -2))
    return rng.uniform(-3.0, 3.0, (count, 2)), sigma, 10.0 ** rng.uniform(-1.0, 0.7, count)

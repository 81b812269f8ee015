"""Regions: sets that the robot keeps out of. One file per method."""

from ..framework.plugins.lazy import lazy

BUILT_IN: dict[str, str] = {
    "best_half_plane": "wideberth.regions.best_half_plane:BestHalfPlane",
    "bhattacharyya": "wideberth.regions.bhattacharyya:Bhattacharyya",
    "du_toit": "wideberth.regions.du_toit:DuToit",
    "eigen_rectangle": "wideberth.regions.eigen_rectangle:EigenRectangle",
    "half_plane": "wideberth.regions.half_plane:HalfPlane",
    "luetkepohl_rectangle": "wideberth.regions.luetkepohl_rectangle:LuetkepohlRectangle",
    "mahalanobis_ellipse": "wideberth.regions.mahalanobis_ellipse:MahalanobisEllipse",
    "minimum_area": "wideberth.regions.minimum_area:MinimumArea",
    "minimum_trace": "wideberth.regions.minimum_trace:MinimumTrace",
    "minkowski_sum": "wideberth.regions.minkowski_sum:MinkowskiSum",
    "park": "wideberth.regions.park:Park",
    "repaired_level": "wideberth.regions.repaired_level:RepairedLevel",
    "repaired_margin": "wideberth.regions.repaired_margin:RepairedMargin",
    "risk_contour": "wideberth.regions.risk_contour:RiskContour",
    "separating_line": "wideberth.regions.separating_line:SeparatingLine",
    "whitened_box": "wideberth.regions.whitened_box:WhitenedBox",
}
"""Name -> where the class is."""

__getattr__, __dir__, __all__ = lazy(__name__, BUILT_IN.values())

"""Regions: what to keep clear of. One file per method."""

BUILT_IN: dict[str, str] = {
    "luetkepohl_rectangle": "wideberth.regions.luetkepohl_rectangle:LuetkepohlRectangle",
    "mahalanobis_ellipse": "wideberth.regions.mahalanobis_ellipse:MahalanobisEllipse",
    "minkowski_sum": "wideberth.regions.minkowski_sum:MinkowskiSum",
}
"""Name -> where the class is."""

"""Static regions: how to keep clear of polygons that stand still. One file per method."""

BUILT_IN: dict[str, str] = {
    "dual": "wideberth.regions.static.dual:Dual",
    "separating_line": "wideberth.regions.static.separating_line:SeparatingLine",
}
"""Name -> where the class is."""

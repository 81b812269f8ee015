"""Static regions: constraints that keep a robot clear of fixed polygons. One file per method."""

BUILT_IN: dict[str, str] = {
    "dual": "wideberth.regions.static.dual:Dual",
    "separating_line": "wideberth.regions.static.separating_line:SeparatingLine",
}
"""Name -> where the class is."""

"""The robot's own state: filters of wheels and gyro, and a matcher of scans to a map."""

from ...framework.plugins.lazy import lazy

BUILT_IN: dict[str, str] = {
    "ekf": "wideberth.perception.state.ekf:Ekf",
    "scan_matching": "wideberth.perception.state.scan_matching:ScanMatching",
    "ukf": "wideberth.perception.state.ukf:Ukf",
}

__getattr__, __dir__, __all__ = lazy(__name__, BUILT_IN.values())

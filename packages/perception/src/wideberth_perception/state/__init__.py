"""The robot's own state: filters of wheels and gyro, and a matcher of scans to a map."""

from wideberth.framework.plugins.lazy import lazy

BUILT_IN: dict[str, str] = {
    "ekf": "wideberth_perception.state.ekf:Ekf",
    "scan_matching": "wideberth_perception.state.scan_matching:ScanMatching",
    "ukf": "wideberth_perception.state.ukf:Ukf",
}

__getattr__, __dir__, __all__ = lazy(__name__, BUILT_IN.values())

"""Robots: one file per model, each a frozen dataclass behind `wideberth.framework.robot.Robot`."""

from ..framework.plugins.lazy import lazy

BUILT_IN: dict[str, str] = {
    "bicycle": "wideberth.robots.bicycle:Bicycle",
    "differential_drive": "wideberth.robots.differential_drive:DifferentialDrive",
    "holonomic": "wideberth.robots.holonomic:Holonomic",
    "holonomic_3d": "wideberth.robots.holonomic_3d:Holonomic3D",
    "holonomic_velocity": "wideberth.robots.holonomic_velocity:HolonomicVelocity",
    "unicycle": "wideberth.robots.unicycle:Unicycle",
    "unicycle_velocity": "wideberth.robots.unicycle_velocity:UnicycleVelocity",
}

__getattr__, __dir__, __all__ = lazy(__name__, BUILT_IN.values())

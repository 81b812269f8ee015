"""Contract checks that every plug-in can run on itself.

Each room of plug-ins has one: `check_predictor`, `check_region`, `check_static_region`,
`check_robot`, `check_level`, `check_cost`, `check_slot_kind`, `check_controller`,
`check_scenario`. They are imported on first use, since each needs libraries of its own; that of
scenarios, which play in another room, stands there.
"""

from importlib import import_module
from typing import Any

CHECKS = {
    "check_predictor": ".predictor",
    "check_region": ".region",
    "check_static_region": ".static_region",
    "check_robot": ".robot",
    "check_level": ".level",
    "check_cost": ".cost",
    "check_slot_kind": ".slot_kind",
    "check_controller": ".controller",
    "check_solver": ".solver",
    "check_scenario": "wideberth.simulation.scenarios.checking",
}


def __getattr__(name: str) -> Any:
    """Import a check on first use."""
    if name in CHECKS:
        return getattr(import_module(CHECKS[name], __name__), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    """List the checks."""
    return sorted(CHECKS)

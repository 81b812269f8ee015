"""Contract checks that every plug-in can run on itself.

Each room of plug-ins has one: `check_predictor`, `check_region`, `check_static_region`,
`check_robot`, `check_level`, `check_cost`, `check_slot_kind`, `check_controller`,
`check_scenario`. It checks the laws that `laws_of` lists by name. The checks are imported on
first use, since each needs libraries of its own; that of scenarios stands beside them.
"""

from importlib import import_module
from typing import Any

from .laws import Law

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


def laws_of(kind: str, plugin: Any) -> tuple[Law, ...]:
    """Return the laws of a plug-in, each with a name and a check of its own.

    Parameters
    ----------
    kind : as in the name of the check: ``predictor``, ``region``, ...
    plugin : to be checked; nothing is computed before a law is checked.

    Examples
    --------
    >>> from wideberth.robots.unicycle import Unicycle
    >>> [law.name for law in laws_of("robot", Unicycle())][1]
    'NumPy and CasADi agree'
    """
    found: tuple[Law, ...] = import_module(CHECKS[f"check_{kind}"], __name__).laws(plugin)
    return found


def __getattr__(name: str) -> Any:
    """Import a check on first use."""
    if name in CHECKS:
        return getattr(import_module(CHECKS[name], __name__), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    """List the checks."""
    return sorted(CHECKS)

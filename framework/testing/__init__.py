"""Contract checks that every plug-in can run on itself.

Each room of plug-ins has one: `check_predictor`, `check_region`, `check_static_region`,
`check_robot`, `check_level`, `check_cost`, `check_slot_kind`, `check_controller`,
`check_calibration`, `check_route_planner`, `check_scenario`; those of rooms that an installed
package declares stand in it. It checks the laws that its method `laws` lists by name,
as `laws_of` does. The checks are imported on first use, since each needs libraries of its own;
that of scenarios stands beside them.
"""

from ..plugins.lazy import lazy
from .laws import CHECKS

__getattr__, __dir__, __all__ = lazy(
    __name__,
    [
        *(f"{__name__}.laws:{name}" for name in ("CHECKS", "Law", "laws_of")),
        *(f"{module}:{name}" for name, module in CHECKS.items()),
    ],
)

"""Level policies beside the paper's: how large each region is held. One file per policy."""

from ...framework.plugins.lazy import lazy

BUILT_IN: dict[str, str] = {
    "discounted": "wideberth.controllers.levels.discounted:Discounted",
    "fixed": "wideberth.framework.mpc.levels.fixed:Fixed",
    "paper": "wideberth.framework.mpc.levels.paper:Paper",
    "relaxed": "wideberth.framework.mpc.levels.relaxed:Relaxed",
    "risk_allocation": "wideberth.controllers.levels.risk_allocation:RiskAllocation",
}
"""Name -> where the class is."""

__getattr__, __dir__, __all__ = lazy(__name__, BUILT_IN.values())

"""Level policies: how large each region is held, for every step and obstacle."""

from ...plugins.lazy import lazy

BUILT_IN = {
    "fixed": "wideberth.framework.mpc.levels.fixed:Fixed",
    "relaxed": "wideberth.framework.mpc.levels.relaxed:Relaxed",
    "paper": "wideberth.framework.mpc.levels.paper:Paper",
    "discounted": "wideberth.framework.mpc.levels.discounted:Discounted",
    "risk_allocation": "wideberth.framework.mpc.levels.risk_allocation:RiskAllocation",
}

__getattr__, __dir__, __all__ = lazy(__name__, BUILT_IN.values())

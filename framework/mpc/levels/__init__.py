"""Level policies: how large each region is held, for every step and obstacle."""

BUILT_IN = {
    "fixed": "wideberth.framework.mpc.levels.fixed:Fixed",
    "relaxed": "wideberth.framework.mpc.levels.relaxed:Relaxed",
    "paper": "wideberth.framework.mpc.levels.paper:Paper",
    "discounted": "wideberth.framework.mpc.levels.discounted:Discounted",
    "risk_allocation": "wideberth.framework.mpc.levels.risk_allocation:RiskAllocation",
}

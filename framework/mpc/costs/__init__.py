"""Costs: what a plan is paid for, on pose, twist and acceleration."""

BUILT_IN = {
    "contouring": "wideberth.framework.mpc.costs.contouring:Contouring",
    "tracking": "wideberth.framework.mpc.costs.tracking:Tracking",
}

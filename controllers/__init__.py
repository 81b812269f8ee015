"""Controllers: ours, and (when they come) the rivals, one file each."""

BUILT_IN = {"mpc": "wideberth.framework.mpc.planner:Planner"}

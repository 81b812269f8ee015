"""Controllers: ours and the rivals, one file each."""

from ..framework.plugins.lazy import lazy

BUILT_IN: dict[str, str] = {
    "around_crowds": "wideberth.routes.around_crowds:AroundCrowds",
    "constant_velocity": "wideberth.controllers.constant_velocity:ConstantVelocityController",
    "dynamic_window": "wideberth.controllers.dynamic_window:DynamicWindow",
    "moussaid_force": "wideberth.controllers.moussaid_force:MoussaidForce",
    "mpc": "wideberth.framework.mpc.planner.planner:Planner",
    "orca": "wideberth.controllers.orca:Orca",
    "policy": "wideberth.controllers.policy:Policy",
    "pure_pursuit": "wideberth.controllers.pure_pursuit:PurePursuit",
    "social_force": "wideberth.controllers.social_force:SocialForceController",
    "withdrawing": "wideberth.controllers.withdrawing:Withdrawing",
}
"""Name -> where the class is."""

__getattr__, __dir__, __all__ = lazy(__name__, BUILT_IN.values())

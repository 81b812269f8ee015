"""Predictors: one file per method, each says where obstacles will be.

The table below is all that is needed to list them; nothing is imported until one is used.
"""

from ..framework.plugins.lazy import lazy

BUILT_IN: dict[str, str] = {
    "adaptive_conformal": "wideberth.predictors.adaptive_conformal:AdaptiveConformal",
    "bayesian_var": "wideberth.predictors.bayesian_var:BayesianVectorAutoregression",
    "cascade": "wideberth.predictors.cascade:FallbackChain",
    "conformal": "wideberth.predictors.conformal:Conformal",
    "constant_acceleration": "wideberth.predictors.constant_acceleration:ConstantAcceleration",
    "constant_velocity": "wideberth.predictors.constant_velocity:ConstantVelocity",
    "coordinated_turn": "wideberth.predictors.coordinated_turn:CoordinatedTurn",
    "corrected": "wideberth.predictors.corrected:Corrected",
    "empirical": "wideberth.predictors.empirical:Empirical",
    "functional_constant": "wideberth.predictors.functional_constant:FunctionalConstant",
    "game": "wideberth.predictors.game:Game",
    "imm": "wideberth.predictors.interacting_models:InteractingModels",
    "kalman": "wideberth.predictors.kalman:Kalman",
    "mixture_density": "wideberth.predictors.mixture_density:MixtureDensity",
    "oracle": "wideberth.predictors.oracle:Oracle",
    "pooled_var": "wideberth.predictors.pooled_var:PooledVectorAutoregression",
    "reacting_people": "wideberth.predictors.reacting_people:ReactingPeople",
    "single_gaussian": "wideberth.predictors.single_gaussian:SingleGaussian",
    "smoothed": "wideberth.predictors.smoothed:Smoothed",
    "social_force": "wideberth.predictors.social_force:SocialForce",
    "static": "wideberth.predictors.static:Static",
    "turning": "wideberth.predictors.turning:TurningPeople",
    "var": "wideberth.predictors.var:VectorAutoregression",
}

__getattr__, __dir__, __all__ = lazy(__name__, BUILT_IN.values())

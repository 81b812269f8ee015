# Written by `make types` from the table in __init__.py: change that, not this.
# ruff: noqa
# fmt: off

from .adaptive_conformal import AdaptiveConformal as AdaptiveConformal
from .bayesian_var import BayesianVectorAutoregression as BayesianVectorAutoregression
from .cascade import FallbackChain as FallbackChain
from .conformal import Conformal as Conformal
from .constant_acceleration import ConstantAcceleration as ConstantAcceleration
from .constant_velocity import ConstantVelocity as ConstantVelocity
from .coordinated_turn import CoordinatedTurn as CoordinatedTurn
from .corrected import Corrected as Corrected
from .empirical import Empirical as Empirical
from .functional_constant import FunctionalConstant as FunctionalConstant
from .game import Game as Game
from .interacting_models import InteractingModels as InteractingModels
from .kalman import Kalman as Kalman
from .mixture_density import MixtureDensity as MixtureDensity
from .oracle import Oracle as Oracle
from .pooled_var import PooledVectorAutoregression as PooledVectorAutoregression
from .reacting_people import ReactingPeople as ReactingPeople
from .single_gaussian import SingleGaussian as SingleGaussian
from .smoothed import Smoothed as Smoothed
from .social_force import SocialForce as SocialForce
from .static import Static as Static
from .turning import TurningPeople as TurningPeople
from .var import VectorAutoregression as VectorAutoregression
__all__ = ['AdaptiveConformal', 'BayesianVectorAutoregression', 'Conformal', 'ConstantAcceleration', 'ConstantVelocity', 'CoordinatedTurn', 'Corrected', 'Empirical', 'FallbackChain', 'FunctionalConstant', 'Game', 'InteractingModels', 'Kalman', 'MixtureDensity', 'Oracle', 'PooledVectorAutoregression', 'ReactingPeople', 'SingleGaussian', 'Smoothed', 'SocialForce', 'Static', 'TurningPeople', 'VectorAutoregression']
BUILT_IN: dict[str, str]

# Written by `make types` from the table in __init__.py: change that, not this.
# ruff: noqa
# fmt: off

from .discounted import Discounted as Discounted
from .risk_allocation import RiskAllocation as RiskAllocation
from ...framework.mpc.levels.fixed import Fixed as Fixed
from ...framework.mpc.levels.paper import Paper as Paper
from ...framework.mpc.levels.relaxed import Relaxed as Relaxed
__all__ = ['Discounted', 'Fixed', 'Paper', 'Relaxed', 'RiskAllocation']
BUILT_IN: dict[str, str]

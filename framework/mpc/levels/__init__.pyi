# Written by `make types` from the table in __init__.py: change that, not this.
# ruff: noqa
# fmt: off

from .discounted import Discounted as Discounted
from .fixed import Fixed as Fixed
from .paper import Paper as Paper
from .relaxed import Relaxed as Relaxed
from .risk_allocation import RiskAllocation as RiskAllocation
__all__ = ['Discounted', 'Fixed', 'Paper', 'Relaxed', 'RiskAllocation']
BUILT_IN: dict[str, str]

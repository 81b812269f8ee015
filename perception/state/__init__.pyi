# Written by `make types` from the table in __init__.py: change that, not this.
# ruff: noqa
# fmt: off

from .ekf import Ekf as Ekf
from .ukf import Ukf as Ukf
__all__ = ['Ekf', 'Ukf']
BUILT_IN: dict[str, str]

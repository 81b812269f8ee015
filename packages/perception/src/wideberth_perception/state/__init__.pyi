# Written by `make types` from the table in __init__.py: change that, not this.
# ruff: noqa
# fmt: off

from .ekf import Ekf as Ekf
from .scan_matching import ScanMatching as ScanMatching
from .ukf import Ukf as Ukf
__all__ = ['Ekf', 'ScanMatching', 'Ukf']
BUILT_IN: dict[str, str]

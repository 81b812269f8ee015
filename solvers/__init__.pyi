# Written by `make types` from the table in __init__.py: change that, not this.
# ruff: noqa
# fmt: off

from . import casadi_program as casadi_program
from .fatrop import Fatrop as Fatrop
from .ipopt import Ipopt as Ipopt
from .riccati.solver import Riccati as Riccati
__all__ = ['Fatrop', 'Ipopt', 'Riccati']
BUILT_IN: dict[str, str]

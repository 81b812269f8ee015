"""CasADi functions compiled by Numba, without a compiler on the user's machine."""

from .columns import KERNEL as KERNEL
from .columns import address as address
from .store import load as load
from .transpile import JAX_IMPORTS as JAX_IMPORTS
from .transpile import NUMBA_IMPORTS as NUMBA_IMPORTS
from .transpile import jax_source as jax_source
from .transpile import numba_source as numba_source
from .transpile import recursion_source as recursion_source

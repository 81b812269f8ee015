"""Many instances of a problem solved at once, on a GPU where JAX has one."""

from .solve import BatchSolution as BatchSolution
from .solve import solve_batch as solve_batch

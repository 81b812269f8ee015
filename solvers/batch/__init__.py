"""The solver ``batch``: many instances of a problem at once, on a GPU where JAX has one."""

from .solver import Batch as Batch
from .solver import BatchSolution as BatchSolution
from .solver import solve_batch as solve_batch

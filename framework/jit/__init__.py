"""CasADi functions as machine code, without a compiler on the user's machine."""

from .columns import SIGNATURE as SIGNATURE
from .transpile import kernel_source as kernel_source
from .transpile import module_source as module_source
from .transpile import recursion_source as recursion_source

# Written by `make types` from the table in __init__.py: change that, not this.
# ruff: noqa
# fmt: off

from .bicycle import Bicycle as Bicycle
from .differential_drive import DifferentialDrive as DifferentialDrive
from .holonomic import Holonomic as Holonomic
from .holonomic_3d import Holonomic3D as Holonomic3D
from .holonomic_velocity import HolonomicVelocity as HolonomicVelocity
from .unicycle import Unicycle as Unicycle
from .unicycle_velocity import UnicycleVelocity as UnicycleVelocity
__all__ = ['Bicycle', 'DifferentialDrive', 'Holonomic', 'Holonomic3D', 'HolonomicVelocity', 'Unicycle', 'UnicycleVelocity']
BUILT_IN: dict[str, str]

# Written by `make types` from the table in __init__.py: change that, not this.
# ruff: noqa
# fmt: off

from .antipodal_swap import AntipodalSwap as AntipodalSwap
from .blind_corner import BlindCorner as BlindCorner
from .chicken_game import ChickenGame as ChickenGame
from .corridor import Corridor as Corridor
from .crossing import Crossing as Crossing
from .crossing_3d import Crossing3D as Crossing3D
from .crossing_field import CrossingField as CrossingField
from .cylinder_field import CylinderField as CylinderField
from .doorway import Doorway as Doorway
from .furnished import Furnished as Furnished
from .hallway import Hallway as Hallway
from .model_crowd import ModelCrowd as ModelCrowd
from .overtaking import Overtaking as Overtaking
from .pedestrian_corridor import PedestrianCorridor as PedestrianCorridor
from .random_crowd import RandomCrowd as RandomCrowd
from .recorded_scene import RecordedScene as RecordedScene
from .sudden_change import SuddenChange as SuddenChange
__all__ = ['AntipodalSwap', 'BlindCorner', 'ChickenGame', 'Corridor', 'Crossing', 'Crossing3D', 'CrossingField', 'CylinderField', 'Doorway', 'Furnished', 'Hallway', 'ModelCrowd', 'Overtaking', 'PedestrianCorridor', 'RandomCrowd', 'RecordedScene', 'SuddenChange']
BUILT_IN: dict[str, str]

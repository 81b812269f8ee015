"""Scenarios: starts and goals of robots, people and obstacles, drawn from a seed."""

from ...framework.plugins.lazy import lazy

BUILT_IN: dict[str, str] = {
    "antipodal_swap": "wideberth.simulation.scenarios.antipodal_swap:AntipodalSwap",
    "blind_corner": "wideberth.simulation.scenarios.blind_corner:BlindCorner",
    "chicken_game": "wideberth.simulation.scenarios.chicken_game:ChickenGame",
    "corridor": "wideberth.simulation.scenarios.corridor:Corridor",
    "crossing": "wideberth.simulation.scenarios.crossing:Crossing",
    "crossing_3d": "wideberth.simulation.scenarios.crossing_3d:Crossing3D",
    "crossing_field": "wideberth.simulation.scenarios.crossing_field:CrossingField",
    "cylinder_field": "wideberth.simulation.scenarios.cylinder_field:CylinderField",
    "doorway": "wideberth.simulation.scenarios.doorway:Doorway",
    "furnished": "wideberth.simulation.scenarios.furnished:Furnished",
    "hallway": "wideberth.simulation.scenarios.hallway:Hallway",
    "model_crowd": "wideberth.simulation.scenarios.model_crowd:ModelCrowd",
    "overtaking": "wideberth.simulation.scenarios.overtaking:Overtaking",
    "pedestrian_corridor": "wideberth.simulation.scenarios.pedestrian_corridor:PedestrianCorridor",
    "random_crowd": "wideberth.simulation.scenarios.random_crowd:RandomCrowd",
    "recorded_scene": "wideberth.simulation.scenarios.recorded_scene:RecordedScene",
    "sudden_change": "wideberth.simulation.scenarios.sudden_change:SuddenChange",
}
"""Name -> where the class is."""

__getattr__, __dir__, __all__ = lazy(__name__, BUILT_IN.values())

"""Simulation: plant, clock, agents, scenarios and episodes.

The room's plug-ins are its scenarios; the other modules are what they run on.
"""

BUILT_IN: dict[str, str] = {
    "antipodal_swap": "wideberth.simulation.antipodal_swap:AntipodalSwap",
    "blind_corner": "wideberth.simulation.blind_corner:BlindCorner",
    "chicken_game": "wideberth.simulation.chicken_game:ChickenGame",
    "corridor": "wideberth.simulation.corridor:Corridor",
    "crossing": "wideberth.simulation.crossing:Crossing",
    "crossing_3d": "wideberth.simulation.crossing_3d:Crossing3D",
    "crossing_field": "wideberth.simulation.crossing_field:CrossingField",
    "crowdnav": "wideberth.simulation.crowdnav:CrowdNav",
    "doorway": "wideberth.simulation.doorway:Doorway",
    "hallway": "wideberth.simulation.hallway:Hallway",
    "model_crowd": "wideberth.simulation.model_crowd:ModelCrowd",
    "overtaking": "wideberth.simulation.overtaking:Overtaking",
    "pedestrian_corridor": "wideberth.simulation.pedestrian_corridor:PedestrianCorridor",
    "random_crowd": "wideberth.simulation.random_crowd:RandomCrowd",
    "recorded_scene": "wideberth.simulation.recorded_scene:RecordedScene",
    "sudden_change": "wideberth.simulation.sudden_change:SuddenChange",
}
"""Name -> where the class is."""

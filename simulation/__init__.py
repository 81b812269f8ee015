"""Simulation: plant, clock, agents, scenarios and episodes.

The room's plug-ins are its scenarios; the other modules are what they run on.
"""

BUILT_IN: dict[str, str] = {
    "blind_corner": "wideberth.simulation.blind_corner:BlindCorner",
    "chicken_game": "wideberth.simulation.chicken_game:ChickenGame",
    "crossing": "wideberth.simulation.crossing:Crossing",
    "crossing_3d": "wideberth.simulation.crossing_3d:Crossing3D",
    "crossing_field": "wideberth.simulation.crossing_field:CrossingField",
}
"""Name -> where the class is."""

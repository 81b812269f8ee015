"""Simulation: plant, clock, agents, scenarios and episodes.

The room's plug-ins are its scenarios; the other modules are what they run on.
"""

BUILT_IN: dict[str, str] = {
    "chicken_game": "wideberth.simulation.chicken_game:ChickenGame",
    "crossing": "wideberth.simulation.crossing:Crossing",
}
"""Name -> where the class is."""

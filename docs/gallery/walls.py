"""
Between walls and people
========================

Walls are polygons, known exactly. The plan keeps clear of them in the same problem in which it keeps out of the regions
around people.
"""

import numpy as np

from wideberth import Detection, Observation, Path, Polygon, draw, recommended

walls = (
    Polygon(((3.0, 0.9), (6.0, 0.9), (6.0, 3.0), (3.0, 3.0)), "upper block"),
    Polygon(((3.0, -3.0), (6.0, -3.0), (6.0, -1.4), (3.0, -1.4)), "lower block"),
)
planner = recommended({"type": "unicycle", "radius": 0.4}, speed=0.5, quiet=True)
planner.set_path(Path([(0, 0.5), (10, 0.5)]))


def seen(time):
    """Return what the robot sees at a time, s."""
    person = Detection("person", (8.0, -3.0 + 0.3 * time), 1e-4 * np.eye(2), radius=0.3)
    state = (0.5 + 0.5 * time, 0.5, 0.0, 0.5, 0.0)
    return Observation(time, state, detections=(person,), polygons=walls)


for k in range(-10, 0):
    planner.remember(seen(0.5 * k))
planner.command(seen(0.0))

draw.plan(planner.plan)

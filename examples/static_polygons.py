"""A rectangular robot drives through the gap between two walls that do not move, drawn."""

import matplotlib.pyplot as plt
import numpy as np

from wideberth import Observation, Outline, Path, Polygon, build

body = Outline(((-0.6, -0.25), (0.6, -0.25), (0.6, 0.25), (-0.6, 0.25)))
robot = build("robots", {"type": "unicycle", "radius": body.reach, "footprint": body})
planner = build("controllers", {"type": "mpc", "robot": robot, "region": "separating_line",
    "static_region": "separating_line", "predictor": "kalman", "level": "fixed",
    "solver": "fatrop", "margin": 0.1})  # fmt: skip
planner.set_path(Path([(0, 0), (12, 0)]))
corner = Polygon(((2, -3), (4, -3), (4, -1.6), (5, -1.6), (5, -0.1), (2, -0.1)), "corner")
block = Polygon(((2.5, 0.8), (4.5, 0.7), (4.5, 3), (2.5, 3)), "block")
planner.command(Observation(0.0, (0, 0, 0, 0.5, 0), polygons=(corner, block)))
for wall in (corner, block):
    plt.fill(*wall.points.T, color="0.8")
for x, y, phi, *_ in planner.plan.states:
    turn = np.array([[np.cos(phi), -np.sin(phi)], [np.sin(phi), np.cos(phi)]])
    plt.fill(*((x, y) + body.vertices @ turn.T).T, facecolor="none", edgecolor="C0")
plt.axis("equal"), plt.xlabel("x / m"), plt.ylabel("y / m"), plt.savefig("gap.png")
print("The plan is", planner.plan.rung, "and keeps", planner.margin, "m from both walls")

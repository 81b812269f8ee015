"""
The same turn with four robots
==============================

A path with a right angle, without obstacles. The same planner turns with each robot as its limits allow: a car-like
robot needs the room of its turning circle, a holonomic one slides around the corner.
"""

import matplotlib.pyplot as plt

from wideberth import Path, build, recommended
from wideberth.simulation import RobotAgent, Settings, run_episode

path = Path([(0, 0), (5, 0), (5, 5)])
figure, ax = plt.subplots(figsize=(5.5, 5), layout="constrained")
ax.plot(*path.points.T, color="0.7", linewidth=5, label="path")
for name, line in (
    ("unicycle", "-"),
    ("differential_drive", "--"),
    ("bicycle", "-."),
    ("holonomic", ":"),
):
    robot = build("robots", name)
    planner = recommended(robot, speed=0.5, quiet=True)
    driven = run_episode([RobotAgent(name, robot, planner, path)], Settings(time_limit=40.0))
    positions = driven.at(driven.agents[0], driven.times)[:, :2]
    ax.plot(*positions.T, line, label=name)
ax.set(xlabel="x / m", ylabel="y / m", aspect="equal")
ax.legend()

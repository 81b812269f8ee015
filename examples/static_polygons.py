"""A rectangular robot plans through the gap between two walls; ``gap.png`` shows the plan.

Walls are polygons, convex or not, known exactly. They are part of the observation; a static region
keeps the body of the robot clear of them.
"""

import matplotlib.pyplot as plt
import numpy as np

from wideberth import Observation, Outline, Path, Polygon, build

BODY = Outline(((-0.6, -0.25), (0.6, -0.25), (0.6, 0.25), (-0.6, 0.25)))  # m, body frame
WALLS = (
    Polygon(((2, -3), (4, -3), (4, -1.6), (5, -1.6), (5, -0.1), (2, -0.1)), "corner"),
    Polygon(((2.5, 0.8), (4.5, 0.7), (4.5, 3), (2.5, 3)), "block"),
)  # m, world frame
START = (0.0, 0.0, 0.0, 0.5, 0.0)  # x, y in m, heading in rad, speed in m/s, yaw rate in rad/s


MARGIN = 0.1  # m, kept free around the body


def make_planner():
    """Return a planner of a unicycle with a rectangular body."""
    return build(
        "controllers",
        {
            "type": "mpc",
            "robot": {"type": "unicycle", "radius": BODY.reach, "footprint": BODY},
            "region": "separating_line",  # for moving obstacles, here none
            "static_region": "separating_line",  # for walls
            "predictor": "kalman",
            "level": "fixed",
            "solver": "riccati",
            "margin": MARGIN,
        },
    )


def body_at(state):
    """Return the corners of the robot's body in the world frame, (4, 2), m."""
    x, y, heading = state[:3]
    cosine, sine = np.cos(heading), np.sin(heading)
    rotation = np.array([[cosine, -sine], [sine, cosine]])
    return np.array([x, y]) + np.asarray(BODY.vertices) @ rotation.T


def draw(plan, file):
    """Draw the walls and the robot's body at every step of the plan."""
    figure, axes = plt.subplots(figsize=(7, 4))
    for wall in WALLS:
        axes.fill(*wall.points.T, color="0.8")
    for state in plan.states:
        axes.fill(*body_at(state).T, facecolor="none", edgecolor="C0")
    axes.set(xlabel="x / m", ylabel="y / m", aspect="equal")
    figure.savefig(file, dpi=150, bbox_inches="tight")


if __name__ == "__main__":
    planner = make_planner()
    planner.set_path(Path([(0, 0), (12, 0)]))
    planner.command(Observation(stamp=0.0, state=START, polygons=WALLS))
    print("The plan is", planner.plan.rung, "and keeps", MARGIN, "m from both walls")
    draw(planner.plan, "gap.png")

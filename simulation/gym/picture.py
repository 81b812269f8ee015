"""A picture of one instant of a running episode, as an array of bytes."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..engine.episode import Run

SIDE = 480
"""Pixels."""
ROOM = 2.0
"""m around paths and robots."""


def picture(run: Run, name: str) -> NDArray[np.uint8]:
    """Draw the present scene from above, (480, 480, 3).

    The robot ``name`` is filled and its way dashed; other robots and people are rings with
    their edge in blue, bystanders grey, polygons dark.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure
    from matplotlib.patches import Circle

    now = np.array([run.clock[-1]])
    figure = Figure(figsize=(SIDE / 100, SIDE / 100), dpi=100)
    canvas: Any = FigureCanvasAgg(figure)
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    for polygon in run.polygons:
        axes.fill(*polygon.points.T, color="0.3")
    for other in run.others:
        place = other.at(now)[0]
        if np.isfinite(place).all():
            axes.add_patch(Circle((place[0], place[1]), other.radius, color="0.7"))
    for driver in run.drivers:
        x, y = driver.positions[-1][:2]
        acts = driver.name == name
        axes.add_patch(
            Circle((x, y), driver.radius, facecolor="C1" if acts else "none", edgecolor="C0")
        )
        heading = driver.agent.robot.pose(driver.states[-1]).heading
        if heading is not None:
            tip = driver.radius * np.array([np.cos(heading), np.sin(heading)])
            axes.plot([x, x + tip[0]], [y, y + tip[1]], color="black")
        if acts:
            axes.plot(*driver.paths[-1][1].points.T[:2], "--", color="C1")
            axes.plot(*driver.paths[-1][1].goal[:2], "*", color="C1", markersize=12)
    _frame(axes, run)
    canvas.draw()
    return np.asarray(canvas.buffer_rgba(), dtype=np.uint8)[..., :3].copy()


def _frame(axes: Any, run: Run) -> None:
    """Show the same square throughout an episode: all paths, with room around."""
    points = np.concatenate([driver.paths[0][1].points[:, :2] for driver in run.drivers])
    middle = 0.5 * (points.max(axis=0) + points.min(axis=0))
    half = 0.5 * float(np.ptp(points, axis=0).max()) + ROOM
    axes.set(xlim=middle[0] + half * np.array([-1, 1]), ylim=middle[1] + half * np.array([-1, 1]))
    axes.set_aspect("equal")
    axes.axis("off")

"""Pictures of paths, of polygons and of maps of cells."""

from typing import TYPE_CHECKING, Any

import numpy as np

from ..framework.values.arrays import Array
from ..framework.values.costmap import (
    INSCRIBED,
    LETHAL,
    MAX_NON_OBSTACLE,
    NO_INFORMATION,
    Costmap,
)
from ..framework.values.occupancy_grid import OCCUPIED_CELL, UNKNOWN_CELL, OccupancyGrid
from ..framework.values.path import Path
from ..framework.values.polygon import Polygon
from .style import WALL, picture, polygons

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def path(shown: Path, ax: "Axes | None" = None) -> "Axes":
    """Draw a path, its start (circle) and its goal (cross); return the axes.

    Parameters
    ----------
    shown : the path.
    ax : axes to draw into, in three dimensions with ``projection="3d"``; None for a figure.
    """

    def draw(panel: Any) -> Array:
        panel.plot(*shown.points.T, "-", color="0.7", linewidth=0.9, zorder=1, label="path")
        for point, marker, label in ((shown.points[0], "o", "start"), (shown.goal, "x", "goal")):
            panel.plot(
                *point[:, None], linestyle="none", marker=marker, markersize=6, color="0.35",
                markerfacecolor="none", label=label,
            )  # fmt: skip
        return shown.points

    return picture(draw, shown.points.shape[1], ax)


def polygon(shown: Polygon, ax: "Axes | None" = None) -> "Axes":
    """Draw a polygon, and dotted where it is cut into convex parts; return the axes.

    Parameters
    ----------
    shown : the polygon.
    ax : axes to draw into, in the plane; None for a figure.
    """

    def draw(panel: Any) -> Array:
        polygons(panel, [shown.points], **{**WALL, "label": shown.name or WALL["label"]})
        if len(shown.parts) > 1:
            polygons(
                panel, shown.parts, facecolor="none", edgecolor="0.35", linewidth=0.7,
                linestyle=":", zorder=0.9, label="convex parts",
            )  # fmt: skip
        return shown.points

    return picture(draw, 2, ax)


def grid(shown: OccupancyGrid | Costmap, ax: "Axes | None" = None) -> "Axes":
    """Draw cells, the darker the more occupied or the more costly; return the axes.

    Parameters
    ----------
    shown : a map or a costmap.
    ax : axes to draw into, in the plane; None for a figure.
    """
    low = np.array(shown.origin)
    high = low + shown.resolution * np.array([shown.width, shown.height])
    dark = _costs(shown) if isinstance(shown, Costmap) else _occupancy(shown)

    def draw(panel: Any) -> Array:
        panel.imshow(
            dark, cmap="Greys", vmin=0.0, vmax=1.0, origin="lower", zorder=0.5,
            interpolation="nearest", extent=(low[0], high[0], low[1], high[1]),
        )  # fmt: skip
        return np.stack([low, high])

    return picture(draw, 2, ax)


def _occupancy(shown: OccupancyGrid) -> Array:
    """Return how dark each cell of a map is, from 0 to 1."""
    return np.where(shown.cells == UNKNOWN_CELL, 0.25, shown.cells / OCCUPIED_CELL)


def _costs(shown: Costmap) -> Array:
    """Return how dark each cell of a costmap is, from 0 to 1."""
    special = [shown.cells == cost for cost in (LETHAL, INSCRIBED, NO_INFORMATION)]
    costs = shown.cells.astype(np.float64)
    return np.select(special, [1.0, 0.5, 0.15], 0.4 * costs / MAX_NON_OBSTACLE)

"""What a controller of Nav2 saw and thought of: its file, and a picture of a few moments."""

from collections.abc import Sequence
from io import BytesIO
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from wideberth.draw import COLOURS
from wideberth.experiments import subplots
from wideberth.experiments.drawing.plotting import PAGE
from wideberth.framework.plugins.io import read_arrays
from wideberth.framework.values.arrays import Array
from wideberth.framework.values.costmap import Costmap
from wideberth.simulation.drawing import artists
from wideberth.simulation.log.episode_log import Episode

from ..costs import LETHAL, NO_INFORMATION

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MOMENTS = (-3.0, -1.5, 0.0, 2.0)
"""s from the closest approach, of the panels."""


AROUND = 5.5
"""Radii of the robot that are shown on each side of it."""
_BLACK = 400.0
"""Darkness of a lethal cell, on the scale of costs."""


class CostmapLook(NamedTuple):
    """What a controller of Nav2 saw and thought of at one tick.

    Attributes
    ----------
    time : s.
    costmap : the local one.
    expected : (T, 3), poses that it expects to pass; (0, 3) where it says nothing.
    sampled : (K, T, 3), trajectories that it compared, the shorter ones continued by NaN.
    """

    time: float
    costmap: Costmap
    expected: Array
    sampled: Array


def looks_to_bytes(looks: Sequence[CostmapLook]) -> bytes:
    """Return looks as the bytes of an ``.npz`` file."""
    arrays: dict[str, Any] = {"times": np.array([one.time for one in looks])}
    for i, one in enumerate(looks):
        arrays |= {
            f"cells_{i}": one.costmap.cells,
            f"place_{i}": np.array([*one.costmap.origin, one.costmap.resolution]),
            f"expected_{i}": one.expected.astype(np.float32),
            f"sampled_{i}": one.sampled.astype(np.float32),
        }
    buffer = BytesIO()
    np.savez_compressed(buffer, **arrays)
    return buffer.getvalue()


def looks_from_bytes(content: bytes) -> list[CostmapLook]:
    """Return the looks of `looks_to_bytes`."""
    file = read_arrays(content, "a file of costmaps")
    found = []
    for i, time in enumerate(file["times"]):
        x, y, resolution = (float(value) for value in file[f"place_{i}"])
        costmap = Costmap(file[f"cells_{i}"], resolution, (x, y))
        ways = [np.asarray(file[f"{name}_{i}"], np.float64) for name in ("expected", "sampled")]
        found.append(CostmapLook(float(time), costmap, ways[0], ways[1]))
    return found


def draw_looks(episode: Episode, looks: Sequence[CostmapLook]) -> "Figure":
    """Draw the first robot's local costmap and trajectories at moments about the closest approach.

    Grey is what a cell costs, black a lethal one. Thin lines are the trajectories that the
    controller compared, the thick one is that which it expects to drive. Discs are where
    all robots and people truly are.
    """
    found = artists.closest(episode)
    middle = 0.5 * episode.duration if found is None else found.time
    times = np.array([look.time for look in looks])
    wanted = [int(np.argmin(np.abs(times - middle - moment))) for moment in MOMENTS]
    chosen = [looks[i] for i in dict.fromkeys(wanted)]
    count = len(chosen)
    figure, panels = subplots(
        1, count, figsize=(PAGE, PAGE / count + 0.7), squeeze=False, layout="constrained"
    )
    for panel, look in zip(panels[0], chosen, strict=True):
        _draw_look(panel, episode, look)
    for panel in panels[0]:
        panel.set_xlabel("x (m)")
    panels[0, 0].set_ylabel("y (m)")
    handles, labels = panels[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=5)
    return figure


def _draw_look(panel: Any, episode: Episode, look: CostmapLook) -> None:
    panel.set_title(f"{look.time:.1f} s")
    low, high = corners(look.costmap)
    cells = look.costmap.cells
    costs = np.where(cells == NO_INFORMATION, 0.0, cells)
    panel.imshow(
        np.where(cells == LETHAL, _BLACK, costs), cmap="Greys", vmin=0.0, vmax=_BLACK,
        origin="lower", interpolation="nearest", extent=(low[0], high[0], low[1], high[1]),
    )  # fmt: skip
    for i, way in enumerate(look.sampled):
        panel.plot(
            *way[:, :2].T, "-", color=COLOURS[2], linewidth=0.5,
            label=None if i else "compared trajectories",
        )  # fmt: skip
    expected = look.expected if len(look.expected) else np.full((1, 3), np.nan)
    panel.plot(
        *expected[:, :2].T, "-", color=COLOURS[0], linewidth=1.4, label="expected trajectory"
    )
    now = np.array([look.time])
    styles = artists.looks(episode)
    for log in episode.agents:
        here = episode.at(log, now)[0, :2]
        if np.isfinite(here).all():
            for outline in artists.shapes(log, here, artists.heading_at(episode, log, look.time)):
                panel.fill(*outline.T, facecolor="none", edgecolor=styles[log.name].color)
    for log in episode.robots:
        path = log.paths[-1][1]
        panel.plot(*path.points[:, :2].T, "-", color="0.4", linewidth=0.6)
    panel.plot([], [], "-", color="0.4", linewidth=0.6, label="paths")
    panel.plot([], [], "s", color="0.6", label="cost of a cell")
    panel.plot([], [], "s", color="black", label="lethal cell")
    robot = episode.robots[0]
    here = episode.at(robot, now)[0, :2]
    reach = AROUND * robot.radius
    low, high = here - reach, here + reach
    panel.set_xlim(low[0], high[0])
    panel.set_ylim(low[1], high[1])
    panel.set_aspect("equal")


def corners(costmap: Costmap) -> tuple[Array, Array]:
    """Return the lower left and the upper right corner of a costmap, (2,) each, m."""
    low = np.array(costmap.origin, dtype=np.float64)
    return low, low + costmap.resolution * np.array([costmap.width, costmap.height])

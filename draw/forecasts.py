"""Pictures of forecasts and of regions: Gaussians, and what is kept out of around them."""

from typing import TYPE_CHECKING, Any

import numpy as np

from ..framework.numerics.chi_square import content_bound
from ..framework.region import Region
from ..framework.values.arrays import Array
from ..framework.values.forecast import Forecast, GaussianObstacle
from .shapes import ellipses, ellipsoid, outlines, surfaces
from .style import COLOURS, FORECAST, LINES, PLANNED, chosen_steps, picture, polygons

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_TAIL = 0.05
"""1 - content of the ellipses that are drawn."""


def forecast(shown: Forecast, ax: "Axes | None" = None) -> "Axes":
    """Draw the means and the 95 % ellipses of every obstacle; return the axes.

    Of a mixture every mode is drawn, paler the less it weighs. Of long forecasts at most
    eight steps have an ellipse, the last among them. In space they are ellipsoids.

    Parameters
    ----------
    shown : the forecast.
    ax : axes to draw into, in three dimensions with ``projection="3d"``; None for a figure.
    """
    size = shown.mean.shape[-1]

    def draw(panel: Any) -> Array:
        seen = [np.zeros((0, size))]
        for owner, mode in zip(*np.nonzero(shown.weight > 0), strict=True):
            seen += _mode(panel, shown, owner, mode)
        panel.plot([], [], color="0.5", linewidth=4, alpha=0.3, label=f"{100 * (1 - _TAIL):g} %")
        return np.concatenate(seen)

    return picture(draw, size, ax)


def _mode(panel: Any, shown: Forecast, owner: int, mode: int) -> list[Array]:
    """Draw one mode of an obstacle; return what has to be seen."""
    weight, mean = shown.weight[owner, mode], shown.mean[owner, mode]
    colour, line = COLOURS[owner % len(COLOURS)], LINES[owner % len(LINES)]
    label = f"obstacle {owner}" + (f", {100 * weight:.0f} %" if weight < 1 else "")
    strength = float(0.35 + 0.65 * weight)
    panel.plot(
        *mean.T, linestyle=line, marker="o", markersize=2.2, linewidth=0.9, color=colour,
        alpha=strength, label=label,
    )  # fmt: skip
    steps = chosen_steps(shown.steps)
    spread = shown.covariance[owner, mode][steps]
    return [mean, _spread(panel, mean[steps], spread, _TAIL, (colour, strength))]


def content_outlines(
    shown: Forecast, tail: float = 0.05, count: int = 96, every: int = 1
) -> Array:
    """Outlines of the content regions, one per obstacle, mode and step, (K, count, 2), m.

    With D coordinates, mean mu, covariance Sigma and content 1 - tail the region is::

        (x - mu)^T Sigma^-1 (x - mu) <= q,    P(chi^2_D > q) = tail

    and its outline from above is mu + sqrt(q) L (cos t, sin t), where L L^T is the block of
    Sigma for x and y. Modes of weight 0 are left out.

    Parameters
    ----------
    shown : the forecast.
    tail : 1 - content, in (0, 1).
    count : points of an outline.
    every : steps from one outline to the next; the last step has one.
    """
    kept = shown.weight > 0
    steps = slice((shown.steps - 1) % every, None, every)
    centre = shown.mean[kept][:, steps, :2].reshape(-1, 2)
    blocks = shown.covariance[kept][:, steps, :2, :2].reshape(-1, 2, 2)
    return ellipses(centre, blocks, content_bound(shown.mean.shape[-1], tail), count)


def region(
    shown: Region,
    ax: "Axes | None" = None,
    obstacle: GaussianObstacle | None = None,
    margin: float = 0.0,
    level: float | None = None,
) -> "Axes":
    """Draw the set that the robot's centre keeps out of; return the axes.

    The obstacle's ellipse of the same content, before it is enlarged, stands pale in it.

    Parameters
    ----------
    shown : the region.
    ax : axes to draw into, in three dimensions with ``projection="3d"``; None for a figure.
    obstacle : one, or a batch of them (N, D); a Gaussian of 0.5 m by 0.2 m by default.
    margin : m, r + r_d.
    level : the region's own; that of 95 % content by default.

    Raises
    ------
    WideberthError : a region of a singular covariance for which it is not defined.
    """
    if obstacle is None:
        size = shown.dimensions[0]
        obstacle = GaussianObstacle(np.zeros(size), np.diag([0.25, 0.04, 0.04][:size]))
    size = obstacle.mean.shape[-1]
    mean, covariance = obstacle.mean.reshape(-1, size), obstacle.covariance
    flat = GaussianObstacle(mean, covariance.reshape(-1, size, size))
    held = shown.level(_TAIL, size) if level is None else float(level)
    return picture(lambda panel: _regions(panel, shown, flat, margin, held), size, ax)


def _regions(
    panel: Any, shown: Region, some: GaussianObstacle, margin: float, level: float
) -> Array:
    """Draw the regions around some Gaussians; return what has to be seen."""
    size = some.mean.shape[-1]
    tail, every = shown.tail(level, size), np.full(len(some.mean), 1.0)
    if 0.0 < tail < 1.0:
        label = f"{100 * (1 - tail):.4g} % of the Gaussian, not enlarged"
        _spread(panel, some.mean, some.covariance, tail, (FORECAST, 1.0))
        panel.plot([], [], color=FORECAST, linewidth=4, alpha=0.4, label=label)
    panel.plot(*some.mean.T, linestyle="none", marker="+", color=FORECAST, label="expected place")
    name = type(shown).__name__
    if size == 2:
        rims = outlines(shown, some, margin * every, level * every)
        polygons(panel, list(rims), facecolor="none", edgecolor=PLANNED, linewidth=1.2,
                 label=f"kept out of: {name}")  # fmt: skip
        return np.asarray(rims.reshape(-1, 2))
    skins = surfaces(shown, some, margin * every, level * every)
    for skin in skins:
        panel.plot_wireframe(*np.moveaxis(skin, -1, 0), color=PLANNED, linewidth=0.4)
    panel.plot([], [], color=PLANNED, linestyle=LINES[0], label=f"kept out of: {name}")
    return np.asarray(skins.reshape(-1, 3))


def _spread(
    panel: Any, mean: Array, covariance: Array, tail: float, look: tuple[str, float]
) -> Array:
    """Draw the content regions of Gaussians, (K, D) and (K, D, D); return points of them.

    Parameters
    ----------
    panel : axes, in space those of three dimensions.
    tail : 1 - content.
    look : colour, and how strong it is, in [0, 1].
    """
    colour, strength = look
    square = content_bound(mean.shape[-1], tail)
    if mean.shape[-1] == 2:
        rims = ellipses(mean, covariance, square)
        polygons(
            panel, list(rims), facecolor=(colour, 0.07 * strength),
            edgecolor=(colour, 0.5 * strength), linewidth=0.7,
        )  # fmt: skip
        return np.asarray(rims.reshape(-1, 2))
    skins = [ellipsoid(*one, square, 13) for one in zip(mean, covariance, strict=True)]
    for skin in skins:
        panel.plot_surface(
            *np.moveaxis(skin, -1, 0), color=colour, alpha=0.1 * strength, linewidth=0
        )
    return np.concatenate([skin.reshape(-1, 3) for skin in skins])

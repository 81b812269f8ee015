"""Pictures of plans, and the boundaries of the sets that a plan kept out of."""

from typing import TYPE_CHECKING, Any

import numpy as np

from ..framework.values.arrays import Array
from ..framework.values.errors import WideberthError
from ..framework.values.forecast import LIGHT, GaussianObstacle
from ..framework.values.plan import Plan, Rung, Situation, percent
from .shapes import body_outlines, outlines, sphere, surfaces
from .style import BLACK, FORECAST, WALL, chosen_steps, halo, picture, polygons, shades

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def plan(shown: Plan, ax: "Axes | None" = None) -> "Axes":
    """Draw a plan and what it keeps out of; return the axes.

    A planned position and the set that the robot's centre keeps out of at that step have the
    same shade, darker the later; the forecast's mean has it too. At most eight steps, the last
    among them, have a region and their time ahead. Around the first position stands the robot.

    Parameters
    ----------
    shown : the plan.
    ax : axes to draw into, in three dimensions with ``projection="3d"``; None for a figure.

    Examples
    --------
    >>> ax = plan(planner.plan)          # doctest: +SKIP
    >>> pyplot.savefig("plan.png")       # doctest: +SKIP
    """
    return picture(lambda panel: _plan(panel, shown), shown.positions.shape[1], ax)


def _plan(panel: Any, shown: Plan) -> Array:
    """Draw into axes of the right dimension; return what has to be seen."""
    seen = [shown.positions, _situation(panel, shown), _kept_out(panel, shown)]
    panel.plot(*shown.positions.T, "-", color="0.45", linewidth=0.7, zorder=2.2)
    steps = _drawn_steps(shown)
    others = np.delete(shown.positions, [0, *(i + 1 for i in steps)], axis=0)
    panel.plot(*others.T, linestyle="none", marker=".", color="0.45", markersize=2.5)
    for i, (step, shade) in enumerate(zip(steps, shades(len(steps)), strict=True)):
        place = shown.positions[step + 1]
        panel.plot(
            *place[:, None], "s", color=shade, markersize=5.0, markeredgecolor="black",
            markeredgewidth=0.5, zorder=2.6, label=None if i else "planned positions",
        )  # fmt: skip
    if shown.positions.shape[1] == 2:
        span = float(np.ptp(np.concatenate(seen), axis=0).max())
        times = shown.dt * (np.array(steps) + 1.0)
        _write_times(panel, shown.positions[1:][steps], times, 0.08 * span)
    panel.set_title(_title(shown), loc="left")
    return np.concatenate(seen)


def _title(shown: Plan) -> str:
    """Name the rung, and the content that is held."""
    name = "plan" if shown.rung is Rung.OPTIMAL else str(shown.rung)
    head = f"{name} at t = {shown.stamp:g} s"
    if not shown.content.size:
        return f"{head}, no obstacle"
    return f"{head}, holds {percent(1.0 - shown.lowest_content, 'content', 2)} content"


def kept_out(
    shown: Plan, situation: Situation | None, steps: list[int]
) -> dict[tuple[int, int], Array]:
    """Boundaries of the sets that a plan kept the robot's centre out of.

    It is the planner's own region with the margin r + r_d and what is added to it, at the level
    that the plan held at each step. Of a robot of discs it is that for each disc's centre; of one
    with corners, where the region knows them, that for the whole body (r = 0). The robot's own
    uncertainty, which a plan does not record, is left out.

    Parameters
    ----------
    steps : of the forecast, from 0.

    Returns
    -------
    (obstacle, mode) of the forecast -> (len(steps), COUNT, 2), m, in space surfaces
    (len(steps), C, C, 3), of the obstacles that a constraint holds. Empty where the region is not
    known or not defined.
    """
    forecast = shown.forecast
    if forecast is None or situation is None or situation.region is None or not shown.level.size:
        return {}
    keys = [
        (int(owner), int(mode))
        for owner, mode in zip(*np.nonzero(forecast.weight >= LIGHT), strict=True)
        if shown.tracked[owner] in shown.ids
    ]
    if not keys:
        return {}
    owners, modes = (np.array(part) for part in zip(*keys, strict=True))
    obstacle = GaussianObstacle(
        forecast.mean[owners, modes][:, steps], forecast.covariance[owners, modes][:, steps]
    )
    # Modes of one obstacle share a name and a level.
    columns = [shown.ids.index(shown.tracked[owner]) for owner in owners]
    level = shown.level[steps][:, columns].T
    margin = np.broadcast_to((situation.radii[owners] + situation.room)[:, None], level.shape)
    trace = outlines if forecast.mean.shape[-1] == 2 else surfaces
    try:
        found = trace(situation.region, obstacle, margin, level)
    except WideberthError:  # a region that a singular covariance leaves undefined
        return {}
    return dict(zip(keys, found, strict=True))


def _drawn_steps(shown: Plan) -> list[int]:
    """Choose the steps, from 0, that have a region in a picture; fewer in space."""
    return chosen_steps(len(shown.inputs), 8 if shown.positions.shape[1] == 2 else 4)


def _kept_out(panel: Any, shown: Plan) -> Array:
    """Draw what a plan keeps out of, each step in its shade; return all points drawn."""
    size, steps = shown.positions.shape[1], _drawn_steps(shown)
    seen = [np.zeros((0, size))]
    if shown.forecast is not None:
        for mean in shown.forecast.mean[shown.forecast.weight >= LIGHT]:
            panel.plot(*mean.T, "-", color=FORECAST, linewidth=0.7, zorder=1.6)
            seen.append(mean)
    found = kept_out(shown, shown.situation, steps)
    for i, (step, shade) in enumerate(zip(steps, shades(len(steps)), strict=True)):
        first = i == 0
        if shown.forecast is not None:
            means = shown.forecast.mean[shown.forecast.weight >= LIGHT][:, step]
            panel.plot(
                *means.T, linestyle="none", marker="P", color=shade, markersize=4.5,
                markeredgewidth=0.0, zorder=2.0, label="expected places" if first else None,
            )  # fmt: skip
        label = "kept out of, in the shade of its step" if first else None
        rims = [rim[i] for rim in found.values()]
        if rims and size == 2:
            polygons(
                panel, rims, facecolor=(shade, 0.04), edgecolor=shade, linewidth=1.1, zorder=1.8,
                gid=f"kept out of at step {step + 1}", label=label,
            )  # fmt: skip
        for skin in rims if size == 3 else ():
            panel.plot_wireframe(
                *np.moveaxis(skin, -1, 0), color=shade, linewidth=0.35, rcount=9, ccount=9,
                label=label,
            )  # fmt: skip
            label = None
        seen += [rim.reshape(-1, size) for rim in rims]
    return np.concatenate(seen)


def _situation(panel: Any, shown: Plan) -> Array:
    """Draw the path, what stands still and the robot; return points that have to be seen."""
    situation, start = shown.situation, shown.positions[0]
    size = len(start)
    route = situation.path.points if situation and situation.path else shown.reference
    panel.plot(*route.T, "-", color="0.7", linewidth=0.9, zorder=1.0, label="path")
    if situation is None:
        panel.plot(*start[:, None], "o", color=BLACK, markersize=5, label="robot")
        return np.asarray(start[None])
    if size == 3:
        skin = start + situation.radius * sphere(17)
        panel.plot_surface(*np.moveaxis(skin, -1, 0), color=BLACK, alpha=0.5, linewidth=0)
        panel.plot([], [], "o", color=BLACK, alpha=0.5, label="robot")
        return np.asarray(skin.reshape(-1, 3))
    walls = [one.points for one in situation.polygons]
    if walls:
        polygons(panel, walls, **WALL)
    body = body_outlines(start, situation.heading, situation.radius, situation.footprint)
    polygons(panel, body, facecolor="white", edgecolor=BLACK, linewidth=1.0, zorder=2.3,
             label="robot")  # fmt: skip
    ahead = np.array([np.cos(situation.heading), np.sin(situation.heading)])
    nose = np.stack([start, start + situation.radius * ahead])
    panel.plot(*nose.T, "-", color=BLACK, linewidth=1.6, zorder=2.4)
    return np.asarray(np.concatenate([np.zeros((0, 2)), *body]))


def _write_times(panel: Any, places: Array, times: Array, apart: float) -> None:
    """Write a time ahead beside each place, those alone that are so many metres apart."""
    last = np.full(2, np.inf)
    for place, time in zip(places[::-1], times[::-1], strict=True):
        if np.linalg.norm(place - last) > apart:
            last = place
            panel.annotate(
                f"{time:.3g} s", place, (4.0, 4.0), textcoords="offset points", color="0.15",
                zorder=3.0, **halo(),
            )  # fmt: skip

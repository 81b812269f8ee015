"""Pieces that pictures and films of an episode are made of.

Positions of three coordinates are seen from above (x and y).
"""

from itertools import combinations
from typing import Any, NamedTuple

import numpy as np

from ...draw.forecasts import content_outlines
from ...draw.shapes import body_outlines
from ...draw.style import COLOURS, LINES, WALL, number, polygons
from ...framework.values.arrays import Array
from ...framework.values.forecast import Forecast
from ...framework.values.plan import Plan
from ...metrics.gaps import gaps, wall_gaps
from .logged import DrawnAgent, Logged

_MARKERS = ("o", "s", "^", "D", "v")
_CYCLE = (1, 2, 3, 5, 0)  # of COLOURS and LINES; pink is kept for forecasts

_NEAR = 1.6  # m beside the robots' ways that are drawn of walls


class Look(NamedTuple):
    """How one agent is drawn."""

    color: str
    linestyle: Any
    marker: str


def looks(episode: Logged) -> dict[str, Look]:
    """Colour, line and marker of each agent; bystanders share one grey."""
    found = {log.name: Look("0.55", (0, (1, 1)), ".") for log in episode.agents}
    for i, log in enumerate(episode.robots):
        place = _CYCLE[i % len(_CYCLE)]
        found[log.name] = Look(COLOURS[place], LINES[place], _MARKERS[i % len(_MARKERS)])
    return found


def pairs(episode: Logged) -> list[tuple[DrawnAgent, DrawnAgent]]:
    """All pairs of agents of which at least one is a robot."""
    return [p for p in combinations(episode.agents, 2) if "robot" in (p[0].kind, p[1].kind)]


def plan_at(log: DrawnAgent, time: float) -> Plan | None:
    """Return the plan that a robot followed at a time, s; its first one before that."""
    stamps = [plan.stamp for plan in log.plans]
    if not stamps:
        return None
    return log.plans[max(int(np.searchsorted(stamps, time + 1e-9)) - 1, 0)]


def shapes(log: DrawnAgent, place: Array, heading: float, count: int = 60) -> list[Array]:
    """Outlines (K, 2), m, of what an agent covers when it is at a place."""
    return body_outlines(place, heading, log.radius, log.footprint, count)


def heading_at(episode: Logged, log: DrawnAgent, time: float) -> float:
    """Heading of an agent at a time, rad; NaN for one without."""
    return float(log.headings[max(int(np.searchsorted(episode.times, time + 1e-9)) - 1, 0)])


def walls(panel: Any, episode: Logged) -> None:
    """Draw what stands still."""
    if episode.polygons:
        polygons(panel, [one.points for one in episode.polygons], **WALL)


def clearance_over_time(episode: Logged) -> Array:
    """Smallest clearance of any robot at each logged instant, (T,), m; NaN if alone."""
    found = [gaps(a, b) for a, b in pairs(episode)]
    found += [wall_gaps(log, one) for log in episode.robots for one in episode.polygons]
    least = np.full(len(episode.times) - 1, np.nan)
    for gap in found:
        least = np.fmin(least, gap)
    return np.append(least[:1], least)


def nose(episode: Logged, log: DrawnAgent, time: float) -> Array:
    """Line from the centre to the rim along the heading, (2, 2), m; NaN without a heading."""
    place = episode.at(log, np.array([time]))[0, :2]
    heading = heading_at(episode, log, time)
    return np.stack([place, place + log.radius * np.array([np.cos(heading), np.sin(heading)])])


def outlines(forecast: Forecast | None, tail: float, count: int = 96, every: int = 1) -> Array:
    """Outlines of a plan's forecast, as `content_outlines`; None gives none."""
    return (
        np.zeros((0, count, 2))
        if forecast is None
        else content_outlines(forecast, tail, count, every)
    )


def extent(episode: Logged) -> tuple[Array, Array]:
    """Corners of the part of the world in which the robots and their paths are, (2,) each, m."""
    points = [log.positions[:, :2] for log in episode.robots]
    points += [path.points[:, :2] for log in episode.robots for _, path in log.paths]
    every, margin = np.concatenate(points), max(log.radius for log in episode.agents) + 0.6
    low, high = np.nanmin(every, axis=0) - margin, np.nanmax(every, axis=0) + margin
    for polygon in episode.polygons:  # of walls, what is near
        near = np.clip(polygon.points, low - _NEAR, high + _NEAR)
        low, high = np.fmin(low, near.min(axis=0)), np.fmax(high, near.max(axis=0))
    middle, reach = 0.5 * (low + high), 0.4 * max(high - low)
    ends = np.minimum(low, middle - reach), np.maximum(high, middle + reach)
    for log in episode.agents:  # of others, who is beside, as far as the figure is then wide
        places = np.clip(log.positions[:, :2], *ends)
        low = np.fmin(low, np.fmin.reduce(places))
        high = np.fmax(high, np.fmax.reduce(places))
    span = np.maximum(high - low, 0.4 * max(high - low))
    return 0.5 * (low + high - span), 0.5 * (low + high + span)


def frame(panel: Any, low: Array, high: Array) -> None:
    """Set limits, equal scale and grid on both axes, and their labels."""
    from matplotlib.ticker import MultipleLocator

    panel.set_xlim(low[0], high[0])
    panel.set_ylim(low[1], high[1])
    panel.set_aspect("equal")
    steps = np.outer(10.0 ** np.arange(-3, 6), (1.0, 2.0, 5.0)).ravel()
    step = steps[np.argmin(np.abs(np.log(steps * 8.0 / max(high - low))))]
    for axis in (panel.xaxis, panel.yaxis):
        axis.set_major_locator(MultipleLocator(step))
    panel.set_xlabel("x (m)")
    panel.set_ylabel("y (m)")


def courses(panel: Any, episode: Logged) -> None:
    """Draw the robots' reference paths, their starts and their goals."""
    styles = looks(episode)
    for log in episode.robots:
        hollow = {"linestyle": "none", "markerfacecolor": "none", "color": styles[log.name].color}
        for _, path in log.paths:
            panel.plot(*path.points[:, :2].T, "-", color="0.75", linewidth=0.7)
            panel.plot(*path.points[0, :2], marker="o", markersize=7, **hollow)
            panel.plot(*path.goal[:2], marker="x", markersize=5, **hollow)
    panel.plot([], [], "-", color="0.75", linewidth=0.7, label="reference path")
    for label, marker in (("start", "o"), ("goal", "x")):
        panel.plot([], [], marker, color="0.3", markerfacecolor="none", label=label)


class Closest(NamedTuple):
    """The closest approach of an episode: time (s), the pair, and its clearance (m)."""

    time: float
    pair: tuple[DrawnAgent, DrawnAgent]
    clearance: float


def closest(episode: Logged) -> Closest | None:
    """Where the clearance is smallest; None if no pair was ever there together."""
    best: Closest | None = None
    for first, second in pairs(episode):
        apart = gaps(first, second)
        if not np.isfinite(apart).any():
            continue
        i = int(np.nanargmin(apart))
        if best is None or apart[i] < best.clearance:
            start = (first.positions - second.positions)[i : i + 2]
            move = start[1] - start[0]
            share = np.clip(-start[0] @ move / max(float(move @ move), 1e-300), 0.0, 1.0)
            time = episode.times[i] + share * (episode.times[i + 1] - episode.times[i])
            best = Closest(float(time), (first, second), float(apart[i]))
    return best


def mark_closest(panel: Any, episode: Logged) -> Array:
    """Draw both bodies at the closest approach and the line between their surfaces.

    Returns points of what was drawn, (K, 2), m, so that other things can keep clear of it.
    """
    from matplotlib.collections import PolyCollection

    found = closest(episode)
    if found is None:
        return np.zeros((0, 2))
    styles = looks(episode)
    drawn = []
    for log in found.pair:
        place = episode.at(log, np.array([found.time]))[0, :2]
        outlines = shapes(log, place, heading_at(episode, log, found.time), 180)
        edge = styles[log.name].color
        body = PolyCollection(outlines, facecolor="none", edgecolor=edge, linewidth=0.7)
        panel.add_collection(body, autolim=False)
        drawn.append(np.concatenate([_rim(outline) for outline in outlines]))
    rims = _nearest(found, [episode.at(log, np.array([found.time]))[0, :2] for log in found.pair])
    if rims is None:
        apart = np.linalg.norm(drawn[0][:, None] - drawn[1][None], axis=2)
        one, other = np.unravel_index(int(apart.argmin()), apart.shape)
        rims = np.array([drawn[0][one], drawn[1][other]])
    least = number(found.clearance, ".2f")
    label = f"least clearance between agents\n{least} m at {found.time:.1f} s"
    panel.plot(*rims.T, "k.-", linewidth=0.9, markersize=4, label=label)
    return np.concatenate([*drawn, np.linspace(rims[0], rims[1], 10)])


def _nearest(found: Closest, places: list[Array]) -> Array | None:
    """Points of two discs' rims on the line between their centres, (2, 2); None for others."""
    if any(log.footprint is not None for log in found.pair):
        return None
    apart = float(np.linalg.norm(places[1] - places[0]))
    along = (places[1] - places[0]) / apart if apart > 0.0 else np.array([1.0, 0.0])
    rims = places[0] + found.pair[0].radius * along, places[1] - found.pair[1].radius * along
    return np.array(rims)


def _rim(outline: Array, count: int = 180) -> Array:
    """Return about ``count`` points along a closed outline, (K, 2), m."""
    ahead = np.roll(outline, -1, axis=0)
    share = np.linspace(0.0, 1.0, max(count // len(outline), 1), endpoint=False)[:, None, None]
    return np.asarray(((1.0 - share) * outline + share * ahead).reshape(-1, 2))

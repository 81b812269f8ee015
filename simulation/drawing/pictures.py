"""The picture of an episode: where all agents drove, and the closest approach.

Positions of three coordinates are drawn from above (x and y).
"""

from typing import Any

import numpy as np

from ...draw.shapes import sphere
from ...draw.style import halo, number
from ...framework.values.arrays import Array
from . import artists
from .logged import DrawnAgent, Logged

_MARK = 5.0  # s between two time marks
_MANY = 8  # agents; of more the ways of those that are no robots are drawn thin and pale


def draw_episode(panel: Any, episode: Logged) -> Array:
    """Draw an episode into axes of the right dimension; return what has to be seen."""
    if episode.agents[0].positions.shape[1] == 2:
        low, high = artists.extent(episode)
        draw_ways(panel, episode, low, high)
        return np.stack([low, high])
    low, high = volume(episode)
    draw_ways_in_space(panel, episode, low, high)
    found = artists.closest(episode)
    if found is not None:
        ends = [episode.at(log, np.array([found.time]))[0] for log in found.pair]
        label = f"least clearance\n{number(found.clearance, '.2f')} m at {found.time:.1f} s"
        panel.plot(*np.transpose(ends), "k.-", linewidth=0.9, markersize=4, label=label)
        draw_balls(panel, episode, found.time, low, high)
    return np.stack([low, high])


def volume(episode: Logged) -> tuple[Array, Array]:
    """Corners of the part of space in which the robots and their paths are, (3,) each, m."""
    points = [log.positions for log in episode.robots]
    points += [path.points for log in episode.robots for _, path in log.paths]
    every = np.concatenate(points)
    low, high = every.min(axis=0) - 0.8, every.max(axis=0) + 0.8
    middle, span = 0.5 * (low + high), np.maximum(high - low, 0.5 * max(high - low))
    return middle - 0.5 * span, middle + 0.5 * span


def draw_ways_in_space(panel: Any, episode: Logged, low: Array, high: Array) -> None:
    """Draw the ways of all agents inside a box, with their shadows on its floor."""
    styles = artists.looks(episode)
    for log in episode.agents:
        look, way = styles[log.name], inside(log.positions, low, high)
        shade = np.column_stack([way[:, :2], np.full(len(way), low[2])])
        panel.plot(*shade.T, "-", color="0.88", linewidth=0.7)
        robot = log.kind == "robot"
        label = f"{log.name} robot" if robot else once(panel, "passers-by")
        panel.plot(
            *way.T, linestyle=look.linestyle, color=look.color, linewidth=1.3 if robot else 1.0,
            label=label,
        )  # fmt: skip
        if robot:
            _course(panel, log, look.color)


def draw_balls(panel: Any, episode: Logged, time: float, low: Array, high: Array) -> None:
    """Draw all agents inside a box at a time, s."""
    styles = artists.looks(episode)
    for log in episode.agents:
        place = episode.at(log, np.array([time]))[0]
        if np.isfinite(place).all() and (place > low).all() and (place < high).all():
            draw_ball(panel, place, log.radius, styles[log.name].color)


def _course(panel: Any, log: DrawnAgent, color: str) -> None:
    """Draw a robot's reference path, its start and its goal."""
    for _, path in log.paths:
        label = once(panel, "reference path")
        panel.plot(*path.points.T, "-", color="0.75", linewidth=0.7, label=label)
        ends = ((path.points[0], "o", "start"), (path.goal, "x", "goal"))
        for place, marker, label in ends:
            panel.plot(
                *place[:, None], linestyle="none", marker=marker, color=color, markersize=5,
                markerfacecolor="none", label=once(panel, label),
            )  # fmt: skip


def inside(points: Array, low: Array, high: Array) -> Array:
    """Return the points with NaN where they leave the box: what is drawn breaks there."""
    outside = np.any((points < low) | (points > high), axis=1)
    return np.where(outside[:, None], np.nan, points)


def draw_ball(panel: Any, place: Array, radius: float, color: str) -> None:
    """Draw a ball in space."""
    skin = place + radius * sphere(17)
    panel.plot_surface(*np.moveaxis(skin, -1, 0), color=color, alpha=0.55, linewidth=0)


def draw_ways(panel: Any, episode: Logged, low: Array, high: Array) -> None:
    """Draw where all agents drove, with a mark every 5 s and the closest approach.

    Parameters
    ----------
    panel : about 3 inches along its longer side.
    low, high : (2,), m, corners of what is shown.
    """
    artists.frame(panel, low, high)
    artists.walls(panel, episode)
    artists.courses(panel, episode)
    styles = artists.looks(episode)
    for log in episode.agents:
        _way(panel, episode, log, styles[log.name])
    taken = artists.mark_closest(panel, episode)
    write_times(panel, episode, taken, _MARK)


def once(panel: Any, label: str) -> str | None:
    """Return the label, unless the panel has it already."""
    return None if label in panel.get_legend_handles_labels()[1] else label


def _way(panel: Any, episode: Logged, log: DrawnAgent, look: artists.Look) -> None:
    """Draw where one agent drove, with a mark every 5 s."""
    if log.kind == "robot":
        label: str | None = f"{log.name}, marks every {_MARK:g} s"
    else:
        label = once(panel, "replayed" if log.kind == "replay" else log.kind)
    many = log.kind != "robot" and len(episode.agents) > _MANY
    thin: dict[str, Any] = {"linewidth": 0.6, "alpha": 0.5} if many else {}
    marks = episode.at(log, np.arange(_MARK, episode.duration, _MARK))
    panel.plot(*log.positions[:, :2].T, color=look.color, linestyle=look.linestyle, **thin)
    size = 1.5 if many else 3.0
    panel.plot(*marks[:, :2].T, look.marker, color=look.color, markersize=size)
    panel.plot(
        [], [], look.marker, color=look.color, linestyle=look.linestyle, markersize=size,
        label=label,
    )  # fmt: skip


def write_times(panel: Any, episode: Logged, taken: Array, every: float) -> None:
    """Write the time at the robots' marks where there is room; elsewhere the mark stands alone.

    Parameters
    ----------
    panel : about 3 inches along its longer side, with its limits set.
    taken : (K, 2), m, points that labels had better keep clear of, beside the robots' ways.
    every : s between two marks.
    """
    styles = artists.looks(episode)
    ways = [log.positions[::10, :2] for log in episode.robots]
    taken = np.concatenate([taken, *ways])
    corners = np.array([panel.get_xlim(), panel.get_ylim()]).T
    span = float((corners[1] - corners[0]).max())
    # Half the size of a label in the panel's units: 215 points along the longer side.
    half = 0.5 * span / 215.0 * np.array([3.6 * len(f"{episode.duration:.0f} s") + 1.5, 7.5])
    boxes = np.zeros((0, 2))
    times = np.arange(every, episode.duration, every)
    for log in episode.robots:
        places = episode.at(log, times)[:, :2]
        last = log.positions[0, :2]
        for time, place in zip(times, places, strict=True):
            if np.linalg.norm(place - last) < 0.03 * span:  # the marks are one upon the other
                continue
            last = place
            chosen = _spot(place, half, boxes, taken, corners)
            if chosen is None:
                continue
            boxes = np.concatenate([boxes, chosen[None]])
            panel.text(
                *chosen, f"{time:g} s", ha="center", va="center", color=styles[log.name].color,
                zorder=3, **halo(),
            )  # fmt: skip


def _spot(place: Array, half: Array, boxes: Array, taken: Array, corners: Array) -> Array | None:
    """Choose the middle of a label beside a mark, off other labels; None without room.

    Parameters
    ----------
    place : (2,), of the mark.
    half : (2,), half the size of a label.
    boxes : (K, 2), middles of the labels that are there.
    taken : (M, 2), points that it had better keep clear of.
    corners : (2, 2), of the panel, lower left and upper right.
    """
    angles = np.arange(16) * np.pi / 8.0
    rays = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    spots = np.concatenate([place + reach * half * rays for reach in (1.7, 2.3)])
    inside = np.all((spots - half >= corners[0]) & (spots + half <= corners[1]), axis=1)
    apart = np.all((np.abs(spots[:, None] - boxes) >= 2.0 * half).any(axis=2), axis=1)
    free = inside & apart
    if not free.any():
        return None
    covered = np.all(np.abs(spots[:, None] - taken) < half, axis=2).sum(axis=1)
    return np.asarray(spots[int(np.argmin(np.where(free, covered, np.inf)))])

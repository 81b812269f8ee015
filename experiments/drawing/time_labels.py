"""Times written beside the marks along the ways of an episode."""

from typing import Any

import numpy as np

from ...framework.values.arrays import Array
from ...simulation.log.episode_log import Episode
from . import episode_artists as pieces


def write_times(panel: Any, episode: Episode, taken: Array, every: float) -> None:
    """Write the time at the robots' marks where there is room; elsewhere the mark stands alone.

    Parameters
    ----------
    panel : about 3 inches along its longer side, with its limits set.
    taken : (K, 2), m, points that labels had better keep clear of, beside the robots' ways.
    every : s between two marks.
    """
    from matplotlib.patheffects import withStroke

    styles = pieces.looks(episode)
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
                *chosen, f"{time:g} s", ha="center", va="center", fontsize=6,
                color=styles[log.name].color, zorder=3,
                path_effects=[withStroke(linewidth=1.5, foreground="white")],
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

"""Where two agents came closest to each other."""

from typing import Any, NamedTuple

import numpy as np

from ...framework.values.arrays import Array
from ...simulation.log.episode_log import AgentLog, Episode
from ...simulation.measures.gaps import gaps
from . import episode_artists as pieces


class Closest(NamedTuple):
    """The closest approach of an episode: time (s), the pair, and its clearance (m)."""

    time: float
    pair: tuple[AgentLog, AgentLog]
    clearance: float


def closest(episode: Episode) -> Closest | None:
    """Where the clearance is smallest; None if no pair was ever there together."""
    best: Closest | None = None
    for first, second in pieces.pairs(episode):
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


def mark_closest(panel: Any, episode: Episode) -> Array:
    """Draw both bodies at the closest approach and the line between their surfaces.

    Returns points of what was drawn, (K, 2), m, so that other things can keep clear of it.
    """
    from matplotlib.collections import PolyCollection

    found = closest(episode)
    if found is None:
        return np.zeros((0, 2))
    styles = pieces.looks(episode)
    drawn = []
    for log in found.pair:
        place = episode.at(log, np.array([found.time]))[0, :2]
        outlines = pieces.shapes(log, place, pieces.heading_at(episode, log, found.time), 180)
        edge = styles[log.name].color
        body = PolyCollection(outlines, facecolor="none", edgecolor=edge, linewidth=0.7)
        panel.add_collection(body, autolim=False)
        drawn.append(np.concatenate([_rim(outline) for outline in outlines]))
    rims = _nearest(found, [episode.at(log, np.array([found.time]))[0, :2] for log in found.pair])
    if rims is None:
        apart = np.linalg.norm(drawn[0][:, None] - drawn[1][None], axis=2)
        one, other = np.unravel_index(int(apart.argmin()), apart.shape)
        rims = np.array([drawn[0][one], drawn[1][other]])
    label = f"least clearance between agents\n{found.clearance:.2f} m at {found.time:.1f} s"
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

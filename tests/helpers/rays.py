"""Ranges of a LiDAR among discs and walls, from plain geometry; a peer of its own."""

import numpy as np


def ranges(
    origin: np.ndarray,
    bearings: np.ndarray,
    discs: np.ndarray,
    radius: float,
    walls: np.ndarray | None = None,
) -> np.ndarray:
    """Return how far each ray goes, (B,), m; infinite where it meets nothing.

    origin : (2,). bearings : (B,). discs : (N, 2), their centres. walls : (W, 2, 2), their ends.
    """
    unit = np.stack([np.cos(bearings), np.sin(bearings)], axis=-1)
    best = np.full(len(bearings), np.inf)
    for place in np.asarray(discs).reshape(-1, 2):
        away = place - origin
        along = unit @ away
        aside = unit[:, 0] * away[1] - unit[:, 1] * away[0]
        half = radius**2 - aside**2
        found = along - np.sqrt(np.maximum(half, 0.0))
        best = np.where((half >= 0.0) & (found > 0.0), np.minimum(best, found), best)
    for begin, end in np.zeros((0, 2, 2)) if walls is None else walls:
        edge, away = end - begin, begin - origin
        cross = unit[:, 0] * edge[1] - unit[:, 1] * edge[0]
        with np.errstate(divide="ignore", invalid="ignore"):
            found = (away[0] * edge[1] - away[1] * edge[0]) / cross
            share = (away[0] * unit[:, 1] - away[1] * unit[:, 0]) / cross
        met = (found > 0.0) & (share >= 0.0) & (share <= 1.0)
        best = np.where(met, np.minimum(best, found), best)
    return best

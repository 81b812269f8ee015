"""Distances from a point to a polygon, vectorised."""

import numpy as np

from wideberth.framework.values.arrays import Array, BoolArray


def polygon_signed_distance(points: Array, vertices: Array) -> Array:
    """Distance to the outline, m, negative inside: points (..., 2), vertices (V, 2) -> (...).

    The smallest distance to an edge; the sign from the number of edges that a ray to the right
    crosses, so the polygon may be non-convex and of either orientation.
    """
    points, vertices = np.asarray(points, dtype=np.float64), np.asarray(vertices, dtype=np.float64)
    edge = np.roll(vertices, -1, axis=0) - vertices
    offset = points[..., None, :] - vertices
    length = (edge**2).sum(axis=-1)
    along = np.divide(
        (offset * edge).sum(axis=-1), length, out=np.zeros(offset.shape[:-1]), where=length > 0
    )
    gap = offset - np.clip(along, 0.0, 1.0)[..., None] * edge
    distance = np.hypot.reduce(gap, axis=-1).min(axis=-1)
    return np.asarray(np.where(_inside(points, vertices, edge), -distance, distance))


def _inside(points: Array, vertices: Array, edge: Array) -> BoolArray:
    y = points[..., None, 1]
    above = vertices[:, 1] > y
    crosses = above != (np.roll(vertices, -1, axis=0)[:, 1] > y)
    height = np.where(edge[:, 1] == 0.0, 1.0, edge[:, 1])
    meets = vertices[:, 0] + edge[:, 0] * (y - vertices[:, 1]) / height
    return np.asarray((crosses & (points[..., None, 0] < meets)).sum(axis=-1) % 2 == 1)


def max_face(points: Array, vertices: Array) -> Array:
    """Largest signed distance to the line of a face, m: (..., 2) and convex (V, 2) -> (...).

    The vertices run counter-clockwise. Equal to the signed distance inside and where a face is
    closest; beyond a corner it is smaller, so keeping it above a margin keeps the distance too.
    """
    points, vertices = np.asarray(points, dtype=np.float64), np.asarray(vertices, dtype=np.float64)
    edge = np.roll(vertices, -1, axis=0) - vertices
    normal = np.stack([edge[:, 1], -edge[:, 0]], axis=-1)
    normal = normal / np.hypot.reduce(normal, axis=-1)[:, None]
    return np.asarray(((points[..., None, :] - vertices) * normal).sum(axis=-1).max(axis=-1))

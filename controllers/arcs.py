"""How far a disc can go along a circular arc before it touches something that stands still."""

from collections.abc import Sequence

import numpy as np

from ..framework.values.arrays import Array
from ..framework.values.polygon import Polygon, edge_normals
from ..people.walls import away_from_walls

STRAIGHT = 1e-6
"""1/m; an arc of less curvature is taken as a line, 0.05 mm off after 10 m."""
TOUCH = 1e-9
"""m; who is this near touches already."""


def free_way(
    place: Array,
    direction: Array,
    curvature: Array,
    radius: float,
    discs: tuple[Array, Array],
    polygons: Sequence[Polygon] = (),
) -> Array:
    """Length of arcs from a place to the first contact, (S,), m; infinite where there is none.

    Exact. The centre of the disc moves among the obstacles enlarged by its radius: discs of
    radius r + r_d, and for polygons discs of radius r about their corners and the edges, moved
    outwards by r. On an arc of radius R about c an obstacle at distance D from c is met at the
    angle phi before it, cos phi = (R^2 + D^2 - rho^2) / (2 R D); an edge n . q = c_n at
    sin(alpha - delta) = c_n / R - n_y, see the code.

    What is touched already has length 0, but for arcs that lead off it: these are free of it.

    Parameters
    ----------
    place : (2,), m, centre of the disc.
    direction : (S, 2), unit vectors, in which each arc starts.
    curvature : (S,), 1/m, positive to the left; 0 for a straight line.
    radius : r, m.
    discs : centres (O, 2), m, and radii (O,), m, of obstacles.
    polygons : obstacles too.
    """
    count = len(direction)
    side = np.where(curvature < 0.0, -1.0, 1.0)  # mirrored, so that every arc turns to the left
    left = side[:, None] * np.stack([-direction[:, 1], direction[:, 0]], axis=1)
    axes = direction, left
    bend = np.where(np.abs(curvature) < STRAIGHT, 0.0, np.abs(curvature))
    ways = [
        np.full((count, 1), np.inf),
        _to_discs(axes, bend, discs[0] - place, radius + discs[1]),
    ]
    if polygons:
        corners = np.concatenate([polygon.points for polygon in polygons])
        ahead = np.concatenate([np.roll(polygon.points, -1, axis=0) for polygon in polygons])
        normals = np.concatenate([edge_normals(polygon.points) for polygon in polygons])
        starts, ends = corners + radius * normals - place, ahead + radius * normals - place
        ways.append(_to_discs(axes, bend, corners - place, np.full(len(corners), radius)))
        ways.append(_to_edges(axes, bend, starts, ends, normals))
        room, away = away_from_walls(place, polygons)
        stuck = (room <= radius + TOUCH) & (direction @ away.T < TOUCH)
        ways.append(np.where(stuck, 0.0, np.inf))
    return np.asarray(np.concatenate(ways, axis=1).min(axis=1))


def _to_discs(axes: tuple[Array, Array], bend: Array, centres: Array, reach: Array) -> Array:
    """Lengths to discs about centres (O, 2) relative to the start: (S, O), m."""
    x, y = axes[0] @ centres.T, axes[1] @ centres.T
    distance = np.hypot(centres[:, 0], centres[:, 1])
    away = np.broadcast_to(distance, x.shape)
    touching = away <= reach + TOUCH
    with np.errstate(invalid="ignore", divide="ignore"):
        way = x - np.sqrt(reach**2 - y**2)  # NaN where the line passes by
        straight = np.where((x > 0.0) & (np.abs(y) < reach), way, np.inf)
        turn = 1.0 / bend[:, None]
        apart = np.hypot(x, turn - y)
        cosine = (turn**2 + apart**2 - reach**2) / (2.0 * turn * apart)
        angle = np.arctan2(x, turn - y) - np.arccos(cosine)
        curved = np.where(np.abs(cosine) <= 1.0, turn * np.mod(angle, 2.0 * np.pi), np.inf)
    way = np.where(bend[:, None] > 0.0, curved, straight)
    way = np.where(touching & (bend[:, None] == 0.0), np.inf, way)
    return np.asarray(np.where(touching & (x > -TOUCH), 0.0, way))


def _to_edges(
    axes: tuple[Array, Array], bend: Array, starts: Array, ends: Array, normals: Array
) -> Array:
    """Lengths to where edges (E, 2), relative to the start, are crossed inwards: (S, E), m.

    On the arc q = R (sin alpha, 1 - cos alpha) the edge's line n . q = c is met at
    sin(alpha - delta) = c / R - n_y, delta = atan2(n_y, n_x); inwards where the cosine is not
    positive.
    """
    nx, ny = axes[0] @ normals.T, axes[1] @ normals.T
    beyond = (starts * normals).sum(axis=1)
    along = ends - starts
    length = np.hypot(along[:, 0], along[:, 1])
    along = along / length[:, None]
    with np.errstate(invalid="ignore", divide="ignore"):
        turn = 1.0 / bend[:, None]
        angle = np.arctan2(ny, nx) + np.pi - np.arcsin(beyond / turn - ny)
        angle = np.mod(angle, 2.0 * np.pi)
        curved = turn * angle
        ahead, aside = turn * np.sin(angle), turn * (1.0 - np.cos(angle))
        way = beyond / nx
        straight = np.where((nx < 0.0) & (way >= 0.0), way, np.nan)
        flat = bend[:, None] == 0.0
        way = np.where(flat, straight, curved)
        x, y = np.where(flat, straight, ahead), np.where(flat, 0.0, aside)
        where = x * (axes[0] @ along.T) + y * (axes[1] @ along.T) - (starts * along).sum(axis=1)
        met = (where >= -TOUCH) & (where <= length + TOUCH)
    return np.asarray(np.where(met, way, np.inf))

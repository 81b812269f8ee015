"""Straight segments through the points of what stands still: split, fit and merge."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache
from itertools import pairwise
from math import atan2, cos, sin

import numpy as np

from wideberth.framework.numerics.chi_square import content_bound
from wideberth.framework.values.arrays import Array, BoolArray
from wideberth.framework.values.sensing import Scan
from wideberth.simulation.sensing.perceived import Segments, Sightings

from .groups import by_gap
from .hits import DRIFT, TURN, Hits, IntArray, hits_of, without

GAP, SLANT = 0.1, 0.17
"""m, and sine of the smallest angle between beam and wall at which its points still belong
together: they are then farther apart by 1 / `SLANT`."""
STRAIGHT, SURELY = 0.05, 5.0
"""m, by which points may lie beside their segment, or so many deviations of a range."""
UNEVEN = 1e-3
"""Share of even walls that are taken for uneven ones."""
_GRAZING = 0.05
"""Sine of the angle between beam and wall; at smaller ones a range says no more of the wall."""


@dataclass(frozen=True, eq=False)
class _Line:
    """A line through points, with what is known of it.

    Attributes
    ----------
    index : of its points, by bearing.
    ends : (2, 2), m.
    covariance : (2, 2), m^2, across the line at its ends.
    widest : m, of the point farthest beside it.
    """

    index: IntArray
    ends: Array
    covariance: Array
    widest: float


def segments_of(
    hits: Hits, deviation: float, drift: float = DRIFT, turn: float = TURN
) -> Segments:
    """Lay straight segments through points on what stands still.

    Neighbours that may be of one surface are grouped (`by_gap`, as far apart as they are on a wall
    that the beams meet at the sine `SLANT`). Each group is split at the point farthest from the
    chord of its ends until all pieces are straight (iterative end-point fit). A line is fitted to
    each piece, to longer ones first, by weighted least squares: the error of a range r_i acts
    along its beam d_i, so that across the line, whose normal is n,

        s_i = deviation |n . d_i|,    min over a, b of  sum_i (a + b t_i - e_i)^2 / s_i^2,

    e_i and t_i the places of the points across and along. The point between two pieces is of the
    longer one. Neighbouring pieces that are straight together are merged. The covariance holds
    the errors of a and b, those of the poses within the scan, and the unevenness of what is met:
    by how much the points lie farther aside than ranges err.

    A point apart from all lines is a segment of no length, which is known along the line of
    sight alone.

    Parameters
    ----------
    hits : on what stands still.
    deviation : m, of a range.
    drift, turn : see `Discs`.

    References
    ----------
    Nguyen et al., "A comparison of line extraction algorithms using 2D laser rangefinder for
    indoor mobile robotics", IROS 2005 (split-and-merge).
    """
    found: list[_Line] = []
    for group in by_gap(hits, GAP, hits.spacing / SLANT):
        lines = _merged(hits, _lines(hits, group, deviation), deviation)
        found += [*lines, *_rest(hits, group, lines, deviation)]
    ends = np.array([line.ends for line in found]).reshape(-1, 2, 2)
    spread = np.array([line.covariance for line in found]).reshape(-1, 2, 2)
    if hits.sensor is not None:
        spread = spread + _of_poses(ends, hits.sensor, drift, turn)
    return Segments(ends, spread)


def with_static(found: Sightings, scan: Scan, poses: Array, static: BoolArray) -> Sightings:
    """Return sightings with further beams, (B,), of a scan that met what stands still."""
    hits, _ = hits_of(without(scan, ~static), poses)
    return replace(
        found,
        static=np.concatenate([found.static, hits.points]),
        segments=found.segments.and_those(segments_of(hits, scan.deviation)),
    )


def _lines(hits: Hits, group: IntArray, deviation: float) -> list[_Line]:
    """Split a group into straight pieces of at least three points, and fit a line to each."""
    points, limit = hits.points[group], max(STRAIGHT, SURELY * deviation)
    breaks, waiting = {0, len(group) - 1}, [(0, len(group) - 1)]
    while waiting:
        first, last = waiting.pop()
        aside = _beside(points[first : last + 1])
        at = first + int(aside.argmax())
        if first < at < last and aside.max() > limit:
            breaks.add(at)
            waiting += [(first, at), (at, last)]
    pieces = [np.arange(a, b + 1) for a, b in pairwise(sorted(breaks)) if b - a > 1]
    free, lines = np.ones(len(group), dtype=np.bool_), dict[int, _Line]()
    for piece in sorted(pieces, key=len, reverse=True):
        rest = piece[free[piece]]  # the longer one has the point between two
        if len(rest) > 1:
            lines[int(rest[0])] = _fit(hits, group[rest], deviation)
            free[rest] = False
    return [lines[at] for at in sorted(lines)]


def _beside(points: Array) -> Array:
    """Distances of points from the chord between the first and the last, (n,), m."""
    away, along = points - points[0], points[-1] - points[0]
    length = float(np.hypot(*along))
    if length < 1e-9:  # a loop
        return np.asarray(np.hypot(away[:, 0], away[:, 1]))
    return np.asarray(np.abs(away[:, 0] * along[1] - away[:, 1] * along[0]) / length)


def _fit(hits: Hits, index: IntArray, deviation: float) -> _Line:
    """Fit a line to at least two points; the last one is not the first one."""
    points = hits.points[index]
    middle = points.sum(axis=0) / len(points)
    away = points - middle
    (xx, xy), (_, yy) = (away.T @ away).tolist()
    angle = 0.5 * atan2(2.0 * xy, xx - yy)  # of the longest extent
    along = np.array([cos(angle), sin(angle)])
    if along @ (points[-1] - points[0]) < 0.0:
        along = -along
    normal = np.array([-along[1], along[0]])
    place, aside = away @ along, away @ normal
    sine = np.abs((points - hits.origins[index]) @ normal) / hits.ranges[index]
    across = deviation * np.maximum(sine, _GRAZING)
    weight = across**-2.0
    lever = weight * place
    known = np.array([[weight.sum(), lever.sum()], [lever.sum(), lever @ place]])
    spread = np.linalg.inv(known)
    shift, tilt = spread @ np.array([weight @ aside, lever @ aside])
    aside = aside - shift - tilt * place
    reach = np.array([place.min(), place.max()])
    arms = np.stack([np.ones(2), reach], axis=1)
    ends = middle + reach[:, None] * along + (shift + tilt * reach)[:, None] * normal
    uneven = _excess(aside / across) * float(across @ across) / len(index)
    covariance = arms @ spread @ arms.T + uneven * np.eye(2)
    return _Line(index, ends, covariance, float(np.abs(aside).max()))


def _excess(off: Array) -> float:
    """By how much the mean square of distances exceeds 1; 0 where chance may explain it."""
    free, total = len(off) - 2, float(off @ off)
    return total / free - 1.0 if free > 0 and total > _bound(free) else 0.0


@cache
def _bound(free: int) -> float:
    """Return what the sum of ``free`` squared deviations exceeds with probability `UNEVEN`."""
    return content_bound(free, UNEVEN)


def _merged(hits: Hits, lines: Sequence[_Line], deviation: float) -> list[_Line]:
    """Join lines with the next one while both are straight together."""
    limit, found = max(STRAIGHT, SURELY * deviation), list[_Line]()
    for line in lines:
        both = _both(hits, found[-1], line, limit, deviation) if found else None
        found[len(found) - (both is not None) :] = [both or line]
    return found


def _both(hits: Hits, one: _Line, next_: _Line, limit: float, deviation: float) -> _Line | None:
    """Return one line for two; None where their points are not straight together."""
    corners = np.array([one.ends[0], one.ends[1], next_.ends[0], next_.ends[1]])
    if _beside(corners).max() > limit:
        return None
    index = np.concatenate([one.index, next_.index])
    both = _fit(hits, index, deviation)
    return both if both.widest <= limit else None


def _rest(hits: Hits, group: IntArray, lines: Sequence[_Line], deviation: float) -> list[_Line]:
    """Return what stands for the points of a group that are on no line, nor beside one."""
    free = ~np.isin(group, np.concatenate([np.zeros(0, int), *(line.index for line in lines)]))
    if lines and free.any():
        ends = np.array([line.ends for line in lines])
        along, away = ends[:, 1] - ends[:, 0], hits.points[group[free]][:, None] - ends[:, 0]
        share = np.clip((away * along).sum(axis=2) / (along**2).sum(axis=1), 0.0, 1.0)
        off = np.linalg.norm(away - share[..., None] * along, axis=2)
        free[free] = off.min(axis=1) > STRAIGHT
    places = np.flatnonzero(free)
    found = []
    for run in np.split(places, np.flatnonzero(np.diff(places) > 1) + 1):
        index, straight = group[run], max(STRAIGHT, SURELY * deviation)
        if len(run) > 2 and _beside(hits.points[index]).max() <= straight:
            found.append(_fit(hits, index, deviation))
        else:
            found += [_point(hits, i, deviation) for i in index]
    return found


def _point(hits: Hits, index: int, deviation: float) -> _Line:
    """Return a segment of no length."""
    place = hits.points[index]
    spread = np.full((2, 2), deviation**2)
    return _Line(np.array([index]), np.stack([place, place]), spread, 0.0)


def _of_poses(ends: Array, sensor: Array, drift: float, turn: float) -> Array:
    """Covariance of the ends across by errors of the poses within a scan, (S, 2, 2), m^2."""
    along = ends[:, 1] - ends[:, 0]
    length = np.hypot(along[:, 0], along[:, 1])[:, None]
    unit = np.divide(along, length, out=np.zeros_like(along), where=length > 0.0)
    places = np.einsum("sek,sk->se", ends - sensor, unit)
    return np.asarray(drift**2 + turn**2 * places[:, :, None] * places[:, None, :])

"""The dual of the distance between body and polygon: multipliers on the faces (OBCA)."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar, TypeAlias, final

import numpy as np

from ...framework.region import Auxiliary, Constraint
from ...framework.static_region import StaticRegion
from ...framework.values.arrays import Array, Scalar
from ...framework.values.errors import WideberthError
from ...framework.values.motion import Pose
from ...framework.values.polygon import edge_normals
from . import packing

Row: TypeAlias = tuple[Scalar, Scalar]


@final
@dataclass(frozen=True)
class Dual(StaticRegion):
    """Optimisation-based collision avoidance: the distance by linear programming duality.

    The polygon is {x : A x <= b} with unit rows, the body {p + Rot(heading) y : G y <= g}, or
    the point p. Body and polygon are apart iff multipliers lam, mu >= 0 of their faces give

        ((A p - b)^T lam - g^T mu - sqrt(n^T M n) - margin) / scale >= 0,   n = A^T lam,
        G^T mu + Rot(heading)^T n = 0,   |n|^2 = 1,

    since for given n the best (A p - b)^T lam is n . p minus the largest n . w over the polygon,
    and the best -g^T mu the smallest n . Rot v over the body. One inequality however many
    corners there are, but V + W variables (V for a point) and three equalities (one)
    where `SeparatingLine` has one angle; n is the same normal.

    The paper has |n| <= 1, which is convex in lam and gives the distance, 0 in an overlap: there
    lam = 0 is the best it can do, all derivatives vanish, and an optimiser that starts inside
    stays. We ask |n| = 1: then it is the signed distance, with a slope everywhere. For margins
    above zero both allow the same poses.

    Bodies need three corners or one; scale as in `SeparatingLine`.

    References
    ----------
    X. Zhang, A. Liniger and F. Borrelli, Optimization-based collision avoidance, IEEE Trans.
    Control Syst. Technol. 29 (2021).
    """

    reference: ClassVar[str] = "zhang2021optimization"

    def parameters(self, parts: Array, margin: Array, spread: Array) -> Array:
        """`packing.pack`, then the unit normals of the edges, zero for a repeated vertex."""
        packed = packing.pack(parts, margin, spread)
        normals = edge_normals(np.asarray(parts, dtype=np.float64))
        flat = normals.reshape(*normals.shape[:-2], -1)
        flat = np.broadcast_to(flat, (*packed.shape[:-1], flat.shape[-1]))
        return np.concatenate([packed, flat], axis=-1)

    def parameter_count(self, corners: int) -> int:
        """P = 4 V + 5."""
        return packing.packed_count(corners) + 2 * corners

    def auxiliary(self, corners: int, outline: int) -> Auxiliary:
        """Declare lam and, for a body with faces, mu, both >= 0.

        The start is that of one face of either; `auxiliary_start` gives better ones.

        Raises
        ------
        WideberthError : a body of two corners, which has no faces.
        """
        if outline == 2:
            raise WideberthError(
                "outline has 2 corners; the dual region takes bodies of one corner or of at "
                "least 3: use separating_line"
            )
        start = (1.0,) + (0.0,) * (corners - 1)
        if outline > 1:
            start += (1.0,) + (0.0,) * (outline - 1)
        count = len(start)
        return Auxiliary((0.0,) * count, (np.inf,) * count, start, regularisation=1e-5)

    def auxiliary_start(self, pose: Pose, parameters: Array) -> Array:
        """Return the multipliers of the best normal, (..., V) or (..., V + W)."""
        packed, rows = _unpack(parameters, parameters.shape[-1])
        normal = packed.best_normal(pose)
        faces = np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)
        gaps = np.broadcast_arrays(*_gaps(packed, rows, pose))
        first = _multipliers(faces, np.stack(gaps, axis=-1), normal)
        if len(pose.outline) < 2:
            return first
        own, bounds = _faces(pose.outline)
        toward = np.stack(_turned_back(pose.heading, (normal[..., 0], normal[..., 1])), axis=-1)
        second = _multipliers(own, -bounds, -toward)
        return np.concatenate([first, second], axis=-1)

    def constraint(self, pose: Pose, parameters: Scalar, auxiliary: Scalar) -> Constraint:
        """State the dual value and the equalities that tie the multipliers."""
        packed, rows = _unpack(parameters, parameters.numel())
        lam = [auxiliary[j] for j in range(len(rows))]
        normal = _combined(rows, lam)
        value = _weighted(_gaps(packed, rows, pose), lam)
        ties = [normal[0] ** 2 + normal[1] ** 2 - 1.0]
        if len(pose.outline) > 1:
            own, bounds = _faces(pose.outline)
            mu = [auxiliary[len(rows) + i] for i in range(len(own))]
            value -= _weighted(bounds.tolist(), mu)
            turned = _turned_back(pose.heading, normal)
            pushed = _combined(own.tolist(), mu)
            ties += [pushed[0] + turned[0], pushed[1] + turned[1]]
        free = value - packed.deviation(normal) - packed.margin
        return Constraint((free / packed.scale,), tuple(ties))


def _unpack(parameters: Scalar, count: int) -> tuple[packing.PackedPolygons, list[Row]]:
    """Numbers as in `packing` and the rows A_j."""
    corners = (count - packing.packed_count(0)) // 4
    numeric = isinstance(parameters, np.ndarray)
    start = packing.packed_count(corners)
    pieces = [parameters[..., i] if numeric else parameters[i] for i in range(start, count)]
    rows = list(zip(pieces[::2], pieces[1::2], strict=True))
    return packing.PackedPolygons(parameters, corners), rows


def _gaps(packed: packing.PackedPolygons, rows: list[Row], pose: Pose) -> list[Scalar]:
    """A_j . p - b_j, signed distances from the lines of the edges, m.

    They are measured from the body's frame, or from the one corner of a body that has no other.
    The edge of a repeated vertex is the row 0 with b = 1: a multiplier on it only costs.
    """
    x, y = pose.corners()[0] if len(pose.outline) == 1 else pose.position
    return [
        a * (x - w[0]) + b * (y - w[1]) - (1.0 - a**2 - b**2)
        for w, (a, b) in zip(packed.vertices, rows, strict=True)
    ]


def _faces(outline: tuple[Row, ...]) -> tuple[Array, Array]:
    """Return rows G (W, 2) and bounds g (W,), m, of a counter-clockwise outline."""
    corners = np.asarray(outline, dtype=np.float64)
    rows = edge_normals(corners)
    return rows, (rows * corners).sum(axis=-1)


def _turned_back(heading: Scalar, vector: Row) -> Row:
    """Rot(heading)^T of a vector."""
    cosine, sine = np.cos(heading), np.sin(heading)
    return cosine * vector[0] + sine * vector[1], cosine * vector[1] - sine * vector[0]


def _combined(rows: Sequence[Sequence[Scalar]], weights: list[Scalar]) -> Row:
    """Rows^T weights."""
    return (
        _weighted([row[0] for row in rows], weights),
        _weighted([row[1] for row in rows], weights),
    )


def _weighted(values: Sequence[Scalar], weights: list[Scalar]) -> Scalar:
    return sum(value * weight for value, weight in zip(values, weights, strict=True))


def _multipliers(faces: Array, values: Array, wanted: Array) -> Array:
    """Solve max values . m over m >= 0 with faces^T m = wanted: (..., V).

    A linear program with two equalities has a solution with at most two entries above zero, so
    all pairs of faces are tried: those beside the vertex that the normal points to win.

    Parameters
    ----------
    faces : (..., V, 2), unit rows (zero ones are never chosen).
    values : (..., V), m.
    wanted : (..., 2), unit.

    Pairs that turn by less than 1e-7 are passed over, since the equalities would lose more than
    1e-9; the pair beyond them costs at most 1e-7 of the length of an edge.
    """
    count = faces.shape[-2]
    first, second = np.triu_indices(count, 1)
    one, other, goal = faces[..., first, :], faces[..., second, :], wanted[..., None, :]
    area = one[..., 0] * other[..., 1] - one[..., 1] * other[..., 0]
    solid = np.where(np.abs(area) > 1e-7, area, np.nan)
    share = (goal[..., 0] * other[..., 1] - goal[..., 1] * other[..., 0]) / solid
    rest = (one[..., 0] * goal[..., 1] - one[..., 1] * goal[..., 0]) / solid
    fits = (share > -1e-12) & (rest > -1e-12)  # NaN compares false
    share, rest = (np.where(fits, np.maximum(part, 0.0), 0.0) for part in (share, rest))
    reached = np.where(fits, share * values[..., first] + rest * values[..., second], -np.inf)
    best = reached.argmax(axis=-1)
    chosen = best[..., None]
    columns = np.arange(count)
    kept = np.take_along_axis(share, chosen, axis=-1) * (columns == first[best][..., None])
    return np.asarray(
        kept + np.take_along_axis(rest, chosen, axis=-1) * (columns == second[best][..., None])
    )

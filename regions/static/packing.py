"""Parameters of static regions and the corners of a body.

Layout of the parameters, P = 2 V + 5 numbers for polygons of V vertices: the vertices (2 V), the
root of the spread M^1/2 as (xx, xy, yy), margin, and the length that makes constraints unit-free.
"""

import numpy as np

from ...framework.numerics.symbolic import ca
from ...framework.values.arrays import Array, Scalar, checked_covariance, stacked
from ...framework.values.errors import WideberthError
from ...framework.values.motion import Pose
from ...framework.values.polygon import best_direction
from ...framework.values.roots import symmetric_root
from ..gaussian import FLOOR

_LENGTHS = (0.1, 1.0)
"""m. Bounds on the length that stands beside the margin in the scale. The upper one keeps a
violation of 1e-4 below 0.1 mm at a wall of any length, the lower one is for poles.
"""


def pack(parts: Array, margin: Array, spread: Array) -> Array:
    """Parameters of convex polygons: (..., V, 2), (...), (..., 2, 2) -> (..., 2 V + 5).

    The scale is the margin plus half the polygon's diameter, the latter within [0.1, 1] m.

    Raises
    ------
    WideberthError : fewer than three vertices, not finite, a negative margin, a spread that is
        no covariance.
    """
    parts = np.asarray(parts, dtype=np.float64)
    if parts.ndim < 2 or parts.shape[-1] != 2 or parts.shape[-2] < 3:
        raise WideberthError(
            f"parts have shape {parts.shape}; wanted (..., V, 2) with at least 3 vertices"
        )
    margin, spread = np.asarray(margin, dtype=np.float64), np.asarray(spread, dtype=np.float64)
    if not (np.isfinite(margin).all() and np.isfinite(parts).all()) or (margin < 0.0).any():
        raise WideberthError(
            f"parts or margin ({margin}) are not finite, or margin is negative; wanted lengths in "
            "m, the margin at least 0"
        )
    spread = checked_covariance("spread", spread, 2)
    batch = np.broadcast_shapes(parts.shape[:-2], margin.shape, spread.shape[:-2])
    apart = parts[..., :, None, :] - parts[..., None, :, :]
    radius = 0.5 * np.hypot(apart[..., 0], apart[..., 1]).max(axis=(-2, -1))
    root = symmetric_root(spread)
    pieces = [
        parts.reshape(*parts.shape[:-2], -1),
        root.reshape(*root.shape[:-2], 4)[..., [0, 1, 3]],
        margin[..., None],
        (margin + np.clip(radius, *_LENGTHS))[..., None],
    ]
    whole = [np.broadcast_to(piece, (*batch, piece.shape[-1])) for piece in pieces]
    return np.concatenate(whole, axis=-1)


def packed_count(corners: int) -> int:
    """P, for polygons of V vertices."""
    return 2 * corners + 5


class PackedPolygons:
    """Unpacked parameters of polygons of V vertices.

    They may be an array (..., P) or a CasADi vector, and more numbers may follow them.
    """

    def __init__(self, parameters: Scalar, corners: int) -> None:
        numeric = isinstance(parameters, np.ndarray)
        count = packed_count(corners)
        pieces = [parameters[..., i] if numeric else parameters[i] for i in range(count)]
        self.vertices: list[tuple[Scalar, Scalar]] = list(
            zip(pieces[: 2 * corners : 2], pieces[1 : 2 * corners : 2], strict=True)
        )
        self.root: list[Scalar] = pieces[2 * corners : 2 * corners + 3]
        self.margin: Scalar = pieces[-2]
        self.scale: Scalar = pieces[-1]

    def deviation(self, normal: tuple[Scalar, Scalar]) -> Scalar:
        """Return sqrt(n^T M n) = |M^1/2 n| of a vector n, m, in CasADi.

        The floor, added in quadrature, gives it a slope where it is zero.
        """
        along, across = normal
        first, mixed, last = self.root
        pulled = (first * along + mixed * across, mixed * along + last * across)
        return ca.sqrt(pulled[0] ** 2 + pulled[1] ** 2 + FLOOR**2)

    def best_normal(self, pose: Pose) -> Array:
        """Return the unit normals that separate NumPy poses from polygons most, (..., 2)."""
        first, mixed, last = self.root
        root = np.stack([first, mixed, mixed, last], axis=-1).reshape(*first.shape, 2, 2)
        return best_direction(pose.corner_points(), stacked(self.vertices), root @ root)[1]

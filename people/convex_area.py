"""A convex area in the plane that people do not leave."""

from dataclasses import dataclass
from typing import final

import numpy as np

from ..framework.values.arrays import Array, checked
from ..framework.values.errors import WideberthError
from ..framework.values.polygon import area_within, convex_hull, edge_normals, width_across

NEAREST = 0.1
"""m, least way to the border."""
THIN = 0.1
"""m; what people use is no area as long as it is not wider."""
Corners = tuple[tuple[float, float], ...]
"""Of a convex outline, m; () where no area is known."""


@final
@dataclass(frozen=True, eq=False)
class ConvexArea:
    """A convex area that people do not leave: all p with n . p <= offset for all its borders.

    Attributes
    ----------
    normal : (E, 2), outward unit normals.
    offset : (E,), m.
    """

    normal: Array
    offset: Array

    @classmethod
    def around(cls, corners: Array, beyond: float) -> "ConvexArea":
        """Return the area inside corners (V, 2), m, of a convex outline, and ``beyond`` m more."""
        middle = corners.mean(axis=0)
        normal = edge_normals(corners - middle)
        offset = (normal * (corners - middle)).sum(axis=1)
        outward = np.where(offset >= 0.0, 1.0, -1.0)
        normal = normal * outward[:, None]
        return cls(normal, offset * outward + normal @ middle + beyond)

    def way_left(self, place: Array, direction: Array) -> Array:
        """How far it is to the border from places, (O, M, 2), m, in directions (O, K, 2).

        Returns
        -------
        distance : (O, M, K), m, along unit vectors, at least `NEAREST`; so it is where people
            outside walk away.
        """
        towards = np.einsum("ed,okd->eok", self.normal, direction)
        pace = 1.0 / np.maximum(towards, 1e-9)
        room = self.offset[:, None, None] - np.einsum("ed,omd->eom", self.normal, place)
        distance = (np.maximum(room, 0.0)[..., None] * pace[:, :, None]).min(axis=0)
        return np.asarray(np.maximum(distance, NEAREST))

    def depth(self, places: Array) -> Array:
        """How deep places (..., 2), m, are inside, (...), m; negative outside."""
        along = np.einsum("ed,...d->...e", self.normal, places)
        return np.asarray((self.offset - along).min(axis=-1))


def checked_area(name: str, corners: Corners) -> Array:
    """Return the corners of a convex area as an array, (V, 2), m; V is 0 where none is known.

    Raises
    ------
    WideberthError : fewer than three corners, no area between them, or an outline that is not
        convex.
    """
    found = checked(name, corners if len(corners) else np.empty((0, 2)), (None, 2))
    if not len(found):
        return found
    if len(found) < 3 or width_across(found) < THIN:
        raise WideberthError(
            f"{name} is {corners}; wanted three corners or more around an area wider than "
            f"{THIN:g} m, or none"
        )
    if area_within(found) < (1.0 - 1e-6) * area_within(convex_hull(found)):
        raise WideberthError(
            f"{name} is {corners}, which is not convex; wanted the corners of a convex outline, "
            "in their order"
        )
    return found

"""Footprints: the area that a robot covers, in its own frame."""

from dataclasses import dataclass
from math import hypot
from typing import TypeAlias, final

import numpy as np

from .arrays import Array, checked, positive
from .errors import WideberthError

Place: TypeAlias = tuple[float, float]
"""(ahead, to the left) of the robot's position, m."""


@final
@dataclass(frozen=True)
class Discs:
    """A union of equal discs, which covers a long robot more closely than a single one.

    Regions keep their promise for each disc, so the robot's risk is at most the sum.

    Parameters
    ----------
    centres : in the robot's frame, m.
    radius : m.
    """

    centres: tuple[Place, ...]
    radius: float

    def __post_init__(self) -> None:
        _checked_places("discs.centres", self.centres, least=1)
        positive("discs.radius", self.radius)

    @property
    def reach(self) -> float:
        """Radius of the disc around the robot's position that encloses the footprint, m."""
        return self.radius + max(hypot(*place) for place in self.centres)


@final
@dataclass(frozen=True)
class Outline:
    """A convex polygon.

    Parameters
    ----------
    vertices : corners in the robot's frame, m, counter-clockwise.

    Raises
    ------
    WideberthError : fewer than three corners, not convex, or not counter-clockwise.
    """

    vertices: tuple[Place, ...]

    def __post_init__(self) -> None:
        corners = _checked_places("outline.vertices", self.vertices, least=3)
        edge = np.roll(corners, -1, axis=0) - corners
        turn = edge[:, 0] * np.roll(edge[:, 1], -1) - edge[:, 1] * np.roll(edge[:, 0], -1)
        angle = np.arctan2(turn, (edge * np.roll(edge, -1, axis=0)).sum(axis=1)).sum()
        if (turn <= 0.0).any() or abs(angle - 2.0 * np.pi) > 1e-6:
            raise WideberthError(
                f"outline.vertices {self.vertices} do not run counter-clockwise around a convex "
                "polygon with a corner at each; wanted that (cover others with Discs)"
            )

    @property
    def reach(self) -> float:
        """Radius of the disc around the robot's position that encloses the footprint, m."""
        return max(hypot(*place) for place in self.vertices)


Footprint: TypeAlias = Discs | Outline


def checked_footprint(name: str, footprint: Footprint | None, radius: float) -> None:
    """Refuse a footprint that reaches beyond the robot's disc, which is all that others see.

    Raises
    ------
    WideberthError : it does.
    """
    if footprint is not None and footprint.reach > radius * (1.0 + 1e-9):
        raise WideberthError(
            f"{name}.footprint reaches {footprint.reach:.4g} m from the robot's position, beyond "
            f"{name}.radius, {radius:.4g} m; wanted a radius that encloses the footprint"
        )


def _checked_places(name: str, places: tuple[Place, ...], least: int) -> Array:
    array = checked(name, places, (None, 2))
    if len(array) < least:
        raise WideberthError(f"{name} holds {len(array)} places; wanted at least {least}")
    return array

"""Maps of square cells: which places are occupied, free or unknown."""

from dataclasses import dataclass
from typing import Any, ClassVar, TypeAlias, final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .arrays import FARTHEST, Array, BoolArray, checked, positive, settle
from .errors import WideberthError

Cells: TypeAlias = NDArray[np.int64]
"""Columns and rows of cells, (..., 2)."""

SMALLEST = 1e-6
"""m, least side of a cell."""
UNKNOWN_CELL, FREE_CELL, OCCUPIED_CELL = -1, 0, 100
"""Values of cells as in ROS: not observed, surely free, surely occupied; percent between."""


@dataclass(frozen=True, eq=False)
class CellGrid:
    """Numbers on square cells in the plane; `OccupancyGrid` and `Costmap` derive from it.

    A cell is named by its column mx and its row my; it covers

        origin + resolution [mx, mx + 1] x [my, my + 1]

    and stands at ``cells[my, mx]``, so that row 0 is the lowest one. The axes of the grid are
    those of the world.

    Attributes
    ----------
    cells : (height, width), read-only whole numbers.
    resolution : m, side of a cell.
    origin : (x, y), m, the lower left corner of the cell in column 0 and row 0.

    Raises
    ------
    WideberthError : no cell, numbers that are not whole or out of range, a resolution below
        `SMALLEST`, corners beyond `FARTHEST`.
    """

    cells: NDArray[Any]
    resolution: float
    origin: tuple[float, float]

    _label: ClassVar[str] = "grid"
    _range: ClassVar[tuple[int, int]] = (0, 0)
    _type: ClassVar[Any] = np.int8

    def __init__(
        self, cells: ArrayLike, resolution: float, origin: ArrayLike = (0.0, 0.0)
    ) -> None:
        label = self._label
        cells = _whole_cells(f"{label}.cells", cells, self._range).astype(self._type)
        cells.setflags(write=False)
        resolution = positive(f"{label}.resolution", resolution)
        if resolution < SMALLEST:
            raise WideberthError(
                f"{label}.resolution is {resolution:g} m; wanted at least {SMALLEST:g}"
            )
        origin = checked(f"{label}.origin", origin, (2,))
        far = np.abs(np.stack([origin, origin + resolution * np.array(cells.shape[::-1])]))
        if far.max() > FARTHEST:
            raise WideberthError(f"{label} reaches beyond {FARTHEST:g} m from the world's origin")
        corner = float(origin[0]), float(origin[1])
        settle(self, cells=cells, resolution=resolution, origin=corner)

    def __repr__(self) -> str:
        """Say size and place; the cells themselves are too many."""
        kind, (x, y) = type(self).__name__, self.origin
        size = f"{self.width} x {self.height} cells of {self.resolution:g} m"
        return f"{kind}({size} from ({x:g}, {y:g}))"

    @property
    def width(self) -> int:
        """Number of columns."""
        return int(self.cells.shape[1])

    @property
    def height(self) -> int:
        """Number of rows."""
        return int(self.cells.shape[0])

    def world_to_map(self, points: ArrayLike) -> Cells:
        """Columns and rows of the cells that hold points, (..., 2) m -> (..., 2).

        A point outside the grid, or one that is not finite, gets a column or row that the grid
        does not have.
        """
        places = np.asarray(points, dtype=np.float64)
        with np.errstate(invalid="ignore"):
            found = np.floor((places - self.origin) / self.resolution)
        found = np.where(np.isnan(found), -1.0, found)
        return np.clip(found, -1, [self.width, self.height]).astype(np.int64)

    def map_to_world(self, cells: ArrayLike) -> Array:
        """Centres of cells, columns and rows (..., 2) -> (..., 2) m."""
        return np.asarray(self.origin + (np.asarray(cells) + 0.5) * self.resolution)

    def inside(self, points: ArrayLike) -> BoolArray:
        """Tell which points lie on the grid, (..., 2) m -> (...)."""
        return self._has(self.world_to_map(points))

    def at(self, points: ArrayLike, outside: int) -> Cells:
        """Numbers of the cells that hold points, (..., 2) m -> (...), or ``outside`` off the grid.

        Parameters
        ----------
        points : (..., 2), m.
        outside : what stands for a point that is not on the grid.
        """
        cells = self.world_to_map(points)
        here = self._has(cells)
        mx, my = np.moveaxis(np.where(here[..., None], cells, 0), -1, 0)
        return np.where(here, self.cells[my, mx].astype(np.int64), outside)

    def _has(self, cells: Cells) -> BoolArray:
        """Tell which columns and rows the grid has, (..., 2) -> (...)."""
        return np.asarray(((cells >= 0) & (cells < [self.width, self.height])).all(axis=-1))


@final
@dataclass(frozen=True, eq=False, repr=False, init=False)
class OccupancyGrid(CellGrid):
    """A map as ROS has it: -1 where nothing is known, else the occupancy of a cell in percent.

    Its fields and methods are those of `CellGrid`; each cell holds a number from -1 to 100.

    Examples
    --------
    >>> room = OccupancyGrid([[0, 0, 100], [0, -1, 100]], resolution=0.5, origin=(1.0, 2.0))
    >>> room
    OccupancyGrid(3 x 2 cells of 0.5 m from (1, 2))
    >>> room.world_to_map((2.2, 2.1)).tolist(), room.map_to_world((2, 0)).tolist()
    ([2, 0], [2.25, 2.25])
    >>> room.at([(2.2, 2.1), (9.0, 9.0)], outside=-1).tolist()
    [100, -1]
    """

    _label: ClassVar[str] = "occupancy_grid"
    _range: ClassVar[tuple[int, int]] = (UNKNOWN_CELL, OCCUPIED_CELL)


def _whole_cells(label: str, value: ArrayLike, limits: tuple[int, int]) -> NDArray[Any]:
    """Return cells (height, width) if they are whole numbers within the limits.

    Raises
    ------
    WideberthError : they are not.
    """
    if isinstance(value, np.ndarray) and value.dtype.kind in "iu" and value.ndim == 2:
        cells = value
    else:
        cells = checked(label, value, (None, None), reason=": a row of cells per row of the map")
    low, high = limits
    if not cells.size:
        raise WideberthError(f"{label} has shape {cells.shape}; wanted at least one cell")
    wrong = (cells < low) | (cells > high) | (cells != np.floor(cells))
    if wrong.any():
        my, mx = (int(i) for i in np.argwhere(wrong)[0])
        raise WideberthError(
            f"{label}[{my}, {mx}] is {cells[my, mx]}; wanted whole numbers from {low} to {high}"
        )
    return np.array(cells)

"""A robot through a field of pillars that a cellular automaton has grown, as in BARN."""

from dataclasses import dataclass
from typing import ClassVar, final

import numpy as np

from ...framework.route_planner import RoutePlanner
from ...framework.values.arrays import BoolArray, positive
from ...framework.values.errors import WideberthError
from ...framework.values.path import Path
from ...framework.values.polygon import Polygon
from ...routes.walls import box
from .base import Cast, Placement, Scenario
from .furnished import Furnished

CELLS, SIDE = 30, 0.15
"""Cells along a side of the field; m, side of a cell."""
FILLS, SMOOTHINGS = (0.15, 0.20, 0.25, 0.30), (2, 3, 4)
"""Shares of cells that are filled at first, and numbers of smoothings: twelve kinds of fields."""
CROWDED, LONELY = 5, 1
"""Filled neighbours from which on a cell is filled, and up to which it is cleared."""
BEFORE, BEHIND = 2.0, 3.5
"""m from the start to the field, and from the field to the goal."""
AROUND = 1.5
"""m from start and goal to the walls behind them, which close the corridor of the field."""
_FINER = 3
"""Places along a cell at which it is asked whether the robot may pass."""
_DRAWS = 20_000
"""Fields that are drawn before the robot is said to be too large."""
ROOM = 0.02
"""m, least distance of the path from the field's cells beside the robot's radius."""
RESOLUTION = 0.05
"""m, of the map for the path."""


@final
@dataclass(frozen=True)
class CylinderField(Scenario):
    """A robot drives from (-2, 0) to (8, 0) through a field that fills a corridor 4.5 m wide.

    A cell of the field is filled with a probability. Then in each smoothing all cells change
    at once: one with at least 5 filled ones of 8 neighbours is filled, one with at most 1 is
    cleared. Both sides of the field are filled at first, and what lies beyond counts as filled.
    Fields without a route are drawn again. Seed k has the (k mod 12)-th kind of field, of 4
    probabilities and 3 numbers of smoothings.

    Parameters
    ----------
    routes : finds the path through the field; None for the straight line, which pillars block.
    robot_radius : m, of the robot that there is room for.
    reference_speed : m/s; the robot starts from a stand.

    Raises
    ------
    WideberthError : a number not above 0; when drawing, no field with a route.

    Notes
    -----
    The rules, the twelve kinds, the size of cells and field and the places of start and goal are
    those of BARN; its worlds themselves are not taken, and its cylinders of 0.075 m radius are
    squares here, so that filled cells next to each other are one rectangle. BARN cuts a way
    where there is none; here another field is drawn. Its robot is 0.51 m x 0.43 m.
    """

    reference: ClassVar[str] = "perille2020benchmarking"

    routes: RoutePlanner | None = None
    robot_radius: float = 0.25
    reference_speed: float = 0.5

    def __post_init__(self) -> None:
        for name in ("robot_radius", "reference_speed"):
            positive(f"cylinder_field.{name}", getattr(self, name))

    def cast(self, seed: int) -> Cast:
        """Draw fields until there is a route, and place the robot at its start."""
        rng = np.random.default_rng([seed, 7])
        fill = FILLS[seed // len(SMOOTHINGS) % len(FILLS)]
        smoothings = SMOOTHINGS[seed % len(SMOOTHINGS)]
        return self._drawn(rng, fill, smoothings)

    def build(self, rng: np.random.Generator) -> tuple[Placement, ...]:
        """Place the robot before a field of any kind."""
        return self._drawn(rng, float(rng.choice(FILLS)), int(rng.choice(SMOOTHINGS))).placements

    def _drawn(self, rng: np.random.Generator, fill: float, smoothings: int) -> Cast:
        straight = Path(np.array([[-BEFORE, 0.0], [CELLS * SIDE + BEHIND, 0.0]]))
        for _ in range(_DRAWS):
            cells = grown(rng, fill, smoothings)
            room = self.robot_radius + ROOM
            if not passable(cells, room):
                continue
            walls = (*corridor(), *rectangles(cells))
            path = self._path(walls, straight, room)
            if path is not None:
                one = Placement("robot", path, 0.0, reference_speed=self.reference_speed)
                return Cast((one,), polygons=walls)
        raise WideberthError(
            f"cylinder_field: in {_DRAWS} draws no field has a route for a robot of radius "
            f"{self.robot_radius:g} m; take a smaller one"
        )

    def _path(self, walls: tuple[Polygon, ...], straight: Path, room: float) -> Path | None:
        """Return the path among walls, if there is one."""
        if self.routes is None:
            return straight
        world = Furnished(walls=walls, room=room, resolution=RESOLUTION)
        costmap = world.costmap(straight.points)
        path = self.routes.plan(costmap, straight.points[0], straight.goal).path
        if path is None or costmap.blocked_steps(path.points).any():
            return None
        return path


def grown(rng: np.random.Generator, fill: float, smoothings: int) -> BoolArray:
    """Return which cells are filled; rows across the way, columns along it.

    Parameters
    ----------
    fill : probability that a cell is filled at first.
    smoothings : number of steps of the automaton.
    """
    cells = rng.random((CELLS, CELLS)) < fill
    cells[[0, -1]] = True
    for _ in range(smoothings):
        around = np.pad(np.pad(cells, ((1, 1), (0, 0)), constant_values=True), ((0, 0), (1, 1)))
        count = sum(
            np.roll(around, (i, j), (0, 1))[1:-1, 1:-1].astype(np.int64)
            for i in (-1, 0, 1)
            for j in (-1, 0, 1)
            if i or j
        )
        cells = (cells & (count > LONELY)) | (count >= CROWDED)
    return cells


def passable(cells: BoolArray, room: float) -> bool:
    """Tell whether a disc of radius ``room``, m, may pass the field; a route may need a bit more.

    Places are a third of a cell apart, and distances are to the nearest such place that is
    filled: they exceed those to the cells by less than that.
    """
    from scipy.ndimage import distance_transform_edt, label

    fine = np.repeat(np.repeat(cells, _FINER, axis=0), _FINER, axis=1)
    walled = np.pad(fine, ((1, 1), (0, 0)), constant_values=True)
    free = distance_transform_edt(~walled) * (SIDE / _FINER) > room
    regions, _ = label(free)
    return bool(np.intersect1d(regions[:, 0], regions[:, -1]).any())


def corridor() -> tuple[Polygon, ...]:
    """Return the four walls around start, field and goal."""
    left, right = -BEFORE - AROUND, CELLS * SIDE + BEHIND + AROUND
    high = 0.5 * CELLS * SIDE
    return (
        box((left - SIDE, high), (right + SIDE, high + SIDE), "left wall"),
        box((left - SIDE, -high - SIDE), (right + SIDE, -high), "right wall"),
        box((left - SIDE, -high), (left, high), "wall behind the start"),
        box((right, -high), (right + SIDE, high), "wall behind the goal"),
    )


def rectangles(cells: BoolArray) -> tuple[Polygon, ...]:
    """Return rectangles that cover the filled cells and nothing else, without overlap."""
    left = cells.copy()
    found: list[Polygon] = []
    for row, column in np.argwhere(cells):
        if not left[row, column]:
            continue
        end = column
        while end < CELLS and left[row, end]:
            end += 1
        last = row
        while last < CELLS and left[last, column:end].all():
            left[last, column:end] = False
            last += 1
        low, high = (SIDE * (float(at) - 0.5 * CELLS) for at in (row, last))
        name = f"pillar {len(found)}"
        near, far = SIDE * float(column), SIDE * float(end)
        found.append(box((near, low), (far, high), name))
    return tuple(found)

"""Whether a robot finds a way along its path."""

import numpy as np
import pytest

from wideberth import Path
from wideberth.framework.values.passage import passable
from wideberth.framework.values.polygon import Polygon
from wideberth.routes.walls import box

STRAIGHT = Path(np.array([(-4.0, 0.0), (4.0, 0.0)]))
OBLIQUE = Path(np.array([(-4.0, 0.8), (0.0, 0.0), (4.0, -0.8)]))


def door(width: float) -> tuple[Polygon, ...]:
    return box((-0.1, 0.5 * width), (0.1, 8.0)), box((-0.1, -8.0), (0.1, -0.5 * width))


@pytest.mark.parametrize("path", [STRAIGHT, OBLIQUE])
@pytest.mark.parametrize(("width", "fits"), [(0.72, True), (0.68, False)])
def test_a_door_is_passed_by_what_is_narrower(path: Path, width: float, fits: bool) -> None:
    assert passable(path, 0.0, path.length, 0.35, (), door(width)) is fits


@pytest.mark.parametrize(("aside", "fits"), [(0.0, False), (0.6, True)])
def test_a_person_in_a_corridor_leaves_room_on_one_side(aside: float, fits: bool) -> None:
    """The corridor is 2 m wide: beside a person of 0.6 m it leaves 0.7 m twice, or 1.3 m once."""
    walls = box((-9.0, 1.0), (9.0, 1.2)), box((-9.0, -1.2), (9.0, -1.0))
    discs = [(np.array([0.0, aside]), 0.3)]
    assert passable(STRAIGHT, 0.0, 8.0, 0.4, discs, walls) is fits


def test_a_wall_that_ends_beside_the_path_is_gone_round() -> None:
    wall = box((-0.1, -8.0), (0.1, 1.0))
    assert passable(STRAIGHT, 0.0, 8.0, 0.35, (), (wall,))
    assert not passable(STRAIGHT, 0.0, 8.0, 0.35, (), (box((-0.1, -8.0), (0.1, 4.0)),))

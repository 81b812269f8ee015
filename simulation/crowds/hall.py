"""The hallways of CrowdSimPlus: walls, doors, and how people are placed in them."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Literal, TypeAlias, final

import numpy as np

from ...framework.values.arrays import Array
from ...framework.values.errors import WideberthError
from ...framework.values.polygon import Polygon

Layout: TypeAlias = Literal["open", "static", "static_with_back", "bottleneck", "squeeze"]
Corners: TypeAlias = list[tuple[float, float]]

OUTSIDE = 0.2
"""m of wall behind its surface."""
THIN = 0.02
"""m, thickness of the walls that have none there and are met from both sides."""
MIDDLE = 0.4, 0.6
"""Where a static door begins and ends to be at its narrowest, as shares of its length."""
SLANT = 0.75
"""Where its slanted sides begin, as a share of the way from its edge to the wall."""
SQUEEZE = 2.5
"""Half the length of the squeezing walls over the circle's radius."""


@final
@dataclass(frozen=True)
class Hall:
    """A hallway along the y axis, with its middle in the origin.

    - ``open``: two walls.
    - ``static``: and a block on either side of the middle, which leave a door with slanted
      jambs from y = -length to y = length.
    - ``static_with_back``: and a wall across at either end, y = -height / 2 and y = height / 2.
    - ``bottleneck``: the two walls, and a thin one across with a door in it at y = 0.
    - ``squeeze``: two walls that come nearer up to a door at y = 0, and go apart again.

    Parameters
    ----------
    layout : which of them.
    width, height : m; the straight walls go from -height to height.
    door : m, width of the door.
    length : m, half the length of a static door.
    circle_radius : m, which the squeezing walls' length hangs on.
    """

    layout: Layout
    width: float
    height: float
    door: float
    length: float
    circle_radius: float

    def polygons(self) -> tuple[Polygon, ...]:
        """Return the walls as bodies."""
        side, end, edge = 0.5 * self.width, self.height, 0.5 * self.door
        out = side + OUTSIDE
        if self.layout == "squeeze":
            far = SQUEEZE * self.circle_radius
            return _both([(side, -far), (out, -far), (out, far), (side, far), (edge, 0.0)], "wall")
        walls = _both([(side, -end), (out, -end), (out, end), (side, end)], "wall")
        if self.layout == "bottleneck":
            half = 0.5 * THIN
            return walls + _both(
                [(edge, -half), (side, -half), (side, half), (edge, half)], "jamb"
            )
        if self.layout in ("static", "static_with_back"):
            walls += _both(self._block(), "block")
        if self.layout == "static_with_back":
            back = 0.5 * self.height
            for name, low, high in (
                ("back above", back, back + THIN), ("back below", -back - THIN, -back),
            ):  # fmt: skip
                corners = ((-side, low), (side, low), (side, high), (-side, high))
                walls += (Polygon(corners, name),)
        return walls

    def lines(self) -> Array:
        """Return the segments that CrowdSimPlus has, (L, 2, 2), m, in its order and direction."""
        side, end, edge = 0.5 * self.width, self.height, 0.5 * self.door
        if self.layout == "squeeze":
            far = SQUEEZE * self.circle_radius
            right: Corners = [(side, -far), (edge, 0.0), (side, far)]
            return _segments([_mirrored(right), right])
        chains: list[Corners] = [[(k * side, -end), (k * side, end)] for k in (-1.0, 1.0)]
        if self.layout == "bottleneck":
            chains += [[(-side, 0.0), (-edge, 0.0)], [(edge, 0.0), (side, 0.0)]]
        elif self.layout != "open":
            chains += [_mirrored(self._block()), self._block()]
        if self.layout == "static_with_back":
            back = 0.5 * self.height
            chains += [[(-side, y), (side, y)] for y in (-back, back)]
        return _segments(chains)

    def head(self, place: Array, goal: Array) -> Array:
        """Return what a person heads for, (2,), m: the goal, or the middle of the door before."""
        return np.zeros(2) if self.through(place, goal) else goal

    def through(self, place: Array, goal: Array) -> bool:
        """Whether a person on the way to a goal heads for the middle of the door.

        A person whose way leads through the door does, until half its width away from its
        middle; in the open and the squeezing hallway no one does.
        """
        if self.layout in ("open", "squeeze"):
            return False
        narrow = self.length * (MIDDLE[1] - MIDDLE[0])
        below, above = sorted((float(place[1]), float(goal[1])))
        return below < -narrow and above > narrow and float(np.hypot(*place)) > 0.5 * self.door

    def _block(self) -> Corners:
        """Corners of the block on the right, from its lower end on the wall to its upper."""
        side, edge = 0.5 * self.width, 0.5 * self.door
        slant = edge + SLANT * (side - edge)
        narrow = self.length * (MIDDLE[1] - MIDDLE[0])
        return [
            (side, -self.length), (slant, -self.length), (edge, -narrow), (edge, narrow),
            (slant, self.length), (side, self.length),
        ]  # fmt: skip


def _mirrored(corners: Corners) -> Corners:
    return [(-x, y) for x, y in corners]


def _both(corners: Corners, name: str) -> tuple[Polygon, ...]:
    """Return a polygon on the right and its mirror image on the left."""
    return (
        Polygon(tuple(corners), f"{name} right"),
        Polygon(tuple(_mirrored(corners)), f"{name} left"),
    )


def _segments(chains: list[Corners]) -> Array:
    """Segments between neighbours of each chain, (L, 2, 2)."""
    return np.array([pair for chain in chains for pair in pairwise(chain)])


CASES = 1000
"""Added to the seed: there the test cases follow 1000 validation cases."""
DOWN, RIGHT, CROSSES = 0.15, 0.8, 0.3
"""Chances that a person walks down, walks on the right, and crosses over."""
DISCOMFORT = 0.2
"""m between a person and the robot, at first."""
STRETCH = 1.1
"""Factor of the drawn heights after each place that was not free."""
DRAWS = 1000
"""Tries to place one person; the original has no limit."""


@final
@dataclass(frozen=True)
class PeopleDraws:
    """How CrowdSimPlus draws people's ways, one person after the other.

    Each failed attempt draws everything again, from a range of y that is `STRETCH` times as
    high. A start keeps clear of the other starts; a goal keeps clear of the robot's goal and
    of what the people before head for, which is the door's middle for those who pass it
    (`Hall.head`; the robot heads for its goal). Both keep clear of the walls.

    Parameters
    ----------
    hall : its walls.
    person_radius, robot_radius : m.
    speeds : m/s, between which the preferred speed of each is drawn, anew in every attempt; None
        where it is not drawn.
    """

    hall: Hall
    person_radius: float
    robot_radius: float
    speeds: tuple[float, float] | None = None

    @staticmethod
    def generator(case: int) -> np.random.Generator:
        """Return the generator of a test case, from 0, in its first state."""
        return np.random.default_rng(CASES + case)

    def ways(
        self, rng: np.random.Generator, persons: int
    ) -> list[tuple[float | None, Array, Array]]:
        """Draw preferred speed, m/s, start and goal, (2,) each, m, of each person.

        Raises
        ------
        WideberthError : no room in `DRAWS` attempts.
        """
        reach = self.hall.circle_radius
        starts, heads = [np.array([0.0, -reach])], [np.array([0.0, reach])]
        found: list[tuple[float | None, Array, Array]] = []
        for _ in range(persons):
            speed, start, goal = self._way(rng, starts, heads, persons)
            starts.append(start)
            heads.append(self.hall.head(start, goal))
            found.append((speed, start, goal))
        return found

    def _way(
        self, rng: np.random.Generator, starts: list[Array], heads: list[Array], persons: int
    ) -> tuple[float | None, Array, Array]:
        """Draw one person, who keeps clear of those starts, and of where those head for."""
        size = 2.0 * self.person_radius
        lines, height = self.hall.lines(), self.hall.height
        radii = np.array([self.robot_radius] + [self.person_radius] * (len(starts) - 1))
        apart = self.person_radius + radii
        around = np.concatenate([apart[:1] + DISCOMFORT, apart[1:]])
        for _ in range(DRAWS):
            speed = None if self.speeds is None else float(rng.uniform(*self.speeds))
            down = 1.0 if rng.random() < DOWN else -1.0
            left = RIGHT if down > 0.0 else 1.0 - RIGHT  # chance to start at x < 0
            side = -1.0 if rng.random() < left else 1.0
            crosses = 1.0 - CROSSES if rng.random() < left else CROSSES
            other = -side if rng.random() < crosses else side
            scale = np.array(
                [0.5 * (self.hall.width - size), self.hall.circle_radius * (height - size)]
            )
            start = rng.random(2) * scale * np.array([side, 0.25 * down])
            height *= STRETCH
            if not _free(start, starts, around, lines, self.person_radius + 0.01):
                continue
            goal = rng.random(2) * scale * np.array([other, -0.5 * down])
            if _free(goal, heads, apart, lines, self.person_radius):
                return speed, start, goal
        raise WideberthError(
            f"in {DRAWS} draws there was no room in the hallway for person {len(starts)} of "
            f"{persons}; take fewer people, or a wider hallway"
        )


def nearest(place: Array, lines: Array) -> Array:
    """Return the nearest points of segments (L, 2, 2) to a place (2,), (L, 2), m."""
    begin, step = lines[:, 0], lines[:, 1] - lines[:, 0]
    share = np.einsum("ld,ld->l", place - begin, step) / np.einsum("ld,ld->l", step, step)
    return np.asarray(begin + np.clip(share, 0.0, 1.0)[:, None] * step)


def _free(place: Array, others: Sequence[Array], least: Array, lines: Array, wall: float) -> bool:
    """Whether a place keeps these distances from others (O,) and from segments (L, 2, 2), m."""
    if (np.linalg.norm(np.array(others) - place, axis=1) < least).any():
        return False
    return bool(np.linalg.norm(nearest(place, lines) - place, axis=1).min() >= wall)

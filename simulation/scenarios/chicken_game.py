"""The paper's first scenario: two robots head-on, each on the other's way."""

from dataclasses import dataclass
from typing import final

import numpy as np

from ...framework.values.path import Path
from .base import PHASE, Placement, Range, Scenario, checked_range, draw_value

LAG = (-2.0, 2.0)
"""s, range of l; negative where the right one is ahead."""
SPEED = 0.5
"""m/s, reference speed and speed at time 0."""


@final
@dataclass(frozen=True)
class ChickenGame(Scenario):
    """Two robots drive towards each other on (nearly) the same line.

    With distance d, lateral offset o, side c (+1 or -1), lag l and speed v::

        left    starts at (-d/2 + l v / 2,  c o/2),  drives to ( d/2,  c o/2)
        right   starts at ( d/2 + l v / 2, -c o/2),  drives to (-d/2, -c o/2)

    so that they are d apart at time 0 (along x), and undisturbed the left one passes the
    middle l seconds before the right one.

    Parameters
    ----------
    distance : m, range of d.
    offset : m, range of o; which side is drawn with equal chances.

    Raises
    ------
    WideberthError : a range that is not ordered or out of bounds.

    Notes
    -----
    The paper (section V) shows such an encounter without its start positions; these ranges
    are ours. Its reference speed is 0.5 m/s. Its paths come from NavFn, Nav2's path planner on a
    grid; these are straight lines.
    """

    distance: Range = (12.0, 20.0)
    offset: Range = (0.0, 0.5)

    def __post_init__(self) -> None:
        checked_range("chicken_game.distance", self.distance, 0.1)
        checked_range("chicken_game.offset", self.offset, 0.0)

    def build(self, rng: np.random.Generator) -> tuple[Placement, ...]:
        """Draw distance, offset, side, lag and the two phases."""
        half = 0.5 * draw_value(rng, self.distance)
        aside = 0.5 * draw_value(rng, self.offset) * (1.0 if rng.random() < 0.5 else -1.0)
        shift = 0.5 * SPEED * draw_value(rng, LAG)
        phases = (draw_value(rng, PHASE), draw_value(rng, PHASE))
        left = Path(np.array([[shift - half, aside], [half, aside]]))
        right = Path(np.array([[shift + half, -aside], [-half, -aside]]))
        return (
            Placement("left", left, SPEED, phases[0]),
            Placement("right", right, SPEED, phases[1]),
        )

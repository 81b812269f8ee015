"""The paper's second scenario: two robots whose paths cross."""

from dataclasses import dataclass
from typing import final

import numpy as np

from ...framework.values.path import Path
from .base import PHASE, Placement, Scenario, draw_value

DISTANCE = (12.0, 20.0)
"""m, range of d."""
LAG = (-2.0, 2.0)
"""s, range of l; negative where the upper one is ahead."""
SPEED = 0.5
"""m/s, reference speed and speed at time 0."""


@final
@dataclass(frozen=True)
class Crossing(Scenario):
    """Two paths that cross at a right angle, in the origin.

    With start distance d, lag l and speed v the starts lie e1 and e2 before the crossing::

        e1^2 + e2^2 = d^2,    e2 - e1 = l v

        lower   from (0, -e1) to (0, d / sqrt 2)
        upper   from (e2, 0) to (-d / sqrt 2, 0)

    so that they are d apart at time 0, and undisturbed the lower one reaches the crossing
    l seconds before the upper one.

    Notes
    -----
    The paper (section V) shows a crossing without its start positions; the right angle and
    these ranges are ours. Its reference speed is 0.5 m/s. Its paths come from NavFn, Nav2's path
    planner on a grid; these are straight lines.
    """

    def build(self, rng: np.random.Generator) -> tuple[Placement, ...]:
        """Draw distance, lag and the two phases."""
        distance = draw_value(rng, DISTANCE)
        behind = SPEED * draw_value(rng, LAG)
        phases = (draw_value(rng, PHASE), draw_value(rng, PHASE))
        beyond = distance / np.sqrt(2.0)
        middle = np.sqrt(0.5 * distance**2 - 0.25 * behind**2)
        lower = Path(np.array([[0.0, 0.5 * behind - middle], [0.0, beyond]]))
        upper = Path(np.array([[middle + 0.5 * behind, 0.0], [-beyond, 0.0]]))
        return (
            Placement("lower", lower, SPEED, phases[0]),
            Placement("upper", upper, SPEED, phases[1]),
        )

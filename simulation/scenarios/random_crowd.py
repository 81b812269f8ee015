"""A robot through a random crowd of a given density."""

from dataclasses import dataclass
from typing import final

import numpy as np

from ...framework.values.arrays import Array, positive, whole
from ...framework.values.path import Path
from ..engine.agents import RobotAgent
from .base import PHASE, Placement, Scenario, draw_value
from .crowd_mix import mix_of
from .placing import apart, draw_place

SPACE = 0.1
"""m between people at time 0."""
ROBOT_SPACE = 0.5
"""m between people and the robot at time 0."""
LEGS = 8
"""Goals of each person, one after the other, so that no one has arrived before the robot: the
fastest by the shortest legs need 1.3 times the robot's longest free time, at its usual speed."""
EQUAL_SHARES: dict[str, dict[str, float]] = {
    "orca": {"period": 0.25, "look_ahead": 1.0},
    "social_force": {"period": 0.25},
    "constant_velocity": {"period": 0.25, "look_ahead": 1.0},
}
"""The benchmark's mixture; ``look_ahead`` has ORCA and the blind ones go from goal to goal, who
would head straight for the last one."""
MEAN_SPEED, SPEED_DEVIATION = 1.34, 0.26
"""m/s, of the normal distribution of people's speeds."""
PERSON_SPEED = (0.82, 1.86)
"""m/s; a drawn speed beyond its ends is moved to the end."""
PERSON_RADIUS = (0.2, 0.3)
"""m, range of people's radii."""
ASIDE = (-0.25, 0.25)
"""Range of y1 and y2 as shares of a; each drawn."""
SPEED = 0.7
"""m/s, of the robot at time 0, and its reference speed."""


@final
@dataclass(frozen=True, eq=False)
class RandomCrowd(Scenario):
    """n people walk about in a square of side a = sqrt(n / density); a robot drives through it.

    The robot drives from (-a / 2, y1) to (a / 2, y2). Each person starts anywhere in the square
    and walks from one drawn goal to the next, each at least a / 2 from the one before. Speeds
    are normal, cut off at the ends of a range, radii uniform.

    Parameters
    ----------
    persons : n; the benchmark's are 5, 10, 15, 20 and 30.
    density : people per m^2; the benchmark's are 0.05 to 0.3.
    robot_radius : m, of the robot that there is room for.

    Raises
    ------
    WideberthError : a number out of range; when drawing, more people than there is room for.

    Notes
    -----
    n, density, mixture, N(1.34, 0.26) and 0.2 to 0.3 m are the benchmark's. Where it cuts the
    speeds off is not said (two deviations here), nor the goals (these are ours).
    """

    persons: int = 10
    density: float = 0.1
    robot_radius: float = 0.3

    def __post_init__(self) -> None:
        whole("random_crowd.persons", self.persons, least=0)
        for name in ("density", "robot_radius"):
            positive(f"random_crowd.{name}", getattr(self, name))

    @property
    def side(self) -> float:
        """Length of the square's side a, m; that of one person where there is no one."""
        return float(np.sqrt(max(self.persons, 1) / self.density))

    def build(self, rng: np.random.Generator) -> tuple[Placement, ...]:
        """Draw start, goal and phase."""
        half = 0.5 * self.side
        first, second = (self.side * draw_value(rng, ASIDE) for _ in range(2))
        way = Path(np.array([[-half, first], [half, second]]))
        phase = draw_value(rng, PHASE)
        return (Placement("robot", way, SPEED, phase),)

    def people(
        self, rng: np.random.Generator, placements: tuple[Placement, ...]
    ) -> tuple[RobotAgent, ...]:
        """Draw the crowd, one after the other."""
        crowd = mix_of(EQUAL_SHARES)
        taken = [(placements[0].path.points[0], self.robot_radius + ROBOT_SPACE - SPACE)]
        found = []
        for k in range(self.persons):
            radius = draw_value(rng, PERSON_RADIUS)
            speed = float(np.clip(rng.normal(MEAN_SPEED, SPEED_DEVIATION), *PERSON_SPEED))
            start = self._free_place(rng, radius, taken, k)
            taken.append((start, radius))
            way = Path(np.stack([start, *self._goals(rng, start)]))
            found.append(crowd.person(rng, f"person {k + 1}", way, speed, radius))
        return tuple(found)

    def _free_place(
        self, rng: np.random.Generator, radius: float, taken: list[tuple[Array, float]], k: int
    ) -> Array:
        """Draw a place that no one occupies."""
        return draw_place(
            lambda: self._place(rng),
            lambda place: apart(place, radius, taken, SPACE),
            f"person {k + 1} of {self.persons} in a square of {self.side:.3g} m; take a lower "
            "density, or smaller people",
        )

    def _goals(self, rng: np.random.Generator, start: Array) -> list[Array]:
        """Draw the goals of one person."""
        goals = [start]
        for _ in range(LEGS):
            goals.append(
                draw_place(
                    lambda: self._place(rng),
                    lambda place: float(np.hypot(*(place - goals[-1]))) >= 0.5 * self.side,
                    "a goal",
                )
            )
        return goals[1:]

    def _place(self, rng: np.random.Generator) -> Array:
        """Draw a place in the square, (2,), m."""
        return np.asarray(self.side * (rng.random(2) - 0.5))

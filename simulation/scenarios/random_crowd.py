"""A robot through a random crowd of a given density."""

from dataclasses import dataclass
from typing import final

import numpy as np

from ...framework.values.arrays import Array, positive, whole
from ...framework.values.path import Path
from ..engine.agents import RobotAgent
from .base import Placement, Range, Scenario, checked_range, draw
from .crowd_mix import CrowdMix, mix_of
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
    mean_speed, speed_deviation : m/s, of the normal distribution.
    person_speed : m/s; a drawn speed beyond its ends is moved to the end.
    person_radius : m, range.
    robot_radius : m, of the robot that there is room for.
    aside : range of y1 and y2 as shares of a; each drawn.
    crowd : who the people are; None for ORCA, social force and constant velocity in equal
        shares, which needs the library of ORCA. Who has an infinite ``look_ahead`` heads straight
        for the last goal: give ORCA and constant velocity a finite one.
    phase : range of the phase offset, as a share of the control period, in [0, 1).
    speed : m/s, of the robot at time 0, and its reference speed.
    visible : whether the people make way for the robot.

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
    mean_speed: float = 1.34
    speed_deviation: float = 0.26
    person_speed: Range = (0.82, 1.86)
    person_radius: Range = (0.2, 0.3)
    robot_radius: float = 0.3
    aside: Range = (-0.25, 0.25)
    crowd: CrowdMix | None = None
    phase: Range = (0.0, 0.99)
    speed: float = 0.7
    visible: bool = True

    def __post_init__(self) -> None:
        whole("random_crowd.persons", self.persons, least=0)
        for name in ("density", "mean_speed", "robot_radius", "speed"):
            positive(f"random_crowd.{name}", getattr(self, name))
        positive("random_crowd.speed_deviation", self.speed_deviation, zero=True)
        checked_range("random_crowd.person_speed", self.person_speed, 1e-3)
        checked_range("random_crowd.person_radius", self.person_radius, 1e-3)
        checked_range("random_crowd.aside", self.aside, -0.5, 0.5)
        checked_range("random_crowd.phase", self.phase, 0.0, 1.0 - 1e-9)

    @property
    def side(self) -> float:
        """Length of the square's side a, m; that of one person where there is no one."""
        return float(np.sqrt(max(self.persons, 1) / self.density))

    def build(self, rng: np.random.Generator) -> tuple[Placement, ...]:
        """Draw start, goal and phase."""
        half = 0.5 * self.side
        first, second = (self.side * draw(rng, self.aside) for _ in range(2))
        way = Path(np.array([[-half, first], [half, second]]))
        phase = draw(rng, self.phase)
        return (Placement("robot", way, self.speed, phase, self.visible),)

    def people(
        self, rng: np.random.Generator, placements: tuple[Placement, ...]
    ) -> tuple[RobotAgent, ...]:
        """Draw the crowd, one after the other."""
        crowd = mix_of(EQUAL_SHARES) if self.crowd is None else self.crowd
        taken = [(placements[0].path.points[0], self.robot_radius + ROBOT_SPACE - SPACE)]
        found = []
        for k in range(self.persons):
            radius = draw(rng, self.person_radius)
            speed = float(
                np.clip(rng.normal(self.mean_speed, self.speed_deviation), *self.person_speed)
            )
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

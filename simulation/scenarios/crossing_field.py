"""One robot crosses a field of walkers whose motion is as uncertain as a Kalman filter assumes."""

from dataclasses import dataclass
from typing import final

import numpy as np

from ...framework.values.arrays import Array, positive, whole
from ...framework.values.errors import WideberthError
from ...framework.values.path import Path
from ...metrics.episode import approach
from ..engine.agents import ReplayAgent
from .base import PHASE, Placement, Scenario, draw_value

ROOM = 0.3
"""m between surfaces that walkers leave to each other, and to the robot at first."""
CALM = 4.0
"""s after time 0 during which they leave that much to the robot where it stood."""
DRAWS = 200
"""Tries to place a walker before the ranges are said to leave no room."""
SPAN = (-60.0, 200.0)
"""s, from when to when walkers are there, longer where the robot's way takes longer."""
SAMPLE_TIME = 0.2
"""s between the instants at which their ways are drawn; straight in between."""
WALKER_SPEED = (0.3, 0.7)
"""m/s, range of the mean speeds."""
SHARE = (0.25, 0.9)
"""Range of the share of the way at which a walker is met."""
ASIDE = (-1.5, 1.5)
"""m, range of how far beside the robot it passes undisturbed."""
ACCELERATION_DENSITY = 0.01
"""m^2/s^3, q per axis."""
TIME_CONSTANT = 5.0
"""s, tau."""


@final
@dataclass(frozen=True)
class CrossingField(Scenario):
    """A robot drives from (-reach, 0) to (reach, 0); walkers cross its way and make none.

    Each walker is aimed at a place of the robot's way, at the time at which an undisturbed robot
    is there. Its velocity is a mean of random direction and speed, and about it white
    acceleration of density q with a pull back to the mean (an Ornstein-Uhlenbeck process)::

        dv = -(v - mean) / tau dt + sqrt(q) dW,     var(v) = q tau / 2 per axis

    Over times short against tau that is the motion which the Kalman predictor with the
    acceleration density q assumes, so that its forecasts are honest, and their regions grow
    as they have to. One that comes too near to another, or to the robot where it stands at
    first, is drawn again.

    Parameters
    ----------
    walkers : number of them.
    reach : m.
    speed : m/s, of the robot at time 0, and its reference speed.
    walker_radius : m.

    Raises
    ------
    WideberthError : a range that is not ordered or out of bounds; when drawing, no room.
    """

    walkers: int = 8
    reach: float = 10.0
    speed: float = 0.5
    walker_radius: float = 0.4

    def __post_init__(self) -> None:
        whole("crossing_field.walkers", self.walkers)
        for name in ("speed", "walker_radius"):
            positive(f"crossing_field.{name}", getattr(self, name))
        positive("crossing_field.reach", self.reach - ASIDE[1])

    def build(self, rng: np.random.Generator) -> tuple[Placement, ...]:
        """Draw the phase; the way is the same for every seed."""
        way = Path(np.array([[-self.reach, 0.0], [self.reach, 0.0]]))
        return (Placement("robot", way, self.speed, draw_value(rng, PHASE)),)

    def bystanders(
        self, rng: np.random.Generator, placements: tuple[Placement, ...]
    ) -> tuple[ReplayAgent, ...]:
        """Draw the walkers, one after the other, with room between them."""
        last = max(SPAN[1], 2.0 * self.reach / self.speed)
        times = np.arange(SPAN[0], last + SAMPLE_TIME, SAMPLE_TIME)
        robot = placements[0].path.at(self.speed * np.clip(times, 0.0, CALM))
        first = times <= CALM
        room = 2.0 * self.walker_radius + ROOM
        kept: list[Array] = []
        for k in range(self.walkers):
            for _ in range(DRAWS):
                way = self._way(rng, times)
                near = approach(way[first], robot[first]).min() < room + self.walker_radius
                if not near and all(approach(way, other).min() >= room for other in kept):
                    kept.append(way)
                    break
            else:
                raise WideberthError(
                    f"in {DRAWS} draws there was no room for walker {k + 1}; take fewer walkers "
                    "or a longer reach"
                )
        return tuple(
            ReplayAgent(f"walker {k + 1}", times, way, self.walker_radius)
            for k, way in enumerate(kept)
        )

    def _way(self, rng: np.random.Generator, times: Array) -> Array:
        """Draw the way of one walker, (T, 2), m."""
        share, angle = draw_value(rng, SHARE), draw_value(rng, (-np.pi, np.pi))
        ahead = np.array([np.cos(angle), np.sin(angle)])
        place = np.array([(2.0 * share - 1.0) * self.reach, 0.0])
        place += draw_value(rng, ASIDE) * np.array([-ahead[1], ahead[0]])
        velocity = draw_value(rng, WALKER_SPEED) * ahead + self._sway(rng, len(times))
        way = np.concatenate([np.zeros((1, 2)), np.cumsum(SAMPLE_TIME * velocity[:-1], axis=0)])
        met = int(np.searchsorted(times, 2.0 * share * self.reach / self.speed))
        return np.asarray(way - way[met] + place)

    def _sway(self, rng: np.random.Generator, count: int) -> Array:
        """Draw the stationary process about the mean velocity, exact at the steps, (T, 2), m/s."""
        keep = float(np.exp(-SAMPLE_TIME / TIME_CONSTANT))
        deviation = np.sqrt(0.5 * ACCELERATION_DENSITY * TIME_CONSTANT)
        sway: Array = deviation * rng.standard_normal((count, 2))
        sway[1:] *= np.sqrt(1.0 - keep**2)
        for i in range(1, count):
            sway[i] += keep * sway[i - 1]
        return sway

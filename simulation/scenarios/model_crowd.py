"""A robot among walkers that move exactly as a stated stochastic model says."""

from dataclasses import dataclass, field
from typing import final

import numpy as np

from ...framework.values.arrays import Array, positive
from ...framework.values.path import Path
from ..engine.agents import ReplayAgent
from .base import Placement, Scenario
from .placing import draw_place

AFTER = 60.0
"""s after time 0 for which walkers are there."""


@final
@dataclass(frozen=True)
class WhiteAcceleration:
    """A velocity that drifts under white acceleration: the model of the Kalman predictor.

    (p, v)_{k+1} = F (p, v)_k + w,   w ~ N(0, Q),   v_0 ~ N(0, speed^2 I)

    with F and Q of one step exactly, Q = q [[dT^3/3, dT^2/2], [dT^2/2, dT]] per axis.

    Parameters
    ----------
    acceleration_density : q, m^2/s^3.
    speed : m/s per axis, standard deviation at the first instant.
    """

    acceleration_density: float = 0.02
    speed: float = 0.4

    def __post_init__(self) -> None:
        positive("white_acceleration.acceleration_density", self.acceleration_density)
        positive("white_acceleration.speed", self.speed)

    def walk(self, rng: np.random.Generator, count: int, dt: float) -> Array:
        """Draw positions at ``count`` instants, relative to the first one, (count, 2), m."""
        square = np.array([[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]])
        root = np.linalg.cholesky(self.acceleration_density * square)
        shocks = rng.standard_normal((count - 1, 2, 2)) @ root.T  # (step, axis, p or v)
        start = self.speed * rng.standard_normal((1, 2))
        velocity = start + np.concatenate([np.zeros((1, 2)), np.cumsum(shocks[..., 1], axis=0)])
        moved = dt * velocity[:-1] + shocks[..., 0]
        return np.concatenate([np.zeros((1, 2)), np.cumsum(moved, axis=0)])


BEFORE = 10.0
"""s before time 0 at which the motion begins."""
WALKERS = 3
"""Number of walkers."""
REACH = 6.0
"""m, length of the robot's way."""
ASIDE = 2.0
"""m beside the way up to which walkers begin."""
ROOM = 1.2
"""m about the robot's start in which no walker is placed."""
WALKER_RADIUS = 0.3
"""m, of a walker."""
SPEED = 0.6
"""m/s, of the robot at time 0, and its reference speed."""


@final
@dataclass(frozen=True)
class ModelCrowd(Scenario):
    """A robot drives from (0, 0) to (6, 0); walkers about its way follow one model exactly.

    A walker's motion and its place at time 0 are drawn independently, the place uniformly over
    [0, 6] x [-2, 2] but for `ROOM` about the robot's start. So the robot's
    place says nothing about how a walker moves, and a predictor that assumes the model knows all
    that can be known: its forecasts are calibrated, given what was seen. (A walker aimed at the
    robot would not do: its aim would say more than its past.) Walkers pass through each other, and
    through the robot.

    Parameters
    ----------
    motion : the model.
    dt : s, step of the model; between its instants walkers go straight.

    Raises
    ------
    WideberthError : a number out of range; when drawing, no place outside `ROOM`.
    """

    motion: WhiteAcceleration = field(default_factory=WhiteAcceleration)
    dt: float = 0.5

    def __post_init__(self) -> None:
        positive("model_crowd.dt", self.dt)

    def build(self, rng: np.random.Generator) -> tuple[Placement, ...]:
        """Return the robot; its way is the same for every seed."""
        return (Placement("robot", Path(np.array([[0.0, 0.0], [REACH, 0.0]])), SPEED),)

    def bystanders(
        self, rng: np.random.Generator, placements: tuple[Placement, ...]
    ) -> tuple[ReplayAgent, ...]:
        """Draw each walker's place at time 0 and its motion."""
        begin = int(np.ceil(BEFORE / self.dt - 1e-9))
        times = self.dt * np.arange(-begin, int(AFTER / self.dt) + 1, dtype=np.float64)
        low, high = np.array([0.0, -ASIDE]), np.array([REACH, ASIDE])
        found = []
        for k in range(WALKERS):
            place = draw_place(
                lambda: rng.uniform(low, high),
                lambda at: float(np.hypot(*at)) >= ROOM,
                f"walker {k + 1}; take less room or a longer reach",
            )
            way = self.motion.walk(rng, len(times), self.dt)
            way += place - way[begin]
            found.append(ReplayAgent(f"walker {k + 1}", times, way, WALKER_RADIUS))
        return tuple(found)

"""Rewards of the decisions of a learned policy."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar, TypeAlias, final

from ...framework.values.arrays import positive


@dataclass(frozen=True)
class Transition:
    """The interval between two decisions of a robot.

    Attributes
    ----------
    duration : s.
    clearance : m, smallest distance between the surfaces of the robot and anybody else who
        moves, exact between the instants too; inf without anybody.
    wall_clearance : m, the same to what stands still.
    advance : m, by how much the straight distance to the goal shrank.
    reached : whether the robot was at its goal at the end.
    collided : whether it touched anybody or anything.
    """

    duration: float
    clearance: float
    wall_clearance: float
    advance: float
    reached: bool
    collided: bool


Reward: TypeAlias = Callable[[Transition], float]


@final
@dataclass(frozen=True)
class CrowdNavReward:
    """The reward of CrowdNav: of arriving, of touching, and of coming too near.

    ::

        collision -0.25,   else goal 1,   else d < 0.2:  0.5 (d - 0.2) dt,   else 0

    with d the clearance, m, and dt the duration, s.

    Attributes
    ----------
    goal, collision : once, at the end.
    room : m, below which a clearance is too small.
    price : 1/(m s).

    References
    ----------
    C. Chen et al., "Crowd-Robot Interaction: Crowd-Aware Robot Navigation With Attention-Based
    Deep Reinforcement Learning", ICRA 2019.
    """

    goal: float = 1.0
    collision: float = -0.25
    room: float = 0.2
    price: float = 0.5

    reference: ClassVar[str] = "chen2019crowd"

    def __post_init__(self) -> None:
        positive("reward.room", self.room, zero=True)
        positive("reward.price", self.price, zero=True)

    def __call__(self, transition: Transition) -> float:
        """Reward of one transition."""
        if transition.collided:
            return self.collision
        if transition.reached:
            return self.goal
        too_near = min(transition.clearance - self.room, 0.0)
        return self.price * too_near * transition.duration

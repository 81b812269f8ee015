"""Another scenario, in which only some of the people see the robot."""

from dataclasses import dataclass, field, replace
from pathlib import Path as File
from typing import Any, final

import numpy as np

from ...framework.values.arrays import probability
from ...framework.values.errors import WideberthError
from ...framework.values.polygon import Polygon
from ..engine.agents import Bystander, RobotAgent
from ..log.episode_log import Episode
from .base import Cast, Placement, Scenario
from .hallway import Hallway

STREAM = 11
"""Of the generator that draws who is courteous, beside those of `Scenario.cast`."""


@final
@dataclass(frozen=True)
class PartlyCourteous(Scenario):
    """The situations of another scenario; each person sees the robot with a given probability.

    Who does not see it walks as if it were not there. With one seed everybody who is courteous at
    a small share is so at a larger one, and starts, goals and kinds are the same, so that episodes
    can be compared in pairs over the shares. Kinds that avoid nobody, such as
    ``constant_velocity``, make no way even if they see the robot.

    Parameters
    ----------
    scenario : draws everything else.
    share : probability that a person sees the robot.

    Raises
    ------
    WideberthError : a share outside [0, 1]; when drawing, a scenario whose people move by rules of
        their own.
    """

    scenario: Scenario = field(default_factory=Hallway)
    share: float = 0.5
    robot_radius: float = field(init=False)

    def __post_init__(self) -> None:
        probability("partly_courteous.share", self.share, closed=True)
        object.__setattr__(self, "robot_radius", self.scenario.robot_radius)

    def cast(self, seed: int) -> Cast:
        """Draw the other scenario's situation, then who sees the robot."""
        cast = self.scenario.cast(seed)
        if cast.rules is not None:
            raise WideberthError(
                f"partly_courteous: the people of {type(self.scenario).__name__} move by rules of "
                "their own, which decide whom they see; take another scenario, such as "
                "random_crowd"
            )
        drawn = np.random.default_rng([seed, STREAM]).random(len(cast.people))
        courteous = (drawn < self.share).tolist()
        people = [
            replace(one, courteous=own) for one, own in zip(cast.people, courteous, strict=True)
        ]
        return replace(cast, people=tuple(people))

    def build(self, rng: np.random.Generator) -> tuple[Placement, ...]:
        """Draw the other scenario's robots."""
        return self.scenario.build(rng)

    def people(
        self, rng: np.random.Generator, placements: tuple[Placement, ...]
    ) -> tuple[RobotAgent, ...]:
        """Draw the other scenario's people; `cast` draws who of them is courteous."""
        return self.scenario.people(rng, placements)

    def bystanders(
        self, rng: np.random.Generator, placements: tuple[Placement, ...]
    ) -> tuple[Bystander, ...]:
        """Draw the other scenario's bystanders."""
        return self.scenario.bystanders(rng, placements)

    def polygons(self, rng: np.random.Generator) -> tuple[Polygon, ...]:
        """Draw the other scenario's static obstacles."""
        return self.scenario.polygons(rng)

    def inputs(self) -> tuple[File, ...]:
        """Return the files of the other scenario."""
        return self.scenario.inputs()

    def judge(self, episode: Episode) -> dict[str, Any]:
        """Judge as the other scenario does."""
        return self.scenario.judge(episode)

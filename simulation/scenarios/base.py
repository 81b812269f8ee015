"""The Scenario interface: starts and goals of all agents, drawn from a seed."""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path as File
from typing import Any, TypeAlias

import numpy as np

from ...framework.controller import Controller
from ...framework.robot import Robot
from ...framework.values.errors import WideberthError
from ...framework.values.path import Path
from ...framework.values.polygon import Polygon
from ..engine.agents import Bystander, RobotAgent
from ..engine.episode import Run
from ..engine.settings import Settings
from ..engine.world import Rules, World
from ..log.episode_log import Episode

Range: TypeAlias = tuple[float, float]
"""Lowest and highest value; a value is drawn uniformly between them. Equal ends fix it."""
PHASE: Range = (0.0, 0.99)
"""Of the robots' phase offsets, as shares of the control period, in [0, 1)."""


@dataclass(frozen=True, eq=False)
class Placement:
    """One robot of a scenario; an experiment adds the robot model and the controller.

    Attributes
    ----------
    name : identity.
    path : reference path; the robot stands at its start at time 0.
    speed : m/s at time 0.
    phase : s after time 0 of the first decision, as a share of the control period: in
        [0, 1).
    visible : whether people detect it; see `RobotAgent`.
    reference_speed : m/s, of the free time; see `RobotAgent`.
    """

    name: str
    path: Path
    speed: float
    phase: float = 0.0
    visible: bool = True
    reference_speed: float | None = None

    def agent(self, robot: Robot, controller: Controller, truth: bool) -> RobotAgent:
        """Return the robot of this place, complete; ``truth`` as of `RobotAgent`."""
        return RobotAgent(
            self.name,
            robot,
            controller,
            self.path,
            self.speed,
            self.phase * controller.period,
            truth=truth,
            visible=self.visible,
            reference_speed=self.reference_speed,
        )


@dataclass(frozen=True, eq=False)
class Cast:
    """All agents and obstacles of one situation.

    Attributes
    ----------
    placements : the robots whose controller is examined.
    people : others who decide for themselves, complete with body and controller.
    bystanders : others who move and decide nothing.
    polygons : what stands still.
    rules : those of a benchmark that moves a crowd of its own and judges; None for ours.
    """

    placements: tuple[Placement, ...]
    people: tuple[RobotAgent, ...] = ()
    bystanders: tuple[Bystander, ...] = ()
    polygons: tuple[Polygon, ...] = ()
    rules: Rules | None = None

    def begin(
        self,
        robots: Sequence[RobotAgent],
        settings: Settings,
        seed: int,
        world: World | None = None,
    ) -> Run:
        """Return an episode at its start.

        Parameters
        ----------
        robots : those of ``placements``, complete.
        settings, seed : as of `run_episode`.
        world : None for positions that are exchanged, or for that of the rules.

        Raises
        ------
        WideberthError : as `run_episode`; a world beside rules that have one of their own.
        """
        if self.rules is not None and world is not None:
            raise WideberthError(
                f"{type(self.rules).__name__} moves its crowd by rules of its own, which have no "
                f"place in a {type(world).__name__}; take another scenario"
            )
        own = world if self.rules is None else self.rules.world(settings)
        agents = [*robots, *self.people]
        return Run(agents, settings, seed, self.bystanders, (), self.polygons, own)


class Scenario(ABC):
    """A family of situations; a frozen dataclass.

    Law: the same seed gives the same cast, and the same generator state the same parts of it.
    """

    robot_radius: float = 0.0
    """m, of the robots that a scenario leaves room for; 0 where it states none."""

    def cast(self, seed: int) -> Cast:
        """Draw the situation of a seed; the same for every controller that is compared.

        Each part has a generator of its own, so that one more of a kind changes no other kind.
        """
        robots, people, bystanders, polygons = (
            np.random.default_rng([seed, stream]) for stream in (7, 6, 8, 9)
        )
        placements = self.build(robots)
        return Cast(
            placements,
            self.people(people, placements),
            self.bystanders(bystanders, placements),
            self.polygons(polygons),
        )

    @abstractmethod
    def build(self, rng: np.random.Generator) -> tuple[Placement, ...]:
        """Draw one situation."""

    def people(
        self, rng: np.random.Generator, placements: tuple[Placement, ...]
    ) -> tuple[RobotAgent, ...]:
        """Draw the people who decide for themselves; none by default."""
        return ()

    def bystanders(
        self, rng: np.random.Generator, placements: tuple[Placement, ...]
    ) -> tuple[Bystander, ...]:
        """Draw the bystanders, who move without deciding; none by default."""
        return ()

    def polygons(self, rng: np.random.Generator) -> tuple[Polygon, ...]:
        """Draw the static obstacles; none by default."""
        return ()

    def inputs(self) -> tuple[File, ...]:
        """Files that the situations depend on; none by default."""
        return ()

    def judge(self, episode: Episode) -> dict[str, Any]:
        """Outcome by a benchmark's own rules, column -> value, beside ours.

        By default what the rules of the cast say, nothing without any.
        """
        return episode.verdict


def checked_range(name: str, value: Range, low: float, high: float = np.inf) -> Range:
    """Return a range that is ordered and lies within [low, high].

    Raises
    ------
    WideberthError : not two numbers, not ordered, or beyond the limits.
    """
    try:
        first, last = (float(v) for v in value)
    except (TypeError, ValueError):
        raise WideberthError(
            f"{name} is {value!r}; wanted two numbers, lowest and highest (equal to fix it)"
        ) from None
    if not low <= first <= last <= high:
        raise WideberthError(
            f"{name} is ({first:g}, {last:g}); wanted two numbers in order within "
            f"[{low:g}, {high:g}]"
        )
    return first, last


def draw_value(rng: np.random.Generator, bounds: Range) -> float:
    """Draw one value; takes one draw also where the range is a point."""
    return float(bounds[0] + (bounds[1] - bounds[0]) * rng.random())

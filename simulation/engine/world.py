"""The World of an episode: what moves in it, and what each robot observes of it."""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from ...framework.values.arrays import Array
from ...framework.values.errors import WideberthError
from ...framework.values.motion import Observation
from ...framework.values.plan import Plan
from ...framework.values.polygon import Polygon
from ..log.perception_log import PerceptionLog
from .agents import Bystander, RobotAgent
from .driver import Driver
from .plant import Plant
from .settings import Settings


@dataclass(frozen=True, eq=False)
class Around:
    """All that is there in an episode; the lists grow as it runs.

    Attributes
    ----------
    drivers : who decides.
    others : who moves without deciding.
    polygons : what stands still.
    clock : s, the instants so far.
    seed : of the noise.
    """

    drivers: list[Driver]
    others: list[Bystander]
    polygons: tuple[Polygon, ...]
    clock: list[float]
    seed: int


class World(ABC):
    """Gives robots their bodies, moves what they share, and returns what each one observes.

    In `ExchangedPositions` robots send each other their positions, as in the paper's text; in
    the package wideberth-perception they have wheels and sensors in a physics simulator.
    """

    @abstractmethod
    def plants(
        self,
        agents: Sequence[RobotAgent],
        others: Sequence[Bystander],
        polygons: Sequence[Polygon],
        seed: int,
    ) -> list[Plant]:
        """Return the body of each agent, at time 0; called once, before all else.

        Raises
        ------
        WideberthError : an agent cannot be in this world.
        """

    @abstractmethod
    def newcomer(self, agent: RobotAgent) -> Plant:
        """Return the body of an agent that appears later, at the start of its path."""

    @abstractmethod
    def observe(
        self, driver: Driver, time: float, tick: int, state: Array, around: Around
    ) -> Observation:
        """Return what a robot in a true ``state`` (n,) observes at a time, s.

        Times before 0 belong to the history, in which it was on its way to its start.
        """

    def next_instant(self, now: float, wanted: float) -> float:
        """Return the instant to move on to, s; by default the one that is wanted."""
        return wanted

    def move(self, now: float, duration: float, around: Around) -> None:
        """Move what the plants share on by ``duration`` s; they advance after it."""
        return

    def clone(self) -> "World":
        """Return another world whose plants, copied, go on as in this one.

        Raises
        ------
        WideberthError : it cannot be copied, as a physics simulator cannot.
        """
        raise WideberthError(
            f"{type(self).__name__} cannot be copied in the middle of an episode; only the world "
            "of exchanged positions can"
        )

    def others(self) -> tuple[Bystander, ...]:
        """Return who is there at time 0 by this world's own rules; no one by default.

        Those who come later are added to ``around.others`` by `settle`.
        """
        return ()

    def settle(self, around: Around) -> str | None:
        """Do what is due at the newest instant, once all have moved; say why the episode ends.

        Returns
        -------
        ended : a reason as of `Episode.ended`; empty while it goes on; None, by default, where the
            engine's own rules decide.
        """
        return None

    def verdict(self) -> dict[str, Any]:
        """Return what this world's own rules say of the episode; nothing by default."""
        return {}

    def perception(self) -> dict[str, PerceptionLog]:
        """Return what each robot has perceived; empty where they have no sensors."""
        return {}

    def in_world(self, driver: Driver, plan: Plan) -> Plan:
        """Return a robot's plan in the frame, and with the names, of an onlooker."""
        return plan


class Rules(ABC):
    """Rules of a benchmark for one situation: who else moves, how, and what the verdict is.

    A frozen dataclass: equal rules give equal worlds.
    """

    @abstractmethod
    def world(self, settings: Settings) -> World:
        """Return a new world, in which one episode is played.

        Raises
        ------
        WideberthError : the settings do not fit the rules.
        """

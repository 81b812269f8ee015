"""What pictures need of an episode: the logs of its agents, as an `Episode` holds them."""

from collections.abc import Sequence
from typing import Protocol

from ...framework.values.arrays import Array
from ...framework.values.path import Path
from ...framework.values.plan import Plan
from ...framework.values.polygon import Polygon
from ...metrics.gaps import Moving


class DrawnAgent(Moving, Protocol):
    """The log of one agent, see `AgentLog`."""

    @property
    def name(self) -> str:
        """Identity."""
        ...

    @property
    def kind(self) -> str:
        """Robot, person, replay or scripted."""
        ...

    @property
    def speeds(self) -> Array:
        """(T,), m/s; NaN for those who decide nothing."""
        ...

    @property
    def paths(self) -> Sequence[tuple[float, Path]]:
        """Time, s, and path of each reference path."""
        ...

    @property
    def plans(self) -> Sequence[Plan]:
        """In the order in which they were made."""
        ...


class Logged(Protocol):
    """The log of one episode, see `Episode`."""

    @property
    def times(self) -> Array:
        """(T,), s."""
        ...

    @property
    def agents(self) -> Sequence[DrawnAgent]:
        """All who were there."""
        ...

    @property
    def robots(self) -> Sequence[DrawnAgent]:
        """The robots under test."""
        ...

    @property
    def polygons(self) -> Sequence[Polygon]:
        """What stood still."""
        ...

    @property
    def duration(self) -> float:
        """Time of the last instant, s."""
        ...

    def at(self, agent: Moving, times: Array) -> Array:
        """Positions of an agent at any times, (K,) -> (K, D), m; NaN where it is absent."""
        ...

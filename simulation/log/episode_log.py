"""Episode: all that happened, from which every metric is computed."""

from dataclasses import dataclass, field

import numpy as np

from ...framework.values.arrays import Array
from ...framework.values.errors import WideberthError
from ...framework.values.footprint import Footprint
from ...framework.values.path import Path
from ...framework.values.plan import Plan
from ...framework.values.polygon import Polygon


@dataclass(frozen=True, eq=False)
class CommandLog:
    """Commands of one robot.

    Attributes
    ----------
    stamp : (C,), s, when each was asked for.
    effect : (C,), s, when it reached the plant: stamp + solve time.
    linear : (C, D), m/s.
    omega : (C,), rad/s.
    ramp : (C,), s.
    """

    stamp: Array
    effect: Array
    linear: Array
    omega: Array
    ramp: Array

    def __len__(self) -> int:
        """Count the commands."""
        return len(self.stamp)


@dataclass(frozen=True, eq=False)
class AgentLog:
    """What one agent did; arrays over the T instants of the episode.

    Attributes
    ----------
    name : identity.
    kind : "robot", "person" (decides as well, but is not examined), "replay" or "scripted".
    radius : m, of the enclosing disc.
    positions : (T, D), m, NaN where absent.
    headings : (T,), rad, NaN where there is none.
    speeds : (T,), m/s, length of the linear velocity; NaN for those who decide nothing.
    yaw_rates : (T,), rad/s; NaN for bystanders.
    paths : (time, path) of each reference path, in order; empty for bystanders.
    speed : m/s, reference speed; NaN for bystanders, and where it is unknown.
    period : s, of the controller; NaN for bystanders.
    reached : s, when it first was at its goal; NaN if never.
    skipped : ticks at which the controller was still busy with the one before.
    commands : what the controller decided.
    plans : the plan behind each command; shorter or empty where a controller has none.
        Measured seconds are taken out (0): they stand in `Episode.plan_seconds`. The
        forecast's covariance over the whole horizon (`joint`) is not kept.
    footprint : what it covers within the disc; None for all of it.
    """

    name: str
    kind: str
    radius: float
    positions: Array
    headings: Array
    speeds: Array
    yaw_rates: Array
    paths: tuple[tuple[float, Path], ...]
    speed: float
    period: float
    reached: float
    skipped: int
    commands: CommandLog
    plans: tuple[Plan, ...]
    footprint: Footprint | None = None


@dataclass(frozen=True, eq=False)
class Episode:
    """The log of one episode.

    Attributes
    ----------
    times : (T,), s: every plant step and every instant at which something happened, so the
        spacing varies; between two of them everything moves in a straight line.
    agents : one log each, in the order they were given.
    ended : why it ended: "goals", "deadlock", "time limit" or "collision".
    goal_tolerance : m, how near its goal a robot has to come.
    seed : of the noise.
    plan_seconds : name -> (C,), s, measured wall time of each call of the controller.
        Kept apart, and not part of `to_bytes`: it is the one thing that a second run with
        the same seed does not repeat.
    polygons : what stood still.
    """

    times: Array
    agents: tuple[AgentLog, ...]
    ended: str
    goal_tolerance: float
    seed: int
    plan_seconds: dict[str, Array] = field(default_factory=dict)
    polygons: tuple[Polygon, ...] = ()

    @property
    def robots(self) -> tuple[AgentLog, ...]:
        """Those who are examined."""
        return tuple(agent for agent in self.agents if agent.kind == "robot")

    @property
    def duration(self) -> float:
        """Time of the last instant, s."""
        return float(self.times[-1])

    def agent(self, name: str) -> AgentLog:
        """Return the log of the agent with this name."""
        for agent in self.agents:
            if agent.name == name:
                return agent
        names = [agent.name for agent in self.agents]
        raise WideberthError(f"the episode has no agent {name!r}; it has {names}")

    def at(self, agent: AgentLog, times: Array) -> Array:
        """Positions of an agent at any times of the episode, (K,) -> (K, D), m.

        NaN outside the episode and where the agent was absent.
        """
        columns = [
            np.interp(times, self.times, column, left=np.nan, right=np.nan)
            for column in agent.positions.T
        ]
        return np.stack(columns, axis=-1)

    def times_rows(self) -> list[dict[str, float | str]]:
        """One row per call of a controller: agent, stamp (s), measured seconds."""
        return [
            {"agent": agent.name, "stamp": float(stamp), "seconds": float(seconds)}
            for agent in self.robots
            for stamp, seconds in zip(
                agent.commands.stamp, self.plan_seconds.get(agent.name, ()), strict=False
            )
        ]

    def to_bytes(self) -> bytes:
        """Write everything but the measured times; the same episode gives the same bytes."""
        from .codec import to_bytes

        return to_bytes(self)

    @classmethod
    def from_bytes(cls, data: bytes) -> "Episode":
        """Read what `to_bytes` wrote.

        Raises
        ------
        WideberthError : not an episode, or of a version that this release does not know.
        """
        from .codec import from_bytes

        return from_bytes(data)

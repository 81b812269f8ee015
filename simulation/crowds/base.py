"""The Crowd interface, and the world that puts one around a robot."""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import replace
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from ...framework.robot import start_state
from ...framework.values.arrays import Array, BoolArray
from ...framework.values.errors import WideberthError
from ...framework.values.motion import Observation, Pose, Twist
from ...framework.values.polygon import Polygon
from ..engine.agents import Bystander, CrowdMember, RobotAgent
from ..engine.driver import Driver
from ..engine.exchanged_positions import ExchangedPositions
from ..engine.plant import KinematicPlant, Plant
from ..engine.settings import Settings
from ..engine.world import Around, World

STEP = 0.25
"""s, of every crowd here."""
ENDS = {"": "", "success": "goals", "collision": "collision", "timeout": "time limit"}
"""Outcome of a crowd -> why the episode ends."""
_SAME = 1e-9
"""s; instants closer together than this are one."""


class Crowd(ABC):
    """People of one case who move in steps of 0.25 s, and the verdict; made at time 0.

    Attributes
    ----------
    positions : (N, 2), m, of the people in their slots at present.
    ahead : (N, 2), m, where they will be after the next step.
    radii : (N,), m.
    arrivals : (N,), how many have had this slot before.
    seen : (N,), whether the robot saw who was in this slot when it looked last.
    robot : (2,), m, where the robot is.
    """

    positions: Array
    radii: Array
    arrivals: NDArray[np.int64]
    seen: BoolArray
    robot: Array

    @property
    @abstractmethod
    def ahead(self) -> Array:
        """Where people will be after the next step, (N, 2), m."""

    @abstractmethod
    def step(self, robot: Array, *, stopped: bool = False) -> str:
        """Move on by one step, at whose end the robot is at ``robot``, (2,), m; judge.

        Parameters
        ----------
        stopped : whether a wall has shortened the robot's way.

        Returns
        -------
        outcome : "success", "collision" or "timeout"; empty while it goes on.
        """

    @abstractmethod
    def verdict_row(self) -> dict[str, Any]:
        """Return what the rules say of the case up to now, column -> value."""

    def stop(self, place: Array, wanted: Array, radius: float) -> Array:
        """Return where a body gets to that wants from ``place`` to ``wanted``, (2,), m.

        By default ``wanted`` itself: there are no walls.
        """
        return wanted


@final
class CrowdWorld(World):
    """One robot among a `Crowd`; it sees positions and radii by the channel, without delay.

    The robot's plant moves between the crowd's steps as it does elsewhere; people go straight.
    Before time 0 no one is seen. The crowd's rules alone, and the time limit of the settings,
    end the episode: not its deadlocks, contacts or arrivals.

    Parameters
    ----------
    crowd : at time 0.
    settings : of the episode.

    Raises
    ------
    WideberthError : a channel with a delay.
    """

    def __init__(self, crowd: Crowd, settings: Settings) -> None:
        if settings.channel.delay:
            raise WideberthError(
                f"settings.channel.delay is {settings.channel.delay:g} s; a crowd with rules of "
                "its own is seen at once: leave it at 0"
            )
        self.crowd: Crowd = crowd
        self._exchange = ExchangedPositions(settings)
        self._tick = 0
        self._slots = [
            CrowdMember(f"person {slot}", radius, 0.0, place)
            for slot, (radius, place) in enumerate(
                zip(crowd.radii.tolist(), crowd.positions, strict=True), start=1
            )
        ]
        self._go_on()
        self._hidden = self._unseen()
        self._plant: _StoppedPlant | None = None

    def others(self) -> tuple[Bystander, ...]:
        """Return the people at time 0."""
        return tuple(self._slots)

    def plants(
        self,
        agents: Sequence[RobotAgent],
        others: Sequence[Bystander],
        polygons: Sequence[Polygon],
        seed: int,
    ) -> list[Plant]:
        """Return the planner's own model, which the crowd's walls stop.

        Raises
        ------
        WideberthError : more than one agent, or one that moves in space.
        """
        if len(agents) != 1 or agents[0].robot.dimension != 2:
            raise WideberthError(
                f"a crowd with rules of its own has one robot in the plane; these are "
                f"{[agent.name for agent in agents]}"
            )
        self._plant = _StoppedPlant(agents[0], self.crowd)
        return [self._plant]

    def newcomer(self, agent: RobotAgent) -> Plant:
        """Refuse a newcomer: the crowd replaces its people itself."""
        raise WideberthError(f"{agent.name} cannot appear in a crowd with rules of its own")

    def observe(
        self, driver: Driver, time: float, tick: int, state: Array, around: Around
    ) -> Observation:
        """Return the positions and radii of those that the robot sees."""
        found = self._exchange.observe(driver, time, tick, state, around)
        seen = tuple(one for one in found.detections if one.ident not in self._hidden)
        return replace(found, detections=seen)

    def next_instant(self, now: float, wanted: float) -> float:
        """Return the next instant of the crowd, if that is earlier."""
        return min(wanted, STEP * (self._tick + 1))

    def settle(self, around: Around) -> str | None:
        """Let the crowd take its step, if it is due, and judge."""
        now = around.clock[-1]
        if now < STEP * (self._tick + 1) - _SAME:
            return ""
        assert self._plant is not None, "plants() makes it"
        self._tick += 1
        before = self.crowd.arrivals.copy()
        outcome = self.crowd.step(np.array(self._plant.position), stopped=self._plant.asked())
        self._hidden = self._unseen()
        for slot in np.flatnonzero(self.crowd.arrivals != before).tolist():
            name = f"person {slot + 1} ({self.crowd.arrivals[slot] + 1})"
            radius, place = float(self.crowd.radii[slot]), self.crowd.positions[slot]
            self._slots[slot] = CrowdMember(name, radius, now, place)
            around.others.append(self._slots[slot])
            self._hidden.add(name)  # the robot has looked before
        self._go_on()
        return ENDS[outcome]

    def verdict(self) -> dict[str, Any]:
        """Return what the crowd's rules say."""
        return self.crowd.verdict_row()

    def _go_on(self) -> None:
        for member, place in zip(self._slots, self.crowd.ahead, strict=True):
            member.move(STEP * (self._tick + 1), place)

    def _unseen(self) -> set[str]:
        """Names of those whom the robot does not see now."""
        pairs = zip(self._slots, self.crowd.seen.tolist(), strict=True)
        return {member.name for member, seen in pairs if not seen}


class _StoppedPlant(KinematicPlant):
    """A robot that follows its commands as elsewhere, and is stopped by the crowd's walls.

    Of each plant step it is the straight way that is shortened; the speed falls with it.
    """

    def __init__(self, agent: RobotAgent, crowd: Crowd) -> None:
        direction = agent.path.direction(np.zeros(1))[0]
        start = start_state(agent.robot, agent.path.points[0], direction, agent.speed)
        super().__init__(agent.robot, *start)
        self._crowd = crowd
        self._stopped = False

    def asked(self) -> bool:
        """Whether a wall has stopped it since this was asked last."""
        stopped, self._stopped = self._stopped, False
        return stopped

    def advance(self, time: float, duration: float) -> None:
        """Move on by ``duration`` s, from ``time`` s."""
        place = np.array(self.position)
        super().advance(time, duration)
        wanted = np.array(self.position)
        reached = self._crowd.stop(place, wanted, self.robot.radius)
        if np.array_equal(reached, wanted):
            return
        self._stopped = True
        pose, twist = self.robot.pose(self.state), self.robot.twist(self.state, self.control)
        share = float(np.hypot(*(reached - place)) / np.hypot(*(wanted - place)))
        slower = Twist(tuple(share * float(v) for v in twist.linear), twist.angular)
        there = Pose((float(reached[0]), float(reached[1])), pose.heading)
        self.state = tuple(float(v) for v in self.robot.state_at(there, slower))

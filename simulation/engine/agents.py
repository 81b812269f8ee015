"""Agents of an episode: robots and people with controllers, recordings, scripted walkers."""

from dataclasses import dataclass
from typing import final

import numpy as np

from ...framework.controller import Controller
from ...framework.robot import Robot
from ...framework.values.arrays import Array, checked, positive
from ...framework.values.errors import WideberthError
from ...framework.values.path import Path


@final
@dataclass(frozen=True, eq=False)
class RobotAgent:
    """A robot, or a person, with a controller of its own.

    An episode examines robots: it ends when all of them have arrived, and only pairs with a
    robot in them count as clearances. People are the crowd that they move in. At time 0 either
    stands at the start of its path and moves along it at ``speed``; before that it came along
    the straight extension of the path's first segment.

    Parameters
    ----------
    name : identity, by which the others detect it.
    robot : model of the plant; its radius is what the others see.
    controller : decides; called every ``controller.period`` s.
    path : reference path.
    speed : m/s at time 0.
    phase : s, time of the first decision, in [0, period).
    truth : grant the controller the others' future (for the oracle predictor).
    person : one of the crowd.
    visible : whether people detect it; robots detect everyone. An invisible robot has to make
        all the way itself (the "invisible" setting of CrowdNav).
    courteous : of a person: whether it detects robots, without which it makes way for none.
    reference_speed : m/s, at which its path takes the free time, whatever drives it; ``speed`` by
        default, and unknown where that is 0.
    respawn : a person who has arrived appears anew at the start of its path, see `Respawning`.

    Raises
    ------
    WideberthError : a phase outside [0, period), a speed out of range, a path of another
        dimension than the robot's, a robot that would respawn or detect no robots.
    """

    name: str
    robot: Robot
    controller: Controller
    path: Path
    speed: float = 0.5
    phase: float = 0.0
    truth: bool = False
    person: bool = False
    visible: bool = True
    courteous: bool = True
    reference_speed: float | None = None
    respawn: bool = False

    def __post_init__(self) -> None:
        positive(f"{self.name}.speed", self.speed, zero=True)
        positive(f"{self.name}.phase", self.phase, zero=True)
        if self.respawn and not self.person:
            raise WideberthError(
                f"{self.name} is a robot and would respawn; only people (person=True) come anew, "
                "an episode ends when its robots have arrived"
            )
        if not (self.courteous or self.person):
            raise WideberthError(
                f"{self.name} is a robot and would detect no robots; only people (person=True) "
                "may lack courtesy"
            )
        if self.reference_speed is not None:
            positive(f"{self.name}.reference_speed", self.reference_speed)
        positive(f"{self.name}.controller.period", self.controller.period)
        if self.phase >= self.controller.period:
            raise WideberthError(
                f"{self.name}.phase is {self.phase:g} s; wanted less than the controller's "
                f"period, {self.controller.period:g} s"
            )
        if self.path.points.shape[1] != self.robot.dimension:
            raise WideberthError(
                f"{self.name}.path has {self.path.points.shape[1]} coordinates; its robot "
                f"moves in {self.robot.dimension} dimensions"
            )

    @property
    def radius(self) -> float:
        """Radius of the enclosing disc, m."""
        return self.robot.radius

    @property
    def reference(self) -> float:
        """Reference speed, m/s; NaN where it is unknown."""
        return (self.speed or np.nan) if self.reference_speed is None else self.reference_speed


@final
@dataclass(frozen=True, eq=False)
class ReplayAgent:
    """Moves as it was recorded, whatever the others do.

    Between two samples it is interpolated linearly; beside a NaN sample and outside the
    recording it is absent.

    Parameters
    ----------
    name : identity.
    times : (T,), s, increasing.
    positions : (T, D), m, NaN where absent.
    radius : m.

    Raises
    ------
    WideberthError : times not increasing, or shapes that do not fit.
    """

    name: str
    times: Array
    positions: Array
    radius: float

    def __post_init__(self) -> None:
        times = checked(f"{self.name}.times", self.times, (None,))
        shape = (len(times), None)
        positions = checked(f"{self.name}.positions", self.positions, shape, finite=False)
        if len(times) < 2 or (np.diff(times) <= 0).any():
            raise WideberthError(
                f"{self.name}.times must hold at least two instants, each later than the last"
            )
        positive(f"{self.name}.radius", self.radius, zero=True)
        object.__setattr__(self, "times", times)
        object.__setattr__(self, "positions", positions)

    def at(self, times: Array) -> Array:
        """Positions at the given times, (T,) -> (T, D), m, NaN where absent."""
        asked = np.asarray(times, dtype=np.float64)
        last = len(self.times) - 2
        below = np.clip(np.searchsorted(self.times, asked, side="right") - 1, 0, last)
        share = (asked - self.times[below]) / (self.times[below + 1] - self.times[below])
        outside = (share < 0) | (share > 1)
        share = np.clip(share, 0.0, 1.0)[:, None]
        first, second = self.positions[below], self.positions[below + 1]
        place = (1 - share) * first + share * second
        # On a sample itself the other one does not count, be it NaN.
        place = np.where(share == 0, first, np.where(share == 1, second, place))
        place[outside] = np.nan
        return place


@final
@dataclass(frozen=True, eq=False)
class ScriptedAgent:
    """Moves along a path at constant speed and stops at its end, whatever the others do.

    Before ``start`` it comes along the straight extension of the path's first segment.

    Parameters
    ----------
    name : identity.
    path : where it goes.
    speed : m/s.
    radius : m.
    start : s, when it passes the path's first point (its lag).
    """

    name: str
    path: Path
    speed: float
    radius: float
    start: float = 0.0

    def __post_init__(self) -> None:
        positive(f"{self.name}.speed", self.speed, zero=True)
        positive(f"{self.name}.radius", self.radius, zero=True)

    def at(self, times: Array) -> Array:
        """Positions at the given times, (T,) -> (T, D), m."""
        return along(self.path, self.speed * (np.asarray(times) - self.start))


@final
class CrowdMember:
    """A person of a crowd that moves by rules of its own, see `World.others`; the way grows.

    Before the first place and after the last one they are absent.

    Parameters
    ----------
    name : identity.
    radius : m.
    time : s, when they come.
    place : (2,), m, where.
    """

    def __init__(self, name: str, radius: float, time: float, place: Array) -> None:
        self.name: str = name
        self.radius: float = radius
        self._times: list[float] = [time]
        self._places: list[Array] = [np.array(place)]

    def move(self, time: float, place: Array) -> None:
        """Be at a place (2,), m, at a later time, s; in between on the straight way there."""
        self._times.append(time)
        self._places.append(np.array(place))

    def at(self, times: Array) -> Array:
        """Positions at the given times, (T,) -> (T, 2), m, NaN where absent."""
        asked = np.asarray(times, dtype=np.float64)
        places = np.array(self._places)
        outside = {"left": np.nan, "right": np.nan}
        return np.stack(
            [np.interp(asked, self._times, column, **outside) for column in places.T], axis=-1
        )


Bystander = ReplayAgent | ScriptedAgent | CrowdMember
"""Moves, but is asked by no controller."""


@final
@dataclass(frozen=True, eq=False)
class PathChange:
    """A new path for a robot, in the middle of an episode.

    Attributes
    ----------
    time : s.
    agent : name of the robot.
    path : followed from then on; its end is the new goal.
    """

    time: float
    agent: str
    path: Path

    def __post_init__(self) -> None:
        positive("path_change.time", self.time, zero=True)


def along(path: Path, arc: Array) -> Array:
    """Points of a path, straight on before its start and standing at its end, (T, D), m."""
    first = path.direction(np.zeros(1))[0]
    return np.asarray(path.at(arc) + np.minimum(arc, 0.0)[:, None] * first)

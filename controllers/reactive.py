"""The base of controllers without a horizon, which react to the present observation."""

from abc import ABC, abstractmethod
from contextlib import suppress
from dataclasses import dataclass, fields
from typing import ClassVar

import numpy as np

from ..framework.control.command_limits import within_reach
from ..framework.control.rate_limited_warnings import WARNINGS
from ..framework.controller import Controller, checked_path, checked_ready, checked_use
from ..framework.robot import Robot
from ..framework.tracking.history import MOST, admitted, viewpoint
from ..framework.tracking.names import FASTEST, Names
from ..framework.tracking.stand_ins import LastGood, checked_places
from ..framework.values.arrays import Array, positive
from ..framework.values.errors import WideberthError
from ..framework.values.failures import caught
from ..framework.values.motion import Command, Detection, Observation, checked_numbers
from ..framework.values.number_limits import SHORTEST
from ..framework.values.path import Path
from ..framework.values.plan import Plan
from .steering import PathGuide

FORGET = 3.0
"""s after which an obstacle that is no longer reported is dropped."""


@dataclass(frozen=True, eq=False)
class _Sight:
    """What is known of one neighbour: measured when and where, how fast, and last reported."""

    measured: float
    position: Array
    velocity: Array
    radius: float
    reported: float


class Neighbours:
    """Remembers detections in the plane by identity; a controller that reacts needs no more.

    The velocity is the difference of the last two measurements over the time between them,
    zero at first sight. It is as noisy as that says: sqrt(2) sigma / dt.

    Parameters
    ----------
    forget : s after which an obstacle that is no longer reported is dropped.
    fastest : m/s, speed that no obstacle exceeds, see `Names`.
    """

    def __init__(self, forget: float = FORGET, fastest: float = FASTEST) -> None:
        self._forget, self._fastest = forget, fastest
        self.reset()

    def reset(self) -> None:
        """Drop all neighbours."""
        self._stamp = -np.inf
        self._sights: dict[str, _Sight] = {}
        self._names = Names(self._fastest)
        self.placeless: tuple[str, ...] = ()

    def take(self, observation: Observation, here: Array | None = None) -> list[str]:
        """Record the detections seen from ``here``, (2,), m; return a reason per refused one.

        A measurement less than a microsecond newer than the last one of that obstacle takes its
        place and leaves the velocity; an older one changes nothing but the radius. A clock that
        goes back starts anew. See `admitted`.
        """
        if not np.isfinite(observation.stamp):
            return []
        if observation.stamp < self._stamp:
            self.reset()
        self._stamp = observation.stamp
        sighting = admitted(observation, 2, self._forget, here, self._remembered)
        self.placeless = sighting.placeless
        seen, stamp = sighting.detections, self._stamp
        self._names, named, notes = self._names.assigned(stamp, seen, self._sights)
        for name, detection in named:
            self._sights[name] = self._updated(self._sights.get(name), detection)
        self._sights = {
            name: sight
            for name, sight in self._sights.items()
            if self._stamp - sight.reported <= self._forget
        }
        if len(self._sights) > MOST:
            newest = sorted(self._sights, key=lambda name: self._sights[name].reported)[-MOST:]
            self._sights = {name: self._sights[name] for name in self._sights if name in newest}
        return [*sighting.notes, *notes]

    def now(self) -> tuple[tuple[str, ...], Array, Array, Array]:
        """Return positions, velocities and radii of all neighbours at the newest stamp.

        Returns
        -------
        ids : O identities, in the order in which they were first seen.
        positions : (O, 2), m, carried on from the measurement at constant velocity.
        velocities : (O, 2), m/s.
        radii : (O,), m.
        """
        sights = self._sights.values()
        places = [s.position + (self._stamp - s.measured) * s.velocity for s in sights]
        positions = np.array(places, dtype=np.float64).reshape(-1, 2)
        velocities = np.array([s.velocity for s in sights], dtype=np.float64).reshape(-1, 2)
        radii = np.array([s.radius for s in sights], dtype=np.float64)
        return tuple(self._sights), positions, velocities, radii

    def _remembered(self) -> dict[str, LastGood]:
        """Return what stands in for a neighbour's numbers of no use, by name."""
        return {
            name: LastGood(sight.radius)
            for name, sight in self._sights.items()
            if self._stamp - sight.reported <= self._forget
        }

    def _updated(self, before: _Sight | None, detection: Detection) -> _Sight:
        measured = self._stamp - detection.age
        if before is None:
            known = measured, detection.position, np.zeros(2)
        elif measured - before.measured >= SHORTEST:
            moved = detection.position - before.position
            known = measured, detection.position, moved / (measured - before.measured)
        elif measured >= before.measured:
            known = measured, detection.position, before.velocity
        else:
            known = before.measured, before.position, before.velocity
        return _Sight(*known, detection.radius, self._stamp)


class Preparing(ABC):
    """Has something to build before the first decision, which would take too long within it."""

    @abstractmethod
    def prepare(self) -> None:
        """Build it; `Reactive.set_path` calls this."""


@dataclass(eq=False)
class Reactive(Controller):
    """Controls a robot in the plane from the present observation, without a plan.

    A subclass gives `decide`, and `prepare` if it is `Preparing`; it may keep the velocity that
    it chose last as ``_velocity``, which `reset` sets to None. An exception in `decide`
    becomes the command to stand still, and `reason` says why.

    Parameters
    ----------
    robot : to be driven; in the plane.
    period : s between calls.
    reference_speed : m/s along the path.
    look_ahead : m along the path to the point that is headed for; infinite (``.inf``) for the
        goal itself, straight there.
    obstacle_speed : m/s that no obstacle exceeds; one that is reported farther away than it can
        have moved counts as another one, and the one known before stays remembered.

    Raises
    ------
    WideberthError : a number that is not above 0, or a robot that moves in space.
    """

    zero_allowed: ClassVar[frozenset[str]] = frozenset()
    """Fields that may be 0; every other number must be above."""

    robot: Robot
    period: float = 0.1
    reference_speed: float = 0.5
    look_ahead: float = 2.0
    obstacle_speed: float = FASTEST

    def __post_init__(self) -> None:
        name = type(self).__name__
        if self.robot.dimension != 2:
            raise WideberthError(
                f"{name} drives robots in the plane; {type(self.robot).__name__} moves in "
                f"{self.robot.dimension} dimensions: take mpc or one of its presets"
            )
        for field in fields(self):
            value = getattr(self, field.name)
            endless = field.name == "look_ahead" and value == np.inf
            if isinstance(value, int | float) and not endless:
                positive(f"{name}.{field.name}", value, zero=field.name in self.zero_allowed)
        self._guide = PathGuide()
        self._neighbours = Neighbours(fastest=self.obstacle_speed)
        self.reset()

    def reset(self) -> None:
        """Forget neighbours, progress and the last decision; keep the path."""
        self._guide.reset()
        self._neighbours.reset()
        self._reason = ""
        self._velocity: Array | None = None

    def set_path(self, path: Path) -> None:
        """Follow this path from now on."""
        self._guide.follow(checked_path(self.robot, path))
        if isinstance(self, Preparing):
            with suppress(Exception):  # it goes wrong again in `decide`, which says so
                self.prepare()

    @property
    def last_plan(self) -> Plan | None:
        """None: there is no horizon."""
        return None

    @property
    def reason(self) -> str:
        """Why the last command was to stand still instead of a decision; empty if it was one."""
        return self._reason

    def remember(self, observation: Observation) -> None:
        """Record the detected neighbours."""
        checked_use(self.robot, observation)
        for words in self._neighbours.take(observation, viewpoint(self.robot, observation)):
            WARNINGS.warn(type(self).__name__, "detection", words)

    def command(self, observation: Observation) -> Command:
        """Decide; raises for wrong use alone, see `reason` for other failures.

        Raises
        ------
        WideberthError : no path is set, or something else than an observation of this robot.
        """
        checked_ready(self._guide.path)
        checked_use(self.robot, observation)
        self._reason = ""
        try:
            self.remember(observation)
            checked_numbers(observation)
            checked_places(self._neighbours.placeless)
            place = self.robot.pose(tuple(observation.state)).points()
            command = self.decide(observation, place)
            if not np.isfinite((*command.linear, command.omega, command.ramp)).all():
                raise WideberthError(f"the decision is {command}, which is not finite")
            command = within_reach(self.robot, command)
        except Exception as error:
            self._reason = caught(error)
            WARNINGS.warn(type(self).__name__, "stands still", self._reason)
            return Command((0.0, 0.0))
        return command

    @abstractmethod
    def decide(self, observation: Observation, place: Array) -> Command:
        """Return the command of a robot at ``place``, (2,), m."""

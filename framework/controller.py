"""The Controller interface: our planner is one, every rival is another."""

from abc import ABC, abstractmethod
from dataclasses import fields, is_dataclass, replace
from typing import Any, Protocol, TypeVar, cast, final, runtime_checkable

import numpy as np

from .robot import Robot
from .static_region import StaticRegion
from .values.arrays import FARTHEST
from .values.errors import WideberthError
from .values.motion import Command, Observation
from .values.path import Path
from .values.plan import Plan

P = TypeVar("P")
C = TypeVar("C", bound="Controller")


class Controller(ABC):
    """Turns observations into velocity commands at a fixed rate.

    The paper's planner is a controller plug-in of Nav2 in ROS 2; this one is plain Python.

    Laws, checked by `wideberth.framework.testing.check_controller`:

    - Wrong use raises a `WideberthError` at once: `command` before `set_path`, an argument of the
      wrong type, a state of another length than the robot's. No measured value causes it, so that
      a program which has run once cannot meet it on the road.
    - Nothing else raises, whatever values the observation holds: NaN and infinite numbers, wild
      ones, states beyond the limits, covariances that are none, a clock that jumps, obstacles
      that come, go and have another dimension. Nor does anything that a plug-in throws. The
      command is then a safe one, and a status or reason says why; it is also logged, see
      `wideberth.framework.control.rate_limited_warnings`.
    - Every command is one that the robot can follow: finite, of D linear components, and a
      velocity within the robot's limits, see
      `wideberth.framework.control.command_limits.broken_limit`.
      That holds from a state beyond the limits, too: the command is then within them, and the
      low-level controller brakes towards it as hard as the robot can.
    - What is detected stays an obstacle, however bad its numbers: the last good value, or a
      cautious one, stands in for what is of no use, and a reason says so
      (`wideberth.framework.tracking.stand_ins`). An obstacle that is seen and has no place, not
      even a remembered one, may be anywhere: the robot stops for as long as it is seen. The check
      asks that of controllers that plan; Nav2's do so where they see by detections, and one may be
      made that looks at no obstacle at all.
    - In contact, where the robot's body touches or overlaps an obstacle, a controller that plans
      stops, or leaves the one in contact no faster than the robot moves already, or than 0.25 m/s:
      it never speeds up towards or past it, see `wideberth.framework.mpc.planner.in_contact`.
      Reactive controllers keep to the rule of their own method.
    - After `reset` it behaves as new.
    """

    period: float
    """s between two calls of `command`."""

    @abstractmethod
    def reset(self) -> None:
        """Forget everything but the settings."""

    @abstractmethod
    def set_path(self, path: Path) -> None:
        """Follow this path from now on; what is known of obstacles is kept."""

    @abstractmethod
    def remember(self, observation: Observation) -> None:
        """Take note of what is seen without deciding anything (before the start, say)."""

    @abstractmethod
    def command(self, observation: Observation) -> Command:
        """Decide. Whatever a plug-in throws becomes a status, and the command a safe one.

        Raises
        ------
        WideberthError : wrong use, see the class; nothing else.
        """

    @property
    @abstractmethod
    def last_plan(self) -> Plan | None:
        """The plan behind the last command; None before the first, or without a horizon."""

    @property
    @final
    def plan(self) -> Plan:
        """The plan behind the last command.

        Raises
        ------
        WideberthError : there is none, see `last_plan`.
        """
        plan = self.last_plan
        if plan is None:
            raise WideberthError(
                f"{type(self).__name__} has no plan: a planner has one after its first command, a "
                "controller that does not plan ahead never; where there may be none, use last_plan"
            )
        return plan


@runtime_checkable
class DrivesRobot(Protocol):
    """A controller that knows the robot it drives."""

    @property
    @abstractmethod
    def robot(self) -> Robot:
        """Model of the robot."""


@runtime_checkable
class NeedsStaticRegion(Protocol):
    """A controller that keeps clear of polygons by a static region, and ignores them without."""

    @property
    @abstractmethod
    def static_region(self) -> StaticRegion | None:
        """The region, or None."""


@runtime_checkable
class WrapsController(Protocol):
    """A controller that passes observations to another one."""

    @property
    @abstractmethod
    def controller(self) -> Controller:
        """The other one."""


def driving(controller: C, robot: Robot) -> C:
    """Return a controller with the robot that it, or the one that it wraps, is to drive.

    One that asks for no robot comes back as it is.
    """
    if not is_dataclass(controller):
        return controller
    made: Any = controller
    entries = {entry.name for entry in fields(made) if entry.init}
    if "robot" in entries:
        return controller if made.robot == robot else cast(C, replace(made, robot=robot))
    if "controller" in entries and isinstance(controller, WrapsController):
        inner = driving(controller.controller, robot)
        if inner is not controller.controller:
            return cast(C, replace(made, controller=inner))
    return controller


def own_copy(controller: Controller, place: str) -> Controller:
    """Return the copy that a wrapper drives; ``place`` is where it stands, for messages.

    Raises
    ------
    WideberthError : a controller that does not know its robot.
    """
    if not isinstance(controller, DrivesRobot):
        raise WideberthError(
            f"{place} is {type(controller).__name__}, which does not know its robot; wanted one "
            "with a robot, such as mpc or orca"
        )
    return fresh(controller)


def usable(observation: Observation) -> bool:
    """Whether clock and state can be reckoned with; else the controller says what is wrong."""
    numbers = np.append(observation.state, observation.stamp)
    return bool((np.abs(numbers) <= FARTHEST).all())


def noted(plan: Plan | None, note: str) -> Plan | None:
    """Return a plan with a note of the wrapper's in its reason; None for none."""
    if plan is None or not note:
        return plan
    return replace(plan, reason="; ".join(filter(None, (plan.reason, note))))


def avoids_polygons(controller: Controller) -> bool:
    """Whether a controller has what it needs to keep clear of polygons."""
    if isinstance(controller, WrapsController):
        return avoids_polygons(controller.controller)
    return not isinstance(controller, NeedsStaticRegion) or controller.static_region is not None


def checked_use(robot: Robot, observation: Observation) -> Observation:
    """Return an observation if it is one of this robot.

    Raises
    ------
    WideberthError : something else, or a state of another length.
    """
    if not isinstance(observation, Observation):
        raise WideberthError(
            f"a controller takes an Observation; this is a {type(observation).__name__}"
        )
    if len(observation.state) != len(robot.states):
        raise WideberthError(
            f"the state has {len(observation.state)} entries; wanted {len(robot.states)} of this "
            f"robot: {', '.join(quantity.name for quantity in robot.states)}"
        )
    return observation


def checked_path(robot: Robot, path: Path) -> Path:
    """Return a path, which may come as its points, if the robot can move along it.

    Raises
    ------
    WideberthError : it has another dimension.
    """
    path = path if isinstance(path, Path) else Path(path)
    if path.points.shape[1] != robot.dimension:
        raise WideberthError(
            f"the path has {path.points.shape[1]} columns; the robot moves in "
            f"{robot.dimension} dimensions"
        )
    return path


def checked_ready(path: P | None) -> P:
    """Return a path, or what follows it, if it is set.

    Raises
    ------
    WideberthError : ``path``, or what follows it, is None.
    """
    if path is None:
        raise WideberthError("no path is set: call set_path before command")
    return path


def fresh(controller: Controller) -> Controller:
    """Return another controller with the same settings: every robot needs one of its own."""
    if not is_dataclass(controller):
        raise WideberthError(
            f"{type(controller).__name__} is no dataclass; a controller's settings are its "
            "fields, so that it can be built again for every robot"
        )
    settings = {f.name: getattr(controller, f.name) for f in fields(controller) if f.init}
    return cast(Controller, type(controller)(**settings))

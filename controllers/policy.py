"""A policy as a controller: a function from observed arrays to an action."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, final

from numpy.typing import ArrayLike

from ..framework.control.command_limits import within_reach
from ..framework.control.rate_limited_warnings import WARNINGS
from ..framework.controller import Controller, checked_path, checked_ready, checked_use
from ..framework.plugins.registry import named
from ..framework.robot import Robot
from ..framework.tracking.stand_ins import checked_places
from ..framework.values.arrays import positive
from ..framework.values.errors import WideberthError
from ..framework.values.failures import caught
from ..framework.values.motion import Command, Observation, checked_numbers
from ..framework.values.path import Path
from ..framework.values.plan import Plan
from .policy_observer import ObservationSpec, PolicyObserver, Shown


@final
@dataclass(eq=False)
class Policy(Controller):
    """Calls a function with the arrays of `ObservationSpec` and commands the velocity it returns.

    The arrays are those that the Gymnasium environment shows (here in double precision), and the
    action is its action, so that what was learnt there is compared with any other controller.
    The function must not keep anything from one call to the next: an episode may be played
    again. What goes wrong (an exception, an action of another size or not finite) becomes the
    command to stand still, and `reason` says why. A velocity that the robot cannot have, such as
    one of too large a norm, becomes the nearest that it can.

    Parameters
    ----------
    robot : to be driven.
    policy : "module:function"; it takes a mapping, name -> array, and returns an action,
        (A,), see `VelocityBox`.
    period : s between calls; that of the environment it was trained in.
    sight : how much it sees; that of the environment, too.

    Raises
    ------
    WideberthError : a module that cannot be imported, or without that function.
    """

    robot: Robot
    policy: str
    period: float = 0.25
    sight: ObservationSpec = field(default_factory=ObservationSpec)

    def __post_init__(self) -> None:
        positive("policy.period", self.period)
        self._decide = _function(self.policy)
        self._view = PolicyObserver(self.robot, self.period, self.sight)
        self._reason = ""

    def reset(self) -> None:
        """Forget all observations; keep the path."""
        self._view.reset()
        self._reason = ""

    def set_path(self, path: Path) -> None:
        """Take the end of this path as the goal."""
        self._view.follow(checked_path(self.robot, path))

    def remember(self, observation: Observation) -> None:
        """Record the detections."""
        for words in self._view.take(checked_use(self.robot, observation)):
            WARNINGS.warn(type(self).__name__, "detection", words)

    def command(self, observation: Observation) -> Command:
        """Evaluate the policy; raises for wrong use alone, see `reason` for other failures.

        Raises
        ------
        WideberthError : no path is set, or something else than an observation of this robot.
        """
        checked_ready(self._view.goal)
        checked_use(self.robot, observation)
        self._reason = ""
        try:
            self.remember(observation)
            checked_numbers(observation)
            checked_places(self._view.placeless)
            command = self._view.box.command(self._decide(self._view.show(observation)))
            command = within_reach(self.robot, command)
        except Exception as error:  # a policy may fail in any way
            self._reason = caught(error)
            WARNINGS.warn(type(self).__name__, "stands still", self._reason)
            command = Command((0.0,) * self.robot.dimension)
        self._view.commanded(command)
        return command

    @property
    def last_plan(self) -> Plan | None:
        """None: there is no horizon."""
        return None

    @property
    def reason(self) -> str:
        """Why the last command was to stand still instead of an action; empty if it was one."""
        return self._reason


def _function(target: str) -> Callable[[Shown], ArrayLike]:
    """Import "module:function"."""
    try:
        found: Any = named(target) if ":" in target else None
    except WideberthError as error:
        raise WideberthError(f"policy: {error}; wanted 'module:function'") from error
    if not callable(found):
        raise WideberthError(f"policy is {target!r}; wanted 'module:function', a callable")
    return found  # type: ignore[no-any-return]

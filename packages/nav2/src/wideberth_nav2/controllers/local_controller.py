"""What Nav2's controller server asks of a local controller."""

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Self, final

import numpy as np

from wideberth.framework.values.arrays import Array, checked, number
from wideberth.framework.values.costmap import Costmap
from wideberth.framework.values.errors import WideberthError
from wideberth.framework.values.forecast import Forecast
from wideberth.framework.values.motion import Observation, Twist

from ..costmap.footprint import RobotFootprint
from ..goal_checker import GoalChecker

NO_VALID_CONTROL, INVALID_PATH, CONTROLLER_EXCEPTION = (
    "NoValidControl",
    "InvalidPath",
    "ControllerException",
)
"""Names of Nav2's exceptions: the first alone is forgiven for a while, see `server`."""


@final
@dataclass(frozen=True, eq=False)
class ExpectedPeople:
    """A forecast of discs in the plane, in the frame of the costmap.

    Attributes
    ----------
    forecast : of O people in M modes; step i is ``stamp`` + i dt.
    stamp : s, of the newest sample, on the clock of `Tick`.
    radii : (O,), m, of the people.

    Raises
    ------
    WideberthError : a forecast that is not in the plane or has no step, another number of radii,
        a negative radius, numbers that are not finite.
    """

    forecast: Forecast
    stamp: float
    radii: Array

    def __post_init__(self) -> None:
        people, _, steps, size = self.forecast.mean.shape
        if size != 2 or not steps:
            raise WideberthError(
                f"expected_people.forecast has {steps} steps in {size} dimensions; wanted at "
                "least one step, in the plane"
            )
        radii = checked("expected_people.radii", self.radii, (people,), reason=": one per person")
        if (radii < 0.0).any():
            raise WideberthError("expected_people.radii must not be negative")
        object.__setattr__(self, "radii", radii)
        object.__setattr__(self, "stamp", number("expected_people.stamp", self.stamp))

    def at(self, times: Array) -> tuple[Array, Array]:
        """Return means and covariances at times between the steps, on straight lines.

        Before the first step and after the last the mean goes on as between the two steps next to
        it, and the covariance stays.

        Parameters
        ----------
        times : (T,), s.

        Returns
        -------
        mean : (O, M, T, 2), m.
        covariance : (O, M, T, 2, 2), m^2.
        """
        forecast = self.forecast
        steps = (times - self.stamp) / forecast.dt - 1.0
        first = np.clip(np.floor(steps), 0, max(forecast.steps - 2, 0)).astype(np.int64)
        second = np.minimum(first + 1, forecast.steps - 1)
        share = steps - first
        mean, covariance = forecast.mean, forecast.covariance
        there = mean[:, :, first] + share[:, None] * (mean[:, :, second] - mean[:, :, first])
        within = np.clip(share, 0.0, 1.0)[:, None, None]
        spread = covariance[:, :, first]
        return there, spread + within * (covariance[:, :, second] - spread)


@dataclass(frozen=True, eq=False)
class Tick:
    """All that a local controller sees at one instant. Poses are x, y (m) and yaw (rad).

    Attributes
    ----------
    time : s.
    pose : (3,), of the robot, in the frame of the costmap.
    speed : (3,), measured vx, vy (m/s) and yaw rate (rad/s), in the robot's frame.
    plan : (N, 3), the pruned plan in the frame of the costmap, N >= 1.
    goal : (3,), of the whole path, in the frame of the costmap.
    costmap : with the inflation.
    footprint : of the robot, with its padding.
    track_unknown : whether a cell of unknown cost is free to go.
    checker : of the goal; asking it changes its memory, as in Nav2.
    observation : what the robot sees beside the costmap, for controllers that know of people;
        None for those of Nav2's own that do not.
    people : forecasts, for controllers that make use of them; None where there are none.
    """

    time: float
    pose: Array
    speed: Array
    plan: Array
    goal: Array
    costmap: Costmap
    footprint: RobotFootprint
    track_unknown: bool
    checker: GoalChecker
    observation: Observation | None = None
    people: ExpectedPeople | None = None


@dataclass(frozen=True, eq=False)
class Answer:
    """What a local controller commands, or why it commands nothing.

    Attributes
    ----------
    twist : linear is (vx, vy); None where it refuses.
    error : name of Nav2's exception where it refuses, such as `NO_VALID_CONTROL`; else "".
    reason : why it refuses, in words; else "".
    expected : (T, 3), poses that it expects to pass, in the frame of the costmap; None where it
        computes none.
    sampled : trajectories that it compared, each (T, 3), for a picture.
    """

    twist: Twist | None
    error: str = ""
    reason: str = ""
    expected: Array | None = None
    sampled: tuple[Array, ...] = ()

    @classmethod
    def refusal(cls, reason: str, error: str = NO_VALID_CONTROL) -> "Answer":
        """Return the answer of a controller that commands nothing."""
        return cls(None, error, reason)


class LocalController(ABC):
    """Follows a plan on a costmap, one tick at a time, as a controller plug-in of Nav2 does.

    Laws:

    - `reset` forgets what the original forgets; a new one is made for a new robot.
    - `velocity` raises nothing: where Nav2 throws, the answer names the exception.
    - Equal ticks after equal calls have equal answers, bit by bit.
    """

    @abstractmethod
    def reset(self) -> None:
        """Forget what earlier ticks left; the server calls it after a success and an abort."""

    @abstractmethod
    def new_path(self, path: Array) -> None:
        """Take note of a new or replanned path, whole, (N, 3) in the frame of the costmap."""

    @abstractmethod
    def limit_speed(self, value: float, percentage: bool) -> None:
        """Limit the speed: m/s, or percent of the configured one; 0 lifts the limit."""

    @abstractmethod
    def velocity(self, tick: Tick) -> Answer:
        """Return the velocity for now, or the reason why there is none."""


class CompositeController(LocalController):
    """A controller with critics or plug-ins, which has more parameters than fields."""

    @classmethod
    @abstractmethod
    def from_parameters(cls, parameters: Mapping[str, Any]) -> Self:
        """Make it from parameters by Nav2's names, those of its parts as ``Critic.name``."""

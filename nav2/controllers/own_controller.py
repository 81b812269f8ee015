"""A controller of ours in Nav2's loop: it is asked like Nav2's own, and sees what they see."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from math import hypot, inf
from typing import Any, final

import numpy as np

from ...framework.control.velocity_smoother import VelocitySmoother
from ...framework.controller import Controller, driving, fresh
from ...framework.plugins.config import build
from ...framework.tracking.stand_ins import sound
from ...framework.values.arrays import Array, positive
from ...framework.values.costmap import Costmap
from ...framework.values.errors import WideberthError
from ...framework.values.motion import Observation, Twist
from ...framework.values.path import Path
from ...framework.values.polygon import Polygon
from ..costmap.local_costmap import discs_of, in_sight
from ..parameters import refuse_unknown
from .local_controller import INVALID_PATH, Answer, MadeOfParts, Tick

_DUE = 1e-9
"""s: a decision that is due so soon is due now."""


@final
@dataclass(eq=False)
class OwnController(MadeOfParts):
    """Asks any `Controller`, which learns of those bodies alone that the local costmap shows.

    Whenever the costmap has changed, a disc or polygon is in sight if a lethal cell touches it,
    and it stays so until the next change. The controller decides at its own period; between two
    decisions the velocity is on the ramp of its last command, see
    `wideberth.framework.control.velocity_smoother.VelocitySmoother`.

    Parameters
    ----------
    controller : is asked. It has no `Command` that means that there is no way: where it stands, so
        does the robot, until the progress checker ends the action.
    controller_frequency : Hz, of ticks.

    Raises
    ------
    WideberthError : a frequency that is not above zero.
    """

    controller: Controller
    controller_frequency: float = 20.0

    _limit: tuple[float, bool] = field(default=(0.0, False), init=False, repr=False)
    _ready: bool = field(default=False, init=False, repr=False)
    _decided: float = field(default=inf, init=False, repr=False)
    _ramp: VelocitySmoother | None = field(default=None, init=False, repr=False)
    _shown: Costmap | None = field(default=None, init=False, repr=False)
    _names: set[str] = field(default_factory=set, init=False, repr=False)
    _walls: set[Polygon] = field(default_factory=set, init=False, repr=False)

    def __post_init__(self) -> None:
        positive("own.controller_frequency", self.controller_frequency)

    @classmethod
    def from_parameters(cls, parameters: Mapping[str, Any]) -> "OwnController":
        """Return a new one from ``controller`` (a `Controller`, its config or its name).

        A ``robot`` takes the place of the controller's own, where it has one.

        Raises
        ------
        WideberthError : an unknown name, or no controller.
        """
        refuse_unknown("own", parameters, ("controller", "controller_frequency", "robot"))
        if "controller" not in parameters:
            raise WideberthError("own has no controller; give one, its config or its name")
        rest = {**parameters}
        given, robot = rest.pop("controller"), rest.pop("robot", None)
        own = isinstance(given, Controller)
        made: Any = fresh(given) if own else build("controllers", given, "own")
        if robot is not None:
            made = driving(made, robot)
        return cls(made, **rest)

    def reset(self) -> None:
        """Decide anew at the next tick; the controller remembers whom it has seen."""
        self._decided, self._ramp = inf, None

    def new_path(self, path: Array) -> None:
        """Pass a path on, if it has any length."""
        points = path[:, :2]
        points = points[np.r_[True, (np.diff(points, axis=0) != 0.0).any(axis=1)]]
        self._ready = len(points) > 1
        if self._ready:
            self.controller.set_path(Path(points))
        self._decided = inf

    def limit_speed(self, value: float, percentage: bool) -> None:
        """Slow commands down, along their arc: to m/s, or to percent of what they are."""
        self._limit = value, percentage

    def velocity(self, tick: Tick) -> Answer:
        """Return what the controller wants now, or why it cannot be asked."""
        if not self._ready:
            return Answer.refusal("the path has no length", INVALID_PATH)
        if tick.observation is None:
            return Answer.refusal("there is no observation to decide by")
        seen = self._limited(tick.observation, tick.costmap)
        try:
            ramp = self._ramped(tick, seen)
        except Exception as error:  # whatever a plug-in throws
            return Answer.refusal(f"{type(error).__name__}: {error}")
        return Answer(self._slowed(ramp.at(tick.time + 1.0 / self.controller_frequency)))

    def _slowed(self, twist: Twist) -> Twist:
        """Return a velocity within the limit of speed."""
        value, percentage = self._limit
        v, w = (float(twist.linear[0]), float(twist.linear[1])), float(twist.angular)
        speed = hypot(*v)
        share = value / 100.0 if percentage else value / speed if speed > value else 1.0
        share = min(share, 1.0) if value > 0.0 else 1.0
        return Twist((share * v[0], share * v[1]), share * w)

    def _ramped(self, tick: Tick, seen: Observation) -> VelocitySmoother:
        """Decide, where it is time to; return the ramp of the last command."""
        ramp, period = self._ramp, self.controller.period
        if ramp is not None and self._decided <= tick.time < self._decided + period - _DUE:
            return ramp
        if ramp is None:
            now = tick.speed
            ramp = VelocitySmoother.at_rest(Twist((float(now[0]), float(now[1])), float(now[2])))
        ramp = ramp.aim(self.controller.command(seen), tick.time)
        self._decided, self._ramp = tick.time, ramp
        return ramp

    def _limited(self, observation: Observation, costmap: Costmap) -> Observation:
        """Return the observation without what the costmap does not show.

        Detections are passed on as they are, those without a place as well: the controller
        remembers what can stand in for a number that is of no use.
        """
        ones, _, placeless = sound(observation, 2)
        if costmap is not self._shown:
            self._shown = costmap
            discs, polygons = in_sight(costmap, *discs_of(ones), observation.polygons)
            self._names = {one.ident for one, seen in zip(ones, discs, strict=True) if seen}
            self._walls = {
                one for one, seen in zip(observation.polygons, polygons, strict=True) if seen
            }
        passed_on = {*self._names, *placeless}
        return replace(
            observation,
            detections=tuple(one for one in observation.detections if one.ident in passed_on),
            polygons=tuple(one for one in observation.polygons if one in self._walls),
        )

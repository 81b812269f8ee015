"""Forecasts of the people that a robot sees, for a local controller that makes use of them."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any, final

import numpy as np

from wideberth.framework.plugins.config import build
from wideberth.framework.plugins.yamlfile import shared_settings
from wideberth.framework.predictor import Predictor
from wideberth.framework.values.arrays import Array, positive
from wideberth.framework.values.failures import caught
from wideberth.framework.values.motion import Observation
from wideberth.predictors.core.forecaster import Forecaster

from .local_controller import Answer, CompositeController, ExpectedPeople, LocalController, Tick
from .mppi import MPPI

CRITIC = "ExpectedPeopleCritic"
"""Name of the critic that makes use of forecasts."""


@final
@dataclass(eq=False)
class PeopleForecasts(CompositeController):
    """Forecasts the people of each observation and passes them on to a local controller.

    The detections of each tick are remembered as tracks, which a predictor forecasts. A tick
    without an observation, or without known people, is passed on as it is. Where the predictor
    raises for all the answer is a refusal. It is registered as ``mppi_foresight``.

    Parameters
    ----------
    controller : decides; it is given the forecasts as `Tick.people`.
    predictor : of the people.
    horizon : s, of the forecasts.
    period : s between ticks.

    Raises
    ------
    WideberthError : a time or number out of range.
    """

    controller: LocalController
    predictor: Predictor
    horizon: float = 2.8
    period: float = 0.05

    _forecaster: Forecaster = field(init=False, repr=False)

    def __post_init__(self) -> None:
        for name in ("horizon", "period"):
            positive(f"mppi_foresight.{name}", getattr(self, name))
        self._forecaster = Forecaster(self.predictor, self.period)

    @classmethod
    def from_parameters(cls, parameters: Mapping[str, Any]) -> "PeopleForecasts":
        """Return MPPI with forecasts: with all its parameters, and a ``predictor`` by its config.

        Without one it is the recommended one. The critic that makes use of the forecasts is added
        at the end if it is not named.

        Raises
        ------
        WideberthError : an unknown name.
        """
        rest = {**parameters}
        wanted = rest.pop("predictor", None) or shared_settings("recommended")["predictor"]
        predictor = build("predictors", wanted, "predictor")
        usual = [type(critic).__name__ for critic in MPPI.critics]
        critics = [*rest.pop("critics", usual)]
        rest["critics"] = critics if CRITIC in critics else [*critics, CRITIC]
        controller = MPPI.from_parameters(rest)
        horizon = controller.time_steps * controller.model_dt
        period = 1.0 / controller.controller_frequency
        return cls(controller, predictor, horizon=horizon, period=period)

    def reset(self) -> None:
        """Let the controller forget; people are remembered."""
        self.controller.reset()

    def new_path(self, path: Array) -> None:
        """Pass a path on."""
        self.controller.new_path(path)

    def limit_speed(self, value: float, percentage: bool) -> None:
        """Pass a limit on."""
        self.controller.limit_speed(value, percentage)

    def velocity(self, tick: Tick) -> Answer:
        """Ask the controller, with the forecasts of the people."""
        if tick.observation is None:
            return self.controller.velocity(tick)
        try:
            people = self.expected(tick.observation, tick)
        except Exception as error:  # whatever a plug-in throws
            return Answer.refusal(f"no forecast: {caught(error)}")
        return self.controller.velocity(replace(tick, people=people))

    def expected(self, observation: Observation, tick: Tick) -> ExpectedPeople | None:
        """Take note of what is seen, and forecast it; None where no people are known."""
        self._forecaster.take(observation, tick.pose[:2], tick.footprint.circumscribed)
        dt = self._forecaster.dt
        steps = int(np.ceil(self.horizon / dt - 1e-9))
        found = self._forecaster.at(observation.stamp, dt * np.arange(1.0, steps + 1.0))
        if found is None:
            return None
        tracks, forecast = found
        return ExpectedPeople(forecast, observation.stamp, tracks.radius)

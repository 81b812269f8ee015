"""Forecasts at any instant of those who were seen so far."""

from dataclasses import dataclass, field
from typing import final

from ...framework.predictor import Predictor
from ...framework.tracking.perception import Perception, scene_of
from ...framework.values.arrays import Array
from ...framework.values.forecast import Forecast, Scene
from ...framework.values.motion import Observation
from ...framework.values.tracks import Tracks

DT, SAMPLES, KEPT = 0.1, 40, 3.0
"""s between samples of a track; their number; s after which a person is dropped who is no longer
reported."""


@final
@dataclass(eq=False)
class Forecaster:
    """Remembers the people of each observation, and forecasts them from any later instant on.

    Parameters
    ----------
    predictor : of the people.
    period : s, that are meant to lie between observations.
    dt : s between samples of the tracks. samples : their number.
    """

    predictor: Predictor
    period: float
    dt: float = DT
    samples: int = SAMPLES
    _perception: Perception = field(init=False, repr=False)
    _tracks: Tracks | None = field(default=None, init=False, repr=False)
    _scene: Scene = field(default_factory=Scene, init=False, repr=False)

    def __post_init__(self) -> None:
        self._perception = Perception.initial(
            self.predictor, 2, self.dt, self.samples, self.period, KEPT
        )

    def take(self, observation: Observation, here: Array, radius: float) -> tuple[str, ...]:
        """Take note of what a robot sees from ``here``, (2,) m; return what was wrong with it.

        Parameters
        ----------
        observation : of the robot. here : its place. radius : m, of the robot.
        """
        perception, notes = self._perception.take(observation, here).drained()
        self._tracks = perception.history.tracks()
        self._scene = scene_of(observation, None, radius)
        self._perception = perception.learnt(self._tracks, self._scene)
        return notes

    @property
    def seen(self) -> frozenset[str]:
        """Names of those whom the last observation saw."""
        return self._perception.history.reported(self._perception.stamp)

    @property
    def placeless(self) -> tuple[str, ...]:
        """Names of those whom the last observation saw without a place."""
        return self._perception.placeless

    def at(self, now: float, times: Array) -> tuple[Tracks, Forecast] | None:
        """Return the tracks so far, and the forecast from now on; None where no one is known.

        How long ago a person was measured counts: the forecast reaches over that, too.

        Parameters
        ----------
        now : s, not before the newest observation. times : (N,), s from now on.
        """
        if self._tracks is None:
            return None
        first = max(now, self._tracks.stamp)
        forecast = self._perception.forecast(self._tracks, first, times, self._scene)
        return None if forecast is None else (self._tracks, forecast)

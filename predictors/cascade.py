"""Takes the first of several predictors with enough history and a healthy forecast."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Self, final

import numpy as np

from ..framework.plugins.registry import name_of
from ..framework.predictor import Fittable, Predictor
from ..framework.values.arrays import Array, positive, whole
from ..framework.values.errors import WideberthError
from ..framework.values.failures import caught
from ..framework.values.forecast import Forecast, Scene
from ..framework.values.tracks import Tracks
from .bayesian_var import BayesianVectorAutoregression
from .core.assembly import refuse_adaptive, with_fallback
from .core.history import Histories, gather
from .kalman import Kalman
from .static import Static
from .var import VectorAutoregression


@final
@dataclass(frozen=True)
class FallbackStage:
    """A predictor, and the history and spread that it needs to be taken.

    Parameters
    ----------
    predictor : to be asked.
    minimum_samples : observed samples that the history must have.
    max_speed : m/s; a forecast that is faster anywhere is not healthy. None for no limit.

    Raises
    ------
    WideberthError : a number out of range.
    """

    predictor: Predictor
    minimum_samples: int = 1
    max_speed: float | None = None

    def __post_init__(self) -> None:
        refuse_adaptive("stage.predictor", self.predictor)
        whole("stage.minimum_samples", self.minimum_samples)
        if self.max_speed is not None:
            positive("stage.max_speed", self.max_speed)

    @property
    def name(self) -> str:
        """How the reasons call it."""
        return name_of("predictors", type(self.predictor))


def _stages() -> tuple[FallbackStage, ...]:
    return (
        FallbackStage(VectorAutoregression(), 60),
        FallbackStage(BayesianVectorAutoregression(), 8, max_speed=5.0),
        FallbackStage(Kalman(), 2),
        FallbackStage(Static()),
    )


@final
@dataclass(frozen=True)
class FallbackChain(Fittable):
    """Each obstacle is served by the first stage that is healthy for it; the last one always.

    A stage is passed over for an obstacle with fewer than ``minimum_samples`` observed samples
    (those before a gap that `gather` does not bridge do not count); if it gives a reason of its
    own, which says that it was not itself what answered; if a mean moves faster than
    ``max_speed``, counted from the newest observed position; and if it raises an exception,
    which none that keeps the laws does. The reasons name every stage passed over: "var: 12
    samples, needs 60".

    Each stage is asked once for all obstacles that no earlier one served, so that one which
    looks at neighbours sees those alone, and all of them where it is the first. `fit` passes
    the recordings on to every stage that learns. A stage that adapts is refused: wrap the
    cascade instead.

    Parameters
    ----------
    stages : in order of preference. The default takes `var` from 60 samples, from which its
        fits on real robots are stable, its Bayesian twin from 8, `kalman` from 2, and `static`.

    Raises
    ------
    WideberthError : no stage.
    """

    stages: tuple[FallbackStage, ...] = field(default_factory=_stages)

    def __post_init__(self) -> None:
        if not self.stages:
            raise WideberthError("cascade.stages is empty; wanted one stage at least")

    def predict(self, tracks: Tracks, steps: int, scene: Scene | None = None) -> Forecast:
        """Forecast all obstacles; see `Predictor.predict`."""
        stage, later = self.stages[0], self.stages[1:]
        if not later:
            return stage.predictor.predict(tracks, steps, scene)
        past = gather(tracks)
        reasons = _short(stage, past)
        # a cheap predictor takes the place of a stage that no obstacle may use
        asked = stage.predictor if None in reasons else Static()
        try:
            forecast = asked.predict(tracks, steps, scene)
            ill = _ill(stage, forecast, past, tracks.dt)
        except Exception as error:  # a plug-in may fail in any way; the next one serves
            forecast = Static().predict(tracks, steps)
            ill = [f"{stage.name}: {caught(error)}"] * len(tracks)
        missing = [short or why for short, why in zip(reasons, ill, strict=True)]
        return with_fallback(forecast, missing, replace(self, stages=later), tracks, scene)

    def fit(self, dataset: Sequence[Tracks]) -> Self:
        """Fit every stage that learns; see `Fittable.fit`."""
        fitted = (
            replace(stage, predictor=stage.predictor.fit(dataset))
            if isinstance(stage.predictor, Fittable)
            else stage
            for stage in self.stages
        )
        return replace(self, stages=tuple(fitted))


def _short(stage: FallbackStage, past: Histories) -> list[str | None]:
    """Say per obstacle that its history is too short, or None."""
    name = stage.name  # a look-up in the registry
    return [
        f"{name}: {count} sample{'' if count == 1 else 's'}, needs {stage.minimum_samples}"
        if count < stage.minimum_samples
        else None
        for count in past.samples.tolist()
    ]


def _ill(stage: FallbackStage, forecast: Forecast, past: Histories, dt: float) -> list[str | None]:
    """Say per obstacle why a forecast must not be used, or None."""
    reasons = list(forecast.fallback)
    if stage.max_speed is None:
        return reasons
    fastest = _fastest(forecast, past, dt)
    for index in np.flatnonzero(fastest > stage.max_speed):
        if reasons[index] is None:
            reasons[index] = (
                f"{stage.name}: predicted speed {fastest[index]:.3g} m/s, at most "
                f"{stage.max_speed:g}"
            )
    return reasons


def _fastest(forecast: Forecast, past: Histories, dt: float) -> Array:
    """Largest speed of any mode from the newest observed position on, (O,), m/s."""
    first = np.broadcast_to(past.origin[:, None, None], forecast.mean[:, :, :1].shape)
    steps = np.diff(np.concatenate([first, forecast.mean], axis=2), axis=2)
    times = np.full(steps.shape[:3], dt)
    times[:, :, 0] *= 1 + past.late[:, None]
    speeds = np.linalg.norm(steps, axis=3) / times
    possible = forecast.weight[:, :, None] > 0
    return np.asarray(np.max(np.where(possible, speeds, 0.0), axis=(1, 2), initial=0.0))

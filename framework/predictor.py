"""The Predictor interface: tracks in, forecast out."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import wraps
from typing import Any, ClassVar, Self

from .values.coverage import Coverage
from .values.forecast import Forecast, Scene
from .values.number_limits import bounded
from .values.tracks import Tracks


def _predict_within(predict: Callable[..., Forecast]) -> Callable[..., Forecast]:
    """Let a `predict` see numbers within the limits alone."""

    @wraps(predict)
    def limited(self: Any, tracks: Tracks, steps: int, scene: Scene | None = None) -> Forecast:
        known = bounded(tracks, scene)
        if known is None:
            return predict(self, tracks, steps, scene)
        forecast = predict(self, known.tracks, steps, known.scene)
        reasons = tuple(
            "; ".join(filter(None, both)) or None
            for both in zip(known.reasons, forecast.fallback, strict=True)
        )
        return replace(forecast, dt=tracks.dt, fallback=reasons)

    return limited


def _update_within(update: Callable[..., Any]) -> Callable[..., Any]:
    """Let an `update` see numbers within the limits alone."""

    @wraps(update)
    def limited(self: Any, tracks: Tracks, scene: Scene | None = None) -> Any:
        known = bounded(tracks, scene)
        if known is None:
            return update(self, tracks, scene)
        return update(self, known.tracks, known.scene)

    return limited


class Predictor(ABC):
    """Says where each obstacle will be.

    A predictor is a frozen dataclass; its constructor arguments are its config. Laws,
    checked by `wideberth.framework.testing.check_predictor`:

    - pure: the same tracks give the same forecast, and nothing it is given is changed;
    - any history, however short or broken (NaN, one sample, none), gives a finite forecast
      with PSD covariances, and the reason in ``fallback`` where the named method could not
      be used; it never raises;
    - turning or shifting the tracks turns or shifts the forecast with them;
    - one call serves all obstacles, and what it says of one does not depend on their order;
    - numbers of any magnitude that a float holds: those of one obstacle do not spoil the
      forecast of another.

    The last law is kept here for every subclass: its `predict` (and `Adaptive.update`) is
    called with tracks and scene within the limits of
    `wideberth.framework.values.number_limits`, and the
    obstacles that were beyond them have that as their reason. Within these limits a method's own
    arithmetic must neither overflow nor divide by zero.
    """

    reference: ClassVar[str] = ""
    """BibTeX key of the source, for ``wideberth cite``."""

    coverage: ClassVar[Coverage | None] = None
    """What the regions of its forecasts promise; None where it is a model that may be wrong."""

    def __init_subclass__(cls, **settings: Any) -> None:
        """Put the limits before the methods of a subclass that are given tracks."""
        super().__init_subclass__(**settings)
        limits: dict[str, Callable[[Any], Any]] = {
            "predict": _predict_within,
            "update": _update_within,
        }
        for name, within in limits.items():
            method = cls.__dict__.get(name)
            if callable(method) and not getattr(method, "__isabstractmethod__", False):
                setattr(cls, name, within(method))

    @abstractmethod
    def predict(self, tracks: Tracks, steps: int, scene: Scene | None = None) -> Forecast:
        """Forecast all obstacles ``steps`` steps of ``tracks.dt`` ahead."""


class Fittable(Predictor):
    """A predictor that learns from recorded tracks.

    ``fit_needs`` names what `fit` needs beyond the core: a module, the extra that installs it, and
    who needs it, in words. It is asked for before recordings are read.
    """

    fit_needs: ClassVar[tuple[str, str, str] | None] = None

    @abstractmethod
    def fit(self, dataset: Sequence[Tracks]) -> Self:
        """Return a fitted copy; the predictor itself stays as it was."""


class Adaptive(Predictor):
    """A predictor that adapts while it runs.

    The copy returned by `update` carries its own pending forecasts; it uses the truth of a
    step only once that step has been observed.
    """

    @abstractmethod
    def update(self, tracks: Tracks, scene: Scene | None = None) -> Self:
        """Return a copy that has learnt from the newest samples.

        ``scene`` is what `predict` will be given next, for the forecasts made to be judged.
        """

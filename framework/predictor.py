"""The Predictor interface: tracks in, forecast out."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import wraps
from typing import Any, ClassVar, Self, final

from .values.beliefs import Beliefs
from .values.coverage import Coverage
from .values.forecast import Forecast, Scene
from .values.number_limits import bounded
from .values.tracks import Tracks


def _predict_within(predict: Callable[..., Forecast]) -> Callable[..., Forecast]:
    """Let a `predict` see numbers within the limits alone."""

    @wraps(predict)
    def limited(self: Any, tracks: Tracks, steps: int, scene: Scene | None = None) -> Forecast:
        return _limited_forecast(
            lambda tracks, scene: predict(self, tracks, steps, scene), tracks, scene
        )

    return limited


def _update_within(update: Callable[..., Any]) -> Callable[..., Any]:
    """Let an `update` see numbers within the limits alone."""

    @wraps(update)
    def limited(self: Any, tracks: Tracks, scene: Scene | None = None, *beliefs: Any) -> Any:
        within = bounded(tracks, scene)
        if within is None:
            return update(self, tracks, scene, *beliefs)
        return update(self, within.tracks, within.scene, *beliefs)

    return limited


def _filtered_within(filtered: Callable[..., Beliefs]) -> Callable[..., Beliefs]:
    """Let a `filtered` see numbers within the limits alone."""

    @wraps(filtered)
    def limited(self: Any, tracks: Tracks, before: Beliefs | None = None) -> Beliefs:
        within = bounded(tracks, None)
        return filtered(self, tracks if within is None else within.tracks, before)

    return limited


def _ahead_within(ahead: Callable[..., Forecast]) -> Callable[..., Forecast]:
    """Let an `ahead` see numbers within the limits alone."""

    @wraps(ahead)
    def limited(
        self: Any, beliefs: Beliefs, tracks: Tracks, steps: int, scene: Scene | None = None
    ) -> Forecast:
        def forecast(tracks: Tracks, scene: Scene | None) -> Forecast:
            return ahead(self, beliefs, tracks, steps, scene)

        return _limited_forecast(forecast, tracks, scene)

    return limited


def _limited_forecast(
    forecast: Callable[[Tracks, Scene | None], Forecast], tracks: Tracks, scene: Scene | None
) -> Forecast:
    """Ask for a forecast with numbers within the limits, and add what was beyond them."""
    within = bounded(tracks, scene)
    if within is None:
        return forecast(tracks, scene)
    said = forecast(within.tracks, within.scene)
    reasons = tuple(
        "; ".join(filter(None, both)) or None
        for both in zip(within.reasons, said.fallback, strict=True)
    )
    return replace(said, dt=tracks.dt, fallback=reasons)


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

    The last law is kept here for every subclass: its `predict` (and `filtered`, `ahead`,
    `Adaptive.update`) is called with tracks and scene within the limits of
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
            "filtered": _filtered_within,
            "ahead": _ahead_within,
        }
        for name, within in limits.items():
            method = cls.__dict__.get(name)
            if callable(method) and not getattr(method, "__isabstractmethod__", False):
                setattr(cls, name, within(method))

    @abstractmethod
    def predict(self, tracks: Tracks, steps: int, scene: Scene | None = None) -> Forecast:
        """Forecast all obstacles ``steps`` steps of ``tracks.dt`` ahead."""

    def filtered(self, tracks: Tracks, before: Beliefs | None = None) -> Beliefs:
        """Return what a filter knows of all obstacles, see `Filtering`; here nothing."""
        return Beliefs.none()

    def ahead(
        self, beliefs: Beliefs, tracks: Tracks, steps: int, scene: Scene | None = None
    ) -> Forecast:
        """Forecast from what is filtered, see `Filtering`; here what `predict` does."""
        return self.predict(tracks, steps, scene)


class Filtering(Predictor):
    """A predictor that filters measurements, and goes on where it has come to.

    Its `predict` is `ahead(filtered(tracks), tracks, ...)`, a pure function of the tracks. Who
    forecasts again and again keeps what `filtered` returned and gives it back as ``before``: a
    cache that saves filtering old measurements again. Laws, beside those of `Predictor`:

    - with ``before`` of earlier tracks the forecast is the one without, but for rounding and for
      measurements that the tracks no longer hold;
    - it does not matter how often and when `filtered` was called before;
    - a belief is used only where its log is in the tracks' sightings (`Beliefs.continued`);
    - sightings on the grid give the forecast of the grid.

    Measurements are filtered at their own times (`Tracks.measured`), so that a brief sighting
    between two instants of the grid counts.
    """

    @abstractmethod
    def filtered(self, tracks: Tracks, before: Beliefs | None = None) -> Beliefs:
        """Return what is known of all obstacles after their newest measurements.

        Parameters
        ----------
        tracks : of the obstacles.
        before : what an earlier call returned, on this predictor or a copy that `Adaptive.update`
            made of it.
        """

    @abstractmethod
    def ahead(
        self, beliefs: Beliefs, tracks: Tracks, steps: int, scene: Scene | None = None
    ) -> Forecast:
        """Forecast all obstacles ``steps`` steps of ``tracks.dt`` ahead.

        Parameters
        ----------
        beliefs : what `filtered` returned for these tracks.
        tracks, steps, scene : as for `predict`.
        """

    @final
    def predict(self, tracks: Tracks, steps: int, scene: Scene | None = None) -> Forecast:
        """Forecast all obstacles; see `Predictor.predict`."""
        return self.ahead(self.filtered(tracks), tracks, steps, scene)


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
        """Return a copy that has learnt from the newest measurements.

        ``scene`` is what `predict` will be given next, for the forecasts made to be judged.
        """


class AdaptiveFiltering(Adaptive, Filtering):
    """A predictor that adapts while it runs, and filters once for `update` and `ahead`."""

    @abstractmethod
    def update(
        self, tracks: Tracks, scene: Scene | None = None, beliefs: Beliefs | None = None
    ) -> Self:
        """Return a copy that has learnt from the newest measurements; see `Adaptive.update`.

        ``beliefs`` are what `filtered` returned for these tracks; without them it filters itself.
        """

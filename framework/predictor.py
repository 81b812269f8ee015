"""The Predictor interface: tracks in, forecast out."""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import ClassVar, Self

from .forecast import Forecast, Scene
from .tracks import Tracks


class Predictor(ABC):
    """Says where each obstacle will be.

    A predictor is a frozen dataclass; its constructor arguments are its config. Laws,
    checked by `wideberth.framework.testing.check_predictor`:

    - pure: the same tracks give the same forecast, and nothing it is given is changed;
    - any history, however short or broken (NaN, one sample, none), gives a finite forecast
      with PSD covariances, and the reason in ``fallback`` where the named method could not
      be used; it never raises;
    - turning or shifting the tracks turns or shifts the forecast with them;
    - one call serves all obstacles, and what it says of one does not depend on their order.
    """

    reference: ClassVar[str] = ""
    """BibTeX key of the source, for ``wideberth cite``."""

    @abstractmethod
    def predict(self, tracks: Tracks, steps: int, scene: Scene | None = None) -> Forecast:
        """Forecast all obstacles ``steps`` steps of ``tracks.dt`` ahead."""


class Fittable(Predictor):
    """A predictor that learns from recorded tracks."""

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

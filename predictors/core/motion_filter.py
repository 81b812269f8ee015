"""A predictor that is the filter of one motion."""

from abc import abstractmethod
from collections.abc import Sequence
from functools import cached_property
from typing import TYPE_CHECKING, ClassVar, Self, final

from ...framework.predictor import Filtering, Fittable
from ...framework.values.beliefs import Beliefs
from ...framework.values.forecast import Forecast, Scene
from ...framework.values.tracks import Tracks
from .kalman_filter import Motion, filtered, forecast, started
from .pattern_search import Powers, fit_numbers


class MotionFilter(Filtering, Fittable):
    """Filters all obstacles at once under a `Motion`, and rolls it out over the horizon."""

    if TYPE_CHECKING:
        noise_floor: float  # a field of each subclass, which owns it as an option

    _name: ClassVar[str]
    _scaled: ClassVar[Powers]
    """What `fit` multiplies by powers of one number. The ratios stay: with them free, scenes left
    out of the fit were forecast worse, as noise against motion is a matter of each recording."""

    @abstractmethod
    def _moves(self) -> Motion:
        """Return how obstacles move."""

    @final
    @cached_property
    def _motion(self) -> Motion:
        return self._moves()

    def fit(self, dataset: Sequence[Tracks]) -> Self:
        """Return a copy fitted by `fit_numbers`; see `Fittable.fit`."""
        return fit_numbers(self, (self._scaled,), dataset)

    def filtered(self, tracks: Tracks, before: Beliefs | None = None) -> Beliefs:
        """Return the state of all obstacles under each mode; see `Filtering.filtered`."""
        return filtered(tracks, before, self._motion, self.noise_floor)

    def ahead(
        self, beliefs: Beliefs, tracks: Tracks, steps: int, scene: Scene | None = None
    ) -> Forecast:
        """Forecast all obstacles; see `Filtering.ahead`."""
        return forecast(started(beliefs, tracks, self._motion), steps, self._name)

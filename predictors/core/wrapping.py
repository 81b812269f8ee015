"""What predictors around another one share."""

from ...framework.predictor import Filtering, Predictor
from ...framework.values.beliefs import Beliefs
from ...framework.values.tracks import Tracks


class Wrapping(Filtering):
    """A predictor that changes what its base says; it filters what the base does."""

    base: Predictor

    def filtered(self, tracks: Tracks, before: Beliefs | None = None) -> Beliefs:
        """Return what the base knows of all obstacles; see `Filtering.filtered`."""
        return self.base.filtered(tracks, before)

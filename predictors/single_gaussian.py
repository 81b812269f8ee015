"""One Gaussian in place of several modes."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import ClassVar, Self, final

import numpy as np

from ..framework.predictor import Fittable, Predictor
from ..framework.values.arrays import Array
from ..framework.values.beliefs import Beliefs
from ..framework.values.forecast import Forecast, Scene
from ..framework.values.tracks import Tracks
from .core.assembly import refuse_adaptive
from .core.wrapping import Wrapping
from .mixture_density import MixtureDensity


@final
@dataclass(frozen=True)
class SingleGaussian(Wrapping, Fittable):
    """The forecast of another predictor with its modes merged into one Gaussian.

        mu = sum_k w_k mu_k,   Sigma = sum_k w_k (Sigma_k + (mu_k - mu) (mu_k - mu)')

    The mean and covariance are those of the mixture. An MPC then keeps clear of one region per
    obstacle. That costs less time, and less room where the modes overlap: each mode's own
    region has the content asked for, so that their union has more (99 % instead of 95 % for a
    `mixture_density` fitted to recorded people). Where modes lie far apart the merged region
    covers the free space between them too.

    Parameters
    ----------
    base : predictor whose modes are merged; `fit` fits it. One that adapts is refused.
    """

    base: Predictor = field(default_factory=MixtureDensity)

    reference: ClassVar[str] = ""

    def __post_init__(self) -> None:
        refuse_adaptive("single_gaussian.base", self.base)

    def fit(self, dataset: Sequence[Tracks]) -> Self:
        """Fit the base, where it can be fitted; see `Fittable.fit`."""
        base = self.base.fit(dataset) if isinstance(self.base, Fittable) else self.base
        return replace(self, base=base)

    def ahead(
        self, beliefs: Beliefs, tracks: Tracks, steps: int, scene: Scene | None = None
    ) -> Forecast:
        """Forecast all obstacles; see `Filtering.ahead`."""
        several = self.base.ahead(beliefs, tracks, steps, scene)
        weight = several.weight
        mean = np.einsum("om,omnd->ond", weight, several.mean)
        apart = several.mean - mean[:, None]
        covariance = _merged(weight, several.covariance, apart)
        source = None if several.joint_source is None else partial(_joint, several)
        return Forecast.single(mean, covariance, several.dt, several.fallback, source)


def _merged(weight: Array, covariance: Array, apart: Array) -> Array:
    """Sum of w_k (Sigma_k + a_k a_k') over the modes, (O, ..., D, D)."""
    spread = covariance + apart[..., :, None] * apart[..., None, :]
    return np.asarray(np.einsum("om,om...->o...", weight, spread))


def _joint(several: Forecast) -> Array:
    """Joint covariance of the merged modes, (O, 1, N*D, N*D)."""
    assert several.joint is not None
    obstacles, modes, steps, size = several.mean.shape
    flat = several.mean.reshape(obstacles, modes, steps * size)
    apart = flat - np.einsum("om,oma->oa", several.weight, flat)[:, None]
    return _merged(several.weight, several.joint, apart)[:, None]

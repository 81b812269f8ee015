"""A wrapper: where somebody is at some time within the next seconds, not at one instant."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import partial
from typing import ClassVar, final

import numpy as np

from ..framework.predictor import Predictor
from ..framework.values.arrays import Array, positive
from ..framework.values.forecast import Forecast, Scene
from ..framework.values.tracks import Tracks
from .constant_velocity import ConstantVelocity
from .core.assembly import both_reasons, refuse_adaptive

MOST = 40
"""Steps that the forecast is spread over; of tracks with finer steps it is a shorter time."""


@final
@dataclass(frozen=True)
class SpreadInTime(Predictor):
    """Spreads the forecast of another predictor over the way of the next seconds.

    Step i has the moments of where somebody is at t_i + T, with T drawn from 0, dt, .., c dt::

        mu_i = mean_j mu_{i+j},    Sigma_i = mean_j (Sigma_{i+j} + (mu_{i+j} - mu_i)(..)')

    over j = 0 .. c, c = ``span`` / dt to the nearest whole number, with mu and Sigma of the base;
    modes stay apart. A planner that keeps out of such regions does not step in front of people:
    it leaves them the way of their next ``span`` seconds.

    Of somebody who walks straight on, the deviation along the way is
    |v| c dt sqrt((c + 2) / (12 c)). So an ellipse of content 95 % reaches from before where he is
    at t_i to beyond where he is c dt later: 2.45 deviations, where half the way is at most 1.73.
    An ellipse of less content than 1 - exp(-3 c / (2 (c + 2))), 66 % for c = 5, may leave out the
    place at t_i itself: hold the full level at the steps that are driven next.

    Content is that of the place at t_i + T, so that a comparison with recorded places at t_i finds
    the regions too large and their middles ahead. Work is bounded: a ``span`` of more than `MOST`
    steps is cut to these, and one of at most half a step spreads nothing; the reason says so.

    Parameters
    ----------
    base : predictor that is asked for the steps of ``span`` seconds more. One that adapts is
        refused.
    span : s, above 0.

    Raises
    ------
    WideberthError : a span that is not above 0, or a base that adapts.
    """

    base: Predictor = field(default_factory=ConstantVelocity)
    span: float = 1.25

    reference: ClassVar[str] = ""

    def __post_init__(self) -> None:
        refuse_adaptive("spread_in_time.base", self.base)
        positive("spread_in_time.span", self.span)

    def predict(self, tracks: Tracks, steps: int, scene: Scene | None = None) -> Forecast:
        """Forecast all obstacles; see `Predictor.predict`."""
        later = round(min(self.span / tracks.dt, MOST))
        longer = self.base.predict(tracks, steps + later, scene)
        means = _shifted(longer.mean, steps, later)
        mean = means.mean(axis=0)
        covariance = _mixed(_shifted(longer.covariance, steps, later), means - mean)
        source = longer.joint_source
        joint: Callable[[], Array] | None = None
        if source is not None:
            joint = partial(_joint, longer, steps, later)
        return replace(
            longer,
            mean=mean,
            covariance=covariance,
            fallback=self._reasons(longer, later),
            joint_source=joint,
        )

    def _reasons(self, longer: Forecast, later: int) -> tuple[str | None, ...]:
        """Those of the base, and that the forecast was spread over less than was asked for."""
        spread = later * longer.dt
        if later and spread > self.span - longer.dt:
            return longer.fallback
        words = f"spread_in_time: over {spread:.3g} s of {self.span:g} s, {MOST} steps"
        if not later:
            few = f"{self.span:g} s is no more than half a step of {longer.dt:g} s"
            words = f"spread_in_time: over nothing, {few}"
        return tuple(both_reasons(words, deeper) for deeper in longer.fallback)


def _shifted(values: Array, steps: int, later: int) -> Array:
    """Values (O, M, N + c, ...) from each of the steps 0 .. c on, (c + 1, O, M, N, ...)."""
    return np.stack([values[:, :, j : j + steps] for j in range(later + 1)])


def _mixed(covariance: Array, apart: Array) -> Array:
    """Mean of Sigma_j + a_j a_j' over the first axis."""
    spread = covariance + apart[..., :, None] * apart[..., None, :]
    return np.asarray(spread.mean(axis=0))


def _joint(longer: Forecast, steps: int, later: int) -> Array:
    """Joint covariance of all steps, (O, M, N*D, N*D), where T is the same at all of them."""
    assert longer.joint is not None
    size = longer.mean.shape[-1]
    parts = [slice(j * size, (j + steps) * size) for j in range(later + 1)]
    flat = longer.mean.reshape(*longer.mean.shape[:2], -1)
    means = np.stack([flat[..., part] for part in parts])
    covariance = np.stack([longer.joint[..., part, part] for part in parts])
    return _mixed(covariance, means - means.mean(axis=0))

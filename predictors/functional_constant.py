"""One radius per step around all predicted people, within which all true ones are."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import ClassVar, Self, final

import numpy as np

from ..framework.predictor import Fittable, Predictor
from ..framework.values.arrays import Array, probability, whole
from ..framework.values.beliefs import Beliefs
from ..framework.values.coverage import Coverage, Event
from ..framework.values.forecast import Forecast, Scene, heeded
from ..framework.values.tracks import Tracks
from .calibrations.joint_plan import JointPlan
from .core.assembly import refuse_adaptive
from .core.calibration import Scales, known_scales, same_step, scaled, scored_in_time
from .core.history import IntArray
from .core.wrapping import Wrapping
from .data.windows import same_dimension
from .kalman import Kalman


@final
@dataclass(frozen=True)
class FunctionalConstant(Wrapping, Fittable):
    """Puts discs around the base's means that bound the distance to all people at once.

    D_h(x) >= P_h(x) - U_h  for all places x and steps h,   D = min_j |x - t_j|,
                                                              P = min_k |x - p_k|

    with t_j the true positions at step h, of those who were seen when the forecast was made or,
    with ``newcomers``, of all who are there, and p_k the predicted means, of all modes. The least
    U_h is known in closed form::

        sup_x (P_h(x) - D_h(x)) = max_j min_k |t_j - p_k|

    At x = t_j the left side is min_k |t_j - p_k|, as D is 0 there; and nowhere is it more, since
    with j the person nearest to x, |x - p_k| <= |x - t_j| + |t_j - p_k| for every k. No grid, no
    basis of functions and no mixture is needed. Every true person is within U_h of a predicted
    one, whichever that is: a person who walks where another was expected is covered.

    Newcomers make it another promise at another price. Recorded people appear at the edges of
    what is seen, far from everyone: at 10 %, U grows from 2.8 m to 17 m at half of 4.8 s, within
    which no robot finds a way. Without them nothing is promised of who appears, as by every other
    forecast of people.

    U_h is calibrated over all steps at once, as errors are by `JointPlan`: one score per moment,
    every N-th row, with the growth over the steps from the first half of the recordings. The
    forecast has the isotropic covariances whose region of content 1 - tail is the disc of radius
    U_h; for a disc, regions of the exact sum and of its ellipse are the same.

    The promise holds for moments at which someone is seen. Where no one is, there is no predicted
    person to be near to: P is infinite, and nothing is promised, with ``newcomers`` neither.

    Unfitted, the base's forecast stands. On another time grid U_h^2 is interpolated. Nothing
    bounds an episode.

    Parameters
    ----------
    base : predictor of the means.
    tail : probability that the bound fails somewhere, at any step.
    newcomers : whether people count who are first seen after the forecast.
    observed, steps : samples before and after "now" in `fit`.
    fitted : what `fit` has learnt; its scales are U_h^2 over the quantile of chi^2_D, m^2.

    Raises
    ------
    WideberthError : a tail outside (0, 1), a number of samples below 1, or a base that adapts.

    References
    ----------
    The event is that of functional conformal prediction, which bounds the same field by an
    envelope of principal components (Shin, Ra, Yang, "From Prediction Uncertainty to Conformalized
    Distance Fields for Safe Motion Planning", 2026).
    """

    base: Predictor = field(default_factory=Kalman)
    tail: float = 0.05
    newcomers: bool = False
    observed: int = 8
    steps: int = 12
    fitted: Scales | None = None

    reference: ClassVar[str] = "shin2026prediction"
    coverage: ClassVar[Coverage | None] = Coverage(
        Event.FIELD,
        "at least 1 - tail over the draw of data and future together",
        "moments one horizon apart with people in sight are exchangeable, a new one with those of "
        "the fit; of those who appear after the forecast it is promised with newcomers alone",
        reference,
    )

    def __post_init__(self) -> None:
        refuse_adaptive("functional_constant.base", self.base)
        probability("functional_constant.tail", self.tail)
        for name in ("observed", "steps"):
            whole(f"functional_constant.{name}", getattr(self, name))

    def fit(self, dataset: Sequence[Tracks]) -> Self:
        """Fit the base to the first halves of the recordings and calibrate on the second ones.

        Raises
        ------
        WideberthError : fewer moments than the calibration needs; scenes that differ in dt or
            dimension; what the base refuses.
        """
        same_step(dataset, "functional_constant")
        same_dimension(dataset, "functional_constant")
        judge = of_everyone if self.newcomers else of_those_seen
        base, learnt, scores = scored_in_time(self.base, dataset, self.observed, self.steps, judge)
        size, who = dataset[0].dimension, "functional_constant"
        fitted = known_scales(JointPlan(), scores, self.tail, learnt, size, who)
        return replace(self, base=base, fitted=fitted)

    def ahead(
        self, beliefs: Beliefs, tracks: Tracks, steps: int, scene: Scene | None = None
    ) -> Forecast:
        """Forecast all obstacles; see `Filtering.ahead`."""
        forecast = self.base.ahead(beliefs, tracks, steps, scene)
        if self.fitted is None:
            return forecast
        unit = np.broadcast_to(np.eye(tracks.dimension), forecast.covariance.shape)
        bare = replace(forecast, covariance=unit, joint_source=None)
        return scaled(bare, np.array(self.fitted.scale), self.fitted.dt, tracks)


def of_everyone(forecast: Forecast, present: IntArray, future: Array) -> Array:
    """Squared sup over places of the predicted distance less the true one, (1, N), m^2.

    (max_j min_k |t_j - p_k|)^2, over all who are there and all modes that plans heed; 0 where
    no one is.
    """
    means = forecast.mean[heeded(forecast.weight)]
    apart = np.sum((future[:, None] - means) ** 2, axis=-1)  # (J, K, N)
    return np.asarray(np.fmax.reduce(apart.min(axis=1), axis=0, initial=0.0))[None]


def of_those_seen(forecast: Forecast, present: IntArray, future: Array) -> Array:
    """`of_everyone` of those who were seen when the forecast was made."""
    return of_everyone(forecast, present, future[present])

"""Split conformal calibration: regions of the stated content, whatever the forecasts are worth."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import ClassVar, Self, final

import numpy as np

from ..framework.predictor import Fittable, Predictor
from ..framework.tracking.windows import windows_of
from ..framework.values.arrays import Array, checked, positive, probability, whole
from ..framework.values.coverage import Coverage, Event
from ..framework.values.errors import WideberthError
from ..framework.values.forecast import Forecast, Scene
from ..framework.values.tracks import Tracks
from ..metrics.episode import SMALLEST, content_bound
from .core.assembly import refuse_adaptive
from .core.calibration import replayed, same_step, scaled, squared_distances
from .empirical import Empirical


@dataclass(frozen=True)
class Scales:
    """Scales learnt by split conformal calibration.

    Attributes
    ----------
    dt : s, between the steps.
    scale : (N,), by which the covariance of each step is multiplied.
    windows : how many it was learnt from.

    Raises
    ------
    WideberthError : no step, or a number that is not above 0.
    """

    dt: float
    scale: tuple[float, ...]
    windows: int

    def __post_init__(self) -> None:
        positive("scales.dt", self.dt)
        scale = checked("scales.scale", self.scale, (len(self.scale),))
        if not scale.size or (scale <= 0).any():
            raise WideberthError("scales.scale must hold one number at least, and all above 0")


@final
@dataclass(frozen=True)
class Conformal(Fittable):
    """Scales the covariances of a base predictor so that the regions of one tail hold.

    Sigma_h -> s_h Sigma_h,   s_h = d^2_(k),h / q_D,   k = ceil((n + 1)(1 - tail))

    with d^2_(k),h the k-th smallest of the squared Mahalanobis distances of n calibration
    futures at step h from their forecasts, and q_D the quantile of chi^2_D at 1 - tail. The
    ellipse of content 1 - tail of the scaled Gaussian then holds a new future at step h with
    probability 1 - tail at least (and at most 1 / (n + 1) more), if new futures and those of
    calibration are exchangeable. A new site breaks that, and overlapping windows of one track
    weaken it: `AdaptiveConformal` follows the site instead.

    The scale is right for this one tail; errors have heavier tails than a Gaussian, so that
    regions of other contents are not. With ``joint`` the largest distance over the steps
    takes the place of d^2_h: one scale for all steps, and all N ellipses together hold the
    future with probability 1 - tail. Forecasts with several modes are scored by the nearest
    mode, which makes the guarantee one of the union of the modes' ellipses, that a planner keeps
    clear of. Their region of highest density is smaller and holds less (`AdaptiveConformal`
    calibrates that one; `single_gaussian` around the base makes the two the same).

    A base that can be fitted is fitted to every other track of the dataset (the first, the
    third, ..., counted through all scenes), and the rest serve to calibrate; a base that
    cannot leaves all to calibrate.
    Unfitted, the base's forecast stands. On another time grid scales are interpolated.

    Parameters
    ----------
    base : predictor to calibrate.
    tail : of the region that is to hold.
    joint : whether over all steps at once.
    observed, steps : samples of the windows in `fit`, before and after "now".
    fitted : what `fit` has learnt.

    Raises
    ------
    WideberthError : a tail outside (0, 1), a number of samples below 1, or a base that adapts.

    References
    ----------
    Vovk, Gammerman, Shafer, "Algorithmic Learning in a Random World", 2005. Lindemann et
    al., "Safe Planning in Dynamic Environments using Conformal Prediction", RA-L 2023, for
    forecasts of several steps.
    """

    base: Predictor = field(default_factory=Empirical)
    tail: float = 0.05
    joint: bool = False
    observed: int = 8
    steps: int = 12
    fitted: Scales | None = None

    reference: ClassVar[str] = "lindemann2023safe"
    coverage: ClassVar[Coverage] = Coverage(
        Event.STEP,
        "at least 1 - tail over the draw of both the data of the fit and the future",
        "futures are exchangeable with the windows of the fit",
        reference,
    )

    def __post_init__(self) -> None:
        refuse_adaptive("conformal.base", self.base)
        probability("conformal.tail", self.tail)
        for name in ("observed", "steps"):
            whole(f"conformal.{name}", getattr(self, name))

    def fit(self, dataset: Sequence[Tracks]) -> Self:
        """Fit the base to one half of the tracks and calibrate it on the other.

        Raises
        ------
        WideberthError : fewer windows to calibrate than ceil(1 / tail) - 1, of which no
            quantile is known; scenes that differ in dt or dimension; what the base refuses.
        """
        same_step(dataset, "conformal")
        base, chosen = self.base, [list(range(len(scene))) for scene in dataset]
        if isinstance(base, Fittable):
            learning, chosen = _halves(dataset)
            base = base.fit([s.select(half) for s, half in zip(dataset, learning, strict=True)])
        kept = [scene.select(half) for scene, half in zip(dataset, chosen, strict=True)]
        fewest = math.ceil(1 / self.tail - 1e-9) - 1
        windows = windows_of(kept, self.observed, self.steps, wanted=fewest, who="conformal")
        distances = []
        for scene, found, half in zip(dataset, windows, chosen, strict=True):
            if len(found):
                whole_scene = replace(found, obstacle=np.array(half)[found.obstacle])
                parts = replayed(base, scene, whole_scene)
                distances.append(squared_distances(*parts, found.future))
        scale = self._scale(np.concatenate(distances), dataset[0].dimension)
        fitted = Scales(dataset[0].dt, tuple(scale.tolist()), sum(map(len, distances)))
        return replace(self, base=base, fitted=fitted)

    def _scale(self, distances: Array, size: int) -> Array:
        """Scale of each step, (N,), from squared distances (n, N)."""
        if self.joint:
            distances = np.repeat(distances.max(axis=1)[:, None], self.steps, axis=1)
        count = len(distances)
        rank = min(math.ceil((count + 1) * (1 - self.tail) - 1e-9), count)
        # A base that is exactly right on all windows would leave a region without interior.
        quantile = np.maximum(np.sort(distances, axis=0)[rank - 1], SMALLEST)
        return np.asarray(quantile / content_bound(size, self.tail))

    def predict(self, tracks: Tracks, steps: int, scene: Scene | None = None) -> Forecast:
        """Forecast all obstacles; see `Predictor.predict`."""
        forecast = self.base.predict(tracks, steps, scene)
        if self.fitted is None:
            return forecast
        return scaled(forecast, np.array(self.fitted.scale), self.fitted.dt, tracks)


def _halves(dataset: Sequence[Tracks]) -> tuple[list[list[int]], list[list[int]]]:
    """Deal the tracks of all scenes to two halves in turn: indices per scene."""
    owner = np.cumsum([0, *(len(scene) for scene in dataset)])
    first, second = (
        [
            [i for i in range(len(scene)) if (start + i) % 2 == parity]
            for start, scene in zip(owner[:-1], dataset, strict=True)
        ]
        for parity in (0, 1)
    )
    return first, second

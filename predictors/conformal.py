"""Split conformal calibration: regions of the stated content, whatever the forecasts are worth."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import ClassVar, Self, final

import numpy as np

from ..framework.calibration import Calibration, CalibrationScores, MomentCalibration
from ..framework.predictor import Fittable, Predictor
from ..framework.values.arrays import probability, whole
from ..framework.values.beliefs import Beliefs
from ..framework.values.coverage import Coverage
from ..framework.values.forecast import Forecast, Scene
from ..framework.values.tracks import Tracks
from .calibrations.per_step import PerStep
from .core.assembly import refuse_adaptive
from .core.calibration import Scales, known_scales, same_step, scaled, scored, scored_in_time
from .core.wrapping import Wrapping
from .data.windows import same_dimension
from .empirical import Empirical


@final
@dataclass(frozen=True)
class Conformal(Wrapping, Fittable):
    """Scales the covariances of a base predictor so that regions keep a promise.

        Sigma_h -> s_h Sigma_h,   s_h = q_h / q_D

    with q_h the squared size of the region of step h, in units of the base's covariance, by which
    the ``calibration`` keeps its promise on data, and q_D the quantile of chi^2_D at 1 - tail:
    the ellipse of content 1 - tail of the scaled Gaussian then is that region. Which event is
    promised, one person at one step, all people at all steps or a whole task, and what has to be
    exchangeable for it, the calibration states (`Calibration.coverage`). None but `WholeTask`
    bounds an episode.

    The scale is right for this one tail; errors have heavier tails than a Gaussian, so that
    regions of other contents are not. A new site breaks exchangeability: `AdaptiveConformal`
    follows the site instead. People who react to the robot break it too.

    Forecasts with several modes are scored by the nearest mode, which makes the guarantee one of
    the union of the modes' ellipses, that a planner keeps clear of. Their region of highest
    density is smaller and holds less (`AdaptiveConformal` calibrates that one; `single_gaussian`
    around the base makes the two the same).

    What the base is fitted to serves nothing else. For a calibration of single windows, a base
    that can be fitted is fitted to every other track of the dataset (the first, the third, ...,
    counted through all scenes), and the rest calibrate; a base that cannot leaves all to
    calibrate. For a `MomentCalibration`, of which no person may be missing, each recording is cut
    in time: its first half is for the base and for how errors grow over the steps, its second
    half calibrates. A new moment is exchangeable with those of the second halves, of which the
    base and the growth know nothing; if recordings drift, so that the second half is unlike what
    comes, it is not.

    Unfitted, the base's forecast stands. On another time grid scales are interpolated.

    Parameters
    ----------
    base : predictor to calibrate.
    tail : probability that the calibration's event is missed.
    calibration : which event, and how it is calibrated.
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
    calibration: Calibration = field(default_factory=PerStep)
    observed: int = 8
    steps: int = 12
    fitted: Scales | None = None

    reference: ClassVar[str] = "lindemann2023safe"

    @property
    def coverage(self) -> Coverage:  # type: ignore[override]
        """What its regions of content 1 - tail promise, fitted: its calibration's promise."""
        return self.calibration.coverage

    def __post_init__(self) -> None:
        refuse_adaptive("conformal.base", self.base)
        probability("conformal.tail", self.tail)
        for name in ("observed", "steps"):
            whole(f"conformal.{name}", getattr(self, name))

    def fit(self, dataset: Sequence[Tracks]) -> Self:
        """Fit the base to one half of the data and calibrate it on the other.

        Raises
        ------
        WideberthError : fewer groups of forecasts than the calibration needs; scenes that differ
            in dt or dimension; what the base refuses.
        """
        same_step(dataset, "conformal")
        same_dimension(dataset, "conformal")
        if isinstance(self.calibration, MomentCalibration):
            base, learnt, scores = scored_in_time(self.base, dataset, self.observed, self.steps)
        else:
            learnt = None
            base, scores = self._scored_by_track(dataset)
        size = dataset[0].dimension
        fitted = known_scales(self.calibration, scores, self.tail, learnt, size, "conformal")
        return replace(self, base=base, fitted=fitted)

    def _scored_by_track(self, dataset: Sequence[Tracks]) -> tuple[Predictor, CalibrationScores]:
        """Return the base, fitted to half of the tracks if it can be, and scores of the rest."""
        base, chosen = self.base, [list(range(len(scene))) for scene in dataset]
        if isinstance(base, Fittable):
            learning, chosen = _halves(dataset)
            base = base.fit([s.select(half) for s, half in zip(dataset, learning, strict=True)])
        spans = [range(scene.positions.shape[1]) for scene in dataset]
        scores = scored(base, dataset, spans, self.observed, self.steps)
        pairs = zip(scores.recording.tolist(), scores.track.tolist(), strict=True)
        owned = [set(half) for half in chosen]
        own = [number for number, (scene, track) in enumerate(pairs) if track in owned[scene]]
        return base, scores.select(own)

    def ahead(
        self, beliefs: Beliefs, tracks: Tracks, steps: int, scene: Scene | None = None
    ) -> Forecast:
        """Forecast all obstacles; see `Filtering.ahead`."""
        forecast = self.base.ahead(beliefs, tracks, steps, scene)
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

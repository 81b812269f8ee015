"""The true future, from the simulation or the recording: the upper bound for predictors."""

from dataclasses import dataclass, field
from functools import partial
from typing import ClassVar, final

import numpy as np

from ..framework.predictor import Predictor
from ..framework.values.arrays import Array, positive
from ..framework.values.forecast import Forecast, Scene
from ..framework.values.motion import Truth
from ..framework.values.tracks import Tracks
from .core.assembly import Gaussians, refuse_adaptive, with_fallback
from .kalman import Kalman


@final
@dataclass(frozen=True)
class Oracle(Predictor):
    """Read the future from ``scene.truth``.

    mu_h = p(stamp + h dT) by linear interpolation of the truth,   Sigma_h = spread^2 I

    For scripted obstacles and recordings this is what will happen. People are simulated in a copy
    of the world while the robot keeps to its last plan (`Settings.truth_passes`: to the plan that
    it makes against that), and other robots to theirs: what they will do, but for what the robot
    plans anew. Another robot has no decided future: the simulation grants its current plan, which
    it may still change. The same holds for people of whom no copy can be made.

    An obstacle without truth, or whose truth does not reach over the whole horizon, is left
    to ``fallback``, with the reason.

    Parameters
    ----------
    spread : m, standard deviation; small but above zero, so that regions have an inside.
    fallback : predictor for what the truth does not tell.

    Raises
    ------
    WideberthError : a spread that is not positive.
    """

    spread: float = 0.001
    fallback: Predictor = field(default_factory=Kalman)

    reference: ClassVar[str] = ""

    def __post_init__(self) -> None:
        refuse_adaptive("oracle.fallback", self.fallback)
        positive("oracle.spread", self.spread)

    def predict(self, tracks: Tracks, steps: int, scene: Scene | None = None) -> Forecast:
        """Forecast all obstacles; see `Predictor.predict`."""
        truth = None if scene is None else scene.truth
        ahead = tracks.dt * np.arange(1, steps + 1)
        times = np.asarray(tracks.stamp + ahead, dtype=np.float64)
        count, size = len(tracks), tracks.dimension
        paths = [self._one(truth, ident, times) for ident in tracks.ids]
        missing = [path if isinstance(path, str) else None for path in paths]
        mean = np.zeros((count, steps, size))
        for place, path in enumerate(paths):
            if not isinstance(path, str):
                mean[place] = path
        covariance = np.tile(self.spread**2 * np.eye(size), (count, steps, 1, 1))
        joint = partial(_joint, self.spread**2, count, steps * size)
        own = Gaussians(mean, covariance, (None,) * count, joint)
        return with_fallback(own, missing, self.fallback, tracks, scene)

    def _one(self, truth: Truth | None, ident: str, times: Array) -> Array | str:
        """Positions at these times, (N, D), or why they are not known."""
        if truth is None:
            return "oracle: no truth given"
        if ident not in truth.positions:
            return f"oracle: the truth does not hold {ident}"
        path = np.asarray(truth.positions[ident], dtype=np.float64)
        known = np.isfinite(path).all(axis=1)
        clock, path = np.asarray(truth.times)[known], path[known]
        # A clock of seconds since 1970 resolves 2e-7 s; the grid may miss its end by that.
        if not clock.size or times[0] < clock[0] - 1e-6 or times[-1] > clock[-1] + 1e-6:
            span = f"{clock[0]:.10g} to {clock[-1]:.10g} s" if clock.size else "nothing"
            return f"oracle: the truth spans {span}, needs {times[0]:.10g} to {times[-1]:.10g} s"
        return np.stack([np.interp(times, clock, column) for column in path.T], axis=1)


def _joint(variance: float, count: int, flat: int) -> Array:
    return np.tile(variance * np.eye(flat), (count, 1, 1))

"""Adaptive conformal prediction in a planner that samples paths (ACP)."""

from dataclasses import dataclass
from typing import ClassVar, final

import numpy as np

from wideberth.framework.values.arrays import Array, positive, probability, whole

from .sampled_paths import SampledController, SampledPaths, SeenPeople, clearance

FASTEST = 1.5
"""m/s; a score cannot be larger than this times the time ahead."""
SCORES = 12
"""Scores of one step that a published radius is made of."""
EPISODE = 100
"""Rows of an episode, of which one process of the published code runs several."""
NEWEST = 200
"""Scores of one step that are kept."""


@final
@dataclass(eq=False)
class AdaptiveConformalPlanner(SampledController):
    """Keeps clear of discs around forecasts whose radii adapt to how often they were left.

    The score of step i is the largest error, over the people, of the forecast made i steps ago.
    The radius R_i is the 1 - alpha_i quantile of its scores, and alpha_i follows the misses (Gibbs
    and Candes 2021)::

        alpha_i <- alpha_i + gamma (alpha - 1{score_i > R_i when it was forecast})

    so that in the long run a share of alpha of the steps has someone outside: a promise for each
    step ahead, over time, and for all people at once. A path is allowed where it is farther than
    both bodies' radii and R_i from every forecast at every step.

    With ``as_published``, beside the fault of `SampledController`:

    - R_i is made of `SCORES` numbers: its own scores and bounds of 1.5 m/s at first, later ones
      drawn from its scores with replacement, by NumPy's global generator. That is seeded once per
      process, so that an episode depends on those before it (``earlier``);
    - the quantile is interpolated between two scores; the finite-sample one has the rank
      ceil((n + 1) (1 - alpha_i)) of n;
    - where no one of a forecast is left to compare with, the score is 0.

    Otherwise R_i is the rank quantile of the newest `NEWEST` scores, and the bound where the rank
    is larger than their number; without anyone to compare with there is no score.

    Parameters
    ----------
    tail : alpha.
    rate : gamma.
    earlier : episodes of `EPISODE` decisions that the process ran before, as published.
    robot, predictor, period, steps, paths, seed, as_published : as in `SampledController`.

    Raises
    ------
    WideberthError : a number out of range.

    References
    ----------
    A. Dixit et al., Adaptive conformal prediction for motion planning among dynamic agents, L4DC
    2023; the code is that of CORE-SNU/FCP-MPC, which compares with it.
    """

    reference: ClassVar[str] = "dixit2023adaptive"

    tail: float = 0.2
    rate: float = 0.05
    earlier: int = 0

    def __post_init__(self) -> None:
        probability("AdaptiveConformalPlanner.tail", self.tail)
        positive("AdaptiveConformalPlanner.rate", self.rate, zero=True)
        whole("AdaptiveConformalPlanner.earlier", self.earlier, least=0)
        super().__post_init__()

    def forget(self) -> None:
        """Drop scores, radii and misses."""
        self._alpha = np.full(self.steps, self.tail)
        self._bound = FASTEST * self.period * np.arange(1.0, self.steps + 1.0, dtype=np.float64)
        self._scores: list[list[float]] = [[] for _ in range(self.steps)]
        self._radius = self._bound
        self._past: dict[int, tuple[SeenPeople, Array]] = {}
        # Its draws depend on the numbers of scores alone.
        self._global = np.random.RandomState(self.seed)
        if self.as_published:
            for _ in range(self.earlier):
                for count in range(EPISODE):
                    for step in range(self.steps):
                        self._resampled([0.0] * max(0, count - step), 0.0)

    def learn(self, seen: SeenPeople, place: Array) -> None:
        """Score the forecasts that have fallen due, and set the radii."""
        scores = self._due(seen)
        for step, score in scores.items():
            self._scores[step - 1] = [*self._scores[step - 1], score][-NEWEST:]
        radii = [self._quantile(step) for step in range(self.steps)]
        self._radius = np.array(radii, dtype=np.float64)
        for step, score in scores.items():
            covered = score <= self._past[seen.row - step][1][step - 1]
            # In this order, since alpha may come to 0 but for the last digit.
            self._alpha[step - 1] += self.rate * (self.tail - 1.0 + covered)
        self._past[seen.row] = seen, self._radius
        self._past = {row: one for row, one in self._past.items() if row > seen.row - self.steps}

    def _due(self, seen: SeenPeople) -> dict[int, float]:
        """Return the score of each step, counted from 1, that has fallen due."""
        scores = {}
        for step in range(1, self.steps + 1):
            if seen.row - step not in self._past:
                continue
            now, forecast, _ = seen.with_past(self._past[seen.row - step][0], step)
            errors = np.sqrt(np.sum((forecast - now) ** 2, axis=-1))
            if len(errors) or self.as_published:
                scores[step] = float(errors.max(initial=0.0))
        return scores

    def _quantile(self, step: int) -> float:
        """Return the radius of a step, counted from 0, m."""
        alpha, bound, scores = self._alpha[step], self._bound[step], self._scores[step]
        if self.as_published:
            values = self._resampled(scores, bound)
            if 0.0 < alpha < 1.0:
                return float(np.quantile(values, 1.0 - alpha))
            return float(bound) if alpha <= 0.0 else 0.0
        rank = int(np.ceil((len(scores) + 1) * (1.0 - alpha) - 1e-9))
        if rank > len(scores):
            return float(bound)
        return sorted(scores)[rank - 1] if rank > 0 else 0.0

    def _resampled(self, scores: list[float], bound: float) -> Array:
        """Return the scores that a published radius is made of."""
        missing = SCORES - len(scores)
        if missing > 0:
            bounds = self._global.choice([bound] * SCORES, size=missing)
            return np.concatenate([scores, bounds])
        return np.asarray(self._global.choice(scores, size=SCORES), dtype=np.float64)

    def slowest(self, fastest: float) -> float:
        """As fast backwards."""
        return -fastest

    def cost(self, paths: SampledPaths, goal_cost: Array, seen: SeenPeople) -> Array:
        """Forbid paths that come too near to a forecast."""
        room = clearance(paths.points[:, 1:], seen.ahead, seen.radius) - self.robot.radius
        return np.where((room >= self._radius).all(axis=1), goal_cost, np.inf)

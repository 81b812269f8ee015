"""Functional conformal prediction in a planner that samples paths (FCP)."""

from dataclasses import dataclass
from typing import ClassVar, final

import numpy as np

from wideberth.framework.values.arrays import Array

from .functional_envelope import OUTSIDE, FunctionalEnvelope
from .sampled_paths import SampledController, SampledPaths, SeenPeople, Singles, clearance

SOFT = 100.0
"""Weight of a squared shortfall, 1/m^2, where paths that come too near are only dearer."""


@final
@dataclass(eq=False)
class FunctionalConformalPlanner(SampledController):
    """Keeps its distance from people, less by what the forecast's distances may be too large.

    With D_pred,h the distance to the nearest prediction and U_h the envelope of `EnvelopeFit`,
    the distance to the nearest person at step h is at least max(D_pred,h - U_h, 0) at every place,
    with the envelope's probability for that step. What a path lacks there,

        s_h = max(0, r_h - max(D_pred,h(p_h) - U_h(p_h), 0)),    r_h = r + r_d,

    is forbidden (hard), or costs `SOFT` times the sum of the squares (soft).

    With ``as_published``, beside the fault of `SampledController`,

        r_h = max(0, r + r_d - v_max w_max ((h - 1) dt)^2 / 2)

    "since later steps are planned anew": with the published limits and steps nothing is kept
    at the last 7 of 12 steps, and less than the bodies from the second on. The other published
    faults are not the planner's: it is calibrated on the rows that it is tested on, and in all
    episodes of a recording with the grid of the first one, whose cells then lie elsewhere.

    Off its grid the envelope is 1 m, as published, and everywhere without an envelope; nothing is
    promised there. People of different sizes are as large as the largest at his surface.

    Parameters
    ----------
    envelope : U, calibrated; its steps are those of the paths.
    soft : whether paths that come too near are allowed at a cost.
    robot, predictor, period, steps, paths, seed, as_published : as in `SampledController`.

    Raises
    ------
    WideberthError : a number out of range.

    References
    ----------
    "From Prediction Uncertainty to Conformalized Distance Fields for Safe Motion Planning",
    arXiv 2607.00776; the code is that of CORE-SNU/FCP-MPC.
    """

    reference: ClassVar[str] = "shin2026prediction"

    envelope: FunctionalEnvelope | None = None
    soft: bool = False

    def forget(self) -> None:
        """Nothing is learnt while it drives."""

    def learn(self, seen: SeenPeople, place: Array) -> None:
        """Nothing is learnt while it drives."""

    def slowest(self, fastest: float) -> float:
        """As fast backwards."""
        return -fastest

    def cost(self, paths: SampledPaths, goal_cost: Array, seen: SeenPeople) -> Array:
        """Forbid paths that come too near to people, or make them dearer."""
        lack = self.shortfall(paths.points[:, 1:], seen)
        if self.soft:
            return np.asarray(goal_cost + SOFT * (lack**2).sum(axis=1))
        return np.where((lack > 0.0).any(axis=1), np.inf, goal_cost)

    def shortfall(self, points: Array | Singles, seen: SeenPeople) -> Array:
        """Return what points (P, N, 2), m, lack of the distance that is to be kept, (P, N), m."""
        largest = float(seen.radius.max(initial=0.0))
        distance = clearance(points, seen.ahead, seen.radius) + largest
        known = np.maximum(distance - self._upper(points), 0.0)
        kept = np.full(self.steps, self.robot.radius + largest)
        if self.as_published:
            speed, turning = self._limits
            kept -= 0.5 * speed * turning * (self.period * np.arange(self.steps)) ** 2
        return np.asarray(np.maximum(np.maximum(kept, 0.0) - known, 0.0))

    def _upper(self, points: Array | Singles) -> Array:
        """U at points (P, N, 2), m, (P, N)."""
        if self.envelope is None:
            return np.full(points.shape[:2], OUTSIDE)
        places = np.asarray(points, dtype=np.float64)
        return np.stack([self.envelope.at(places[:, h], h) for h in range(self.steps)], axis=1)

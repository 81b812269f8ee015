"""Conformal control of a planner that samples paths (CC): the weight of distance adapts."""

from dataclasses import dataclass
from typing import ClassVar, final

import numpy as np

from wideberth.framework.values.arrays import Array, number, positive

from .sampled_paths import SampledController, SampledPaths, SeenPeople, clearance

LEAST = 0.01
"""Below which the weight does not fall."""


@final
@dataclass(eq=False)
class ConformalController(SampledController):
    """Weighs the distance to people the more, the nearer they were on average.

    The cheapest path is driven, none is forbidden; with d_k the distance from the nearest
    forecast at step k a path costs

        J - lambda sum_k d_k,    lambda <- max(lambda - eta (epsilon - loss), `LEAST`)

    where loss is minus the distance to the nearest person now. In the long run the average loss
    is at most epsilon, that is, the nearest person is ``-epsilon`` m away on average: a promise
    over time alone, of no step and no person.

    With ``as_published`` it keeps the fault of `SampledController`, and no other. What its loop
    does wrong, the arrival that is overwritten at every later row within the tolerance, is a
    setting of the study that plays it.

    Parameters
    ----------
    risk : epsilon, m.
    rate : eta, 1/m^2.
    weight : lambda at first, 1/m.
    robot, predictor, period, steps, paths, seed, as_published : as in `SampledController`.

    Raises
    ------
    WideberthError : a number out of range.

    References
    ----------
    J. Lekeufack et al., Conformal decision theory: safe autonomous decisions from imperfect
    predictions, ICRA 2024; the code is that of CORE-SNU/FCP-MPC, which compares with it.
    """

    reference: ClassVar[str] = "lekeufack2024conformal"

    risk: float = -2.0
    rate: float = 5000.0
    weight: float = 1.0

    def __post_init__(self) -> None:
        number("ConformalController.risk", self.risk)
        positive("ConformalController.rate", self.rate, zero=True)
        positive("ConformalController.weight", self.weight)
        super().__post_init__()

    def forget(self) -> None:
        """Take the first weight again."""
        self._next = self._weight = self.weight

    def learn(self, seen: SeenPeople, place: Array) -> None:
        """Take the weight that followed from the last instant, and let this one set the next."""
        self._weight = self._next
        now = seen.now[np.isfinite(seen.now).all(axis=1)]
        if len(now):
            with np.errstate(over="ignore"):  # a distance too large to square is infinite
                nearest = np.sqrt(np.sum((place - now) ** 2, axis=-1)).min()
            self._next = max(LEAST, self._weight - self.rate * float(self.risk + nearest))

    def slowest(self, fastest: float) -> float:
        """As fast backwards."""
        return -fastest

    def cost(self, paths: SampledPaths, goal_cost: Array, seen: SeenPeople) -> Array:
        """Reward distance from the people."""
        if not seen.names:
            return goal_cost
        away = clearance(paths.points[:, 1:], seen.ahead, np.zeros(len(seen.names)))
        return np.asarray(goal_cost - self._weight * away.sum(axis=-1))

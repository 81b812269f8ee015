"""Where a robot may stand at the end of its plan: a terminal set for moving obstacles.

A plan that ends at rest is a plan one step later too: what is left of it, and one more step of
standing. It keeps every region of the next problem if

1. the new forecast lies within the old one: its region at each step i = 1..N within the old one's
   at step i + 1, and
2. the place where the plan ends lies outside of the old region at step N + 1.

The first is for the forecast to keep. The second is a constraint of the problem that the solver is
given: at step N the region of an obstacle is replaced by one that holds those of steps N..N + M.
With M = 1 the next problem has a plan, the shifted last one; with a larger M the robot may go on
standing for M steps. How an obstacle moves and how its region grows meanwhile is the forecast's.
Plans are verified against the regions of steps 1..N alone: what the next decision needs is no duty
of this one, and with soft regions it is given up at the same price.

**The region that holds the others.** The Gaussians of steps N..N + M have means c + w_j around the
middle c of the first and the last, and covariances below J, in the order of matrices. Let
w_j w_j^T <= W for all j. Their ellipses of level s lie within that of J, moved by a vector of the
ellipse of W, and so, for any t > 0, within the ellipse of level s of

    N(c, (1 + 1/t) J + (1 + t) W / s^2),    t^2 = s^2 tr J / tr W,

which is the smallest by its trace. Its sum with the disc of the margin then holds their sums. A
region within that sum, such as `MahalanobisEllipse`, may miss as much as it differs from it.

Sung, Ham, Park, Ren and Ahn (PRF-MPC, arXiv 2605.19015) instead enlarge the regions of all steps,
for predictors whose next forecast is distributed as this one says; here the next forecast has to
lie within this one, and nothing but the last step is enlarged.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...values.arrays import Array
from ...values.roots import reduced

_LEAST = 1e-12
"""m^2, so that nothing is divided by an ellipse without size."""


class EndOfPlan(NamedTuple):
    """What holds the Gaussians of O discs from the plan's end on, whatever the level.

    Attributes
    ----------
    middle : (O, D), m. covariance : J, (O, D, D), m^2. way : W, (O, D, D), m^2.
    """

    middle: Array
    covariance: Array
    way: Array

    @classmethod
    def of(cls, mean: Array, covariance: Array) -> "EndOfPlan":
        """Hold Gaussians of M + 1 steps, (M + 1, O, D) in m and (M + 1, O, D, D) in m^2."""
        joined = covariance[0]
        for one in covariance[1:]:
            joined = joined + reduced(one - joined)
        middle = 0.5 * (mean[0] + mean[-1])
        apart = mean - middle
        squares = apart[..., :, None] * apart[..., None, :]
        way = squares.sum(axis=0)
        # the sum holds each, and a share of it does so too
        inverse = np.linalg.pinv(way, hermitian=True)
        share = np.einsum("moi,oij,moj->mo", apart, inverse, apart).max(axis=0)
        return cls(middle, joined, share[:, None, None] * way)

    def some(self, which: NDArray[np.intp]) -> "EndOfPlan":
        """Return those of some of the discs, by their indices."""
        return EndOfPlan(*(one[which] for one in self))

    def at(self, level: Array) -> tuple[Array, Array]:
        """Mean (O, D) and covariance (O, D, D) of a Gaussian that holds all at levels (O,)."""
        way = self.way / np.maximum(level, _LEAST)[:, None, None] ** 2
        traces = (np.trace(one, axis1=1, axis2=2) + _LEAST for one in (self.covariance, way))
        first, second = traces
        t = np.sqrt(first / second)[:, None, None]
        return self.middle, (1.0 + 1.0 / t) * self.covariance + (1.0 + t) * way

"""The unscented Kalman filter of the planar motion model."""

from dataclasses import dataclass
from typing import ClassVar, final

import numpy as np

from wideberth.framework.values.arrays import Array

from .model import SIZE, moved
from .planar import PlanarFilter


@final
@dataclass(eq=False)
class Ukf(PlanarFilter):
    """Unscented Kalman filter: mean and covariance are carried by 19 points.

    With n = 9 and the columns r_i of the root of n P, the points are x and x +- r_i, the scaled
    ones of van der Merwe with alpha = 1, beta = 2, kappa = 0::

        x <- sum w_j f(X_j)          w = 0 for the middle, 1 / (2 n) for the others
        P <- sum c_j (f(X_j) - x) (f(X_j) - x)^T + Q dt,     c = 2 for the middle, w for the others

    The measurements are linear, for which the transform is exact: the update is that of the
    extended filter. All else is that of `PlanarFilter`, with its parameters.
    """

    reference: ClassVar[str] = "vandermerwe2004sigma"

    def carried(self, mean: Array, covariance: Array, dt: float) -> tuple[Array, Array]:
        """Return mean and covariance ``dt`` s later, without the growth of the noise."""
        root = _root(SIZE * covariance)
        points = np.concatenate(
            [mean[:, None], mean[:, None] + root, mean[:, None] - root], axis=1
        )
        after = np.stack(moved(tuple(points), dt))
        centre = after[:, 1:].mean(axis=1)
        away = after - centre[:, None]
        away[:, 0] *= 2.0 * np.sqrt(SIZE)  # weight 2, where the others have 1 / (2 n)
        return centre, (away @ away.T) / (2.0 * SIZE)


def _root(square: Array) -> Array:
    """Return R with R R^T = a positive semi-definite matrix: Cholesky's, or the symmetric one."""
    try:
        return np.asarray(np.linalg.cholesky(square), dtype=np.float64)
    except np.linalg.LinAlgError:  # rounding has taken an eigenvalue below zero
        values, vectors = np.linalg.eigh(square)
        return np.array(vectors * np.sqrt(np.maximum(values, 0.0)))

"""The extended Kalman filter of the planar motion model."""

from dataclasses import dataclass
from typing import ClassVar, final

import numpy as np

from wideberth.framework.values.arrays import Array

from .model import moved, slope
from .planar import PlanarFilter


@final
@dataclass(eq=False)
class Ekf(PlanarFilter):
    """Extended Kalman filter: the covariance is carried by the derivative of the model.

    With f of `model.moved` and F its derivative at the mean::

        x <- f(x, dt)        P <- F P F^T + Q dt

    All else is that of `PlanarFilter`, with its parameters.
    """

    reference: ClassVar[str] = "moore2014generalized"

    def carried(self, mean: Array, covariance: Array, dt: float) -> tuple[Array, Array]:
        """Return mean and covariance ``dt`` s later, without the growth of the noise."""
        state = mean.tolist()
        rate = slope(state, dt)
        return np.array(moved(state, dt)), rate @ covariance @ rate.T

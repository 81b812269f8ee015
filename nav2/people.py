"""Where people are expected to be, on the clock of a controller."""

from dataclasses import dataclass
from typing import final

import numpy as np

from ..framework.values.arrays import Array, checked, number
from ..framework.values.errors import WideberthError
from ..framework.values.forecast import Forecast


@final
@dataclass(frozen=True, eq=False)
class ExpectedPeople:
    """A forecast of discs in the plane, in the frame of the costmap.

    Attributes
    ----------
    forecast : of O people in M modes; step i is ``stamp`` + i dt.
    stamp : s, of the newest sample, on the clock of `Tick`.
    radii : (O,), m, of the people.

    Raises
    ------
    WideberthError : a forecast that is not in the plane or has no step, another number of radii,
        a negative radius, numbers that are not finite.
    """

    forecast: Forecast
    stamp: float
    radii: Array

    def __post_init__(self) -> None:
        people, _, steps, size = self.forecast.mean.shape
        if size != 2 or not steps:
            raise WideberthError(
                f"expected_people.forecast has {steps} steps in {size} dimensions; wanted at "
                "least one step, in the plane"
            )
        radii = checked("expected_people.radii", self.radii, (people,), reason=": one per person")
        if (radii < 0.0).any():
            raise WideberthError("expected_people.radii must not be negative")
        object.__setattr__(self, "radii", radii)
        object.__setattr__(self, "stamp", number("expected_people.stamp", self.stamp))

    def at(self, times: Array) -> tuple[Array, Array]:
        """Return means and covariances at times between the steps, on straight lines.

        Before the first step and after the last the mean goes on as between the two steps next to
        it, and the covariance stays.

        Parameters
        ----------
        times : (T,), s.

        Returns
        -------
        mean : (O, M, T, 2), m.
        covariance : (O, M, T, 2, 2), m^2.
        """
        forecast = self.forecast
        steps = (times - self.stamp) / forecast.dt - 1.0
        first = np.clip(np.floor(steps), 0, max(forecast.steps - 2, 0)).astype(np.int64)
        second = np.minimum(first + 1, forecast.steps - 1)
        share = steps - first
        mean, covariance = forecast.mean, forecast.covariance
        there = mean[:, :, first] + share[:, None] * (mean[:, :, second] - mean[:, :, first])
        within = np.clip(share, 0.0, 1.0)[:, None, None]
        spread = covariance[:, :, first]
        return there, spread + within * (covariance[:, :, second] - spread)

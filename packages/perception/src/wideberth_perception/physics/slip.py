"""A fast model of a skid-steered robot whose wheels slip, in NumPy, fitted to the physics."""

from dataclasses import dataclass, replace
from functools import cache
from typing import final

import numpy as np

from wideberth.framework.values.arrays import Array, Scalar, checked, positive
from wideberth.framework.values.errors import WideberthError

from .body import LARGE, SkidSteerBody


@final
@dataclass(frozen=True, eq=False)
class SlipModel:
    """How a skid-steered robot moves with the speeds of its rims; any number of robots at once.

    With the rims' speeds s_l, s_r and omega_d = (s_r - s_l) / track, at which a robot that does
    not slip would turn, the robot tends to::

        vx = f (s_l + s_r) / 2      omega = g(|omega_d|) omega_d      vy = -a(|omega_d|) vx omega

    by the first order, d(vx, vy, omega)/dt = (steady - now) / lag. g and a are linear between
    the rates at which they were measured, and constant beyond. Friction is the same in all
    directions here. Load, motors at their limits and anything that is touched are left out.

    Parameters
    ----------
    track : m, between the left and the right wheels.
    rates : (K,), rad/s, values of omega_d from small to large.
    gains : (K,), g at each.
    aside : (K,), s, a at each: the robot turns about a point that is a vx ahead of its middle.
    forward : f, the way that a wheel rolls over that of its rim.
    lag : s.

    Raises
    ------
    WideberthError : arrays of unequal length, rates that do not grow, a number out of range.
    """

    track: float
    rates: Array
    gains: Array
    aside: Array
    forward: float = 1.0
    lag: float = 0.008

    def __post_init__(self) -> None:
        object.__setattr__(self, "rates", checked("slip_model.rates", self.rates, (None,)))
        for name in ("gains", "aside"):
            value = checked(f"slip_model.{name}", getattr(self, name), self.rates.shape)
            object.__setattr__(self, name, value)
        if not len(self.rates) or self.rates[0] < 0.0 or (np.diff(self.rates) <= 0.0).any():
            raise WideberthError(
                f"slip_model.rates are {self.rates.tolist()}; wanted one at least, from 0 on, "
                "each larger than the one before"
            )
        for name in ("track", "forward", "lag"):
            positive(f"slip_model.{name}", getattr(self, name))

    def steady(self, left: Scalar, right: Scalar) -> Array:
        """Return forward and lateral speed and yaw rate that a robot tends to, (..., 3).

        Parameters
        ----------
        left, right : (...), m/s, speeds of the rims.
        """
        wanted = (np.asarray(right) - left) / self.track
        pace = np.abs(wanted)
        ahead = 0.5 * self.forward * (np.asarray(right) + left)
        turn = np.interp(pace, self.rates, self.gains) * wanted
        lateral = -np.interp(pace, self.rates, self.aside) * ahead * turn
        return np.stack([ahead, lateral, turn], axis=-1)

    def moved(
        self, pose: Array, twist: Array, left: Scalar, right: Scalar, duration: float
    ) -> tuple[Array, Array]:
        """Return poses and velocities after a time in which the rims keep their speeds.

        The velocity is exact. The pose is that of the mean velocity, along its arc, which
        errs by less than lag * duration * |change of speed| * |turn|.

        Parameters
        ----------
        pose : (..., 3), x, y in m and heading in rad.
        twist : (..., 3), forward and lateral speed in m/s, yaw rate in rad/s.
        left, right : (...), m/s, speeds of the rims.
        duration : s.
        """
        steady = self.steady(left, right)
        left_over = twist - steady
        fading = float(np.exp(-duration / self.lag))
        mean = steady + left_over * (self.lag * (1.0 - fading) / duration)
        half = 0.5 * duration * mean[..., 2]
        middle = pose[..., 2] + half
        chord = duration * np.sinc(half / np.pi)
        cosine, sine = chord * np.cos(middle), chord * np.sin(middle)
        ahead, aside = mean[..., 0], mean[..., 1]
        step = (cosine * ahead - sine * aside, sine * ahead + cosine * aside, 2.0 * half)
        return pose + np.stack(step, axis=-1), steady + left_over * fading


@cache
def slip_of(body: SkidSteerBody) -> SlipModel:
    """Return the model that was fitted to a body in the physics; hull and yaw gain are its own.

    Raises
    ------
    WideberthError : none was: `calibration.measured` and `fitted` give one.
    """
    for known, model in FITTED:
        if replace(body, hull=known.hull, yaw_gain=known.yaw_gain) == known:
            return model
    raise WideberthError(
        "no slip model was fitted to this body; measure one in the physics with "
        "fitted(body, measured(body)) of wideberth_perception.physics.calibration, or take the "
        "body of 17 kg, SkidSteerBody(), or that of 80 kg, LARGE"
    )


_RATES = np.array([0.02, 0.05, 0.1, 0.2, 0.3, 0.6, 1.0, 2.0])
FITTED: tuple[tuple[SkidSteerBody, SlipModel], ...] = (
    (
        SkidSteerBody(),
        SlipModel(
            track=SkidSteerBody().track, rates=_RATES, forward=0.9985,
            gains=np.array([0.481, 0.481, 0.499, 0.510, 0.519, 0.542, 0.554, 0.552]),
            aside=np.array([0.011, 0.011, 0.014, 0.018, 0.024, 0.058, 0.089, 0.119]),
        ),
    ),
    (
        LARGE,
        SlipModel(
            track=LARGE.track, rates=_RATES, forward=0.9992,
            gains=np.array([0.536, 0.563, 0.565, 0.575, 0.583, 0.597, 0.600, 0.593]),
            aside=np.array([0.011, 0.014, 0.021, 0.046, 0.084, 0.135, 0.151, 0.176]),
        ),
    ),
)  # fmt: skip
"""Bodies, and what `calibration.fitted` says of them in MuJoCo 4.0."""

"""MPC with the linearised chance constraint."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, final

from .preset import Preset


@final
@dataclass(eq=False)
class LinearizedChance(Preset):
    """Chance-constrained collision avoidance by a half-plane towards each obstacle.

    The original's: with n the unit vector from the forecast to the robot,

        n . (p - mu) - (r + r_d) >= sqrt(2 n^T Sigma n) erfinv(1 - 2 delta)

    at every step (`half_plane`), one risk delta for all, and forecasts of a Kalman filter at
    constant velocity.

    Not the original's: it is written for multicopters, here it drives any robot; the cost is our
    tracking of the path; the robot's own covariance counts where the observation gives one;
    obstacles are discs or balls, without its whitening of ellipsoids. Its delta is 0.03 as we know
    it; hold it against the publication before quoting.

    Parameters
    ----------
    robot, solver, horizon, dt, period, reference_speed, penalty, track_dt, margin : as in
        `Planner`.
    risk : delta, highest collision risk with one obstacle at one step, below 1/2.

    Raises
    ------
    WideberthError : as `Planner`.

    References
    ----------
    H. Zhu and J. Alonso-Mora, Chance-constrained collision avoidance for MAVs in dynamic
    environments, RA-L 4 (2019).
    """

    reference: ClassVar[str] = "zhu2019chance,labbe2014kalman"

    risk: float = 0.03

    def parts(self) -> Mapping[str, Any]:
        """Kalman forecasts and half-planes."""
        return {
            "predictor": "kalman",
            "region": "half_plane",
            "level": {"type": "fixed", "tail": self.risk},
        }

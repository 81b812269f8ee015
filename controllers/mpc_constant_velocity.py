"""MPC that takes forecasts at constant velocity for certain."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, final

from .preset import Preset


@final
@dataclass(eq=False)
class MpcConstantVelocity(Preset):
    """Our planner without the uncertainty: keeps out of the disc about a straight forecast.

    |p_i - mu_i| >= r + r_d + margin at every step i, mu as `ConstantVelocity` of the predictors
    forecasts; its covariance is not looked at. (The region is `half_plane` with the risk 1/2,
    which is that disc: Phi^-1(1/2) = 0.) What a comparison says beyond this row is what the
    covariance is worth.

    Parameters
    ----------
    robot, solver, horizon, dt, period, reference_speed, penalty, track_dt, margin : as in
        `Planner`; the margin is all the room that is kept.

    Raises
    ------
    WideberthError : as `Planner`.
    """

    reference: ClassVar[str] = "schoeller2020constant"

    def parts(self) -> Mapping[str, Any]:
        """Straight forecasts, and discs."""
        return {
            "predictor": "constant_velocity",
            "region": "half_plane",
            "level": {"type": "fixed", "tail": 0.5},
        }

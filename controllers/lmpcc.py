"""Local model predictive contouring control, with its corrected ellipse."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, final

from .preset import Preset


@final
@dataclass(eq=False)
class Lmpcc(Preset):
    """Contouring control that keeps out of ellipses enlarged by enough to hold ellipse plus disc.

    The original's: forecasts at constant velocity, the contouring cost with its path parameter,
    and the ellipse with semi-axes a + delta, b + delta, where delta is more than r + r_d by just
    so much that nothing of the exact sum sticks out (`repaired_margin`).

    Not the original's: its obstacles are ellipses that are given, here they are the content
    ellipses of the forecast (axes s sigma_i) with the obstacle's disc; the smallest delta is our
    own equation; the weights are those of `Contouring`, so that the row says what region and
    forecast do; its repulsive term is left out, and slack costs ``penalty`` (there 1e4); polygons
    are kept clear of by separating lines, there by one convex piece of free space per step. Its
    code plans 15 steps of 0.2 s at 20 Hz; horizon, dt and period are settings here.

    Parameters
    ----------
    robot, solver, horizon, dt, period, reference_speed, penalty, track_dt, margin : as in
        `Planner`.
    tail : 1 - content of the ellipse.

    Raises
    ------
    WideberthError : as `Planner`.

    References
    ----------
    B. Brito, B. Floor, L. Ferranti and J. Alonso-Mora, Model predictive contouring control for
    collision avoidance in unstructured dynamic environments, RA-L 4 (2019).
    """

    reference: ClassVar[str] = "brito2019contouring,schoeller2020constant"

    tail: float = 0.05

    def parts(self) -> Mapping[str, Any]:
        """Straight forecasts, the corrected ellipse, contouring."""
        return {
            "predictor": "constant_velocity",
            "region": "repaired_margin",
            "level": {"type": "fixed", "tail": self.tail},
            "cost": "contouring",
        }

"""Published planners: recipes of our planner with another author's predictor, region, level, cost.

All else is as in our planner, so that a comparison is one of the methods and not of their solvers
or fallbacks. Each is a name for ``type``; what is stated beside it wins, and any setting of
`PlannerSettings` may be stated.
"""

from collections.abc import Mapping
from typing import Any

from ..framework.plugins.config import build
from .recommended import for_polygons

COMMON: dict[str, Any] = {"type": "mpc", "solver": "riccati", "penalty": 1e5}
"""Settings of every preset."""


def linearized_chance(given: Mapping[str, Any], path: str = "") -> dict[str, Any]:
    """Chance-constrained collision avoidance by a half-plane towards each obstacle.

    The original's: with n the unit vector from the forecast to the robot,

        n . (p - mu) - (r + r_d) >= sqrt(2 n^T Sigma n) erfinv(1 - 2 delta)

    at every step (`half_plane`), one risk delta for all, and forecasts of a Kalman filter at
    constant velocity.

    Not the original's: it is written for multicopters, here it drives any robot; the cost is our
    tracking of the path; the robot's own covariance counts where the observation gives one;
    obstacles are discs or balls, without its whitening of ellipsoids. Its delta, the tail of the
    level, is 0.03 as we know it; hold it against the publication before quoting.

    References
    ----------
    H. Zhu and J. Alonso-Mora, Chance-constrained collision avoidance for MAVs in dynamic
    environments, RA-L 4 (2019).
    """
    level = {"type": "fixed", "tail": 0.03}
    parts = {"predictor": "kalman", "region": "half_plane", "level": level}
    return _completed(parts, given, path)


def lmpcc(given: Mapping[str, Any], path: str = "") -> dict[str, Any]:
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

    References
    ----------
    B. Brito, B. Floor, L. Ferranti and J. Alonso-Mora, Model predictive contouring control for
    collision avoidance in unstructured dynamic environments, RA-L 4 (2019).
    """
    level = {"type": "fixed", "tail": 0.05}
    parts = {"predictor": "constant_velocity", "region": "repaired_margin", "level": level}
    return _completed({**parts, "cost": "contouring"}, given, path)


def mpc_constant_velocity(given: Mapping[str, Any], path: str = "") -> dict[str, Any]:
    """Our planner without the uncertainty: keeps out of the disc about a straight forecast.

    |p_i - mu_i| >= r + r_d + margin at every step i, mu as `ConstantVelocity` of the predictors
    forecasts; its covariance is not looked at. (The region is `half_plane` with the risk 1/2,
    which is that disc: Phi^-1(1/2) = 0.) From the recommended planner it differs in predictor,
    region and level, has no margin unless one is stated, and its weights do not follow the speed:
    a comparison of the two is one of all of these. What the covariance alone is worth is seen
    against the recommended planner with ``level: {type: fixed, tail: 0.999}``.
    """
    level = {"type": "fixed", "tail": 0.5}
    parts = {"predictor": "constant_velocity", "region": "half_plane", "level": level}
    return _completed(parts, given, path)


def _completed(parts: Mapping[str, Any], given: Mapping[str, Any], path: str) -> dict[str, Any]:
    """Complete settings by those of a preset."""
    settings = {**COMMON, **parts, **given, "type": "mpc"}
    if "robot" in given:
        robot = build("robots", given["robot"], f"{path}.robot" if path else "robot")
        settings = {**for_polygons(robot), **settings, "robot": robot}
    return settings

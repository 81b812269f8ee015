"""Published planners, assembled from the parts of this package.

Each is our planner with another author's choice of predictor, region, level and cost.
"""

from abc import abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from typing import Any, ClassVar, final

from ..framework.controller import Controller
from ..framework.mpc.planner.planner import Planner
from ..framework.mpc.solvers.base import Solver
from ..framework.mpc.solvers.riccati.solver import Riccati
from ..framework.plugins.config import build
from ..framework.robot import Robot
from ..framework.static_region import StaticRegion
from ..framework.values.motion import Command, Observation
from ..framework.values.path import Path
from ..framework.values.plan import Plan


@dataclass(eq=False)
class Preset(Controller):
    """A `Planner` of which predictor, region, level and cost are another author's choice.

    All else is as in the planner, so that a comparison tells the methods apart and not their
    solvers or fallbacks. A subclass names its parts.

    Parameters
    ----------
    robot, solver, horizon, dt, period, reference_speed, penalty, track_dt, margin : as in
        `Planner`.

    Raises
    ------
    WideberthError : as `Planner`.
    """

    robot: Robot
    solver: Solver = field(default_factory=Riccati)
    horizon: int = 15
    dt: float = 0.5
    period: float = 0.5
    reference_speed: float = 0.5
    penalty: float | None = 1e5
    track_dt: float = 0.5
    margin: float = 0.0

    def __post_init__(self) -> None:
        # By name: this room does not know the others. Polygons lie in the plane.
        walls = "separating_line" if self.robot.dimension == 2 else None
        settings = {field.name: getattr(self, field.name) for field in fields(Preset)}
        config = {"type": "mpc", **settings, "static_region": walls, **self.parts()}
        made = build("controllers", config)
        assert isinstance(made, Planner)
        self._planner = made

    @abstractmethod
    def parts(self) -> Mapping[str, Any]:
        """Config of predictor, region, level and, where it is not the paper's, cost."""

    @property
    def planner(self) -> Planner:
        """The planner that this preset configures."""
        return self._planner

    @property
    def static_region(self) -> StaticRegion | None:
        """The region for polygons; None in space, where there are none."""
        return self._planner.static_region

    def reset(self) -> None:
        """Forget obstacles, plan and progress; the path stays."""
        self._planner.reset()

    def set_path(self, path: Path) -> None:
        """Follow this path from now on."""
        self._planner.set_path(path)

    def remember(self, observation: Observation) -> None:
        """Record an observation without planning."""
        self._planner.remember(observation)

    def command(self, observation: Observation) -> Command:
        """Plan; never raises."""
        return self._planner.command(observation)

    @property
    def plan(self) -> Plan | None:
        """The plan behind the last command."""
        return self._planner.plan


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

"""Published planners made of our parts: what they share."""

from abc import abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from ..framework.controller import Controller
from ..framework.mpc.planner.planner import Planner
from ..framework.mpc.solvers.base import Solver
from ..framework.mpc.solvers.fatrop import Fatrop
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
    solver: Solver = field(default_factory=Fatrop)
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
        settings = {
            "robot": self.robot,
            "solver": self.solver,
            "horizon": self.horizon,
            "dt": self.dt,
            "period": self.period,
            "reference_speed": self.reference_speed,
            "penalty": self.penalty,
            "track_dt": self.track_dt,
            "margin": self.margin,
            "static_region": walls,
        }
        made = build("controllers", {"type": "mpc", **settings, **self.parts()})
        assert isinstance(made, Planner)
        self._planner = made

    @abstractmethod
    def parts(self) -> Mapping[str, Any]:
        """Config of predictor, region, level and, where it is not the paper's, cost."""

    @property
    def planner(self) -> Planner:
        """The planner behind it, to be asked for what it solved."""
        return self._planner

    @property
    def static_region(self) -> StaticRegion | None:
        """What keeps clear of polygons; None in space, where there are none."""
        return self._planner.static_region

    def reset(self) -> None:
        """Forget obstacles, plan and progress; the path stays."""
        self._planner.reset()

    def set_path(self, path: Path) -> None:
        """Follow this path from now on."""
        self._planner.set_path(path)

    def remember(self, observation: Observation) -> None:
        """Take note of what is seen without planning."""
        self._planner.remember(observation)

    def command(self, observation: Observation) -> Command:
        """Plan; never raises."""
        return self._planner.command(observation)

    @property
    def plan(self) -> Plan | None:
        """The plan behind the last command."""
        return self._planner.plan

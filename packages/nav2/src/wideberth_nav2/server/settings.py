"""Everything that sets the loop around a local controller."""

from collections.abc import Mapping
from dataclasses import astuple, dataclass, field, replace
from functools import partial
from typing import Any, final

from wideberth.framework.robot import Robot
from wideberth.framework.values.arrays import checked, positive

from ..controllers.local_controller import LocalController
from ..controllers.local_controllers import (
    VelocityLimits,
    built,
    shipped_parameters,
    timed,
    together,
)
from ..costmap.footprint import RobotFootprint
from ..costmap.local_costmap import CostmapView
from ..goal_checker import GoalChecker
from ..parameters import made, names_of, refuse_unknown
from ..path_handler import PathHandler
from .recoveries import Recoveries
from .server import ControllerServer, ProgressChecker
from .velocity_smoother import Nav2VelocitySmoother


@final
@dataclass(frozen=True)
class LoopSettings:
    """A local controller by name, and the parameters of all that stands around it.

    The defaults are those that Nav2 ships for its own robot where they differ from the code's.
    Each mapping holds parameters by Nav2's names; what it lacks has the code's default.

    Attributes
    ----------
    local : the local controller, see `wideberth_nav2.controllers.local_controllers.LOCAL`.
    parameters : of that controller.
    server : of `wideberth_nav2.server.server.ControllerServer`.
    path_handler, goal_checker, progress_checker : of the classes of these names.
    velocity_smoother, recoveries : likewise.
    view : local costmap.
    controller_frequency : Hz.
    footprint : (V, 2), m, corners of the robot; () for the robot's own outline or disc.
    robot_radius : m, for a round robot; None for the robot's own.
    """

    local: str = "regulated_pure_pursuit"
    parameters: Mapping[str, Any] = field(default_factory=dict)
    server: Mapping[str, Any] = field(default_factory=partial(shipped_parameters, "server"))
    path_handler: Mapping[str, Any] = field(default_factory=dict)
    goal_checker: Mapping[str, Any] = field(default_factory=dict)
    progress_checker: Mapping[str, Any] = field(default_factory=dict)
    velocity_smoother: Mapping[str, Any] = field(
        default_factory=partial(shipped_parameters, "velocity_smoother")
    )
    recoveries: Mapping[str, Any] = field(default_factory=dict)
    view: CostmapView = field(default_factory=CostmapView)
    controller_frequency: float = 20.0
    footprint: tuple[tuple[float, float], ...] = ()
    robot_radius: float | None = None

    def __post_init__(self) -> None:
        positive("settings.controller_frequency", self.controller_frequency)
        self.make_server()
        self.make_smoother()
        self.make_recoveries()
        if self.footprint:
            RobotFootprint.of(checked("settings.footprint", self.footprint, (None, 2)))
        if self.robot_radius is not None:
            positive("settings.robot_radius", self.robot_radius)

    @classmethod
    def shipped(cls, local: str) -> "LoopSettings":
        """Return the settings that Nav2 has shipped for its own robot with this controller."""
        return cls(local, shipped_parameters(local))

    def driving(self, robot: Robot) -> "LoopSettings":
        """Return the same settings for a robot, whose disc TEB keeps clear.

        A radius that the parameters name stays.
        """
        named = "footprint_model.radius" in self.parameters
        if named or "teb" not in together(self.local, self.parameters):
            return self
        return replace(self, parameters={"robot_radius": robot.radius, **self.parameters})

    def make_controller(self) -> LocalController:
        """Return a new local controller, which knows its frequency where it asks for it.

        Critics of MPPI that infer distances from costs know the costmap's inflation, as in Nav2.
        """
        derived: dict[str, Any] = {}
        kinds = together(self.local, self.parameters)
        if timed(self.local):
            derived["controller_frequency"] = self.controller_frequency
        if {"mppi", "mppi_foresight"} & set(kinds):
            derived["ObstaclesCritic.inflation_radius"] = self.view.inflation_radius
            for critic in ("CostCritic", "ObstaclesCritic"):
                derived[f"{critic}.cost_scaling_factor"] = self.view.cost_scaling_factor
        return built(self.local, {**derived, **self.parameters})

    def make_server(self) -> ControllerServer:
        """Return a new controller server around a new local controller."""
        refuse_unknown("settings.server", self.server, names_of(ControllerServer))
        return ControllerServer(
            self.make_controller(),
            made(PathHandler, "settings.path_handler", self.path_handler),
            made(GoalChecker, "settings.goal_checker", self.goal_checker),
            made(ProgressChecker, "settings.progress_checker", self.progress_checker),
            **self.server,
        )

    def make_smoother(self) -> Nav2VelocitySmoother:
        """Return a new velocity smoother."""
        return made(Nav2VelocitySmoother, "settings.velocity_smoother", self.velocity_smoother)

    def make_recoveries(self) -> Recoveries:
        """Return new recoveries."""
        return made(Recoveries, "settings.recoveries", self.recoveries)

    def within(self, limits: VelocityLimits) -> "LoopSettings":
        """Return the same settings with limits for the controller and the smoother."""
        v, w, a, alpha, _ = astuple(limits)
        smoother = {
            "max_velocity": [v, 0.0, w], "min_velocity": [0.0 - limits.backwards, 0.0, -w],
            "max_accel": [a, 0.0, alpha], "max_decel": [-a, 0.0, -alpha],
        }  # fmt: skip
        return replace(
            self,
            parameters={**self.parameters, **limits.parameters(self.local, self.parameters)},
            velocity_smoother={**self.velocity_smoother, **smoother},
        )

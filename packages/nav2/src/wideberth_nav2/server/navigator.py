"""Nav2 as a controller: local costmap, controller server, recoveries and velocity smoother."""

from dataclasses import dataclass, field, replace
from enum import StrEnum
from pathlib import Path as File
from typing import final

import numpy as np

from wideberth.controllers.steering import yaw_acceleration
from wideberth.framework.control.command_limits import FAST, attained, top_speed, within_reach
from wideberth.framework.control.rate_limited_warnings import WARNINGS
from wideberth.framework.controller import Controller, checked_path, checked_ready, checked_use
from wideberth.framework.robot import Robot
from wideberth.framework.route_planner import RoutePlanner
from wideberth.framework.tracking.stand_ins import sound
from wideberth.framework.values.arrays import Array
from wideberth.framework.values.costmap import Costmap
from wideberth.framework.values.errors import WideberthError
from wideberth.framework.values.failures import caught
from wideberth.framework.values.footprint import Outline
from wideberth.framework.values.motion import Command, Observation, Twist, checked_numbers
from wideberth.framework.values.path import Path
from wideberth.framework.values.plan import Plan

from ..controllers.local_controller import Answer
from ..controllers.local_controllers import VelocityLimits
from ..costmap.footprint import RobotFootprint
from ..costmap.forecast_layer import ForecastLayer, ShownForecast
from ..costmap.local_costmap import CostmapSurroundings, LayeredCostmap, discs_of
from ..costmap.rays import Rays
from .params_file import read_params_file
from .recoveries import Recovery, RecoveryOutcome
from .route import GlobalRoute
from .server import ServerStatus, ServerView
from .settings import LoopSettings

SPACING = 0.05
"""m, between the poses that a path is given as: Nav2's planners give one per cell."""
MOST_POSES = 200_000
"""Of a path: 10 km."""
_HELPED = {
    ServerStatus.UNKNOWN, ServerStatus.CONTROLLER_TIMED_OUT, ServerStatus.FAILED_TO_MAKE_PROGRESS,
    ServerStatus.NO_VALID_CONTROL, ServerStatus.PATIENCE_EXCEEDED, ServerStatus.NO_VALID_PATH,
}  # fmt: skip
"""Results after which Nav2 tries again; an invalid path is none of them."""
_STILL = Twist((0.0, 0.0))
_SOON = 1e-9
"""s: what is due so soon is due now."""


class _Clock:
    """Strikes at a fixed rate, Hz, by the stamps that it is shown; first at once."""

    def __init__(self, frequency: float) -> None:
        self._period, self._next = 1.0 / frequency, -np.inf

    def strikes(self, time: float) -> bool:
        """Return whether it is time (s) again; strokes that were missed are not made up for."""
        if time < self._next - _SOON:
            return False
        late = time - self._next > self._period
        self._next = (time if late else self._next) + self._period
        return True


class Navigation(StrEnum):
    """State of the navigation to the goal."""

    FOLLOWING = "following"
    RECOVERING = "recovering"
    SUCCEEDED = "succeeded"
    FAILED = "failed"


_UNDER_WAY = (Navigation.FOLLOWING, Navigation.RECOVERING)


@final
@dataclass(eq=False)
class Nav2(Controller):
    """Drives a robot as Nav2 does, with any of its local controllers.

    The controller server, the velocity smoother and the local costmap work at their own rates. A
    path is followed until its goal. Where that fails, the local costmap is cleared and what is
    left of the path is tried once more; then follow recoveries in turn. After
    `Recoveries.number_of_retries` of them the robot stands for good. Commands pass the velocity
    smoother.

    The robot's surroundings are what the observation holds. A `CostmapView` sees them by the rays
    of its scan; where it has none, by rays that are cast against its polygons and its detections,
    which are discs, where they are by now if their velocity is known. An exact view shows all of
    these polygons and discs instead. Positions are taken as they are measured. Without a scan the
    robot brakes while a detection has no place: no costmap shows it.

    The headings of a path are its directions: Nav2's own NavFn gives none.

    Parameters
    ----------
    robot : to be driven, in the plane; it has a heading.
    settings : the local controller and all that is around it.
    params_file : one of Nav2's files, ``nav2_params.yaml``; its settings are then taken instead.
    robot_limits : bound the controller and the smoother by what this robot can do.
    planner : finds new routes as the default behaviour tree does, once a second at most; None to
        keep to the path.
    forecasts : of the people who are seen, as a layer of the costmaps; None without.

    Raises
    ------
    WideberthError : a robot without heading or in space, or parameters that are not known.
    """

    robot: Robot
    settings: LoopSettings = field(default_factory=LoopSettings)
    params_file: File | None = None
    robot_limits: bool = False
    planner: RoutePlanner | None = None
    forecasts: ForecastLayer | None = None

    def __post_init__(self) -> None:
        kind = type(self.robot).__name__
        rest = np.zeros(len(self.robot.states))
        if self.robot.dimension != 2 or self.robot.pose(tuple(rest)).heading is None:
            raise WideberthError(
                f"Nav2's controllers drive robots in the plane that have a heading; {kind} has "
                "none: take unicycle or differential_drive"
            )
        self._set = (
            self.settings if self.params_file is None else read_params_file(self.params_file)
        )
        if self.robot_limits:
            self._set = self._set.within(limits_of(self.robot))
        self._set = self._set.driving(self.robot)
        self.footprint: RobotFootprint = self._outline()
        self._given: Array | None = None
        smoothed = self._set.make_smoother().smoothing_frequency
        self.period: float = 1.0 / max(self._set.controller_frequency, smoothed)
        self._make()

    def _outline(self) -> RobotFootprint:
        """Return the robot's outline with its padding."""
        padding, given = self._set.view.footprint_padding, self._set
        if given.footprint:
            return RobotFootprint.of(given.footprint, padding)
        if given.robot_radius is None and isinstance(self.robot.footprint, Outline):
            return RobotFootprint.of(self.robot.footprint.vertices, padding)
        radius = self.robot.radius if given.robot_radius is None else given.robot_radius
        return RobotFootprint.round_of(radius, padding)

    def _make(self) -> None:
        """Make everything that remembers anew."""
        self._path = self._given
        self._server = self._set.make_server()
        self._smoother = self._set.make_smoother()
        self._ticks = _Clock(self._set.controller_frequency)
        self._outputs = _Clock(self._smoother.smoothing_frequency)
        self._sent = Command((0.0, 0.0))
        self._recoveries = self._set.make_recoveries()
        self._local = LayeredCostmap(self._set.view, self.footprint)
        self._people = None if self.forecasts is None else self.forecasts.begun(self.period)
        self._route: GlobalRoute | None = None
        self._navigation, self._reason = Navigation.FOLLOWING, ""
        self._retried = self._begun = False
        self._answer: Answer | None = None
        self._last = np.zeros(3)
        self._stamp = -np.inf

    @property
    def chosen(self) -> LoopSettings:
        """The settings that hold: of the file where there is one, within the robot's limits."""
        return self._set

    def reset(self) -> None:
        """Forget everything but the settings and the path."""
        self._make()

    def set_path(self, path: Path) -> None:
        """Follow this path from now on; with the goal of the former one it is a replanned one."""
        poses = poses_along(checked_path(self.robot, path))
        same = self._path is not None and np.array_equal(self._path[-1, :2], poses[-1, :2])
        self._path = self._given = poses
        if same and self._begun and self._navigation in _UNDER_WAY:
            self._server.replan(poses)
            return
        self._begun, self._retried, self._route = False, False, None
        self._navigation = Navigation.FOLLOWING
        self._recoveries.reset()

    def remember(self, observation: Observation) -> None:
        """Update the local costmap, where its time has come."""
        checked_use(self.robot, observation)
        try:
            checked_numbers(observation)
            self._look(observation)
        except WideberthError as error:
            WARNINGS.warn(type(self).__name__, "observation", str(error))

    def command(self, observation: Observation) -> Command:
        """Return the smoothed command of a tick; raises for wrong use alone, see `reason`.

        Raises
        ------
        WideberthError : no path is set, or something else than an observation of this robot.
        """
        checked_ready(self._path)
        checked_use(self.robot, observation)
        try:
            checked_numbers(observation)
            command = self._ticked(observation)
            if not np.isfinite((*command.linear, command.omega)).all():
                raise WideberthError(f"the command is {command}, which is not finite")
            command = within_reach(self.robot, command)
        except Exception as error:  # whatever a plug-in throws
            self._reason = caught(error)
            WARNINGS.warn(type(self).__name__, "stands still", self._reason)
            command = Command((0.0, 0.0))
        self._last = np.array([*command.linear, command.omega])
        return command

    @property
    def last_plan(self) -> Plan | None:
        """None: what a local controller expects is in `answer`."""
        return None

    @property
    def reason(self) -> str:
        """What was wrong at the last tick; "" where nothing was."""
        return self._reason

    @property
    def navigation(self) -> Navigation:
        """State of the navigation to the goal."""
        return self._navigation

    @property
    def recoveries(self) -> int:
        """Recoveries that were tried on the way to this goal."""
        return self._recoveries.tried

    @property
    def answer(self) -> Answer | None:
        """What the local controller answered last; None before, and while it is not asked."""
        return self._answer

    @property
    def costmap(self) -> Costmap | None:
        """The local costmap; None before the first observation."""
        return self._local.shown

    def _look(self, observation: Observation) -> None:
        """Take note of people, and update the costmap where its time has come."""
        if self._people is not None:
            here = self._pose(observation)[:2]
            self._people.take(observation, here, self.footprint.circumscribed)
        if self._local.due(observation.stamp):
            around = self._around(observation)
            self._local.update(observation.stamp, self._pose(observation), around)

    def _around(self, observation: Observation) -> CostmapSurroundings:
        """Return what is around."""
        detections, notes, _ = sound(observation, 2)  # what has no place is in no costmap
        for words in notes:
            WARNINGS.warn(type(self).__name__, "detection", words)
        centres, radii = discs_of(detections)
        view, scan, rays = self._set.view, observation.scan, None
        if scan is not None:
            rays = Rays.of_scan(scan.scan, scan.pose)
        elif not view.exact:
            here = self._pose(observation)[:2]
            rays = Rays.cast(here, centres, radii, observation.polygons, view.laser_range)
        people = self._expected(observation.stamp)
        return CostmapSurroundings(rays, centres, radii, observation.polygons, people)

    def _expected(self, now: float) -> ShownForecast | None:
        """Return the forecast of people; without one the costmap shows what rays show."""
        if self.forecasts is None or self._people is None:
            return None
        try:
            return self.forecasts.shown(self._people, now)
        except Exception as error:  # whatever a plug-in throws
            WARNINGS.warn(type(self).__name__, "forecast", caught(error))
            return None

    def _pose(self, observation: Observation) -> Array:
        pose = self.robot.pose(tuple(float(value) for value in observation.state))
        return np.array([*pose.position, pose.heading], dtype=np.float64)

    def _speed(self, observation: Observation) -> Array:
        """Measured vx, vy, m/s, and yaw rate, rad/s; the last command where it is the input."""
        state = tuple(float(value) for value in observation.state)
        count = len(self.robot.inputs)
        twist, other = (self.robot.twist(state, (value,) * count) for value in (0.0, 1.0))
        if (twist.linear, twist.angular) != (other.linear, other.angular):
            return self._last
        return np.array([*twist.linear, twist.angular], dtype=np.float64)

    def _ticked(self, observation: Observation) -> Command:
        """Look, decide and smooth."""
        time = observation.stamp
        if time < self._stamp:  # another clock: nothing that is remembered holds
            self._make()
        self._stamp = time
        self._look(observation)
        costmap = self._local.shown
        assert costmap is not None  # it has just been updated
        pose, speed = self._pose(observation), self._speed(observation)
        seen = ServerView(
            time, pose, speed, costmap, self._local.updated, self.footprint,
            self._set.view.track_unknown_space, observation,
        )  # fmt: skip
        self._smoother.measure((float(speed[0]), float(speed[1]), float(speed[2])), time)
        if self._ticks.strikes(time):
            self._reason = ""
            twist = self._decided(seen, observation)
            if twist is not None:
                linear = (float(twist.linear[0]), float(twist.linear[1]))
                self._smoother.take((*linear, float(twist.angular)), time)
        if self._outputs.strikes(time):
            out = self._smoother.output(time) or (0.0, 0.0, 0.0)
            self._sent = Command((out[0], out[1]), out[2])
        return self._sent

    def _decided(self, seen: ServerView, observation: Observation) -> Twist | None:
        """Return the velocity of the behaviour tree's present branch; none while one is lost."""
        self._answer = None
        placeless = () if observation.scan is not None else sound(observation, 2).placeless
        if placeless:
            self._reason = f"seen without a place: {', '.join(map(repr, placeless[:3]))}"
            return _STILL
        if self._navigation is Navigation.RECOVERING:
            return self._recover(seen)
        if self._navigation is not Navigation.FOLLOWING:
            return _STILL
        path = checked_ready(self._path)
        if not self._begun:
            self._begun = True
            if self.planner is not None:
                view = replace(self._set.view, static_layer=True)
                self._route = GlobalRoute.around(self.planner, view, self.footprint, path)
            self._server.begin(path, seen.time)
        if self._route is not None and not self._routed(self._route, seen, observation):
            return _STILL
        step = self._server.tick(seen, 1.0 / self._set.view.update_frequency)
        self._answer, self._reason = step.answer, step.reason
        if step.status is ServerStatus.SUCCEEDED:
            self._navigation = Navigation.SUCCEEDED
        elif step.status is not ServerStatus.RUNNING:
            self._reason = f"{step.status}: {step.reason}"
            self._failed(seen, step.status)
        return step.twist

    def _routed(self, route: GlobalRoute, seen: ServerView, observation: Observation) -> bool:
        """Plan a new route where the tree wants one; return whether there is one to follow."""
        if not route.due(seen.time):
            return True
        found, reason = route.update(seen.time, seen.pose, self._around(observation))
        if found is not None:
            self._path = poses_along(found)
            self._server.replan(self._path)
        elif reason:
            self._reason = f"{ServerStatus.NO_VALID_PATH}: {reason}"
            self._failed(seen, ServerStatus.NO_VALID_PATH, again=True)
        return not reason

    def _failed(self, seen: ServerView, status: ServerStatus, again: bool = False) -> None:
        """Try once more with a cleared costmap, then recover, then give up."""
        if status not in _HELPED:
            self._navigation = Navigation.FAILED
        elif not self._retried and not again:
            self._retried = True
            self._local.clear()
            self._server.again(seen.time)
        else:
            self._retried = False
            self._start(self._recoveries.begin(seen))

    def _start(self, recovery: Recovery | None) -> None:
        """Take note of the recovery that has started, if any."""
        self._navigation = Navigation.FAILED if recovery is None else Navigation.RECOVERING
        if recovery is Recovery.CLEAR:
            self._local.clear()
            if self._route is not None:
                self._route.clear()

    def _recover(self, seen: ServerView) -> Twist:
        """Go on with the recovery; after it, follow the path again."""
        self._reason = f"recovering: {self._recoveries.now}"
        twist, outcome = self._recoveries.velocity(seen)
        if outcome is RecoveryOutcome.SUCCEEDED:
            self._navigation = Navigation.FOLLOWING
            self._server.again(seen.time)
        elif outcome is RecoveryOutcome.FAILED:
            self._navigation = Navigation.FAILED
        elif self._recoveries.now is Recovery.CLEAR:
            self._start(Recovery.CLEAR)
        return twist


def poses_along(path: Path) -> Array:
    """Return poses (N, 3) along a path, `SPACING` apart, each heading along it.

    On a path that would have more than `MOST_POSES` they are farther apart.
    """
    count = min(max(int(np.ceil(path.length / SPACING)), 1), MOST_POSES)
    arc = np.union1d(np.linspace(0.0, path.length, count + 1), path.arc)
    points = path.at(arc)
    direction = path.direction(arc)
    return np.column_stack([points, np.arctan2(direction[:, 1], direction[:, 0])])


def limits_of(robot: Robot) -> VelocityLimits:
    """Ask a robot how fast it can be, and how fast it can become so."""
    rest, soon = np.zeros(len(robot.states)), 1e-3
    ahead, back, turn = Twist((FAST, 0.0)), Twist((-FAST, 0.0)), Twist((0.0, 0.0), FAST)
    gained = float(attained(robot, rest, [ahead], soon)[0, 0])
    return VelocityLimits(
        top_speed(robot, rest),
        float(attained(robot, rest, [turn])[0, 2]),
        gained / soon,
        yaw_acceleration(robot, rest),
        0.0 - float(attained(robot, rest, [back])[0, 0]),
    )

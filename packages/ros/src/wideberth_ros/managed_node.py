"""A planner as a managed node of rclpy: states, parameters, timers, and a stop when it leaves."""

import threading
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import cache
from typing import Any, final

from wideberth.framework.controller import Controller
from wideberth.framework.robot import Robot

from .actions import FollowPathServer, GoalServer, NavigateToPoseServer
from .leaving import brake, decide_forever
from .link import TICK, RosLink, ros, ros_process
from .node import PlannerNode
from .node_settings import NodeSettings
from .parameters import NodeParameters
from .path_sources import GoalTopic

NAME = "wideberth"
"""Of the node, where ``-r __node:=NAME`` states no other."""


@final
class ManagedPlanner:
    """A `PlannerNode` in the states of a managed node of ROS 2.

    Configured, it has its topics, and its planner is compiled; active, it drives; inactive, the
    robot brakes to a stand, and no velocities are published.

    Parameters
    ----------
    controller, robot, settings : as of `PlannerNode`; parameters take the place of settings.

    Raises
    ------
    WideberthError : a parameter that does not fit.
    """

    def __init__(self, controller: Controller, robot: Robot, settings: NodeSettings) -> None:
        self.planner: PlannerNode | None = None
        """The node's own part; None while it is not configured."""
        self._controller, self._robot = controller, robot
        self.ros: Any = _lifecycle_node()(NAME, self)
        self.parameters: NodeParameters = NodeParameters(
            self.ros, settings, lambda: self.planner is not None, self._change
        )
        self._link = RosLink(self.ros)
        self._timers: list[Any] = []
        self._over = threading.Event()
        self._actions: list[GoalServer] = []

    def configure(self) -> None:
        """Open the topics, compile the planner, and start to receive."""
        settings = self.parameters.settings
        planner = PlannerNode(
            self._controller, self._robot, settings, self._link, self._now, self._wall
        )
        planner.active = False
        planner.limit_speed(self.parameters.limit)
        planner.warm_up()
        self.planner = planner
        self._actions = [FollowPathServer(self.ros, planner)]
        if isinstance(settings.follows, GoalTopic):
            self._actions.append(NavigateToPoseServer(self.ros, planner))
        self._timers = [self.ros.create_timer(1.0, planner.publish_diagnostics)]
        if settings.stepped:
            return
        due, self._over = threading.Event(), threading.Event()
        self._timers += [
            self.ros.create_timer(1.0 / settings.rate, planner.publish),
            self.ros.create_timer(self._controller.period, due.set),
        ]
        deciding = (planner, due, self._over)
        threading.Thread(target=decide_forever, args=deciding, name="planner", daemon=True).start()

    def activate(self, active: bool = True) -> None:
        """Let the robot drive, or brake."""
        if self.planner is not None:
            self.planner.active = active

    def clean_up(self) -> None:
        """Stop the robot, and close the topics."""
        self._over.set()
        for timer in self._timers:
            self.ros.destroy_timer(timer)
        self._timers.clear()
        if self.planner is not None:
            self.planner.stop()
            time.sleep(TICK)  # a publisher that is destroyed at once may not send any more
        for action in self._actions:
            action.close()
        self._actions.clear()
        self._link.close()
        self.planner = None

    def leave(self, executor: Any, hurry: Callable[[], bool]) -> None:
        """Brake to a stand as the robot can, or at once where there is hurry; clean up then."""
        if self.planner is not None:
            self.planner.active = False
            for action in self._actions:
                action.abort("the planner leaves")
            while len(self._timers) > 1:
                self.ros.destroy_timer(self._timers.pop())

            def meanwhile() -> None:
                with suppress(Exception):  # the robot's stop does not depend on it
                    executor.spin_once(timeout_sec=0.0)

            brake(self.planner, hurry, meanwhile)
        self.clean_up()

    def _change(self, settings: NodeSettings, limit: float) -> None:
        if self.planner is not None:
            self.planner.settings = settings
            self.planner.limit_speed(limit)

    def _now(self) -> float:
        """Return the time by which silence is judged, s: simulated, or else never set back."""
        clock = self.ros.get_clock()
        return 1e-9 * clock.now().nanoseconds if clock.ros_time_is_active else time.monotonic()

    def _wall(self) -> int:
        return int(self.ros.get_clock().now().nanoseconds)


@cache
def _lifecycle_node() -> Any:
    """Return the class of managed nodes that calls ours."""
    lifecycle = ros("rclpy.lifecycle")
    well = lifecycle.TransitionCallbackReturn.SUCCESS
    ill = lifecycle.TransitionCallbackReturn.FAILURE

    class Node(lifecycle.LifecycleNode):  # type: ignore[misc, name-defined]
        def __init__(self, name: str, owner: ManagedPlanner) -> None:
            self._owner = owner
            super().__init__(name)

        def on_configure(self, state: Any) -> Any:
            try:
                self._owner.configure()
            except Exception as error:  # it is said, and the node stays as it was
                self.get_logger().error(f"configure: {error}")
                self._owner.clean_up()
                return ill
            return well

        def on_activate(self, state: Any) -> Any:
            self._owner.activate()
            return super().on_activate(state)

        def on_deactivate(self, state: Any) -> Any:
            self._owner.activate(False)
            return super().on_deactivate(state)

        def on_cleanup(self, state: Any) -> Any:
            self._owner.clean_up()
            return well

        def on_shutdown(self, state: Any) -> Any:
            self._owner.clean_up()
            return well

    return Node


def run_planner(
    controller: Controller,
    robot: Robot,
    settings: NodeSettings,
    arguments: Sequence[str] = (),
    seconds: float | None = None,
) -> PlannerNode | None:
    """Run a managed planner until it is stopped; return its last state.

    Parameters
    ----------
    controller, robot, settings : as of `PlannerNode`.
    arguments : for ROS, as in ``["--ros-args", "-r", "/odom:=/robot/odom"]``.
    seconds : after which it stops; None for never.

    Raises
    ------
    WideberthError : ROS 2 is not found, or a parameter does not fit.
    """
    planner = None
    with ros_process(arguments) as process:
        node = ManagedPlanner(controller, robot, settings)
        executor = ros("rclpy.executors").SingleThreadedExecutor()
        executor.add_node(node.ros)
        if node.parameters.autostart:
            node.ros.trigger_configure()
            node.ros.trigger_activate()
        try:
            process.spin(executor, seconds)
        finally:
            planner = node.planner
            node.leave(executor, lambda: process.count > 1)
            node.ros.destroy_node()
    return planner

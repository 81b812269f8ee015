"""Topics and rates of a planner on a network of ROS 2."""

from dataclasses import dataclass, field
from typing import final

from wideberth.framework.values.arrays import positive
from wideberth.framework.values.errors import WideberthError

from .obstacle_sources import ObstacleTopic, ScanTopic, check_topic
from .path_sources import GoalTopic, PathTopic


@final
@dataclass(frozen=True)
class NodeSettings:
    """Topics, rates and limits of a `PlannerNode`.

    Parameters
    ----------
    odometry : topic of `nav_msgs/msg/Odometry`.
    sees : where obstacles come from: `ObstacleTopic` or `ScanTopic`; None where there are none.
        One of them alone: whom both show would be two obstacles.
    follows : where paths come from: `PathTopic` or `GoalTopic`; None where they come another way.
    commands : topic of the velocities.
    stamped : send `TwistStamped` or, if False, `Twist`; None for what those who listen take.
    base_frame : of the robot.
    rate : Hz, of the commands.
    patience : s, for which odometry, obstacles or scans may be silent; then the robot brakes.
    stepped : for a simulation that waits, as `wideberth world --stepped`: it decides once for each
        instant of which odometry and obstacles have come, and answers by the controller's own
        command, stamped with that instant.

    Raises
    ------
    WideberthError : a name that is not known, a number that is out of range.
    """

    odometry: str = "/odom"
    sees: ObstacleTopic | ScanTopic | None = field(default_factory=ObstacleTopic)
    follows: PathTopic | GoalTopic | None = field(default_factory=PathTopic)
    commands: str = "/cmd_vel"
    stamped: bool | None = None
    base_frame: str = "base_link"
    rate: float = 20.0
    patience: float = 0.5
    stepped: bool = False

    def __post_init__(self) -> None:
        for name in ("rate", "patience"):
            positive(f"node.{name}", getattr(self, name))
        if self.rate > 200.0:
            raise WideberthError(f"node.rate is {self.rate:g} Hz; wanted at most 200")
        check_topic("node.odometry", self.odometry)
        check_topic("node.commands", self.commands)

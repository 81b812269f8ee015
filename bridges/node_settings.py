"""What a planner on a network of ROS 2 listens to, and what it says there."""

from dataclasses import dataclass
from typing import final

from ..framework.plugins.registry import unknown
from ..framework.values.arrays import positive, whole
from ..framework.values.errors import WideberthError
from .dds import LOOPBACK
from .messages import DISTRIBUTIONS
from .readings import OBSTACLES


@final
@dataclass(frozen=True)
class NodeSettings:
    """Topics, rates and limits of a `PlannerNode`.

    Parameters
    ----------
    domain : number of the DDS domain, as ROS_DOMAIN_ID.
    interface : of the network: "lo" keeps everything on this computer, "default" leaves it to
        Cyclone DDS.
    distribution : of ROS 2.
    odometry : topic of `nav_msgs/msg/Odometry`.
    obstacles : topic of the obstacles; "" where there are none.
    obstacle_type : of its messages.
    path : topic of `nav_msgs/msg/Path` that is followed; "" where paths come another way.
    commands : topic of the velocities.
    stamped : send `TwistStamped`, as Nav2 does from Kilted on; otherwise `Twist`.
    base_frame : of the robot.
    rate : Hz, of the commands.
    patience : s, for which odometry and obstacles may be silent; then the robot brakes.
    radius : m, of obstacles whose size is not stated.
    deviation : m per axis, of obstacles whose covariance is not stated.

    Raises
    ------
    WideberthError : a name that is not known, a number that is out of range.
    """

    domain: int = 0
    interface: str = LOOPBACK
    distribution: str = "jazzy"
    odometry: str = "/odom"
    obstacles: str = "/obstacles"
    obstacle_type: str = "nav2_dynamic_msgs/msg/ObstacleArray"
    path: str = "/plan"
    commands: str = "/cmd_vel"
    stamped: bool = True
    base_frame: str = "base_link"
    rate: float = 20.0
    patience: float = 0.5
    radius: float = 0.3
    deviation: float = 0.05

    def __post_init__(self) -> None:
        whole("node.domain", self.domain, least=0)
        for name in ("rate", "patience", "radius", "deviation"):
            positive(f"node.{name}", getattr(self, name))
        if self.rate > 200.0:
            raise WideberthError(f"node.rate is {self.rate:g} Hz; wanted at most 200")
        if self.distribution not in DISTRIBUTIONS:
            raise WideberthError(unknown("distribution", self.distribution, list(DISTRIBUTIONS)))
        if self.obstacle_type not in OBSTACLES:
            raise WideberthError(unknown("obstacle type", self.obstacle_type, sorted(OBSTACLES)))
        for name in ("odometry", "path", "commands", "obstacles"):
            topic = getattr(self, name)
            if not topic.startswith("/") and (topic or name not in ("obstacles", "path")):
                raise WideberthError(f"node.{name} is {topic!r}; wanted a topic, as in '/odom'")

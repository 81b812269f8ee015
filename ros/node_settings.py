"""Topics and rates of a planner on a network of ROS 2."""

from dataclasses import dataclass, field
from typing import final

from ..framework.plugins.registry import unknown
from ..framework.values.arrays import positive, whole
from ..framework.values.errors import WideberthError
from .dds import LOOPBACK
from .messages import DISTRIBUTIONS
from .obstacle_sources import ObstacleTopic, ScanTopic, check_topic
from .path_sources import GoalTopic, PathTopic
from .priority import MOST_URGENT
from .zenoh_link import ROUTER


@final
@dataclass(frozen=True)
class Dds:
    """The wire of Cyclone DDS and Fast DDS.

    Parameters
    ----------
    interface : of the network: "lo" keeps everything on this computer, "default" leaves it to
        Cyclone DDS.
    """

    interface: str = LOOPBACK


@final
@dataclass(frozen=True)
class Zenoh:
    """The wire of rmw_zenoh.

    Parameters
    ----------
    router : where its router is.
    """

    router: str = ROUTER


@final
@dataclass(frozen=True)
class NodeSettings:
    """Topics, rates and limits of a `PlannerNode`.

    Parameters
    ----------
    domain : number of the domain, as ROS_DOMAIN_ID.
    wire : `Dds` or `Zenoh`.
    distribution : of ROS 2.
    odometry : topic of `nav_msgs/msg/Odometry`.
    sees : where obstacles come from: `ObstacleTopic` or `ScanTopic`; None where there are none.
        One of them alone: whom both show would be two obstacles.
    follows : where paths come from: `PathTopic` or `GoalTopic`; None where they come another way.
    commands : topic of the velocities.
    stamped : send `TwistStamped`, as Nav2 does from Kilted on; otherwise `Twist`.
    base_frame : of the robot.
    rate : Hz, of the commands.
    patience : s, for which odometry, obstacles or scans may be silent; then the robot brakes.
    priority : real-time priority of the commands, see
        `wideberth.ros.priority.set_realtime_priority`; 0 for none. That of the planner and its
        calls of the solver is one lower, 1 at least.

    Raises
    ------
    WideberthError : a name that is not known, a number that is out of range.
    """

    domain: int = 0
    wire: Dds | Zenoh = field(default_factory=Dds)
    distribution: str = "jazzy"
    odometry: str = "/odom"
    sees: ObstacleTopic | ScanTopic | None = field(default_factory=ObstacleTopic)
    follows: PathTopic | GoalTopic | None = field(default_factory=PathTopic)
    commands: str = "/cmd_vel"
    stamped: bool = True
    base_frame: str = "base_link"
    rate: float = 20.0
    patience: float = 0.5
    priority: int = 0

    def __post_init__(self) -> None:
        whole("node.domain", self.domain, least=0)
        for name in ("rate", "patience"):
            positive(f"node.{name}", getattr(self, name))
        if self.rate > 200.0:
            raise WideberthError(f"node.rate is {self.rate:g} Hz; wanted at most 200")
        if whole("node.priority", self.priority, least=0) > MOST_URGENT:
            raise WideberthError(f"node.priority is {self.priority}; wanted at most {MOST_URGENT}")
        if self.distribution not in DISTRIBUTIONS:
            raise WideberthError(unknown("distribution", self.distribution, list(DISTRIBUTIONS)))
        check_topic("node.odometry", self.odometry)
        check_topic("node.commands", self.commands)

"""A crowd of one, who is seen late, and a planner that takes the grid of `wideberth forecast`."""

import json
import time

import numpy as np
import rclpy
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.time import Time

from wideberth_ros.interfaces import provide

provide(["nav2_dynamic_msgs"])

from nav2_dynamic_msgs.msg import Obstacle, ObstacleArray  # noqa: E402
from nav_msgs.msg import OccupancyGrid, Odometry  # noqa: E402

SPEED, LATE = 0.5, 0.3
"""m/s along x, from -3 m on; s, after which the person is reported."""
BEFORE, TAKEN = 3.0, 30
"""s, of which the planner joins later; grids that it takes."""


class Crowd(Node):
    """Shows a robot that stands, and the person."""

    def __init__(self) -> None:
        super().__init__("crowd")
        self.begin = self.now()
        self.robot = self.create_publisher(Odometry, "/odom", 10)
        self.people = self.create_publisher(ObstacleArray, "/obstacles", 10)
        self.create_timer(0.05, self.show_robot)
        self.create_timer(0.1, self.show_person)
        self.off: list[float] = []
        self.ages: list[float] = []
        self.joined = np.nan
        self.first = np.nan

    def now(self) -> float:
        return 1e-9 * float(self.get_clock().now().nanoseconds)

    def person(self, instant: float) -> float:
        """Where the person is at an instant, m."""
        return -3.0 + SPEED * (instant - self.begin)

    def show_robot(self) -> None:
        message = Odometry(child_frame_id="base_link")
        message.header.frame_id = "odom"
        message.header.stamp = self.get_clock().now().to_msg()
        message.pose.pose.orientation.w = 1.0
        self.robot.publish(message)

    def show_person(self) -> None:
        instant = self.now() - LATE
        one = Obstacle()
        one.uuid.uuid[0] = 1
        one.position.x, one.position.y = self.person(instant), 1.0
        one.size.x = one.size.y = 0.6
        one.position_covariance = [1e-4, 0.0, 0.0, 0.0, 1e-4, 0.0, 0.0, 0.0, 0.0]
        message = ObstacleArray(obstacles=[one])
        message.header.frame_id = "odom"
        message.header.stamp = Time(nanoseconds=round(1e9 * instant)).to_msg()
        self.people.publish(message)

    def join(self) -> None:
        """Take grids, as a static layer of Nav2 does."""
        kept = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        self.joined = time.monotonic()
        self.create_subscription(OccupancyGrid, "/wideberth/people/grid", self.take, kept)

    def take(self, grid: OccupancyGrid) -> None:
        if np.isnan(self.first):
            self.first = time.monotonic() - self.joined
        stamp = grid.header.stamp.sec + 1e-9 * grid.header.stamp.nanosec
        cells = np.array(grid.data).reshape(grid.info.height, grid.info.width)
        columns = np.nonzero(cells == 100)[1]
        if len(columns):
            middle = grid.info.origin.position.x + (columns.mean() + 0.5) * grid.info.resolution
            self.off.append(float(middle) - self.person(stamp))
        self.ages.append(self.now() - stamp)


rclpy.init()
crowd = Crowd()
end = time.monotonic() + 60.0
while time.monotonic() < end and len(crowd.off) < TAKEN:
    rclpy.spin_once(crowd, timeout_sec=0.05)
    if np.isnan(crowd.joined) and crowd.now() - crowd.begin > BEFORE:
        crowd.join()
print(json.dumps({"off": crowd.off, "ages": crowd.ages, "first": crowd.first}))

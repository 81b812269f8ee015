"""A robot of plain rclpy: takes velocities, moves, and shows itself and the people around it.

It imports nothing of wideberth. ``python rclpy_robot.py TRACE`` writes a row of JSON each 0.05 s
and takes orders on its input, a line each:

    goal X Y YAW          publish a goal
    path X Y X Y ...      publish a path through these points
    action X Y X Y ...    send the path as a goal of FollowPath
    cancel                cancel that goal
    silent, seen          stop showing people or scans, show them again
    lost, found           stop showing odometry, show it again
    stop                  end
"""

import argparse
import json
import math
import queue
import sys
import threading
import time
from typing import Any

import numpy as np
import rclpy
from action_msgs.msg import GoalStatus
from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseStamped, TransformStamped, Twist, TwistStamped
from nav2_dynamic_msgs.msg import Obstacle, ObstacleArray
from nav2_msgs.action import FollowPath
from nav_msgs.msg import Odometry, Path
from rclpy.action import ActionClient
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import LaserScan
from tf2_msgs.msg import TFMessage

STEP = 0.05
"""s, of the simulated time of the robot."""
RADIUS = 0.3
"""m, of the robot and of people."""
SEEN = 2
"""Steps between two sights of people or scans."""
KINDS = {"Twist": Twist, "TwistStamped": TwistStamped}
ENDS = {
    GoalStatus.STATUS_SUCCEEDED: "succeeded",
    GoalStatus.STATUS_CANCELED: "canceled",
    GoalStatus.STATUS_ABORTED: "aborted",
}
KEPT = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
SENSOR = QoSProfile(depth=5, reliability=ReliabilityPolicy.BEST_EFFORT)


class Robot:
    """A unicycle that does at once as the last velocity says."""

    def __init__(self, options: argparse.Namespace) -> None:
        self.options = options
        simulated = options.factor is not None
        self.node = Node("robot", parameter_overrides=[Parameter("use_sim_time", value=simulated)])
        self.time, self.steps = (0.0 if simulated else time.time()), 0
        self.pose = np.array(options.start, float)
        self.velocity = (0.0, 0.0)
        self.commands, self.came, self.gap = 0, math.nan, 0.0
        self.stamp = math.nan
        self.status, self.said, self.feedback = "", 0, math.nan
        self.ends: list[str] = []
        self.shown, self.found, self.goal = True, True, None
        self.out = open(options.trace, "w")  # closed with the process
        self.orders: queue.Queue[str] = queue.Queue()
        self._open(options.command)
        threading.Thread(target=self._read, daemon=True).start()
        self._fix()

    def _open(self, command: str) -> None:
        make, take = self.node.create_publisher, self.node.create_subscription
        self.odometry = make(Odometry, "odom", 10)
        self.tf, self.fixed = make(TFMessage, "/tf", 100), make(TFMessage, "/tf_static", KEPT)
        self.people = make(ObstacleArray, "obstacles", SENSOR)
        self.scans = make(LaserScan, "scan", SENSOR)
        self.clock = make(Clock, "/clock", SENSOR)
        self.goals, self.paths = make(PoseStamped, "goal_pose", 10), make(Path, "plan", 10)
        take(KINDS[command], "cmd_vel", self._command, 10)
        take(DiagnosticArray, "/diagnostics", self._diagnosed, 10)
        self.client = ActionClient(self.node, FollowPath, "follow_path")

    def _read(self) -> None:
        for line in sys.stdin:
            self.orders.put(line.strip())
        self.orders.put("stop")  # who gave orders has ended

    def _command(self, message: Any) -> None:
        now = time.monotonic()
        if self.commands:
            self.gap = max(self.gap, now - self.came)
        self.came, self.commands = now, self.commands + 1
        if isinstance(message, TwistStamped):
            self.stamp = message.header.stamp.sec + 1e-9 * message.header.stamp.nanosec
            message = message.twist
        self.velocity = (message.linear.x, message.angular.z)

    def _diagnosed(self, message: Any) -> None:
        self.status, self.said = message.status[0].message, self.said + 1

    def step(self) -> None:
        """Move on by one step, and show it."""
        while not self.orders.empty():
            self._obey(*self.orders.get().split())
        speed, rate = self.velocity
        middle = self.pose[2] + 0.5 * STEP * rate
        self.pose += STEP * np.array([speed * math.cos(middle), speed * math.sin(middle), rate])
        self.steps += 1
        self.time = self.time + STEP if self.options.factor is not None else time.time()
        if self.options.factor is not None:
            self.clock.publish(Clock(clock=self._stamp()))
        self._show()
        if self.steps % SEEN == 0 and self.shown:
            self._sense()
        self._note()

    def _obey(self, word: str, *rest: str) -> None:
        numbers = [float(one) for one in rest]
        if word == "goal":
            goal = self._posed(*numbers)
            goal.header.frame_id, goal.header.stamp = "map", self._stamp()
            self.goals.publish(goal)
        elif word == "path":
            self.paths.publish(self._path(numbers))
        elif word == "action":
            self._send(self._path(numbers))
        elif word == "cancel":
            self.goal.cancel_goal_async()
        elif word in ("silent", "seen"):
            self.shown = word == "seen"
        elif word in ("lost", "found"):
            self.found = word == "found"
        else:
            raise SystemExit(0)

    def _path(self, numbers: list[float]) -> Any:
        path = Path()
        path.header.frame_id, path.header.stamp = "map", self._stamp()
        path.poses = [self._posed(x, y, 0.0)
                      for x, y in zip(numbers[::2], numbers[1::2], strict=True)]  # fmt: skip
        return path

    def _posed(self, x: float, y: float, yaw: float) -> Any:
        pose = PoseStamped()
        pose.pose.position.x, pose.pose.position.y = x, y
        pose.pose.orientation.z, pose.pose.orientation.w = math.sin(yaw / 2), math.cos(yaw / 2)
        return pose

    def _send(self, path: Any) -> None:
        """Send a goal of FollowPath, and note what becomes of it."""

        def ended(future: Any) -> None:
            found = future.result()
            self.ends.append(f"{ENDS[found.status]} {found.result.error_code}")

        def accepted(future: Any) -> None:
            self.goal = future.result()
            if self.goal.accepted:
                self.goal.get_result_async().add_done_callback(ended)
            else:
                self.ends.append("rejected")

        def fed(message: Any) -> None:
            self.feedback = message.feedback.distance_to_goal

        self.client.send_goal_async(FollowPath.Goal(path=path), fed).add_done_callback(accepted)

    def _fix(self) -> None:
        """Show once what never moves."""
        map_, laser = TransformStamped(child_frame_id="odom"), TransformStamped()
        map_.header.frame_id, laser.header.frame_id = "map", "base_link"
        laser.child_frame_id, laser.transform.translation.x = "laser", 0.2
        self.fixed.publish(TFMessage(transforms=[map_, laser]))

    def _stamp(self) -> Any:
        seconds = math.floor(self.time)
        return Time(sec=seconds, nanosec=int(1e9 * (self.time - seconds)))

    def _show(self) -> None:
        """Publish odometry and tf."""
        x, y, yaw = self.pose.tolist()
        odometry = Odometry(child_frame_id="base_link")
        odometry.header.frame_id, odometry.header.stamp = "odom", self._stamp()
        odometry.pose.pose = self._posed(x, y, yaw).pose
        odometry.twist.twist.linear.x, odometry.twist.twist.angular.z = self.velocity
        moved = TransformStamped(header=odometry.header, child_frame_id="base_link")
        moved.transform.translation.x, moved.transform.translation.y = x, y
        moved.transform.rotation = odometry.pose.pose.orientation
        if self.found:
            self.odometry.publish(odometry)
        self.tf.publish(TFMessage(transforms=[moved]))

    def places(self) -> tuple[np.ndarray, np.ndarray]:
        """Return where people are, (N, 2) m, and their velocities: to and fro across the way."""
        number = np.arange(self.options.people)
        fold = (0.5 * STEP * self.steps + 3.7 * number) % 12.0
        there = fold < 6.0
        y = np.where(there, fold, 12.0 - fold) - 3.0
        x = 1.5 + self.options.spacing * number
        return np.stack([x, y], -1), np.stack([0.0 * x, np.where(there, 0.5, -0.5)], -1)

    def _sense(self) -> None:
        """Publish people or, in the hall, a scan."""
        if self.options.hall:
            import hall
            import rays

            turned = self.pose[2] + np.linspace(-np.pi, np.pi, hall.BEAMS, endpoint=False)
            ahead = np.array([math.cos(self.pose[2]), math.sin(self.pose[2])])
            origin = self.pose[:2] + 0.2 * ahead
            found = rays.ranges(origin, turned, hall.walkers(STEP * self.steps), hall.WIDE,
                                hall.walls())  # fmt: skip
            scan = LaserScan(angle_min=-np.pi, angle_max=np.pi * (1 - 2 / hall.BEAMS),
                             angle_increment=2 * np.pi / hall.BEAMS, range_min=0.05,
                             range_max=hall.LONGEST, ranges=found.tolist())  # fmt: skip
            scan.header.frame_id, scan.header.stamp = "laser", self._stamp()
            self.scans.publish(scan)
            return
        message = ObstacleArray()
        message.header.frame_id, message.header.stamp = "odom", self._stamp()
        for number, (place, velocity) in enumerate(zip(*self.places(), strict=True)):
            one = Obstacle(score=1.0, position_covariance=np.eye(3).ravel() * 1e-3,
                           velocity_covariance=np.eye(3).ravel() * 1e-3)  # fmt: skip
            one.uuid.uuid = [number + 1] + [0] * 15
            one.position.x, one.position.y = place.tolist()
            one.velocity.x, one.velocity.y = velocity.tolist()
            one.size.x = one.size.y = 2 * RADIUS
            message.obstacles.append(one)
        self.people.publish(message)

    def _note(self) -> None:
        people = self.places()[0]
        away = np.linalg.norm(people - self.pose[:2], axis=1) if len(people) else np.array([9.0])
        row = {
            "time": STEP * self.steps, "wall": time.monotonic(),
            "x": self.pose[0], "y": self.pose[1], "yaw": self.pose[2],
            "speed": self.velocity[0], "rate": self.velocity[1],
            "commands": self.commands, "gap": self.gap, "came": self.came, "stamp": self.stamp,
            "clearance": float(away.min()) - 2 * RADIUS, "status": self.status, "said": self.said,
            "ends": self.ends, "feedback": self.feedback,
            "read": self.fixed.get_subscription_count() > 0,
        }  # fmt: skip
        self.out.write(json.dumps(row) + "\n")
        self.out.flush()


def main() -> None:
    """Run until an order or a signal ends it."""
    parser = argparse.ArgumentParser()
    parser.add_argument("trace")
    parser.add_argument("--command", choices=list(KINDS), default="TwistStamped")
    parser.add_argument("--people", type=int, default=0)
    parser.add_argument("--spacing", type=float, default=2.5, help="m, between their ways")
    parser.add_argument("--hall", action="store_true", help="scans of a hall instead of people")
    parser.add_argument("--start", type=float, nargs=3, default=(0.0, 0.0, 0.0))
    parser.add_argument("--factor", type=float, help="simulated time, so many times as fast")
    options = parser.parse_args()
    rclpy.init()
    robot = Robot(options)
    period = STEP / (options.factor or 1.0)
    due = time.monotonic()
    try:
        while True:
            due += period
            robot.step()
            while (left := due - time.monotonic()) > 0.0:
                rclpy.spin_once(robot.node, timeout_sec=left)
    except (KeyboardInterrupt, ExternalShutdownException):
        pass


if __name__ == "__main__":
    main()

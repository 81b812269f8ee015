"""A planner of an experiment, wrapped by plain rclpy: it drives `wideberth world`.

``python rclpy_planner.py CONFIG COLUMN=VALUE ... --episodes N`` prints what the service
`outcome` answers after each episode, and asks for the next one. With ``--stepped`` it answers
every odometry, otherwise one in each of its periods; with ``--plain`` it sends `Twist`.
``--stop-after S`` leaves it silent after so many seconds of an episode; with ``--watch`` another
planner drives.
"""

import argparse
import json
from typing import Any

import numpy as np
import rclpy
from geometry_msgs.msg import Twist, TwistStamped
from nav_msgs.msg import Odometry, Path
from rclpy.qos import DurabilityPolicy, QoSProfile
from std_srvs.srv import Trigger

from wideberth import Controller, Detection, Observation, Pose
from wideberth import Path as Way
from wideberth.experiments.engine.closed_loop import controllers_of
from wideberth.experiments.engine.shipped_configs import read_experiment
from wideberth.framework.controller import DrivesRobot
from wideberth.framework.values.motion import Twist as Motion
from wideberth_ros.from_outside import chosen_task
from wideberth_ros.link import message_class

KEPT = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
PEOPLE = message_class("nav2_dynamic_msgs/msg/ObstacleArray")


class Planner:
    """Decides by the newest people, and sends what it decides."""

    def __init__(self, controller: Controller, options: argparse.Namespace) -> None:
        assert isinstance(controller, DrivesRobot)
        self.controller, self.robot, self.options = controller, controller.robot, options
        self.node = rclpy.create_node("planner")
        self.kind: Any = Twist if options.plain else TwistStamped
        self.begin: int | None = None
        self.decided = self.known = -1
        self.ready = False
        self.odometry: Any = None
        self.people: Any = None
        self.services = {
            name: self.node.create_client(Trigger, f"/world/{name}")
            for name in ("outcome", "reset")
        }
        if not options.watch:
            self.open_topics()

    def open_topics(self) -> None:
        self.out = self.node.create_publisher(self.kind, "/cmd_vel", 10)
        self.node.create_subscription(Path, "/reference", self.take_path, KEPT)
        self.node.create_subscription(Odometry, "/odom", self.take_odometry, 10)
        self.node.create_subscription(PEOPLE, "/obstacles", self.take_people, 10)

    def take_path(self, message: Path) -> None:
        """Begin an episode; its path comes more than once."""
        if nanoseconds(message.header) == self.known:
            return
        self.known = nanoseconds(message.header)
        places = [[one.pose.position.x, one.pose.position.y] for one in message.poses]
        self.controller.reset()
        self.controller.set_path(Way(np.array(places)))
        self.begin, self.decided, self.ready = None, -1, True
        self.odometry = self.people = None

    def take_odometry(self, message: Odometry) -> None:
        self.odometry = message
        self.decide()

    def take_people(self, message: Any) -> None:
        self.people = message
        if self.options.stepped:
            self.decide()

    def decide(self) -> None:
        if not self.ready or self.odometry is None or self.people is None:
            return
        now, seen = nanoseconds(self.odometry.header), nanoseconds(self.people.header)
        due = self.decided < 0 or now >= self.decided + round(0.98e9 * self.controller.period)
        if (self.options.stepped and seen != now) or not due:
            return
        self.begin = now if self.begin is None else self.begin
        time = (now - self.begin) / 1e9
        if time > self.options.stop_after:
            return
        self.decided = now
        command = self.controller.command(self.observation(time, max(1e-9 * (now - seen), 0.0)))
        sent = self.kind()
        twist = sent if self.options.plain else sent.twist
        twist.linear.x, twist.linear.y = map(float, command.linear)
        twist.angular.z = float(command.omega)
        if not self.options.plain:
            sent.header = self.odometry.header
        self.out.publish(sent)

    def observation(self, time: float, age: float) -> Observation:
        where, moves = self.odometry.pose.pose, self.odometry.twist.twist
        yaw = 2.0 * np.arctan2(where.orientation.z, where.orientation.w)
        heading = None if self.robot.pose((0.0,) * len(self.robot.states)).heading is None else yaw
        pose = Pose((where.position.x, where.position.y), heading)
        twist = Motion((moves.linear.x, moves.linear.y), moves.angular.z)
        found = [
            Detection(
                bytes(one.uuid.uuid).rstrip(b"\0").decode(),
                np.array([one.position.x, one.position.y]),
                np.array(one.position_covariance).reshape(3, 3)[:2, :2],
                0.5 * one.size.x,
                age,
            )
            for one in self.people.obstacles
        ]
        return Observation(time, np.array(self.robot.state_at(pose, twist)), tuple(found))

    def call(self, name: str) -> str:
        """Call a service of the world."""
        self.services[name].wait_for_service()
        answer = self.services[name].call_async(Trigger.Request())
        rclpy.spin_until_future_complete(self.node, answer)
        return str(answer.result().message)

    def drive(self) -> str:
        """Drive an episode to its end."""
        while json.loads(said := self.call("outcome"))["state"] != "over":
            end = self.node.get_clock().now().nanoseconds + 10**8
            while self.node.get_clock().now().nanoseconds < end:
                rclpy.spin_once(self.node, timeout_sec=0.05)
        return said


def nanoseconds(header: Any) -> int:
    return int(header.stamp.sec) * 10**9 + int(header.stamp.nanosec)


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("config")
    parser.add_argument("case", nargs="*")
    parser.add_argument("--episodes", type=int, default=1)
    parser.add_argument("--stepped", action="store_true")
    parser.add_argument("--plain", action="store_true")
    parser.add_argument("--watch", action="store_true")
    parser.add_argument("--stop-after", type=float, default=float("inf"))
    options = parser.parse_args()
    experiment, _ = read_experiment(options.config, [])
    task = chosen_task(experiment, options.case)
    known = controllers_of(experiment)
    rclpy.init()
    name = next(value for value in task.settings.values() if value in known)
    planner = Planner(known[name], options)
    for _ in range(options.episodes):
        print(planner.drive(), flush=True)
        planner.ready = False
        planner.call("reset")
    rclpy.shutdown()


if __name__ == "__main__":
    main()

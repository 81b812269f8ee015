"""A robot on Zenoh that shares no code with the node: CDR by hand, keys as ROS 2 has them.

It is the router as well. It follows `/cmd_vel`, brakes when commands stop for 0.5 s, and sends
odometry, people and a path. Run as a program it writes what it heard to a file:
``zenoh_robot.py PORT SECONDS OUT METRES``.
"""

import json
import math
import struct
import sys
import time
from pathlib import Path

ODOMETRY = (
    "nav_msgs::msg::dds_::Odometry_/"
    "RIHS01_3cc97dc7fb7502f8714462c526d369e35b603cfc34d946e3f2eda2766dfec6e0"
)
WAY = (
    "nav_msgs::msg::dds_::Path_/"
    "RIHS01_1957a5bb3cee5da65c4e52e52b65a93df227efce4c20f8458b36e73066ca334b"
)
PEOPLE = (
    "nav2_dynamic_msgs::msg::dds_::ObstacleArray_/"
    "RIHS01_30bef8eb1da85ccb8d8fd860be402b7710dd81b368d1622325aa617436b0cb2a"
)
ORDERS = (
    "geometry_msgs::msg::dds_::TwistStamped_/"
    "RIHS01_5f0fcd4f81d5d06ad9b4c4c63e3ea51b82d6ae4d0558f1d475229b1121db6f64"
)
"""Type and hash, as ROS 2 prints them."""


class Cdr:
    """A message, little-endian; numbers stand at multiples of their size."""

    def __init__(self) -> None:
        self.data = bytearray(b"\0\1\0\0")

    def put(self, code: str, *values: float) -> "Cdr":
        """Write numbers of one type."""
        size = struct.calcsize(code)
        self.data += b"\0" * (-(len(self.data) - 4) % size)
        self.data += struct.pack(f"<{len(values)}{code}", *values)
        return self

    def header(self, frame: bytes = b"odom") -> "Cdr":
        """Write a header of now."""
        now = time.time_ns()
        self.put("i", now // 10**9).put("I", now % 10**9, len(frame) + 1)
        self.data += frame + b"\0"
        return self


class Robot:
    """A unicycle, among people who stand beside its way."""

    def __init__(self, port: int, domain: int = 0) -> None:
        import zenoh

        config = zenoh.Config()
        config.insert_json5("mode", '"router"')
        config.insert_json5("listen/endpoints", f'["tcp/127.0.0.1:{port}"]')
        config.insert_json5("scouting/multicast/enabled", "false")
        self.session = zenoh.open(config)
        self.domain = domain
        declare = self.session.declare_publisher
        self.senders = {
            name: declare(f"{domain}/{name}/{rest}")
            for name, rest in (("odom", ODOMETRY), ("plan", WAY), ("obstacles", PEOPLE))
        }
        channel = zenoh.handlers.FifoChannel(100)
        self.orders = self.session.declare_subscriber(f"{domain}/cmd_vel/{ORDERS}", channel)
        self.pose, self.speed, self.rate = [0.0, 0.0, 0.0], 0.0, 0.0
        self.heard: list[tuple[float, ...]] = []
        self.notes: list[str] = []
        """Attachments of the commands, as digits."""

    def step(self, dt: float) -> None:
        """Listen, drive for dt, and say where it is."""
        while (one := self.orders.try_recv()) is not None:
            data = one.payload.to_bytes()
            (length,) = struct.unpack_from("<I", data, 12)
            place = 4 + (12 + length + 7) // 8 * 8
            told = struct.unpack_from("<6d", data, place)
            self.heard.append((time.time(), told[0], told[5], self.speed, self.rate))
            self.notes.append(one.attachment.to_bytes().hex() if one.attachment else "")
            self.speed, self.rate = told[0], told[5]
        if not self.heard or time.time() - self.heard[-1][0] > 0.5:
            self.speed, self.rate = max(self.speed - 1.0 * dt, 0.0), 0.0
        x, y, yaw = self.pose
        middle = yaw + 0.5 * dt * self.rate
        self.pose = [x + dt * self.speed * math.cos(middle),
                     y + dt * self.speed * math.sin(middle), yaw + dt * self.rate]  # fmt: skip
        said = Cdr().header()
        said.put("I", 10).data += b"base_link\0"
        x, y, yaw = self.pose
        said.put("d", x, y, 0, 0, 0, math.sin(yaw / 2), math.cos(yaw / 2), *[0.0] * 36)
        said.put("d", self.speed, 0, 0, 0, 0, self.rate, *[0.0] * 36)
        self.senders["odom"].put(bytes(said.data))

    def say_people(self) -> None:
        """Say where everybody is."""
        said = Cdr().header().put("I", 20)
        for i in range(20):
            said.data += bytes([i + 1] * 16)
            said.put("f", 1.0).put("d", 2.0 + 1.5 * i, (4.0 if i % 2 else -4.0), 0)
            said.put("d", 0, 0, 0, 0.6, 0.6, 1.7, *[0.0] * 18)
        self.senders["obstacles"].put(bytes(said.data))

    def say_path(self) -> None:
        """Ask for a straight way."""
        said = Cdr().header().put("I", 101)
        for i in range(101):
            said.header().put("d", 0.5 * i, 0, 0, 0, 0, 0, 1)
        self.senders["plan"].put(bytes(said.data))

    def graph(self) -> list[str]:
        """Return the tokens of all nodes, publishers and subscribers."""
        found = self.session.liveliness().get(f"@ros2_lv/{self.domain}/**")
        return [str(one.ok.key_expr) for one in found if one.ok]


def drive(port: int, seconds: float, out: Path, way: float) -> None:
    """Drive for some time or way, at 50 Hz; people at 10 Hz, the path once a second."""
    robot = Robot(port)
    begin, count = time.monotonic(), 0
    while time.monotonic() - begin < seconds and math.hypot(*robot.pose[:2]) < way:
        robot.step(0.02)
        if count % 5 == 0:
            robot.say_people()
        if count % 50 == 0:
            robot.say_path()
        count += 1
        time.sleep(max(begin + 0.02 * count - time.monotonic(), 0.0))
    found = {"heard": robot.heard, "pose": robot.pose, "notes": robot.notes,
             "graph": robot.graph()}  # fmt: skip
    out.write_text(json.dumps(found))
    robot.session.close()


if __name__ == "__main__":
    drive(int(sys.argv[1]), float(sys.argv[2]), Path(sys.argv[3]), float(sys.argv[4]))

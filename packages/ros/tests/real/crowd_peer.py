"""``python crowd_peer.py N``: N participants of a domain, which only stand about."""

import signal
import sys

from rclpy.context import Context
from rclpy.node import Node

contexts, nodes = [], []
for number in range(int(sys.argv[1])):
    contexts.append(Context())
    contexts[-1].init(args=[])
    nodes.append(Node(f"stander_{number}", context=contexts[-1]))
print("ready")
signal.pause()

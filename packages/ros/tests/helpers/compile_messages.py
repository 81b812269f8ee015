"""Compile all messages that an installation of ROS 2 may lack; `make ros` runs it."""

from wideberth_ros.definitions import ACTIONS, DEFINITIONS
from wideberth_ros.interfaces import provide

provide(sorted({name.partition("/")[0] for name in DEFINITIONS | ACTIONS}))

"""Prints which of the drawn messages ROS 2 itself writes or reads in another way than we do.

Bytes between the fields are not compared: ROS 2 leaves there whatever was in memory.

``python bytes_peer.py DISTRIBUTION``
"""

import sys
from typing import Any

from rclpy.serialization import deserialize_message, serialize_message

from wideberth.packages.ros.tests.helpers.message_samples import TEN, samples
from wideberth_ros.link import RosMessages, message_class
from wideberth_ros.messages import messages


def own(message: Any) -> Any:
    """Return a message as ROS 2's own class."""
    if isinstance(message, list):
        return [own(one) for one in message]
    if not hasattr(message, "__msgtype__"):
        return message
    name = message.__msgtype__
    fields = {key: own(getattr(message, key)) for key, _ in messages().fields(name)}
    return RosMessages().make(name, **fields)


def pads(message: Any) -> bool:
    """Whether a message holds an empty sequence of float64.

    ROS 2 pads behind its length for a number that does not come, and wants that padding; rosbags
    and Cyclone DDS do not. Of what we send nothing holds such a sequence.
    """
    if isinstance(message, list):
        return any(map(pads, message))
    if not hasattr(message, "__msgtype__"):
        return getattr(message, "dtype", None) == "float64" and not len(message)
    return any(pads(getattr(message, key)) for key, _ in messages().fields(message.__msgtype__))


def main() -> None:
    known = messages(sys.argv[1])
    other = []
    for name in TEN:
        for message in samples(name):
            if pads(message):
                continue
            ours, theirs = known.to_bytes(message), serialize_message(own(message))
            read = known.to_bytes(known.read(name, theirs)) == ours
            understood = deserialize_message(ours, message_class(name)) == own(message)
            if len(ours) != len(theirs) or not read or not understood:
                other.append(name)
    print(f"{len(TEN)} types, others: {other}")


if __name__ == "__main__":
    main()

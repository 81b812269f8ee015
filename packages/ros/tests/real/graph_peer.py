"""Look at a node as the command line of ROS 2 does; prints what was found, as JSON."""

import json
import time
from typing import Any

import rclpy
from lifecycle_msgs.srv import GetAvailableTransitions, GetState
from rcl_interfaces.srv import DescribeParameters, GetParameters, ListParameters, SetParameters
from rclpy.action.graph import get_action_names_and_types
from rclpy.node import Node
from rclpy.parameter import Parameter

NAME, HERE = "/wideberth", ("wideberth", "/")


def ask(node: Node, kind: Any, name: str, **fields: Any) -> Any:
    """Call a service of the node."""
    client = node.create_client(kind, f"{NAME}/{name}")
    assert client.wait_for_service(timeout_sec=10.0), name
    future = client.call_async(kind.Request(**fields))
    rclpy.spin_until_future_complete(node, future, timeout_sec=10.0)
    return future.result()


def patience(node: Node) -> float:
    (value,) = ask(node, GetParameters, "get_parameters", names=["patience"]).values
    return float(value.double_value)


def change(node: Node, name: str, value: Any) -> list[Any]:
    one = Parameter(name, value=value).to_parameter_msg()
    result = ask(node, SetParameters, "set_parameters", parameters=[one]).results[0]
    return [result.successful, result.reason]


def main() -> None:
    """Look."""
    rclpy.init()
    node = Node("looker")
    while HERE not in node.get_node_names_and_namespaces():
        time.sleep(0.05)
    time.sleep(0.5)
    found: dict[str, Any] = {"patience": [patience(node)]}
    found["changed"] = change(node, "patience", 0.75)
    found["patience"].append(patience(node))
    found["back"], found["refused"] = change(node, "patience", 0.5), change(node, "patience", -1.0)
    found["fixed"] = change(node, "rate", 10.0)
    found["names"] = list(ask(node, ListParameters, "list_parameters").result.names)
    described = ask(node, DescribeParameters, "describe_parameters", names=["patience", "rate"])
    found["described"] = [one.description for one in described.descriptors]
    while (state := ask(node, GetState, "get_state").current_state.label) != "active":
        time.sleep(0.1)
    found["state"] = state
    ways = ask(node, GetAvailableTransitions, "get_available_transitions").available_transitions
    found["ways"] = [one.transition.label for one in ways]
    found["actions"] = dict(get_action_names_and_types(node))
    while "/cmd_vel" not in (gives := dict(node.get_publisher_names_and_types_by_node(*HERE))):
        time.sleep(0.1)  # the robot is not found yet
    found["publishes"] = gives
    found["listens"] = dict(node.get_subscriber_names_and_types_by_node(*HERE))
    print(json.dumps(found))


if __name__ == "__main__":
    main()

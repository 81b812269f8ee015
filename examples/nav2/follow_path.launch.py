"""Nav2 with our planner in the place of its controller server.

ros2 launch examples/nav2/follow_path.launch.py map:=map.yaml config:=examples/node.yaml

It was written from Nav2's documentation and not run: no ROS was at hand.
"""

from pathlib import Path

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, ExecuteProcess
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

HERE = Path(__file__).resolve().parent
SERVERS = {
    "map_server": "nav2_map_server",
    "planner_server": "nav2_planner",
    "behavior_server": "nav2_behaviors",
    "bt_navigator": "nav2_bt_navigator",
}
"""Nodes of Nav2 that stay -> their packages; controller_server and velocity_smoother do not."""


def generate_launch_description() -> LaunchDescription:
    """Start Nav2 without its controller server, and our node that serves FollowPath."""
    params = str(HERE / "nav2_params.yaml")
    servers = [
        Node(
            package=package,
            executable=name,
            name=name,
            parameters=[params, {"yaml_filename": LaunchConfiguration("map")}],
            output="screen",
        )
        for name, package in SERVERS.items()
    ]
    manager = Node(
        package="nav2_lifecycle_manager",
        executable="lifecycle_manager",
        name="lifecycle_manager_navigation",
        parameters=[{"autostart": True, "node_names": list(SERVERS)}],
        output="screen",
    )
    planner = ExecuteProcess(
        cmd=["wideberth", "node", LaunchConfiguration("config")],
        output="screen",
    )
    arguments = [
        DeclareLaunchArgument("map"),
        DeclareLaunchArgument("config", default_value=str(HERE.parent / "node.yaml")),
    ]
    return LaunchDescription([*arguments, *servers, manager, planner])

"""Start our planner as a node.

ros2 launch node.launch.py config:=node.yaml use_sim_time:=true
"""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, ExecuteProcess
from launch.substitutions import LaunchConfiguration


def generate_launch_description() -> LaunchDescription:
    """Start ``wideberth node`` with a config; it becomes active by itself."""
    simulated = ["use_sim_time:=", LaunchConfiguration("use_sim_time")]
    command = ["wideberth", "node", LaunchConfiguration("config"), "--ros-args", "-p", simulated]
    return LaunchDescription(
        [
            DeclareLaunchArgument("config", description="file with `planner` and `node`"),
            DeclareLaunchArgument("use_sim_time", default_value="false"),
            ExecuteProcess(cmd=command, output="screen"),
        ]
    )

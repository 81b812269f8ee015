"""Nav2 as it ships, among the people of an experiment: `wideberth world` is its robot.

ros2 launch examples/nav2/world.launch.py config:=doorway

Nav2's obstacle layers see people and walls by /scan, its static layer takes /map, and its
navigator the goal that the world sends. It was written from Nav2's documentation and not run: no
Nav2 was at hand. Give Nav2's parameters the robot's radius (`robot_radius`) and limits.
"""

from pathlib import Path

from ament_index_python.packages import get_package_share_directory
from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, ExecuteProcess, IncludeLaunchDescription
from launch.launch_description_sources import PythonLaunchDescriptionSource
from launch.substitutions import LaunchConfiguration


def generate_launch_description() -> LaunchDescription:
    """Start the world, and Nav2 without map server and localisation, which the world has."""
    share = Path(get_package_share_directory("nav2_bringup"))
    world = ExecuteProcess(
        cmd=["wideberth", "world", LaunchConfiguration("config"), "--lidar", "--no-people"],
        output="screen",
    )
    nav2 = IncludeLaunchDescription(
        PythonLaunchDescriptionSource(str(share / "launch" / "navigation_launch.py")),
        launch_arguments={
            "use_sim_time": "true",
            "params_file": LaunchConfiguration("params_file"),
        }.items(),
    )
    arguments = [
        DeclareLaunchArgument("config", default_value="doorway"),
        DeclareLaunchArgument(
            "params_file", default_value=str(share / "params" / "nav2_params.yaml")
        ),
    ]
    return LaunchDescription([*arguments, world, nav2])

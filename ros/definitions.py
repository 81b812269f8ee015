"""Messages that ROS 2 itself does not have, as the text of their definitions."""

DEFINITIONS: dict[str, str] = {
    "nav2_dynamic_msgs/msg/Obstacle": """
unique_identifier_msgs/UUID uuid
float32 score
geometry_msgs/Point position
geometry_msgs/Vector3 velocity
geometry_msgs/Vector3 size
float64[9] position_covariance
float64[9] velocity_covariance
""",
    "nav2_dynamic_msgs/msg/ObstacleArray": """
std_msgs/Header header
nav2_dynamic_msgs/Obstacle[] obstacles
""",
    "costmap_converter_msgs/msg/ObstacleMsg": """
std_msgs/Header header
geometry_msgs/Polygon polygon
float64 radius
int64 id
geometry_msgs/Quaternion orientation
geometry_msgs/TwistWithCovariance velocities
""",
    "costmap_converter_msgs/msg/ObstacleArrayMsg": """
std_msgs/Header header
costmap_converter_msgs/ObstacleMsg[] obstacles
""",
    "mpc_planner_msgs/msg/Gaussian": """
nav_msgs/Path mean
float64[] major_semiaxis
float64[] minor_semiaxis
""",
    "mpc_planner_msgs/msg/ObstacleGMM": """
int32 id
geometry_msgs/Pose pose
mpc_planner_msgs/Gaussian[] gaussians
float64[] probabilities
""",
    "mpc_planner_msgs/msg/ObstacleArray": """
std_msgs/Header header
mpc_planner_msgs/ObstacleGMM[] obstacles
""",
    "vision_msgs/msg/ObjectHypothesis": """
string class_id
float64 score
""",
    "vision_msgs/msg/ObjectHypothesisWithPose": """
vision_msgs/ObjectHypothesis hypothesis
geometry_msgs/PoseWithCovariance pose
""",
    "vision_msgs/msg/BoundingBox3D": """
geometry_msgs/Pose center
geometry_msgs/Vector3 size
""",
    "vision_msgs/msg/Detection3D": """
std_msgs/Header header
vision_msgs/ObjectHypothesisWithPose[] results
vision_msgs/BoundingBox3D bbox
string id
""",
    "vision_msgs/msg/Detection3DArray": """
std_msgs/Header header
vision_msgs/Detection3D[] detections
""",
}
"""Name of a message -> its definition, as in a .msg file."""

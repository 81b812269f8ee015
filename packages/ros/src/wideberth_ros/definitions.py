"""Messages that an installation of ROS 2 may lack, as the text of their definitions."""

DEFINITIONS: dict[str, str] = {
    "tf2_msgs/msg/TFMessage": """
geometry_msgs/TransformStamped[] transforms
""",
    "nav2_msgs/msg/SpeedLimit": """
std_msgs/Header header
bool percentage
float64 speed_limit
""",
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

ACTIONS: dict[str, str] = {
    "nav2_msgs/action/FollowPath": """
nav_msgs/Path path
string controller_id
string goal_checker_id
string progress_checker_id
---
uint16 NONE=0
uint16 UNKNOWN=100
uint16 INVALID_CONTROLLER=101
uint16 TF_ERROR=102
uint16 INVALID_PATH=103
uint16 PATIENCE_EXCEEDED=104
uint16 FAILED_TO_MAKE_PROGRESS=105
uint16 NO_VALID_CONTROL=106
uint16 CONTROLLER_TIMED_OUT=107
std_msgs/Empty result
uint16 error_code
string error_msg
---
float32 distance_to_goal
float32 speed
""",
    "nav2_msgs/action/NavigateToPose": """
geometry_msgs/PoseStamped pose
string behavior_tree
---
uint16 NONE=0
uint16 UNKNOWN=9000
uint16 FAILED_TO_LOAD_BEHAVIOR_TREE=9001
uint16 TF_ERROR=9002
uint16 TIMEOUT=9003
uint16 error_code
string error_msg
---
geometry_msgs/PoseStamped current_pose
builtin_interfaces/Duration navigation_time
builtin_interfaces/Duration estimated_time_remaining
int16 number_of_recoveries
float32 distance_remaining
""",
}
"""Name of an action -> its definition, as in an .action file of Jazzy and Kilted.

Their hashes are equal. Jazzy's NavigateToPose names no error but NONE.
"""

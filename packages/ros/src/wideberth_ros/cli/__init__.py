"""The commands for ROS 2, and what they read."""
